"""Infill patterns: their volume, their shape against the equations they are named after, clipping against shapely."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import bead_volume, joined, prism, process, region_of, shapes
from toolpath_samples import PLA

from cabslice.profile.keys import keys
from cabslice.slicing.curves import gyroid, honeycomb, wave_lines
from cabslice.slicing.fill import sparse_pitch
from cabslice.slicing.layer import Role
from cabslice.slicing.patterns import Sparse, sparse_lines
from cabslice.slicing.slicer import slice_part
from cabslice.toolpath.order import lay_toolpath

PATTERNS = ("rectilinear", "aligned", "grid", "triangles", "cubic", "honeycomb", "gyroid", "concentric")
RING = shapely.Point(0, 0).buffer(20).difference(shapely.Point(5, 3).buffer(6)).union(shapely.box(15, -6, 32, 6))
STEP = 0.857            # two walls of 0.45 mm at 0.2 mm: how far the inside is from the outline


def sparse(pattern, *, pitch=3.0, index=0, z=0.2, angle=0.0):
    return Sparse(pattern, angle, pitch, 0.45, index, z)


def strings(lines):
    return [shapely.LineString(lines.points[a:b]) for a, b in pairwise(lines.starts)]


def test_every_pattern_of_the_profile_is_tested():
    named = keys("processes")[("pattern",)].type.replace(chr(34), "").split(" or ")
    assert set(named) == {*PATTERNS, "lightning"}


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("infill", [0.15, 0.35])
def test_infill_holds_its_share_and_stops_are_few(pattern, infill):
    asked = process(infill=infill, pattern=pattern, skirt_loops=0)
    pitch = sparse_pitch(asked, RING.length, RING.area)
    quarter = gyroid(pitch, 0.0).apart / 4                   # after which the lengths of its lines repeat
    layers = list(slice_part(prism(RING, 0, 2.2 + quarter), asked, nozzle_mm=0.4))[6:6 + round(quarter / 0.2)]
    inside = RING.buffer(-STEP, join_style="mitre").area * 0.2
    assert np.mean([bead_volume(layer, {Role.SPARSE_INFILL}) for layer in layers]) / inside == pytest.approx(
        infill, rel=0.012)
    off = 0.3 if pattern == "gyroid" else 0.02
    for layer in layers:
        assert bead_volume(layer, {Role.SPARSE_INFILL}) / inside == pytest.approx(infill, rel=off)
        crossing = sum(len(lines.starts) - 1 for lines in sparse_lines(region_of(RING), sparse(pattern, pitch=0.5)))
        assert (layer.beads.role == Role.SPARSE_INFILL).sum() < crossing


@settings(max_examples=50, deadline=None)
@given(shapes(), st.sampled_from(PATTERNS), st.floats(0.6, 4), st.floats(0, 30), st.floats(-4, 4))
def test_lines_of_any_pattern_lie_in_the_region(shape, pattern, pitch, z, angle):
    region = region_of(shape)
    grown = shape.buffer(1e-6)
    for lines in sparse_lines(region, sparse(pattern, pitch=pitch, z=z, angle=angle)):
        assert shapely.contains(grown, strings(lines)).all()
        assert (np.diff(lines.starts) > 1).all()


@settings(max_examples=40, deadline=None)
@given(shapes(), st.booleans(), st.floats(0.8, 4), st.floats(0, 30), st.floats(-4, 4))
def test_waves_are_clipped_as_shapely_does(shape, hexagons, pitch, z, angle):
    waves = honeycomb(pitch, 0.4) if hexagons else gyroid(pitch, z)
    found = wave_lines(region_of(shape), waves, angle, 0.0)
    turned = shapely.affinity.rotate(shape, -(angle + waves.turn), origin=(0, 0), use_radians=True)
    period = waves.nodes[-1]
    left = np.floor(turned.bounds[0] / period) * period
    count = int(np.ceil((turned.bounds[2] - left) / period))
    x = np.concatenate([left + k * period + waves.nodes[:-1] for k in range(count)] + [[left + count * period]])
    length = 0.0
    lowest, highest = (int(np.floor(turned.bounds[k] / waves.apart)) for k in (1, 3))
    for side in (waves.low, waves.high):
        y = np.append(np.tile(side[:-1], count), side[0])
        for k in range(lowest - 3, highest + 4):
            line = shapely.LineString(np.stack((x, y + k * waves.apart), 1))
            length += turned.intersection(line).length
    assert found.lengths.sum() == pytest.approx(length, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("pitch", [1.0, 3.0])
def test_a_gyroid_is_one(pitch):
    """All points lie on Schoen's surface, all of it is there, and in the mean 1 mm of line lies on pitch mm^2."""
    box = region_of(shapely.box(-30, -30, 30, 30))
    scale = gyroid(pitch, 0.0).apart / (2 * np.pi)
    share = []
    for z in (np.arange(32) + 0.5) * 2 * np.pi / 32 * scale:
        lines = wave_lines(box, gyroid(pitch, z), 0.0, 0.0)
        nodes = np.abs(lines.points).max(1) < 30 - 1e-9          # ends on the edge lie on chords
        x, y = lines.points[nodes].T / scale
        surface = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z / scale) + np.sin(z / scale) * np.cos(x)
        assert np.abs(surface).max() < 1e-9
        share.append(lines.lengths.sum() * pitch / 60**2)
    assert np.mean(share) == pytest.approx(1, rel=0.01)
    assert np.ptp(share) < 0.35


