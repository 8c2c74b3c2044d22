"""Every bead is laid once, nothing else is; the path is one line; travels are short."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toolpath_samples import PLA, SPEEDS, block, circle, laid_lengths, layer, line, process, ring

from cabslice.errors import ModelError
from cabslice.slicing.flow import bead_area
from cabslice.slicing.layer import Role
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.lines import TINY
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.path import EventKind
from cabslice.toolpath.tour import shortest_tour

coordinate = st.integers(-2000, 2000).map(lambda n: n / 100)
point = st.tuples(coordinate, coordinate)


def lay(layers, used=None, **keys):
    return lay_toolpath(layers, used or process(**keys), PLA, filament_diameter_mm=1.75)


def role_lengths(path):
    return np.bincount(path.role, path.lengths, len(Role))


def segments(path):
    """The laid segments as a sorted array of rounded (layer, role, x0, y0, x1, y1), smaller end first."""
    rows = np.flatnonzero(path.role != Role.TRAVEL)
    a, b = np.round(path.xyz[rows - 1, :2], 6), np.round(path.xyz[rows, :2], 6)
    turned = (a[:, 0] > b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] > b[:, 1]))
    a[turned], b[turned] = b[turned], a[turned].copy()
    table = np.column_stack((path.layer[rows], path.role[rows], a, b))
    return table[np.lexsort(table.T)]


@st.composite
def bead_lines(draw):
    """A few lines of any role; the points of one line lie apart and are not in a row, so that none may be left out."""
    role = draw(st.sampled_from([r for r in Role if r != Role.TRAVEL]))
    points = draw(st.lists(point, min_size=2, max_size=6, unique=True))
    closed = draw(st.booleans()) and len(points) > 2
    width = draw(st.sampled_from([0.3, 0.45, 0.8]))
    return line(points, role, closed=closed, island=draw(st.integers(0, 2)), width=width)


layer_lists = st.lists(st.lists(bead_lines(), min_size=1, max_size=7), min_size=1, max_size=3)


@settings(max_examples=60, deadline=None)
@given(layer_lists, st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 2.0, 50.0]))
def test_any_beads_are_laid_once_and_the_path_keeps_its_rules(lists, hop, min_travel):
    layers = [layer(lines, index) for index, lines in enumerate(lists)]
    path = lay(layers, retraction={"hop_mm": hop, "min_travel_mm": min_travel}, resolution_mm=1e-6)
    assert find_faults(path) == ()
    count = sum(len(one.beads.points) for one in layers)
    np.testing.assert_allclose(role_lengths(path)[1:], laid_lengths(layers)[1:], rtol=1e-6, atol=count * 2 * TINY)
    volume = sum(
        bead_area(width[:1], one.height_mm)[0] * laid_lengths([layer([bead], one.index)]).sum()
        for one, lines in zip(layers, lists, strict=True) for bead in lines for width in [bead[4]]
    )
    laid = path.role != Role.TRAVEL
    assert path.filament[laid].sum() * path.filament_area_mm2 == pytest.approx(volume, rel=1e-6, abs=count * TINY)
    assert path.filament[~laid].sum() == pytest.approx(0, abs=1e-9)
    assert (path.filament[~laid & (path.lengths > 0)] == 0).all()
    np.testing.assert_allclose(path.xyz[laid, 2], 0.2 * (path.layer[laid] + 1))


@settings(max_examples=25, deadline=None)
@given(layer_lists, st.randoms(use_true_random=False))
def test_the_order_of_the_beads_in_a_layer_does_not_change_what_is_laid(lists, random):
    shuffled = [random.sample(lines, len(lines)) for lines in lists]
    first, second = (lay([layer(lines, i) for i, lines in enumerate(some)]) for some in (lists, shuffled))
    np.testing.assert_allclose(role_lengths(first)[1:], role_lengths(second)[1:], rtol=1e-9, atol=0.05)


def test_each_bead_of_a_block_is_laid_exactly_once():
    layers = block()
    laid = segments(lay(layers, retraction={"hop_mm": 0.0}))
    first = laid[(laid[:, 0] == 0) & (laid[:, 1] == Role.SOLID_INFILL)]
    asked = sorted(
        tuple(np.round(points.ravel(), 6)) for one in layers[:1]
        for points in np.split(one.beads.points, one.beads.starts[1:-1]) if len(points) == 2
    )
    assert sorted(map(tuple, first[:, 2:])) == asked


def test_the_same_layers_give_the_same_path():
    once, again = lay(block(shuffle=3)), lay(block(shuffle=3))
    for name in ("xyz", "filament", "width", "height", "speed", "role", "layer", "starts"):
        assert getattr(once, name).tobytes() == getattr(again, name).tobytes()


def test_a_solid_block_is_laid_with_little_travel():
    path = lay(block())
    length = role_lengths(path)
    assert length[Role.TRAVEL] < 0.06 * length[1:].sum()      # one bead spacing per line, and the way to the walls
    assert (path.filament < 0).sum() <= 2 * 4                 # to the walls and to the infill of each layer


def test_walls_come_before_infill_inner_before_outer_skirt_first():
    path = lay(block(1))
    laid = path.role[path.role != Role.TRAVEL]
    order = laid[np.append(True, np.diff(laid) != 0)].tolist()
    assert order == [Role.SKIRT, Role.INNER_WALL, Role.OUTER_WALL, Role.SOLID_INFILL]


def test_a_closed_line_ends_where_it_began():
    path = lay([layer([circle(3, 4, 7)])])
    rows = np.flatnonzero(path.role == Role.OUTER_WALL)
    assert (path.xyz[rows[-1]] == path.xyz[rows[0] - 1]).all()


def seam_points(path):
    """(layers, 2): where the outer wall of each layer begins."""
    wall = path.role == Role.OUTER_WALL
    return path.xyz[np.flatnonzero(wall[1:] & ~wall[:-1]), :2]


def test_seams_of_a_turning_tower_lie_above_each_other():
    """Rings whose points turn from layer to layer: the seam stays, although no point does."""
    layers = [layer([circle(0, 0, 10, phase=0.37 * k)], k) for k in range(12)]
    seams = seam_points(lay(layers))
    assert len(seams) == 12
    assert np.linalg.norm(np.diff(seams, axis=0), axis=1).max() < 0.06


def test_a_seam_hides_in_the_concave_corner():
    shape = [(-10, -10), (10, -10), (10, 10), (0, 10), (0, 0), (-10, 0)]
    layers = [layer([line(np.roll(shape, k, axis=0), Role.OUTER_WALL, closed=True)], k) for k in range(6)]
    np.testing.assert_allclose(seam_points(lay(layers)), np.zeros((6, 2)), atol=1e-12)


def test_a_wall_of_varying_width_keeps_its_widths_and_volume_both_ways():
    points, widths = [(0, 0), (5, 0), (10, 0), (10, 8)], [9.0, 0.3, 0.5, 0.7]    # the first width belongs to no segment
    volume = sum(bead_area(np.array(w), 0.2) * long for w, long in [(0.3, 5), (0.5, 5), (0.7, 8)])
    for order in (1, -1):   # the nozzle comes from (0, 0): the second is laid backwards
        used = line(points[::order], Role.GAP_FILL, width=widths if order == 1 else [9.0, 0.7, 0.5, 0.3])
        path = lay([layer([used])])
        laid = path.role == Role.GAP_FILL
        assert path.filament[laid].sum() * path.filament_area_mm2 == pytest.approx(volume)
        np.testing.assert_allclose(path.width[laid], widths[1:])


def test_a_ring_of_varying_width_keeps_its_volume_wherever_it_begins():
    square, widths = np.array([(0, 0), (8, 0), (8, 5), (0, 5)]), np.array([0.3, 0.4, 0.5, 0.6])
    volume = (bead_area(widths, 0.2) * [5, 8, 5, 8]).sum()   # the segment into point 0 comes from point 3
    for turn in range(4):
        ring_ = line(np.roll(square, turn, 0), Role.OUTER_WALL, closed=True, width=np.roll(widths, turn))
        path = lay([layer([ring_]), layer([line([(4, 0.3), (4.5, 0.4)])], 1)])
        laid = path.role == Role.OUTER_WALL
        assert path.filament[laid].sum() * path.filament_area_mm2 == pytest.approx(volume)


def test_points_in_a_row_go_but_never_where_the_width_changes():
    straight = [(x, 1e-3 * (x % 2)) for x in range(11)]
    path = lay([layer([line(straight)])], resolution_mm=0.005)
    assert (path.role != Role.TRAVEL).sum() == 1
    stepped = [0.4] * 6 + [0.5] * 5
    path = lay([layer([line(straight, width=stepped)])], resolution_mm=0.005)
    np.testing.assert_allclose(path.width[path.role != Role.TRAVEL], [0.4, 0.5])


@settings(max_examples=60, deadline=None)
@given(st.lists(point, min_size=2, max_size=40, unique=True), st.sampled_from([0.005, 0.5, 3.0]))
def test_no_point_left_out_lies_further_from_the_path_than_the_resolution(points, tolerance):
    from cabslice.toolpath.lines import draw

    xy = np.array(points)
    zero = np.zeros(1, np.int64)
    kept, _, starts = draw(
        xy, np.full(len(xy), 0.4), np.array([0, len(xy)]), np.zeros(1, np.bool_), zero, zero, np.zeros(1),
        np.zeros(1, np.bool_), tolerance,
    )
    kept = kept[: starts[1]]
    assert (kept[[0, -1]] == xy[[0, -1]]).all()
    begin, step = kept[:-1], np.diff(kept, axis=0)
    share = np.clip(((xy[:, None] - begin) * step).sum(2) / (step**2).sum(1), 0, 1)
    away = np.linalg.norm(begin + share[..., None] * step - xy[:, None], axis=2).min(1)
    assert away.max() <= tolerance + 1e-9


def test_lines_that_meet_are_laid_without_stop():
    points = np.array([(0, 0), (6, 0), (6, 4), (1, 4), (1, 9)])
    path = lay([layer([line(points[k:k + 2]) for k in (2, 0, 3, 1)])])
    assert (path.role[1:] == Role.SOLID_INFILL).all()
    assert len(path.starts) == 2


def test_short_travels_go_on_long_ones_and_other_islands_draw_back():
    near = [line([(0, 0), (10, 0)]), line([(10, 1.5), (0, 1.5)])]
    assert (lay([layer(near)]).filament >= 0).all()
    assert (lay([layer(near)], retraction={"min_travel_mm": 1.0}).filament < 0).sum() == 1
    apart = [line([(0, 0), (10, 0)]), line([(10, 1.5), (0, 1.5)], island=1)]
    path = lay([layer(apart)])
    row = int(np.flatnonzero(path.filament < 0)[0])
    np.testing.assert_allclose(path.filament[row:row + 5], [-1.2, 0, 0, 0, 1.2])
    np.testing.assert_allclose(path.speed[row:row + 5], [33, 150, 150, 150, 27])
    np.testing.assert_allclose(path.xyz[row:row + 5, 2], [0.2, 0.5, 0.5, 0.2, 0.2])
    assert {row, row + 1, row + 4, row + 5} <= set(path.starts.tolist())
    assert not {row + 2, row + 3} & set(path.starts.tolist())


def test_without_retraction_the_nozzle_never_stops():
    path = lay(block(2), retraction={"length_mm": 0})
    assert path.starts.tolist() == [1, len(path.xyz)]
    assert (path.filament >= 0).all()


def test_speeds_are_those_asked_for_and_lower_in_the_first_layer():
    path = lay(block(2))
    for index in (0, 1):
        for role, name in ((Role.OUTER_WALL, "outer_wall"), (Role.SOLID_INFILL, "solid_infill")):
            rows = (path.layer == index) & (path.role == role)
            assert set(path.speed[rows]) == {min(SPEEDS[name], SPEEDS["first_layer"]) if index == 0 else SPEEDS[name]}
    moving = (path.role == Role.TRAVEL) & (path.lengths > 0)
    assert set(path.speed[moving]) == {SPEEDS["travel"]}


def test_events_heat_first_and_blow_from_the_second_layer_on():
    path = lay(block(3))
    second = int(np.flatnonzero(path.layer == 1)[0])
    found = list(zip(path.events.index.tolist(), path.events.kind.tolist(), path.events.value.tolist(), strict=True))
    assert found == [
        (0, EventKind.BED_TEMPERATURE, 55.0), (0, EventKind.NOZZLE_TEMPERATURE, 205.0), (0, EventKind.FAN, 0.0),
        (second, EventKind.FAN, 0.6),
    ]


def test_nothing_to_lay_is_refused_with_a_sentence():
    with pytest.raises(ModelError, match="no layer holds a bead"):
        lay([layer([])])
    with pytest.raises(ModelError):
        lay([layer([line([(0, 0), (1e-4, 0)])])])


def test_islands_are_visited_in_a_short_tour():
    rng = np.random.default_rng(1)
    places = [(x, y) for x in range(6) for y in range(6)]
    lines = [ring(15 * x, 15 * y, 2, island=k) for k, (x, y) in enumerate(places)]
    path = lay([layer([lines[k] for k in rng.permutation(36)])], retraction={"hop_mm": 0})
    assert role_lengths(path)[Role.TRAVEL] < 1.15 * 35 * 15


@pytest.mark.parametrize("reversible", [True, False])
def test_tours_against_every_order_there_is(reversible):
    """Five lines: the tour is never far from the best of all, most often it is the best."""
    rng = np.random.default_rng(5)
    excess = []
    for _ in range(40):
        begin, end, start = rng.random((5, 2)), rng.random((5, 2)), rng.random(2)
        tour = shortest_tour(begin, end, start, reversible)
        assert sorted(tour // 2) == list(range(5))
        assert reversible or not (tour % 2).any()
        flips = product((0, 1), repeat=5) if reversible else [(0,) * 5]
        every = np.array([2 * np.array(order) + flip for flip in flips for order in permutations(range(5))])
        best = travelled(begin, end, start, every).min()
        excess.append(travelled(begin, end, start, tour[None])[0] / best)
    assert min(excess) >= 1 - 1e-12
    assert np.median(excess) < 1.001
    assert max(excess) < 1.35


def travelled(begin, end, start, tours):
    """(T,) mm travelled by entered-end tours (T, n)."""
    ends = np.stack((begin, end), 1).reshape(-1, 2)
    left = np.concatenate((np.broadcast_to(start, (len(tours), 1, 2)), ends[tours ^ 1][:, :-1]), 1)
    return np.linalg.norm(ends[tours] - left, axis=2).sum(1)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(point, point), min_size=1, max_size=60), st.booleans())
def test_a_tour_visits_every_line_once(lines, reversible):
    begin, end = np.array([a for a, _ in lines]), np.array([b for _, b in lines])
    tour = shortest_tour(begin, end, np.zeros(2), reversible)
    assert sorted(tour // 2) == list(range(len(lines)))
    assert reversible or not (tour % 2).any()


@pytest.mark.parametrize("size", [2, 7, 40, 150])
def test_a_tour_is_no_longer_than_nearest_neighbour(size):
    rng = np.random.default_rng(size)
    for _ in range(5):
        begin, end, start = rng.random((size, 2)), rng.random((size, 2)), rng.random(2)
        greedy, tour = nearest_neighbour(begin, end, start), shortest_tour(begin, end, start, True)
        plain, short = travelled(begin, end, start, np.array([greedy, tour]))
        assert short <= plain + 1e-9
        assert size < 40 or short < 0.9 * plain


def nearest_neighbour(begin, end, start):
    ends, left, here, tour = np.stack((begin, end), 1).reshape(-1, 2), set(range(len(begin))), start, []
    while left:
        tour.append(min((2 * i + side for i in left for side in (0, 1)), key=lambda e: np.linalg.norm(ends[e] - here)))
        here = ends[tour[-1] ^ 1]
        left.discard(tour[-1] // 2)
    return np.array(tour)
