"""Layers by slope and by range of height: heights against the cusp they leave, and values that hold in a range only."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import Mesh, bead_volume, prism, process, ring_area

from cabslice.errors import ProfileError
from cabslice.profile import shelf
from cabslice.profile.stand import Adaptive, Range
from cabslice.slicing.heights import heights_of, layer_heights
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part

RADIUS = 12.0


def ball(rings=180, around=24):
    """A sphere that stands on z = 0, of narrow bands between circles of latitude."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[1:-1]
    turn = 2 * np.pi * np.arange(around) / around
    circle = np.stack((np.cos(turn), np.sin(turn)), 1)
    points = np.concatenate([np.column_stack((np.cos(a) * circle, np.full(around, np.sin(a)))) for a in angle])
    points = np.concatenate((points, [[0, 0, -1], [0, 0, 1]]))
    low = np.arange((rings - 2) * around)
    side = low - low % around + (low + 1) % around
    faces = [np.stack((low, side, side + around), 1), np.stack((low, side + around, low + around), 1)]
    first, ahead = np.arange(around), (np.arange(around) + 1) % around
    last = (rings - 2) * around
    south, north = len(points) - 2, len(points) - 1
    faces += [np.stack((ahead, first, np.full(around, south)), 1),
              np.stack((first + last, ahead + last, np.full(around, north)), 1)]
    return Mesh(RADIUS * (points + np.array([0.0, 0.0, 1.0])), np.concatenate(faces), "ball")


def box(high=10.0):
    return prism(shapely.box(-6, -5, 6, 5), 0.0, high)


def whole(heights, part_mm):
    """Layers lie one on the other from the bed to within half a layer of the part's top."""
    assert heights.top == pytest.approx(np.cumsum(heights.height), abs=1e-9)
    assert abs(heights.top[-1] - part_mm) <= heights.height[-1] / 2 + 1e-9
    assert (heights.height > 0).all()


@pytest.mark.parametrize(("cusp", "least", "most"), [(0.05, 0.08, 0.3), (0.1, 0.05, 0.4), (0.02, 0.1, 0.2)])
def test_no_layer_of_a_ball_leaves_a_larger_cusp(cusp, least, most):
    """|n_z| of a sphere is |z - R| / R: the cusp is known without the mesh; and no layer is thinner than it must be."""
    asked = process(adaptive=Adaptive(cusp_mm=cusp, min_mm=least, max_mm=most), first_layer_mm=0.2)
    heights = heights_of(ball(), asked)
    whole(heights, 2 * RADIUS)
    height, bottom = heights.height[1:], heights.top[:-1]
    assert height.min() >= least - 1e-9
    assert height.max() <= most + 1e-9
    band = 2 * RADIUS * np.pi / 180   # facets are at most that high, as steep as their middle
    for low, high in zip(bottom, height, strict=True):
        steep = max(abs(low - RADIUS), abs(low + high - RADIUS)) / RADIUS
        slack = band / RADIUS
        if high > least + 1e-9:
            assert high * max(steep - slack, 0) <= cusp + 1e-9
        reach = min(max(abs(low - RADIUS), abs(low + most - RADIUS)) / RADIUS + slack, 1.0)
        assert high >= min(most, max(least, cusp / reach)) - least / 8 - 1e-9
    assert height.max() > 1.5 * height.min()


def test_steep_walls_and_level_faces_ask_for_nothing():
    heights = heights_of(box(9.9), process(adaptive=Adaptive(cusp_mm=0.01, min_mm=0.05, max_mm=0.3)))
    assert np.allclose(heights.height[1:], 0.3)
    whole(heights, 9.9)


def test_layers_alike_where_nothing_is_asked():
    plain, found = layer_heights(10.0, 0.2, 0.2), heights_of(box(), process())
    for name in ("top", "height", "plane"):
        assert (getattr(plain, name) == getattr(found, name)).all()


def test_layers_of_a_range_fit_it():
    asked = process(ranges=[Range(from_mm=2.0, to_mm=4.0, layer_mm=0.1), Range(from_mm=6.1, to_mm=7.0, layer_mm=0.35)])
    heights = heights_of(box(), asked)
    whole(heights, 10.0)
    for bound in (2.0, 4.0, 6.1, 7.0):
        assert np.abs(heights.top - bound).min() < 1e-9
    middle = heights.top - heights.height / 2
    own = heights.height[(middle > 2) & (middle < 4)]
    assert own == pytest.approx(np.full(20, 0.1))
    assert heights.height[(middle > 6.1) & (middle < 7)] == pytest.approx(np.full(3, 0.3))
    rest = heights.height[(middle < 2) | ((middle > 4) & (middle < 6.1)) | (middle > 7)]
    assert rest.max() <= 0.2 + 1e-9
    assert rest.min() > 0.1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 12), min_size=2, max_size=8, unique=True),
       st.lists(st.floats(0.03, 0.4), min_size=4, max_size=4), st.floats(0.05, 11))
