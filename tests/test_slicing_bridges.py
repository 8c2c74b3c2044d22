"""Bridges against an exhaustive search over directions, scored by shapely alone."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from raster_judge import segments
from slicing_kit import process, region_of, shape_of

from cabslice.mesh.load import load_mesh
from cabslice.mesh.place import place
from cabslice.slicing.bridges import bridge_angle
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part

MODELS = Path(__file__).parents[2] / "shared" / "models"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")
WIDE = 0.45
DIRECTIONS = np.arange(0, 180, 5)


def spans(gap, hold, degrees, pitch=0.5):
    """mm of lines over the gap at a direction: held at both ends, and not; the longest held one."""
    turned, base = (shapely.affinity.rotate(shape, -degrees, origin=(0, 0)) for shape in (gap, hold.buffer(0.02)))
    left, low, right, high = turned.bounds
    held = free = longest = 0.0
    for y in np.arange(low + pitch / 2, high, pitch):
        cut = turned.intersection(shapely.LineString([(left - 1, y), (right + 1, y)]))
        for line in getattr(cut, "geoms", [cut]):
            if line.geom_type != "LineString" or line.length < 1e-6:
                continue
            if all(base.distance(shapely.Point(end)) < 1e-6 for end in (line.coords[0], line.coords[-1])):
                held, longest = held + line.length, max(longest, line.length)
            else:
                free += line.length
    return held, free, longest


def shares(gap, hold):
    """Of all directions, the share of the lines' length that is held."""
    found = [spans(gap, hold, degrees) for degrees in DIRECTIONS]
    return np.array([held / max(held + free, 1e-9) for held, free, _ in found]), np.array([far for *_, far in found])


def chosen(gap, hold):
    """As the slicer asks: the bridge reaches two beads over what holds it."""
    bridge = gap.buffer(2 * WIDE).intersection(gap.union(hold))
    return np.degrees(bridge_angle(region_of(bridge), region_of(hold), WIDE, 0.123))


def gaps():
    """Name, what spans, what holds it."""
    slot = shapely.box(0, 0, 20, 10)
    legs = shapely.box(-5, 0, 0, 10).union(shapely.box(20, 0, 25, 10))
    frame = shapely.box(-5, -5, 25, 15).difference(slot)
    ell = shapely.box(-5, -5, 0, 10).union(shapely.box(-5, -5, 20, 0))
    horseshoe = frame.difference(shapely.box(1, 9, 19, 20))
    disc = shapely.Point(0, 0).buffer(8)
    ring = shapely.Point(0, 0).buffer(11).difference(disc)
    stairs = shapely.Polygon([(0, 0), (18, 0), (18, 6), (12, 6), (12, 12), (0, 12)])
    yield "legs", slot, legs
    yield "legs of unlike size", slot, legs.difference(shapely.box(20, 4, 30, 20))
    yield "frame", slot, frame
    yield "horseshoe", slot, horseshoe
    yield "corner", slot, ell
    yield "ring", disc, ring
    yield "half ring", disc, ring.intersection(shapely.box(-20, -20, 20, 0))
    yield "two arcs", disc, ring.difference(shapely.box(-4, -20, 4, 20))
    yield "stairs between walls", stairs, shapely.box(-4, -4, 22, 0).union(shapely.box(-4, 12, 12, 16)).union(
        shapely.box(12, 6, 22, 16))


@pytest.mark.parametrize(("name", "gap", "hold"), list(gaps()), ids=[name for name, *_ in gaps()])
@pytest.mark.parametrize("turn", [0, 35, 90])
def test_bridges_run_in_the_best_direction(name, gap, hold, turn):
    """As much of the lines is held as in the best of all directions; among equals the spans are short."""
    gap, hold = (shapely.affinity.rotate(shape, turn, origin=(0, 0)) for shape in (gap, hold))
    held, far = shares(gap, hold)
    picked = round(chosen(gap, hold) / 5) % len(DIRECTIONS)
    assert held[picked] >= held.max() - 0.06, (DIRECTIONS[picked], DIRECTIONS[np.argmax(held)])
    as_good = held >= held[picked] - 0.02
    assert far[picked] <= 1.3 * far[as_good].min()


@needs_models
def test_bridgetest_is_spanned():
    """Wherever the layer below leaves more than two beads of air, lines cross it from hold to hold."""
    part = place(load_mesh(MODELS / "bridgetest.stl"))
    layers = list(slice_part(part, process(infill=0.2), nozzle_mm=0.4))
    bridged = 0
    for below, here in pairwise(layers):
        ground, outline = (shape_of(one.outline.points, one.outline.starts) for one in (below, here))
        air = outline.difference(ground.buffer(0.01)).buffer(-WIDE).buffer(WIDE)
        for gap in getattr(air, "geoms", [air]):
            if gap.is_empty or gap.area < 20:
                continue
            lines = shapely.MultiLineString([(p, q) for p, q, _ in segments(here, {Role.BRIDGE})])
            inner = gap.buffer(-2.2 * WIDE)                        # what two walls do not fill
            if inner.area < 4:
                continue
            assert inner.difference(lines.buffer(WIDE / 2 + 0.05)).area < 0.02 * inner.area
            crossing = [line for line in lines.geoms if line.intersection(gap).length > 0.5 * line.length]
            held = sum(line.length for line in crossing
                       if all(ground.distance(shapely.Point(end)) < 2 * WIDE for end in line.coords))
            best = shares(gap, ground)[0].max()
            assert held >= (best - 0.1) * sum(line.length for line in crossing)
            bridged += 1
    assert bridged >= 1
