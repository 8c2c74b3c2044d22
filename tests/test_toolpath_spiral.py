"""A vase is one line from its floor to its rim, holds the volume of its wall, and never jumps."""

import numpy as np
import pytest
import shapely
from slicing_kit import joined, prism
from slicing_kit import process as slicing_process
from toolpath_samples import PLA

from cabslice.errors import ModelError
from cabslice.slicing.flow import bead_area
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.order import lay_toolpath

HEIGHT, FLOORS = 4.0, 3


def cup(shape, slope=0.05):
    mesh = prism(shape, 0, HEIGHT)
    mesh.vertices[:, :2] *= 1 + slope * mesh.vertices[:, 2:] / HEIGHT
    return mesh


def vase(mesh, **changes):
    asked = slicing_process(spiral=True, infill=0.2, bottom_layers=FLOORS, skirt_loops=0, **changes)
    layers = list(slice_part(mesh, asked, nozzle_mm=0.4))
    return layers, lay_toolpath(layers, asked, PLA, filament_diameter_mm=1.75)


@pytest.mark.parametrize("shape", [shapely.Point(0, 0).buffer(15), shapely.box(-15, -9, 15, 9),
                                   shapely.Point(0, 0).buffer(15).difference(shapely.Point(3, 0).buffer(5))])
def test_a_vase_is_one_line(shape):
    layers, path = vase(cup(shape))
    assert find_faults(path) == ()
    wall = np.flatnonzero(path.layer >= FLOORS)
    wall = wall[np.argmax(path.role[wall] == Role.OUTER_WALL):]
    assert set(path.role[wall]) == {Role.OUTER_WALL}               # nothing between its first and its last bead
    assert path.starts[-1] == wall[-1] + 1                         # and no stop
    assert path.starts[-2] <= wall[0]
    assert path.layer[wall[-1]] == layers[-1].index
    z = path.xyz[wall, 2]
    assert np.diff(z).min() >= -1e-9
    assert z[-1] == pytest.approx(HEIGHT)
    assert path.xyz[wall[0] - 1, 2] == pytest.approx(0.2 * FLOORS)
    slope = np.diff(path.xyz[wall, 2]) / path.lengths[wall[1:]]    # even: 0.2 mm over each ring, but for the rim
    rim = path.layer[wall[1:]] < layers[-1].index
    ring = 0.2 / slope[rim]
    assert ring.max() / ring.min() < 1.06
    volume = float((bead_area(path.width, path.height) * path.lengths)[wall].sum())
    rings = [shapely.LinearRing(layer.beads.points) for layer in layers[FLOORS:]]
    assert path.filament[wall].sum() * path.filament_area_mm2 == pytest.approx(volume, rel=1e-9)
    exact = sum(one.length for one in rings) * float(bead_area(0.45, 0.2))
    assert volume == pytest.approx(exact, rel=0.02)
    for row in wall[::17]:                                         # between its own ring and the one below
        k = int(path.layer[row])
        gap = shapely.Point(path.xyz[row, :2]).distance(rings[k - FLOORS])
        assert gap < 0.05 * 15 * 0.2 / HEIGHT * 1.5 + 0.01


def test_floors_are_solid_and_the_rest_is_empty():
    layers, _ = vase(cup(shapely.box(-15, -9, 15, 9)))
    for layer in layers:
        found = {Role(role) for role in layer.beads.role}
        if layer.index < FLOORS:
            assert Role.SOLID_INFILL in found
            assert Role.SPARSE_INFILL not in found
        else:
            assert found == {Role.OUTER_WALL}
            assert len(layer.beads.role) == 1


def test_the_rim_is_where_the_part_ends():
    layers, path = vase(cup(shapely.box(-15, -9, 15, 9)), top_layers=2)
    assert len(layers) == 20
    assert path.xyz[:, 2].min() >= 0.2 - 1e-9


def test_a_part_with_two_towers_is_no_vase():
    towers = joined(prism(shapely.box(0, 0, 9, 9), 0, 3), prism(shapely.box(20, 0, 29, 9), 0, 3))
    with pytest.raises(ModelError, match=r"z = 0\.80 mm, found 2 outlines"):
        vase(towers)
    with pytest.raises(ModelError, match="narrower"):
        vase(prism(shapely.box(0, 0, 9, 0.3), 0, 3))
