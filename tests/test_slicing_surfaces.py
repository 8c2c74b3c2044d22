"""Skins: where they are, which way they run, how thick they are on slopes, and ironing."""

import numpy as np
import pytest
import shapely
from raster_judge import segments
from slicing_kit import Mesh, bead_volume, joined, prism, process, shape_of
from toolpath_samples import PLA

from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part
from cabslice.toolpath.order import lay_toolpath

STEP = joined(prism(shapely.box(0, 0, 30, 20), 0, 2), prism(shapely.box(0, 0, 15, 20), 2, 4))


def sliced(mesh, **changes):
    return list(slice_part(mesh, process(**{"infill": 0.2, "skirt_loops": 0, **changes}), nozzle_mm=0.4))


def cone(low=14.0, high=4.0, height=6.0, count=48):
    """A frustum."""
    turn = np.arange(count) * 2 * np.pi / count
    circle = np.stack((np.cos(turn), np.sin(turn)), 1)
    bottom, top = (np.column_stack((r * circle, np.full(count, z))) for r, z in ((low, 0.0), (high, height)))
    k, ahead = np.arange(count), (np.arange(count) + 1) % count
    ends = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    faces = np.concatenate([np.stack(rows, 1) for rows in (
        (k, ahead, ahead + count), (k, ahead + count, k + count),
        (ahead, k, ends[0]), (k + count, ahead + count, ends[1]),
    )])
    return Mesh(np.vstack((bottom, top, [(0, 0, 0), (0, 0, height)])), faces)


@pytest.mark.parametrize(("top", "bottom"), [(4, 4), (2, 5), (1, 1)])
def test_slopes_keep_the_thickness_of_the_shell(top, bottom):
    """Straight up and down from any point of the surface, as many layers are solid as are asked for.

    On a flat slope (59 deg from upright) walls alone would leave holes: two of them cover 0.86 mm of the 0.33 mm by
    which each layer is smaller, per layer.
    """
    layers = sliced(cone(), top_layers=top, bottom_layers=bottom)
    for layer in layers[bottom + 1:-1]:
        sparse = [shapely.LineString([p, q]).buffer(0.1) for p, q, _ in segments(layer, {Role.SPARSE_INFILL})]
        above = [layers[k] for k in range(layer.index, min(layer.index + top + 1, len(layers)))]
        if len(above) <= top:
            assert not sparse
            continue
        covered = shape_of(above[-1].outline.points, above[-1].outline.starts)
        hidden = shapely.union_all(sparse) if sparse else shapely.Polygon()
        assert hidden.difference(covered.buffer(0.05)).area < 1e-6       # nothing hollow under fewer layers than asked
        solid = [shapely.LineString([p, q]).buffer(w / 2 + 0.06) for p, q, w in segments(layer)]
        ring = shape_of(layer.outline.points, layer.outline.starts).difference(covered.buffer(0.3))
        ring = ring.buffer(-0.1)
        if ring.area > 1:
            filled = shapely.union_all(solid).intersection(ring).area / ring.area
            assert filled > 0.97, layer.index


def test_skin_angle_turns_skins_and_leaves_infill():
    """Skin lines alternate between 20 and 110 deg, infill stays at its own angle."""
    for layer in sliced(STEP, skin_angle_deg=20.0, infill_angle_deg=45.0, pattern="aligned"):
        for roles, angles in (({Role.SOLID_INFILL, Role.TOP_SKIN}, (20.0, 110.0)[layer.index % 2]),
                              ({Role.SPARSE_INFILL}, 45.0)):
            lines = [(q - p) for p, q, _ in segments(layer, roles) if np.hypot(*(q - p)) > 5]
            found = np.degrees([np.arctan2(step[1], step[0]) for step in lines]) % 180
            along = np.abs((found - angles + 90) % 180 - 90) < 0.01
            edge = np.abs((found + 45) % 90 - 45) < 0.01                 # links along the straight edges
            assert (along | edge).all()
            assert not lines or along.any()


@pytest.mark.parametrize(("spacing", "flow"), [(0.1, 0.15), (0.2, 0.3)])
def test_ironing_covers_top_skins_with_what_is_asked(spacing, flow):
    layers = sliced(STEP, ironing={"enabled": True, "spacing_mm": spacing, "flow": flow})
    ironed = [layer.index for layer in layers if Role.IRONING in layer.beads.role]
    assert ironed == [layer.index for layer in layers if Role.TOP_SKIN in layer.beads.role] == [9, 19]
    for index in ironed:
        lines = segments(layers[index], {Role.IRONING})
        skin = shapely.union_all([shapely.LineString([p, q]).buffer(w / 2) for p, q, w in
                                  segments(layers[index], {Role.TOP_SKIN})])
        over = shapely.union_all([shapely.LineString([p, q]).buffer(spacing / 2 + 1e-6) for p, q, _ in lines])
        inner = skin.buffer(-0.6)
        assert inner.difference(over.buffer(0.02)).area < 0.01 * inner.area
        assert over.difference(skin.buffer(0.05)).area < 1e-6
        held = bead_volume(layers[index], {Role.IRONING})
        assert held == pytest.approx(flow * 0.2 * over.area, rel=0.06)
        long = [(q - p) for p, q, _ in lines if np.hypot(*(q - p)) > 3]
        skins = [(q - p) for p, q, _ in segments(layers[index], {Role.TOP_SKIN}) if np.hypot(*(q - p)) > 5]
        assert abs(long[5] @ skins[5]) < 1e-6 * np.hypot(*long[5]) * np.hypot(*skins[5])     # across the skin's lines
    assert not any(Role.IRONING in layer.beads.role for layer in sliced(STEP))


def test_ironing_comes_last_at_its_own_speed():
    asked = process(infill=0.2, skirt_loops=0, ironing={"enabled": True})
    asked = asked.model_copy(update={"speeds_mm_s": asked.speeds_mm_s.model_copy(update={"ironing": 17.0})})
    path = lay_toolpath(slice_part(STEP, asked, nozzle_mm=0.4), asked, PLA, filament_diameter_mm=1.75)
    ironing = path.role == Role.IRONING
    assert set(path.speed[ironing]) == {17.0}
    for layer in (9, 19):
        mine = np.flatnonzero((path.layer == layer) & (path.role != Role.TRAVEL))
        first = np.argmax(ironing[mine])
        assert ironing[mine[first:]].all()
