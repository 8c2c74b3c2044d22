"""Travels stay inside the part where a way inside is short enough; drawing back, wiping, priming, coasting."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toolpath_samples import PLA, layer, line, process

from cabslice.slicing.layer import Polygons, Role
from cabslice.slicing.region import contains, difference, from_rings, offset, to_rings
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.combing import comb
from cabslice.toolpath.order import lay_toolpath

BEAD = 0.45


def region(*rings):
    return from_rings(np.vstack(rings), np.cumsum([0, *map(len, rings)]))


def rectangle(x0, y0, x1, y1):
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], float)


def rings_of(whole):
    return to_rings(whole), to_rings(offset(whole, -0.4 * BEAD)), to_rings(offset(whole, -0.75 * BEAD))


def densely(points):
    return np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a)
                           for a, b in pairwise(points)])


def way_between(whole, a, b, detour=3.0):
    points, starts = comb(*rings_of(whole), np.array([a]), np.array([b]), 1.5 * BEAD, detour)
    assert starts.tolist() == [0, len(points)]
    return np.vstack((a, points, b)) if len(points) else None


U_SHAPE = np.array([(0, 0), (30, 0), (30, 20), (20, 20), (20, 10), (10, 10), (10, 20), (0, 20)], float)


def test_a_travel_is_led_round_the_corner_of_a_u_and_no_further_than_needed():
    way = way_between(region(U_SHAPE), np.array([9.0, 15.0]), np.array([21.0, 15.0]))
    assert contains(*to_rings(region(U_SHAPE)), densely(way)).all()
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    shortest = 2 * np.hypot(1, 5) + 10                 # round the two inner corners
    assert shortest <= length < shortest + 4 * BEAD
    assert len(way) <= 4 + 2                           # pulled taut


def test_a_detour_has_a_bound():
    a, b = np.array([9.0, 19.0]), np.array([21.0, 19.0])
    assert way_between(region(U_SHAPE), a, b, detour=1.5) is None
    assert way_between(region(U_SHAPE), a, b, detour=4.0) is not None


def test_ends_in_another_region_have_no_way():
    two = region(rectangle(0, 0, 10, 10), rectangle(20, 0, 30, 10))
    assert way_between(two, np.array([5.0, 5.0]), np.array([25.0, 5.0]), 100) is None


coordinate = st.floats(-20, 20)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(coordinate, coordinate, st.floats(1, 8)), min_size=1, max_size=6), st.integers(0, 99))
def test_ways_in_any_region_stay_inside_and_within_their_bound(holes, seed):
    """A plate with holes that may overlap and reach its edge; ends where beads may end."""
    outer = region(rectangle(-22, -22, 22, 22))
    whole = difference(outer, *(region(rectangle(x - r, y - r, x + r, y + r)) for x, y, r in holes))
    inner = to_rings(offset(whole, -0.5 * BEAD))
    if not len(inner[0]):
        return
    rng = np.random.default_rng(seed)
    spots = np.vstack((inner[0], rng.uniform(-22, 22, (40, 2))))
    spots = spots[contains(*to_rings(offset(whole, -0.45 * BEAD)), spots)]
    if len(spots) < 2:
        return
    here, there = (spots[rng.integers(0, len(spots), 30)] for _ in range(2))
    points, starts = comb(*rings_of(whole), here, there, 1.5 * BEAD, 3.0)
    grown = to_rings(offset(whole, 1e-6))
    for t in np.flatnonzero(np.diff(starts)):
        way = np.vstack((here[t], points[starts[t]:starts[t + 1]], there[t]))
        assert contains(*grown, densely(way)).all()
        assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() <= 3.0 * np.linalg.norm(there[t] - here[t]) + 1e-9


def outlined(lines, shape, index):
    one = layer(lines, index)
    return one if shape is None else replace(one, outline=Polygons(shape, np.array([0, len(shape)])))


def lay(lines, shape=None, above=None, below=None, **retraction):
    """The layer between two others, as large as itself where not said otherwise."""
    shapes = [shape if below is None else below, shape, shape if above is None else above]
    layers = [outlined(some, one, index) for index, (some, one) in enumerate(zip([[], lines, []], shapes, strict=True))]
    path = lay_toolpath(layers, process(retraction), PLA, filament_diameter_mm=1.75)
    assert find_faults(path) == ()
    return path


def in_the_u():
    return [line([(2, 2), (2, 18), (9, 18)]), line([(21, 18), (28, 18), (28, 2)])]


@pytest.mark.parametrize(("longest", "drawn_back"), [(100.0, 0), (5.0, 1)])
def test_travels_inside_are_made_without_drawing_back_up_to_a_length(longest, drawn_back):
    path = lay(in_the_u(), U_SHAPE, inside_travel_mm=longest)
    assert (path.filament < 0).sum() == drawn_back
    travel = path.role == Role.TRAVEL
    travel[0] = False
    places = np.vstack((path.xyz[np.flatnonzero(travel)[0] - 1], path.xyz[travel]))[:, :2]
    assert contains(U_SHAPE, np.array([0, 8]), densely(places)).all()


def test_without_detours_a_travel_goes_straight_and_draws_back():
    path = lay(in_the_u(), U_SHAPE, max_detour=1.0, inside_travel_mm=100.0)
    assert (path.filament < 0).sum() == 1
    assert path.lengths[path.role == Role.TRAVEL].sum() == pytest.approx(12 + 2 * 0.3)


def test_over_a_top_skin_filament_is_drawn_back():
    lines = [line([(2, 2), (9, 2)], Role.TOP_SKIN), line([(18, 4), (12, 4)], Role.TOP_SKIN)]
    assert (lay(lines, rectangle(0, 0, 30, 20)).filament < 0).sum() == 1
    lines = [line(points, Role.SOLID_INFILL) for points, *_ in lines]
    assert (lay(lines, rectangle(0, 0, 30, 20)).filament < 0).sum() == 0


@pytest.mark.parametrize("side", ["above", "below"])
def test_where_the_layer_above_or_below_does_not_hide_it_a_travel_draws_back(side):
    """As PrusaSlicer: inside the part is what is under and over other layers, but for the beads at the ends."""
    lines, whole = [line([(2, 2), (9, 2)]), line([(18, 2), (12, 2)])], rectangle(0, 0, 30, 20)
    for shape, drawn_back in ((whole, 0), (rectangle(0, 0, 10, 20), 1), (rectangle(0, 5, 30, 20), 1),
                              (rectangle(9.2, 0, 30, 20), 0), (rectangle(9.3, 0, 30, 20), 1)):
        assert (lay(lines, whole, **{side: shape}).filament < 0).sum() == drawn_back


def test_on_the_bed_and_in_the_topmost_layer_travels_draw_back():
    lines, whole = [line([(2, 2), (9, 2)]), line([(18, 2), (12, 2)])], rectangle(0, 0, 30, 20)
    layers = [outlined(lines, whole, index) for index in range(4)]
    path = lay_toolpath(layers, process(), PLA, filament_diameter_mm=1.75)
    assert set(path.layer[path.filament < 0]) == {0, 3}


APART = [line([(0, 0), (5, 0), (10, 0.5)]), line([(40, 0), (30, 0)], island=1)]


def test_a_wipe_goes_back_along_the_bead_and_draws_back_all_of_it():
    path = lay(APART, wipe_mm=7.0, hop_mm=0.0)
    back = path.filament < 0
    assert (path.lengths[back] > 0).all()
    assert path.lengths[back].sum() == pytest.approx(7.0)
    assert path.filament[back].sum() == pytest.approx(-1.2)
    rows = np.flatnonzero(back)
    np.testing.assert_allclose(path.xyz[rows[0], :2], path.xyz[rows[0] - 2, :2])      # the vertex before the end
    speed = np.abs(path.filament[back]) / path.lengths[back] * path.speed[back]
    assert (speed <= 33 + 1e-9).all()
    short = lay([line([(0, 0), (0.1, 0)]), APART[1]], wipe_mm=7.0)
    assert (short.lengths[short.filament < 0] == 0).all()


def test_more_can_be_primed_than_was_drawn_back():
    path = lay(APART, prime_extra_mm=0.25)
    travel = path.role == Role.TRAVEL
    assert path.filament[travel & (path.filament > 0)].tolist() == pytest.approx([1.45])
    assert path.filament[travel].sum() == pytest.approx(0.25)


def test_coasting_leaves_out_the_filament_of_the_last_stretch_only():
    plain, coasting = lay(APART), lay(APART, coast_mm=3.0)
    used = [path.filament[path.role != Role.TRAVEL].sum() for path in (plain, coasting)]
    lengths = [path.lengths[path.role != Role.TRAVEL].sum() for path in (plain, coasting)]
    assert lengths[0] - lengths[1] == pytest.approx(3.0)               # only before the one travel that draws back
    assert used[1] / used[0] == pytest.approx(lengths[1] / lengths[0])
    assert coasting.lengths.sum() == pytest.approx(plain.lengths.sum())
    dry = np.flatnonzero((coasting.role == Role.TRAVEL) & (coasting.speed == coasting.speed[1]))
    assert coasting.lengths[dry].sum() == pytest.approx(3.0)