def test_any_ranges_stack_without_gap(bounds, layers, high):
    bounds = sorted(bounds)
    ranges = [Range(from_mm=a, to_mm=max(b, 1e-3), layer_mm=h)
              for a, b, h in zip(bounds[::2], bounds[1::2], layers, strict=False)]
    heights = heights_of(box(high), process(ranges=ranges))
    assert heights.top == pytest.approx(np.cumsum(heights.height), abs=1e-9)
    assert heights.height.max() <= 0.4 + 1e-9
    assert heights.height.min() > 0.014
    assert (np.diff(heights.plane) > 0).all()
    if high > 0.2:
        assert abs(heights.top[-1] - high) <= max(heights.height[-1], 0.4) / 2 + 1e-6


def test_walls_and_infill_of_a_range():
    asked = process(infill=0.2, pattern="grid", top_layers=0, bottom_layers=0, ranges=[
        Range(from_mm=1.0, to_mm=2.0, walls=4), Range(from_mm=3.0, to_mm=4.0, infill=0.6),
    ])
    layers = list(slice_part(prism(shapely.box(-15, -12, 15, 12), 0.0, 5.0), asked, nozzle_mm=0.4))
    for layer in layers[1:]:
        middle = layer.z_mm - layer.height_mm / 2
        loops = int(np.isin(layer.beads.role, (Role.OUTER_WALL, Role.INNER_WALL)).sum())
        assert loops == (4 if 1 < middle < 2 else 2)
        walls = 4 if 1 < middle < 2 else 2
        inside = (30 - 2 * walls * 0.43) * (24 - 2 * walls * 0.43) * layer.height_mm
        share = bead_volume(layer, (Role.SPARSE_INFILL,)) / inside
        assert share == pytest.approx(0.6 if 3 < middle < 4 else 0.2, rel=0.1)


def test_beads_of_uneven_layers_hold_what_the_sections_do():
    asked = process(adaptive=Adaptive(cusp_mm=0.08, min_mm=0.1, max_mm=0.35))
    layers = list(slice_part(ball(90), asked, nozzle_mm=0.4))
    assert len({round(layer.height_mm, 3) for layer in layers}) > 5
    held = sum(bead_volume(layer) for layer in layers)
    part = sum(ring_area(layer.outline.points, layer.outline.starts) * layer.height_mm for layer in layers)
    assert held / part == pytest.approx(1, abs=0.015)
    assert part == pytest.approx(np.pi * 4 / 3 * RADIUS**3, rel=0.02)


@pytest.mark.parametrize(("sets", "said"), [
    (["adaptive.max_mm=0.6"], "adaptive.max_mm"), (["adaptive.min_mm=0.3"], "adaptive.min_mm"),
    (["ranges=[{from_mm=2, to_mm=1}]"], "ranges.1.to_mm"),
    (["ranges=[{from_mm=0, to_mm=2}, {from_mm=1, to_mm=3}]"], "ranges.2.from_mm"),
    (["ranges=[{from_mm=0, to_mm=2, layer_mm=0.9}]"], "ranges.1.layer_mm"),
    (["ranges=[{from_mm=0, to_mm=2, layers=0.1}]"], "ranges.1.layers"),
])
def test_wrong_heights_are_named(sets, said):
    with pytest.raises(ProfileError) as caught:
        shelf.load_process("standard-0.4", sets)
    assert said in str(caught.value)


def test_infill_of_several_layers_at_once_is_no_higher_than_the_nozzle_where_layers_differ():
    keys = {"infill": 0.3, "infill_every": 3, "layer_mm": 0.1, "first_layer_mm": 0.1, "top_layers": 1}
    asked = process(ranges=[Range(from_mm=1.0, to_mm=2.0, layer_mm=0.2)], **keys)
    layers = list(slice_part(prism(shapely.box(-10, -9, 10, 9), 0.0, 3.0), asked, nozzle_mm=0.4))
    held = sum(bead_volume(layer) for layer in layers)
    plain = sum(bead_volume(layer) for layer in slice_part(
        prism(shapely.box(-10, -9, 10, 9), 0.0, 3.0), process(**keys | {"infill_every": 1}), nozzle_mm=0.4))
    assert held / plain == pytest.approx(1, abs=0.05)
    assert max(float(layer.beads.height.max(initial=0)) for layer in layers) <= 0.4 + 1e-9
