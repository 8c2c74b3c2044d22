"""Compensation: what is asked for is what moves, measured on polygons by shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import prism, process, region_of, shape_of, shapes

from cabslice.profile.process import Compensation
from cabslice.slicing.compensate import compensated
from cabslice.slicing.region import to_rings
from cabslice.slicing.slicer import slice_part

PLATE = shapely.box(0, 0, 30, 20).difference(shapely.box(5, 5, 12, 12)).difference(shapely.box(18, 6, 26, 14))
PIN = shapely.box(7, 7, 10, 10)                                  # stands in a hole


def asked(**changes):
    return Compensation(**changes)


def moved(shape, *, first=False, **changes):
    return shape_of(*to_rings(compensated(region_of(shape), asked(**changes), 0.45, first=first)))


def grown(box, distance):
    return box.buffer(distance, join_style="mitre")


@pytest.mark.parametrize("outlines", [-0.2, 0.0, 0.15])
@pytest.mark.parametrize("holes", [-0.1, 0.0, 0.25])
def test_outlines_and_holes_move_apart(outlines, holes):
    whole = shapely.union(PLATE, PIN)
    found = moved(whole, outlines_mm=outlines, holes_mm=holes)
    exact = grown(shapely.box(0, 0, 30, 20), outlines)
    for hole in (shapely.box(5, 5, 12, 12), shapely.box(18, 6, 26, 14)):
        exact = exact.difference(grown(hole, holes))
    assert found.symmetric_difference(exact.union(grown(PIN, outlines))).area < 1e-6
    assert moved(whole, first=True, outlines_mm=outlines, holes_mm=holes).equals(found)


@settings(max_examples=40, deadline=None)
@given(shapes(), st.floats(0.05, 0.4))
def test_the_first_layer_is_drawn_in_by_no_more_than_asked(shape, distance):
    found = moved(shape, first=True, first_layer_mm=distance)
    assert found.difference(shape.buffer(1e-4)).area < 1e-6
    assert shape.buffer(-2.1 * distance).difference(found.buffer(1e-3)).area < 1e-3    # mitres reach that far
    assert shape.area - found.area <= 1.05 * distance * shape.length + 1e-6


def test_the_first_layer_is_drawn_in_but_not_where_it_is_thin():
    fin = shapely.box(29, 8, 45, 8.6)
    found = moved(PLATE.union(fin), first=True, first_layer_mm=0.2)
    free = shapely.box(31, 0, 50, 20)
    assert found.intersection(free).equals_exact(fin.intersection(free), 1e-6)
    away = shapely.box(0, 0, 28, 20)
    assert found.intersection(away).symmetric_difference(grown(PLATE, -0.2).intersection(away)).area < 1e-6
    assert found.geom_type == "Polygon"


def test_only_the_first_layer_has_no_foot():
    part = prism(PLATE, 0, 1)
    layers = list(slice_part(part, process(compensation={"first_layer_mm": 0.2}), nozzle_mm=0.4))
    areas = [shape_of(layer.outline.points, layer.outline.starts).area for layer in layers]
    assert areas[0] == pytest.approx(grown(PLATE, -0.2).area, rel=1e-4)
    np.testing.assert_allclose(areas[1:], PLATE.area, rtol=1e-4)


def test_a_compensated_hole_is_printed_that_large():
    """The outer wall's edge, half a bead from its middle, is where the hole shall be."""
    layers = list(slice_part(prism(PLATE, 0, 1), process(compensation={"holes_mm": 0.1}), nozzle_mm=0.4))
    beads = layers[3].beads
    edges = [shapely.Polygon(beads.points[beads.starts[b]:beads.starts[b + 1]])
             for b in np.flatnonzero(beads.closed & (beads.role == 1))]
    hole = min(edges, key=lambda edge: edge.area)
    assert grown(hole, -0.225).symmetric_difference(grown(shapely.box(5, 5, 12, 12), 0.1)).area < 1e-4