def test_a_honeycomb_is_one():
    """Hexagons of equal sides and angles; every third side twice, a bead apart."""
    waves = honeycomb(2.0, 0.4)
    x, low, high = waves.nodes, waves.low, waves.high
    sides = np.hypot(np.diff(x), np.diff(low))
    np.testing.assert_allclose(sides, sides[0])
    np.testing.assert_allclose(np.abs(np.degrees(np.arctan2(np.diff(low), np.diff(x)))), [0, 60, 0, 60], atol=1e-9)
    assert high[2] - low[2] == pytest.approx(0.4)
    assert waves.apart - (high[0] - low[0]) == pytest.approx(0.4)
    assert waves.length_per_mm2 == pytest.approx(1 / 2.0)


def test_cubic_lines_are_walls_of_cubes():
    """Lines of all heights lie in three families of planes at right angles, all as far from the next."""
    steep = np.arctan(np.sqrt(2))
    normals = [np.array([-np.sin(a) * np.sin(steep), np.cos(a) * np.sin(steep), -np.cos(steep)])
               for a in np.radians([0, 120, 240])]
    np.testing.assert_allclose(np.array(normals) @ np.array(normals).T, np.eye(3), atol=1e-12)
    for z in (0.2, 3.7, 11.0):
        for lines, normal in zip(sparse_lines(region_of(RING), sparse("cubic", z=z)), normals, strict=True):
            ends = np.concatenate([lines.points[lines.starts[:-1]], lines.points[lines.starts[1:] - 1]])
            away = np.column_stack((ends, np.full(len(ends), z))) @ normal / (3.0 * np.sin(steep))
            np.testing.assert_allclose(away, np.round(away), atol=1e-9)


def test_triangles_meet_in_points():
    """Where two families cross the third one passes too."""
    first, second, third = (lines.points[:2] for lines in sparse_lines(region_of(RING), sparse("triangles")))
    assert len(first) == len(second) == len(third) == 2
    numbers = [(np.array([-np.sin(a), np.cos(a)]) @ line[0]) / 3.0
               for a, line in zip(np.radians([0, 120, 240]), (first, second, third), strict=True)]
    np.testing.assert_allclose(numbers, np.round(numbers), atol=1e-9)   # k + l + m = 0 has an m for every k, l


def test_which_patterns_turn_and_which_stack():
    layers = list(slice_part(prism(RING, 0, 3), process(infill=0.2, pattern="aligned"), nozzle_mm=0.4))
    lines = [layer.beads.points[np.repeat(layer.beads.role == Role.SPARSE_INFILL, np.diff(layer.beads.starts))]
             for layer in layers[6:8]]
    np.testing.assert_array_equal(*lines)
    even, odd = (sparse_lines(region_of(RING), sparse("rectilinear", index=k))[0] for k in (0, 1))
    assert np.ptp(even.points[:2, 1]) < 1e-9
    assert np.ptp(odd.points[:2, 0]) < 1e-9


def test_rings_keep_their_distance():
    lines, = sparse_lines(region_of(shapely.box(0, 0, 30, 20)), sparse("concentric", pitch=2.0))
    assert lines.closed
    for k, (a, b) in enumerate(pairwise(lines.starts)):
        ring = shapely.LinearRing(lines.points[a:b])
        assert ring.equals(shapely.box(0, 0, 30, 20).buffer(-1 - 2 * k, join_style="mitre").exterior)


@pytest.mark.parametrize(("every", "layer_mm", "found"),
                         [(1, 0.2, 1), (2, 0.2, 2), (3, 0.1, 3), (9, 0.1, 4), (9, 0.3, 1)])
@pytest.mark.parametrize("pattern", ["rectilinear", "grid"])
def test_infill_of_several_layers_is_laid_at_once(every, layer_mm, found, pattern):
    """No higher than the 0.4 mm nozzle is wide; a recess in some of the layers is filled layer by layer; the volume of
    the part is what it is without."""
    recess = joined(prism(RING, 0, 3), prism(RING.difference(shapely.box(-12, -12, -6, -2)), 3, 3 + layer_mm),
                    prism(RING, 3 + layer_mm, 6))
    asked = {"infill": 0.25, "pattern": pattern, "layer_mm": layer_mm, "skirt_loops": 0, "top_layers": 2,
             "bottom_layers": 2}
    many, plain = (list(slice_part(recess, process(**asked, infill_every=k), nozzle_mm=0.4)) for k in (every, 1))
    heights = {round(float(h) / layer_mm) or 1 for layer in many
               for h in layer.beads.height[layer.beads.role == Role.SPARSE_INFILL]}
    assert heights == {1, found}
    for one in (many, plain):
        assert all((layer.beads.height <= 0.4 + 1e-9).all() for layer in one)
    volumes = [sum(bead_volume(layer, {Role.SPARSE_INFILL}) for layer in one) for one in (many, plain)]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.02)
    stops = [sum((layer.beads.role == Role.SPARSE_INFILL).sum() for layer in one) for one in (many, plain)]
    assert stops[0] < 1.3 * stops[1] / found + 40


def test_high_beads_are_laid_high():
    """The path feeds what beads two layers high hold."""
    asked = process(infill=0.25, infill_every=2, skirt_loops=0)
    layers = list(slice_part(prism(RING, 0, 3), asked, nozzle_mm=0.4))
    path = lay_toolpath(layers, asked, PLA, filament_diameter_mm=1.75)
    laid = path.role == Role.SPARSE_INFILL
    assert set(np.round(path.height[laid], 9)) == {0.2, 0.4}
    fed = path.filament[laid].sum() * path.filament_area_mm2
    assert fed == pytest.approx(sum(bead_volume(layer, {Role.SPARSE_INFILL}) for layer in layers), rel=1e-3)
