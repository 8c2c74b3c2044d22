"""Speeds of walls over air, by how much of their width nothing carries, against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import joined, prism, process, region_of, shapes
from toolpath_samples import PLA

from cabslice.slicing.layer import Role
from cabslice.slicing.region import to_polygons
from cabslice.slicing.slicer import slice_part
from cabslice.slicing.unsupported import levels
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.order import lay_toolpath

WIDE = 0.45
SPEEDS = [41.0, 31.0, 21.0, 11.0]


def laid(mesh, **changes):
    asked = process(infill=0.2, skirt_loops=0, overhang_speeds_mm_s=SPEEDS, **changes)
    return lay_toolpath(slice_part(mesh, asked, nozzle_mm=0.4), asked, PLA, filament_diameter_mm=1.75)


@pytest.mark.parametrize(("step", "speed"), [(0.05, 50.0), (0.15, 41.0), (0.26, 31.0), (0.4, 21.0), (0.6, 11.0)])
def test_the_outer_wall_of_stairs_slows_down_by_the_width_over_air(step, speed):
    """Each layer reaches `step` further on one side: so much of the wall there is over air, of 0.45 mm."""
    stairs = joined(*[prism(shapely.box(0, 0, 20 + k * step, 12), 0.2 * k, 0.2 * k + 0.2) for k in range(6)])
    path = laid(stairs)
    assert find_faults(path) == ()
    outer = np.isin(path.role, (Role.OUTER_WALL, Role.OVERHANG_WALL)) & (path.layer == 5)
    before = np.vstack((path.xyz[:1], path.xyz[:-1]))
    right = outer & (np.minimum(before[:, 0], path.xyz[:, 0]) > 20 + 5 * step - 0.24) & (path.lengths > 1)
    assert set(path.speed[right]) == {speed}
    assert (set(path.role[right]) == {Role.OVERHANG_WALL}) == (speed < 41)
    left = outer & (np.maximum(before[:, 0], path.xyz[:, 0]) < 1)
    assert set(path.speed[left]) == {50.0}


def test_nothing_is_lost_or_laid_twice_and_without_the_key_nothing_slows():
    stairs = joined(prism(shapely.box(0, 0, 20, 12), 0, 1), prism(shapely.Point(10, 6).buffer(9), 1, 2))
    slow = laid(stairs)
    asked = process(infill=0.2, skirt_loops=0)
    plain = lay_toolpath(slice_part(stairs, asked, nozzle_mm=0.4), asked, PLA, filament_diameter_mm=1.75)
    assert slow.filament.sum() == pytest.approx(plain.filament.sum(), abs=1e-9)
    walls = [path.lengths[np.isin(path.role, (Role.OUTER_WALL, Role.INNER_WALL, Role.OVERHANG_WALL))].sum()
             for path in (slow, plain)]
    assert walls[0] == pytest.approx(walls[1])
    assert Role.OVERHANG_WALL not in plain.role
    assert len(slow.starts) == len(plain.starts)                   # no stop more
    first = slow.layer == 0
    assert Role.OVERHANG_WALL not in slow.role[first]


@settings(max_examples=40, deadline=None)
@given(shapes(), st.integers(0, 2**32 - 1), st.sampled_from([0.3, 0.45, 1.2]))
def test_levels_are_how_far_out_a_line_is(shape, seed, width):
    """Lengths at each level against shapely's intersections with grown outlines."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-4, 4, (12, 2)), axis=0)
    walls = rng.uniform(size=12) < 0.7
    walls[0] = False
    source, share, level = levels(points, walls, width, to_polygons(region_of(shape)))
    before = np.maximum(source - 1, 0)
    place = points[before] + share[:, None] * (points[source] - points[before])
    np.testing.assert_array_equal(place[share == 1], points)
    long = np.append(0.0, np.linalg.norm(np.diff(place, axis=0), axis=1))
    assert long.sum() == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    assert (level[~walls[source]] == 0).all()
    asked = shapely.MultiLineString([points[k - 1:k + 1] for k in np.flatnonzero(walls)] or [[(0, 0), (0, 0)]])
    for k in range(1, 5):
        far = (k / 4 - 0.5) * width
        small, large = (shape.buffer(share * far) for share in ((0.97, 2.1) if far > 0 else (2.1, 0.97)))  # mitres
        edges = small.boundary.union(large.boundary).buffer(0.11 * width)          # where cuts may not be made
        slack = asked.intersection(edges).length + 1e-6
        found = long[level >= k].sum()
        assert asked.difference(large).length - slack <= found <= asked.difference(small).length + slack
