"""Support does what its keys say: where it is, how far from the part, on what it stands; measured on the beads."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import joined, prism, prisms, shapes
from support_kit import farthest, gate, laid, layers_of, leaning, lines, outline, supported, table

from cabslice.mesh.load import load_mesh
from cabslice.mesh.place import place
from cabslice.slicing.flow import bead_area
from cabslice.slicing.layer import Role

MODELS = Path(__file__).parents[2] / "shared" / "models"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")
HEIGHT, BEAD = 0.2, 0.45


def keeps_clear(layers, xy, z_above, z_below, slack=0.02):
    """No support bead nearer to the part than it may be, sideways, from above, from below."""
    parts = [outline(layer) for layer in layers]
    for k in supported(layers):
        layer, beads = layers[k], laid(layers[k])
        assert parts[k].distance(beads) >= xy - slack
        for other, part in zip(layers, parts, strict=True):
            above = other.z_mm - other.height_mm - layer.z_mm
            below = layer.z_mm - layer.height_mm - other.z_mm
            if -1e-6 < above < z_above - 1e-6 or -1e-6 < below < z_below - 1e-6:
                assert part.intersection(beads).area < 1e-3 * max(beads.area, 1)


def stands_on_something(layers, xy, bottom, reach=0.3):
    """Every support bead has, under it, support in the layer below, or the part not further down than the gap."""
    for k in supported(layers):
        if k == 0:
            continue
        down = int(np.ceil(bottom / HEIGHT - 1e-6)) + 1
        ground = [outline(layers[j]).buffer(xy + BEAD) for j in range(max(0, k - down), k)]
        held = shapely.union_all([laid(layers[k - 1]).buffer(reach), *ground])
        if layers[k].z_mm - layers[k].height_mm <= bottom + 1e-6:
            continue
        for points, width, _ in lines(layers[k]):
            line = shapely.LineString(points)
            assert line.intersection(held.buffer(width / 2)).length > 0.05 * line.length, (k, points)


def below(layers, z):
    """The topmost layer with its top at or below z."""
    return max((layer for layer in layers if layer.z_mm <= z + 1e-6), key=lambda layer: layer.z_mm)


@pytest.mark.parametrize(("xy", "z", "pattern"), [(0.5, 0.2, "lines"), (1.2, 0.0, "grid"), (0.3, 0.5, "grid")])
def test_gaps_to_the_part_and_contact(xy, z, pattern):
    """Support ends exactly as many layers under the plate as the gap needs, and fills what lies under it."""
    layers = layers_of(table(), xy_gap_mm=xy, z_gap_mm=z, pattern=pattern)
    keeps_clear(layers, xy, z, 0.2)
    stands_on_something(layers, xy, 0.2)
    top = layers[supported(layers)[-1]]
    assert top.z_mm == pytest.approx(4.0 - HEIGHT * np.ceil(z / HEIGHT - 1e-9))
    under = shapely.box(-10, -10, 10, 10) - shapely.box(-2 - xy, -2 - xy, 2 + xy, 2 + xy)
    assert farthest(under, laid(top)) < BEAD / 0.75 / 2                 # half the interface's line spacing
    assert supported(layers) == list(range(top.index + 1))


@pytest.mark.parametrize(("lean", "asked", "needed"), [
    (60, 50, True), (45, 50, False), (45, 40, True), (30, 40, False), (75, 60, True), (10, 0, True), (80, 85, False),
])
def test_overhang_angle_from_the_vertical(lean, asked, needed):
    layers = layers_of(leaning(lean), angle_deg=asked, bridge_mm=0.0)
    assert bool(supported(layers)) == needed


def test_every_overhang_has_support_within_the_line_spacing():
    """Points of a slope that leans 70 degrees: below each, outside the gap beside the part, lies a bead."""
    layers = layers_of(leaning(70, height=4.0), density=0.2, angle_deg=50)
    for x in np.arange(3.2, 3 + 3 * np.tan(np.radians(70)), 0.4):
        under = 1 + (x - 3) / np.tan(np.radians(70))                     # height of the slope there
        # a cut plane lies half a layer from its layer's ends, and the gap is a whole layer
        layer = below(layers, under - 0.2 - HEIGHT)
        for y in (1.0, 4.0, 7.0):
            point = shapely.Point(x, y)
            if outline(layer).distance(point) > 0.5 + BEAD:
                assert laid(layer).distance(point) < BEAD / 0.2 / 2 + BEAD


def test_bridges_that_are_held_need_none():
    assert supported(layers_of(gate(10.0), bridge_mm=10.5)) == []
    assert supported(layers_of(gate(10.0), bridge_mm=9.5))
    assert supported(layers_of(gate(10.0), bridge_mm=0.0))
    half = joined(prism(shapely.box(0, 0, 4, 6), 0.0, 4.0), prism(shapely.box(0, 0, 9, 6), 3.0, 5.0))
    assert supported(layers_of(half, bridge_mm=20.0)), "held at one end it is no bridge"


def test_small_overhangs_are_left_out_but_not_what_nothing_holds():
    knob = joined(prism(shapely.box(0, 0, 6, 6), 0.0, 4.0), prism(shapely.box(5, 2, 8, 4), 2.0, 4.0))   # covers 4 mm2
    assert supported(layers_of(knob, smallest_mm2=3.9))
    assert supported(layers_of(knob, smallest_mm2=4.5)) == []
    stalactite = joined(table(), prism(shapely.box(7, 7, 8, 8), 2.0, 4.5))    # begins in the air
    assert laid(layers_of(stalactite, smallest_mm2=1000.0)[5]).intersects(shapely.box(7, 7, 8, 8))
    assert laid(layers_of(stalactite, smallest_mm2=1000.0)[12]).is_empty


def shelf():
    """A plate whose one half hangs over a lower step of the part, the other over the bed."""
    return joined(
        prism(shapely.box(-2, -4, 2, 4), 0.0, 6.0), prism(shapely.box(-12, -4, 0, 4), 0.0, 2.0),
        prism(shapely.box(-12, -4, 12, 4), 5.0, 7.0),
    )


def test_support_only_from_the_bed():
    free, bed = layers_of(shelf(), bottom_gap_mm=0.4), layers_of(shelf(), where="bed")
    keeps_clear(free, 0.5, 0.2, 0.4)
    stands_on_something(free, 0.5, 0.4)
    step = shapely.box(-12, -4, -3, 4)
    assert any(laid(layer).intersects(step) for layer in free)
    lowest = min(layer.z_mm - layer.height_mm for layer in free if laid(layer).intersects(step))
    assert lowest == pytest.approx(2.4)
    footprint = shapely.union_all([outline(layer) for layer in bed[:10]])
    assert supported(bed)
    for k in supported(bed):
        assert laid(bed[k]).distance(footprint) > 0.48


def test_blockers_and_enforcers():
    left, right = (prism(shapely.box(*box), 0.0, 30.0) for box in ((-20, -20, 0, 20), (0, -20, 20, 20)))
    layers = layers_of(table(), blockers=[left])
    assert supported(layers)
    assert all(laid(layers[k]).bounds[0] >= 0 for k in supported(layers))
    assert supported(layers_of(leaning(30), angle_deg=50)) == []
    forced = layers_of(table(), enforcers=[right], overhangs="enforced")
    assert supported(forced)
    assert all(laid(forced[k]).bounds[0] >= -0.5 for k in supported(forced))
    lean = layers_of(leaning(30, 12.0), angle_deg=50, enforcers=[prism(shapely.box(-9, 0, 90, 4), 0.0, 30.0)])
    assert supported(lean)
    assert all(laid(lean[k]).bounds[3] < 4.6 for k in supported(lean))
    both = layers_of(table(), enforcers=[right], blockers=[left, right])
    assert supported(both) == []


@pytest.mark.parametrize("count", [0, 1, 3])
def test_interface_layers_above_and_below(count):
    layers = layers_of(shelf(), interface_layers=count, bottom_interface_layers=count)
    right, left = shapely.box(4, -3, 11, 3), shapely.box(-11, -3, -4, 3)
    dense = [layer.index for layer in layers if laid(layer, (Role.SUPPORT_INTERFACE,)).intersects(right)]
    assert dense == list(range(24 - count, 24))
    dense = [layer.index for layer in layers if laid(layer, (Role.SUPPORT_INTERFACE,)).intersects(left)]
    assert dense == [*range(11, 11 + count), *range(24 - count, 24)]


@pytest.mark.parametrize(("pattern", "density", "walls"), [
    ("lines", 0.1, 0), ("lines", 0.3, 0), ("grid", 0.2, 0), ("lines", 1.0, 0), ("grid", 0.2, 2),
])
def test_density_is_the_share_that_is_filled(pattern, density, walls):
    layers = layers_of(table(4.0, 60.0, 10.0), pattern=pattern, density=density, walls=walls, interface_layers=0)
    layer = layers[10]
    volume = sum(
        np.linalg.norm(np.diff(points, axis=0), axis=1).sum() * bead_area(width, HEIGHT)
        for points, width, _ in lines(layer)
    )
    room = 60**2 - 11**2
    loops = walls * (4 * 60 + 4 * 11) * BEAD
    assert volume / HEIGHT == pytest.approx(density * (room - loops) + loops, rel=0.1)


def test_lines_run_as_asked_and_interface_crosses_them():
    layers = layers_of(table(4.0, 40.0), line_angle_deg=30, walls=0, interface_layers=1)
    for k, role, angle in ((5, Role.SUPPORT, 30), (18, Role.SUPPORT_INTERFACE, 120)):
        steps = np.concatenate([np.diff(points, axis=0) for points, _, _ in lines(layers[k], (role,))])
        long = steps[np.linalg.norm(steps, axis=1) > 6]
        turned = np.degrees(np.arctan2(long[:, 1], long[:, 0])) % 180
        assert np.abs(turned - angle).max() < 0.1


def test_beads_of_support_are_beside_the_part_and_off_means_nothing():
    layers = layers_of(table())
    role, island = layers[3].beads.role, layers[3].beads.island
    assert (island[np.isin(role, (Role.SUPPORT, Role.SUPPORT_INTERFACE))] == -1).all()
    assert supported(layers_of(table(), kind="none", enforcers=[table()])) == []
    bare = layers_of(table(), kind="none")
    for with_it, without in zip(layers, bare, strict=True):
        count = len(without.beads.role)
        assert (with_it.beads.role[:count] == without.beads.role).all()
        assert (with_it.beads.points[: len(without.beads.points)] == without.beads.points).all()


@needs_models
def test_support_of_a_real_part_keeps_clear_and_stands():
    layers = layers_of(place(load_mesh(MODELS / "overhang.stl")), xy_gap_mm=0.6)
    keeps_clear(layers, 0.6, 0.2, 0.2)
    stands_on_something(layers, 0.6, 0.2)


@settings(max_examples=12, deadline=None)
@given(shapes(16.0), shapes(10.0), st.sampled_from([0.2, 0.7]), st.sampled_from([0.0, 0.3]))
def test_support_of_any_shape_keeps_clear(upper, lower, xy, z):
    part = joined(prisms(lower, 0.0, 1.2), prisms(upper, 1.0, 1.6))
    layers = layers_of(part, xy_gap_mm=xy, z_gap_mm=z, bridge_mm=2.0)
    keeps_clear(layers, xy, z, 0.2)
