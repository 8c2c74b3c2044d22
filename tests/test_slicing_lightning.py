"""Lightning infill: skins and walls are held from below, every branch rests on one, and little else is laid."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_judge import segments
from slicing_kit import bead_volume, joined, prism, process, region_of, shape_of, shapes

from cabslice.slicing.layer import Role
from cabslice.slicing.lightning import Forest, clipped, paths, shorten
from cabslice.slicing.slicer import slice_part

PLATE = shapely.Point(0, 0).buffer(14).difference(shapely.Point(4, 3).buffer(4))
TOWER = shapely.Point(-7, 0).buffer(6)
WIDE, STEP = 0.45, 0.2


@pytest.fixture(scope="module")
def layers():
    part = joined(prism(PLATE, 0, 5), prism(TOWER, 5, 8))
    return list(slice_part(part, process(infill=0.2, pattern="lightning", skirt_loops=0), nozzle_mm=0.4))


def laid(layer, roles=None):
    return shapely.union_all([shapely.LineString([p, q]).buffer(w / 2) for p, q, w in segments(layer, roles)])


def hollow(layer):
    """What of a layer lies under no bead but infill's."""
    outline = shape_of(layer.outline.points, layer.outline.starts)
    return outline.difference(laid(layer, set(Role) - {Role.SPARSE_INFILL}))


def test_skins_and_walls_lie_within_reach_of_what_holds_them(layers):
    """No solid bead's middle over the hollow is further from a bead below than the grid of places allows."""
    reach = 0.407 / 0.2 / 2 * (1 + 2**0.5) + WIDE      # of a branch, from the farthest corner of a cell of places
    held = 0
    for below, here in pairwise(layers[6:]):
        solid = [(p + q) / 2 for p, q, _ in segments(here, {Role.SOLID_INFILL, Role.TOP_SKIN, Role.OUTER_WALL})]
        over = shapely.points(solid)[shapely.contains(hollow(below), shapely.points(solid))]
        if len(over):
            held += len(over)
            assert shapely.distance(laid(below), over).max() < reach, below.index
    assert held > 50


def test_every_branch_rests_on_one(layers):
    """Of a branch no more hangs over air than a layer is high (45 deg), and half a bead: shorter ones are not laid."""
    for below, here in pairwise(layers[4:]):
        lines = [shapely.LineString([p, q]) for p, q, _ in segments(here, {Role.SPARSE_INFILL})]
        rest = laid(below).buffer(STEP + WIDE / 2 + 0.02)
        over = shapely.union_all(lines).difference(rest) if lines else shapely.Point()
        assert over.length < 1e-6, here.index


def test_little_is_laid(layers):
    part = joined(prism(PLATE, 0, 5), prism(TOWER, 5, 8))
    plain = list(slice_part(part, process(infill=0.2, skirt_loops=0), nozzle_mm=0.4))
    share = [sum(bead_volume(layer, {Role.SPARSE_INFILL}) for layer in one) for one in (layers, plain)]
    assert 0.02 * share[1] < share[0] < 0.6 * share[1]
    empty = [bead_volume(layer, {Role.SPARSE_INFILL}) for layer in layers[5:20]]
    assert empty == sorted(empty)                              # branches end one after the other going down
    for layer in layers:
        outline = shape_of(layer.outline.points, layer.outline.starts)
        assert shapely.contains_xy(outline.buffer(1e-6), layer.beads.points).all()


def test_branches_are_shortened_from_their_tips():
    forest = Forest()
    forest.add(np.array([(0, 0), (1, 0), (2, 0), (3, 0)], float), -1)
    forest.add(np.array([(2, 0.5), (2, 1.0)]), 2)
    shorten(forest, 1.25)                                      # (3, 0) is 1 from the fork, (2, 1) is 1 from it
    points, starts = paths(forest)
    assert len(starts) == 2
    assert shapely.LineString(points).length == pytest.approx(2 - 0.25, abs=0.26)
    shorten(forest, 9.0)
    assert len(forest.place) == 0


@settings(max_examples=40, deadline=None)
@given(shapes(), st.integers(0, 2**32 - 1))
def test_lines_are_clipped_as_shapely_does(shape, seed):
    rng = np.random.default_rng(seed)
    points, starts = rng.uniform(-11, 11, (14, 2)), np.array([0, 5, 7, 14])
    found, cuts = clipped((points, starts), region_of(shape))
    lines = shapely.MultiLineString([points[a:b] for a, b in pairwise(starts)])
    pieces = [shapely.LineString(found[a:b]) for a, b in pairwise(cuts)]
    assert sum(piece.length for piece in pieces) == pytest.approx(lines.intersection(shape).length, abs=1e-6)
    assert shapely.contains(shape.buffer(1e-6), pieces).all()
