"""Where outer walls begin and in which order walls are laid, read from the finished path."""

import numpy as np
import pytest
import shapely
from toolpath_samples import PLA, circle, layer, line, process

from cabslice.slicing.layer import Role
from cabslice.toolpath.order import lay_toolpath

ELL = np.array([(0, 0), (30, 0), (30, 8), (8, 8), (8, 24), (0, 24)], float)     # concave at (8, 8), rear at y = 24


def walls(count=6, outer=None):
    """Layers of an L, or of the given rings, two walls each."""
    made = []
    for index in range(count):
        points = ELL if outer is None else outer(index)
        inner = np.array(shapely.Polygon(points).buffer(-0.45, join_style="mitre").exterior.coords)[:-1]
        both = line(inner, Role.INNER_WALL, closed=True), line(points, Role.OUTER_WALL, closed=True)
        made.append(layer(both, index))
    return made


def seams(layers, **keys):
    """(L, 2) where the outer wall of each layer begins."""
    path = lay_toolpath(layers, process(**keys), PLA, filament_diameter_mm=1.75)
    outer = path.role == Role.OUTER_WALL
    return np.array([path.xyz[np.flatnonzero(outer & (path.layer == k))[0] - 1, :2] for k in range(len(layers))])


def test_hidden_seams_are_in_the_concave_corner():
    np.testing.assert_allclose(seams(walls(), seam="hidden"), [(8, 8)] * 6, atol=1e-6)


def test_rear_seams_are_at_the_largest_y():
    assert (seams(walls(), seam="rear")[:, 1] == 24).all()
    round_ones = walls(outer=lambda k: circle(0, 0, 10, phase=0.37 * k)[0])
    found = seams(round_ones, seam="rear")
    np.testing.assert_allclose(found[:, 1], [one.beads.points[:, 1].max() for one in round_ones])


def test_aligned_seams_stay_in_a_line():
    """A round wall whose corners wander: aligned seams do not follow them."""
    rings = walls(40, lambda k: circle(0, 0, 10, phase=0.1 * k)[0])
    steps = np.linalg.norm(np.diff(seams(rings, seam="aligned"), axis=0), axis=1)
    assert steps.max() < 1.0


def test_nearest_seams_begin_where_the_layer_before_ended():
    layers = [layer([circle(0, 0, 10, phase=0.37 * k), line([(0, 0), (2, 0.1 * k)])], k) for k in range(6)]
    path = lay_toolpath(layers, process(seam="nearest"), PLA, filament_diameter_mm=1.75)
    for k in range(1, 6):
        begin = np.flatnonzero((path.role == Role.OUTER_WALL) & (path.layer == k))[0] - 1
        left = path.xyz[np.flatnonzero((path.role != Role.TRAVEL) & (path.layer == k - 1))[-1], :2]
        ring = shapely.LinearRing(layers[k].beads.points[:120])
        gap = np.linalg.norm(path.xyz[begin, :2] - left)
        assert gap == pytest.approx(ring.distance(shapely.Point(left)), abs=0.06)


def test_random_seams_are_spread_evenly_and_the_same_in_every_print():
    layers = walls(400, lambda k: circle(0, 0, 10)[0])
    found = seams(layers, seam="random")
    np.testing.assert_array_equal(found, seams(layers, seam="random"))
    angle = np.sort(np.arctan2(found[:, 1], found[:, 0]) / (2 * np.pi) + 0.5)
    off = np.abs(angle - (np.arange(400) + 0.5) / 400).max()
    assert off < 1.63 / np.sqrt(400)             # Kolmogorov-Smirnov, 1 %


@pytest.mark.parametrize("outer_first", [False, True])
def test_which_wall_comes_first(outer_first):
    path = lay_toolpath(walls(), process(outer_wall_first=outer_first), PLA, filament_diameter_mm=1.75)
    for k in range(6):
        role = path.role[path.layer == k]
        order = list(dict.fromkeys(role[role != Role.TRAVEL].tolist()))
        assert order == ([Role.OUTER_WALL, Role.INNER_WALL] if outer_first else [Role.INNER_WALL, Role.OUTER_WALL])
