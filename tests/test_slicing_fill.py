"""Regions, walls, fill lines and thin strips against shapely and against conservation of volume."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from slicing_kit import region_of, ring_area, shape_of, shapes

from cabslice.slicing.bridges import bridge_angle
from cabslice.slicing.flow import bead_area, bead_spacing, bead_width
from cabslice.slicing.infill import even_lines, fixed_lines
from cabslice.slicing.region import Region, contains, difference, offset, opening, to_rings, union
from cabslice.slicing.surfaces import RunningIntersection, Window, divide, neighbours
from cabslice.slicing.thin import Strips, strip_area, thin_lines, thin_out
from cabslice.slicing.walls import walls

LINE = {"height_mm": 0.2, "thinnest_mm": 0.12, "fill_spacing_mm": float(bead_spacing(0.45, 0.2))}


@given(st.floats(0.05, 3), st.floats(0.05, 1.2))
def test_width_and_spacing_are_inverse(spacing, height):
    width = bead_width(spacing, height)
    assert bead_spacing(width, height) == pytest.approx(spacing)
    assert bead_area(width, height) == pytest.approx(spacing * height)


@settings(max_examples=40, deadline=None)
@given(shapes(), st.floats(0.1, 1.5))
def test_opening_is_between_shapely_round_and_the_region(shape, radius):
    opened = shape_of(*to_rings(opening(region_of(shape), radius)))
    assert opened.difference(shape.buffer(1e-6)).area < 1e-4
    round_one = shape.buffer(-1.02 * radius).buffer(0.99 * radius)     # decided up to 2 % of the radius
    assert round_one.difference(opened.buffer(1e-3)).area < 1e-3 + 1e-3 * shape.area


@settings(max_examples=40, deadline=None)
@given(shapes(), st.integers(0, 2**32 - 1))
def test_contains_agrees_with_shapely(shape, seed):
    query = np.random.default_rng(seed).uniform(-11, 11, (200, 2))
    clear = shapely.distance(shape.boundary, shapely.points(query)) > 1e-3
    found = contains(*to_rings(region_of(shape)), query)
    np.testing.assert_array_equal(found[clear], shapely.contains_xy(shape, query)[clear])


@settings(max_examples=40, deadline=None)
@given(shapes(), st.integers(0, 3))
def test_walls_and_what_they_leave_fill_the_outline(shape, number):
    """Length of wall lines times spacing + thin strips + inside = outline, but for slivers, rounding and corners."""
    outline = region_of(shape)
    levels, inside = walls(outline, (0.45,) * number, **LINE)
    spacing = LINE["fill_spacing_mm"]
    held, scallop, around = inside.wide.area() + inside.thin.area(), 0.0, shape
    for k, level in enumerate(levels):
        ring = shape_of(*to_rings(level.lines))
        room = around.buffer(0.003 - spacing if k else -0.222)
        assert ring.difference(room).area < 1e-6             # never nearer to the edge, or to the wall outside
        around = ring
        held += level.thin.area() + spacing * ring.length
        scallop += (0.45 - spacing) / 2 * ring.length * (k == 0)
    hairs = shape.area - shape.buffer(-0.0601).buffer(0.0601).area
    corners = shapely.get_num_coordinates(shape) * (1 + number) * 0.45**2
    assert -0.05 * shape.area - 0.2 * corners <= shape.area - held - scallop <= hairs + 0.02 * shape.area + corners


@pytest.mark.parametrize(("thick", "lines"), [(0.35, 0), (0.5, 0), (0.8, 0), (1.0, 1), (2.0, 2)])
def test_a_fin_gets_as_many_pairs_of_walls_as_it_has_room_for(thick, lines):
    levels, _ = walls(region_of(shapely.box(0, 0, 20, thick)), (0.45, 0.45), **LINE)
    assert sum(not level.lines.is_empty() for level in levels) == lines
    if not lines:
        assert levels[0].thin.area() == pytest.approx(20 * thick, rel=1e-6)


def strip_lines(*regions, reach=0.5):
    strips = [Strips(region, reach, 0.0) for region in regions]
    return thin_lines(strips, narrowest_mm=0.1, widest_mm=0.99, step_mm=0.14)


def line_strings(lines):
    return [shapely.LineString(lines.points[a:b]) for a, b in pairwise(lines.starts)]


@settings(max_examples=60, deadline=None)
@given(shapes(), st.floats(0.3, 2), st.floats(-4, 4), st.floats(0, 20), st.booleans())
def test_fill_lines_lie_in_the_region_and_meet_all_of_it(shape, spacing, angle, link, fixed):
    region = region_of(shape)
    lines = fixed_lines(region, spacing, angle, link) if fixed else even_lines(region, spacing, angle, 0.0, link)
    grown = shape.buffer(1e-6)
    assert shapely.contains(grown, line_strings(lines)).all()
    if fixed and len(lines.starts) > 1:
        # straight scan of the same rows with shapely: the unlinked lines add up to the same length
        c, s = np.cos(angle), np.sin(angle)
        across = np.array(shape.envelope.exterior.coords) @ [-s, c]
        rows = np.arange(np.floor(across.min() / spacing), np.ceil(across.max() / spacing) + 1) * spacing
        reach, row = np.array([[-99 * c, -99 * s], [99 * c, 99 * s]]), np.array([-s, c])
        exact = sum(shape.intersection(shapely.LineString(reach + y * row)).length for y in rows)
        unlinked = fixed_lines(region, spacing, angle, 0.0)
        assert unlinked.lengths.sum() == pytest.approx(exact, rel=1e-6, abs=1e-6)
        linked = lines.lengths.sum() - exact
        assert -1e-6 <= linked <= shape.length + 1e-6


@settings(max_examples=40, deadline=None)
@given(st.floats(0.5, 30), st.floats(0.5, 30), st.floats(0.25, 1.2))
def test_rows_fill_a_rectangle_evenly(wide, high, spacing):
    lines = even_lines(region_of(shapely.box(0, 0, wide, high)), spacing, 0.0, spacing / 2, 4 * spacing)
    rows = np.unique(np.round(lines.points[:, 1], 3))
    if high <= 1.1 * spacing:
        assert len(rows) == 1
        assert rows[0] == pytest.approx(high / 2, abs=0.002)
        return
    assert rows[0] == pytest.approx(spacing / 2, abs=0.002)
    assert rows[-1] == pytest.approx(high - spacing / 2, abs=0.002)
    assert np.diff(rows).max(initial=0) <= 1.1 * spacing + 0.002
    assert len(lines.starts) == 2                # one line all the way


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 5), st.sampled_from([0.15, 0.35, 0.5, 0.8]))
def test_a_winding_strip_is_printed_once_along_its_middle(seed, corners, wide):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.uniform(-1.2, 1.2, corners))
    legs = rng.uniform(3, 8, corners)[:, None] * np.stack((np.cos(turn), np.sin(turn)), 1)
    middle = shapely.LineString(np.concatenate(([[0, 0]], np.cumsum(legs, 0))))
    strip = middle.buffer(wide / 2, cap_style="flat", join_style="mitre")
    assume(strip.is_simple and strip.area == pytest.approx(middle.length * wide, rel=1e-3))
    lines = strip_lines(region_of(strip))
    assert len(lines.closed) == 1
    assert not lines.closed.any()
    found = shapely.LineString(lines.points)
    assert found.length == pytest.approx(middle.length, abs=1.6 * wide * corners)
    assert shapely.hausdorff_distance(found, middle) < 0.75 * wide
    assert strip_area(*lines.of_group(0)) / found.length == pytest.approx(wide, rel=0.03)
    covered = found.buffer(wide / 2 * 0.98)
    assert strip.difference(covered).area < 0.03 * strip.area + 0.4 * wide**2 * corners
    assert strip_area(*lines.of_group(0)) == pytest.approx(strip.area, rel=0.03, abs=0.6 * corners * wide**2)


def test_a_ring_closes_and_groups_do_not_mix():
    ring = difference(offset(Region.circle(5, 180), 0.25), offset(Region.circle(5, 180), -0.25))
    assert len(strip_lines(ring).closed) == 1
    bar = region_of(shapely.box(-5, -0.2, 5, 0.2))
    lines = strip_lines(bar, Region(), ring, reach=0)
    assert lines.group.tolist() == [2, 0] or lines.group.tolist() == [0, 2]
    points, starts, diameter, closed = lines.of_group(2)
    assert closed.tolist() == [True]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 5, atol=0.02)
    assert strip_area(points, starts, diameter, closed) == pytest.approx(ring.area(), rel=0.01)
    points, *_ = lines.of_group(0)
    np.testing.assert_allclose(points[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(np.sort(points[:, 0]), [-4.8, 4.8], atol=0.1)


def test_branches_meet_and_spots_become_dots():
    cross = union([region_of(shapely.box(-5, -0.25, 5, 0.25)), region_of(shapely.box(-0.25, -5, 0.25, 5))])
    points, starts, diameter, closed = strip_lines(cross).of_group(0)
    assert len(closed) == 2
    assert strip_area(points, starts, diameter, closed) == pytest.approx(cross.area(), rel=0.05)
    dot = strip_lines(region_of(shapely.box(0, 0, 0.4, 0.5)))
    assert len(dot.closed) == 1
    assert strip_area(*dot.of_group(0)) == pytest.approx(0.4 * 0.2, rel=0.1)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(2, 60), min_size=1, max_size=5), st.floats(0.001, 0.3), st.integers(0, 2**32 - 1))
def test_thinned_lines_stay_within_the_tolerance(sizes, tolerance, seed):
    rng = np.random.default_rng(seed)
    starts = np.concatenate(([0], np.cumsum(sizes)))
    points = np.concatenate([np.cumsum(rng.normal(0, 0.3, (n, 2)), 0) for n in sizes])
    kept = thin_out(points, starts, np.full(len(sizes), tolerance))
    assert kept[starts[:-1]].all()
    assert kept[starts[1:] - 1].all()
    for a, b in pairwise(starts):
        line = shapely.LineString(points[a:b][kept[a:b]])
        assert shapely.distance(shapely.points(points[a:b]), line).max() <= tolerance + 1e-12


@settings(max_examples=30, deadline=None)
@given(st.lists(shapes(holes=1), min_size=1, max_size=7), st.integers(0, 3), st.integers(0, 3))
def test_skins_are_what_too_few_layers_cover(many, top, bottom):
    """The running intersection against the definition, layer by layer, by shapely."""
    seen = list(neighbours([region_of(shape) for shape in many], Window(0, len(many), len(many), bottom, top)))
    assert [near.index for near in seen] == list(range(len(many)))
    for i, near in enumerate(seen):
        common = many[i]
        for j in range(i - bottom, i + top + 1):
            common = common.intersection(many[j]) if 0 <= j < len(many) else shapely.Polygon()
        assert near.common.area() == pytest.approx(common.area, abs=1e-5)
        assert near.outline.area() == pytest.approx(many[i].area, abs=1e-5)


def test_running_intersection_of_a_queue():
    rng = np.random.default_rng(5)
    boxes = [shapely.box(*rng.uniform(-9, -1, 2), *rng.uniform(1, 9, 2)) for _ in range(30)]
    running, first = RunningIntersection(), 0
    for k, box in enumerate(boxes):
        running.push(region_of(box))
        if k - first > rng.integers(1, 6):
            running.pop()
            first += 1
        assert running.value().area() == pytest.approx(shapely.intersection_all(boxes[first : k + 1]).area)


@settings(max_examples=30, deadline=None)
@given(shapes(), shapes(), shapes(), st.booleans(), st.booleans())
def test_the_inside_is_divided_without_overlap_or_loss(below, here, above, sparse, solid):
    inside = region_of(here)
    near = list(neighbours([region_of(below), inside, region_of(above)], Window(0, 3, 3, 1, 1)))[1]
    parts = divide(inside, near, 0.45, sparse=sparse, solid=solid)
    pieces = [parts.top, parts.bridge, parts.solid, parts.sparse]
    assert sum(piece.area() for piece in pieces) == pytest.approx(here.area, abs=1e-4)
    assert union(pieces).area() == pytest.approx(here.area, abs=1e-4)
    if solid:
        assert parts.sparse.is_empty()
    must = here.difference(above.intersection(below))
    must = must.buffer(-0.23).buffer(0.2)                          # patches wider than a bead
    assert must.intersection(shape_of(*to_rings(parts.sparse))).area < 1e-4


def test_bridges_run_from_hold_to_hold():
    hold = region_of(shapely.MultiPolygon([shapely.box(-5, 0, 0, 10), shapely.box(20, 0, 25, 10)]))
    gap = region_of(shapely.box(0, 0, 20, 10))
    for turn in (0, 35, 90):
        angle = bridge_angle(gap.rotate(turn), hold.rotate(turn), 0.45, 9.9)
        assert np.degrees(angle) % 180 == pytest.approx(turn, abs=1e-6)
    assert bridge_angle(gap, Region(), 0.45, 9.9) == 9.9
    plate = difference(offset(gap, 5), gap)                        # held all around: the short way over
    assert np.degrees(bridge_angle(gap, plate, 0.45, 9.9)) == pytest.approx(90)


def test_ring_area_of_holes_is_negative():
    points, starts = to_rings(region_of(shapely.box(0, 0, 4, 4).difference(shapely.box(1, 1, 2, 2))))
    assert ring_area(points, starts) == pytest.approx(15)
