"""Brim, skirt and raft do what their keys say, measured on the beads with shapely."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from slicing_kit import joined, prism, process
from support_kit import laid, lines, outline, supported, table

from cabslice.profile.stand import Brim, Raft, Support
from cabslice.slicing.flow import bead_area
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part

RING = shapely.box(-10, -8, 10, 8) - shapely.box(-6, -4, 6, 4)
BEAD, SPACING = 0.45, 0.45 - 0.2 * (1 - np.pi / 4)
LOOPS = (Role.SKIRT,)


def layers_of(part, **keys):
    asked = {"infill": 0.0, "top_layers": 1, "bottom_layers": 1, "skirt_loops": 0, **keys}
    return list(slice_part(part, process(**asked), nozzle_mm=0.4))


def frame(height=1.0):
    return prism(RING, 0.0, height)


@pytest.mark.parametrize(("where", "gap", "width"), [
    ("outside", 0.0, 5.0), ("holes", 0.0, 2.0), ("both", 0.5, 1.5), ("outside", 1.0, 0.3),
])
def test_brim_fills_its_width_from_its_gap_on_the_first_layer_only(where, gap, width):
    layers = layers_of(frame(), brim=Brim(where=where, gap_mm=gap, width_mm=width))
    assert [layer.index for layer in layers if not laid(layer, LOOPS).is_empty] == [0]
    found, part = laid(layers[0], LOOPS), outline(layers[0])
    reach = gap + max(BEAD, width)
    hole = shapely.box(-6, -4, 6, 4)
    asked = (part.buffer(reach, quad_segs=32) - part.buffer(gap, quad_segs=32)) & {
        "outside": part.envelope.buffer(99) - hole, "holes": hole, "both": part.envelope.buffer(99),
    }[where]
    assert part.distance(found) == pytest.approx(gap, abs=0.03)
    assert (found - asked.buffer(SPACING / 2 + 0.05)).area < 0.01
    assert (asked.buffer(-SPACING / 2 - 0.05) - found.buffer(0.03)).area < 0.01


def test_brim_goes_around_support_too():
    keys = {"support": Support(kind="straight"), "brim": Brim(width_mm=3.0)}
    layer = layers_of(table(across=12.0), **keys)[0]
    together = shapely.union_all([outline(layer), laid(layer)])
    assert laid(layer, LOOPS).contains(together.buffer(2.5, quad_segs=32) - together.envelope.buffer(0.05))


@pytest.mark.parametrize(("count", "loops", "gap"), [(1, 1, 3.0), (4, 2, 1.0)])
def test_skirt_surrounds_all_its_layers(count, loops, gap):
    """A part that grows wider upwards: the skirt is clear of all layers it stands beside."""
    part = joined(prism(shapely.box(-3, -3, 3, 3), 0.0, 2.0), prism(shapely.box(-7, -3, 3, 3), 0.6, 2.0))
    layers = layers_of(part, skirt_loops=loops, skirt_gap_mm=gap, skirt_layers=count)
    with_skirt = [layer for layer in layers if not laid(layer, LOOPS).is_empty]
    assert [layer.index for layer in with_skirt] == list(range(count))
    hull = shapely.union_all([outline(layer) for layer in with_skirt]).convex_hull
    for layer in with_skirt:
        found = laid(layer, LOOPS)
        assert len(list(lines(layer, LOOPS))) == loops
        assert found.distance(hull) == pytest.approx(gap, abs=0.03 + 0.025 * gap)      # arcs are made of chords
        for points, _, _ in lines(layer, LOOPS):
            assert shapely.Polygon(points).contains(hull)


def test_skirt_is_as_long_as_asked_and_surrounds_brim_and_support():
    keys = {"support": Support(kind="straight"), "brim": Brim(width_mm=2.0), "skirt_gap_mm": 2.0, "skirt_loops": 1}
    found = [layers_of(table(across=12.0), skirt_min_mm=least, **keys)[0] for least in (0.0, 300.0, 1000.0)]
    lengths = []
    for layer in found:
        loops = [shapely.LinearRing(points) for points, _, _ in lines(layer, LOOPS)]
        stands = shapely.union_all([outline(layer), laid(layer)]).buffer(2.0, quad_segs=32)
        around = [ring for ring in loops if ring.distance(stands) > 1.0]
        lengths.append(sorted(ring.length for ring in around))
        assert all(shapely.Polygon(ring).contains(stands) for ring in around)
    assert len(lengths[0]) == 1
    for least, found_lengths in zip((300.0, 1000.0), lengths[1:], strict=True):
        assert sum(found_lengths[:-1]) < least <= sum(found_lengths)


@pytest.mark.parametrize(("count", "dense", "gap", "margin"), [(1, 0, 0.1, 2.0), (4, 2, 0.25, 3.0), (2, 5, 0.0, 0.5)])
def test_raft_lifts_the_part_and_reaches_beyond_it(count, dense, gap, margin):
    keys = {"first_layer_mm": 0.3, "skirt_loops": 0}
    asked = Raft(layers=count, interface_layers=dense, gap_mm=gap, margin_mm=margin)
    plain, lifted = layers_of(frame(), **keys), layers_of(frame(), raft=asked, **keys)
    assert [layer.index for layer in lifted] == list(range(count + len(plain)))
    raft, part = lifted[:count], lifted[count:]
    for with_it, without in zip(part, plain, strict=True):
        assert with_it.z_mm == pytest.approx(without.z_mm + 0.3 + 0.2 * (count - 1) + gap)
        assert (with_it.beads.points == without.beads.points).all()
    assert part[0].z_mm - part[0].height_mm - raft[-1].z_mm == pytest.approx(gap)
    room = RING.envelope.buffer(margin, quad_segs=32)
    for k, layer in enumerate(raft):
        role = Role.SUPPORT_INTERFACE if k >= count - dense else Role.SUPPORT
        assert set(layer.beads.role) == {role}
        assert (layer.beads.island == -1).all()
        assert laid(layer).envelope.equals_exact(room.envelope, 0.03)
        assert (laid(layer) - room.buffer(0.03)).area < 0.01
        if role == Role.SUPPORT_INTERFACE:
            assert (room - laid(layer).buffer(0.1)).area < 0.01 * room.area
    assert all(a.z_mm < b.z_mm - b.height_mm + 1e-9 for a, b in pairwise(lifted))


@pytest.mark.parametrize("density", [0.25, 0.6])
def test_density_of_the_raft(density):
    asked = Raft(layers=3, interface_layers=0, density=density)
    part = prism(shapely.box(-30, -30, 30, 30), 0.0, 0.6)
    layer = layers_of(part, raft=asked)[1]
    volume = sum(
        np.linalg.norm(np.diff(points, axis=0), axis=1).sum() * bead_area(width, 0.2)
        for points, width, _ in lines(layer)
    )
    loop = 4 * 66 * 0.45
    assert volume / 0.2 == pytest.approx(density * (66**2 - loop) + loop, rel=0.08)


def test_support_stands_on_the_raft():
    keys = {"raft": Raft(layers=2, margin_mm=1.0), "support": Support(kind="straight")}
    layers = layers_of(table(across=12.0), **keys)
    assert supported(layers)[:3] == [0, 1, 2]
    assert laid(layers[1]).buffer(0.1).contains(laid(layers[2]))


def test_brim_and_raft_exclude_each_other(tmp_path):
    from cabslice.errors import ProfileError
    from cabslice.profile import shelf

    with pytest.raises(ProfileError, match=r"brim\.width_mm"):
        shelf.load_process("standard-0.4", ("brim.width_mm=3", "raft.layers=2"))
