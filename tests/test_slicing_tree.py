"""Branches of tree support: they stand, keep clear, lean no further than they may, meet, and grow thicker downwards."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from slicing_kit import joined, prism, prisms, shapes
from support_kit import farthest, laid, layers_of, outline, supported, table
from test_slicing_support import HEIGHT, keeps_clear

from cabslice.mesh.load import load_mesh
from cabslice.mesh.place import place
from cabslice.profile.stand import Tree

MODELS = Path(__file__).parents[2] / "shared" / "models"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")


def grown(part, *, tree=None, **keys):
    return layers_of(part, kind="tree", tree=Tree(**(tree or {})), **keys)


def branches(layer):
    """The branches of a layer, hollow as they are, as full shapes."""
    found = laid(layer)
    return [shapely.Polygon(one.exterior) for one in getattr(found, "geoms", [found]) if not one.is_empty]


def no_branch_floats(layers, gap=0.5, bottom=0.2, bed=False, apart=3.5):
    """Each lies on those of the layer below, no place of it much further than tips are apart (3 mm) from where it does.

    Or it lies on the part not further down than the gap, if it need not reach the bed.
    """
    down = int(np.ceil(bottom / HEIGHT - 1e-6)) + 1
    parts, below = [outline(layer).buffer(gap + 0.5) for layer in layers], None
    for k in supported(layers):
        here = branches(layers[k])
        for one in here if k else ():
            held = one.intersection(below)
            on_part = not bed and any(one.intersects(part) for part in parts[max(0, k - down):k])
            rests = held.area > 0.15 * min(one.area, 0.5) and farthest(one, held, 0.2) < apart
            assert rests or on_part, (k, one.centroid, one.area)
        below = shapely.union_all(here)


@pytest.mark.parametrize("where", ["everywhere", "bed"])
def test_branches_keep_clear_and_stand(where):
    part = joined(
        prism(shapely.box(-2, -6, 2, 6), 0.0, 12.0), prism(shapely.box(-10, -8, 0, 8), 0.0, 3.0),
        prism(shapely.box(-13, -6, 13, 6), 10.0, 12.0),
    )
    layers = grown(part, where=where, bottom_gap_mm=0.4)
    keeps_clear(layers, 0.5, 0.2, 0.4)
    no_branch_floats(layers, bottom=0.4, bed=where == "bed")
    step = shapely.box(-10, -8, 0, 8)
    on_step = any(one.within(step) for k in range(20) for one in branches(layers[k]))
    assert on_step == (where == "everywhere")
    assert any(one.centroid.x < -10 for one in branches(layers[3])), "the left side is reached around the step"


def test_tips_reach_every_overhang_and_are_as_thick_as_asked():
    tree = {"tip_mm": 1.2, "tip_distance_mm": 4.0, "taper_deg": 0.0, "branch_angle_deg": 0.0}
    layers = grown(table(4.0, 24.0), tree=tree, interface_layers=0)
    tips = branches(layers[supported(layers)[-1]])
    assert layers[supported(layers)[-1]].z_mm == pytest.approx(3.8)
    middles = np.array([one.centroid.coords[0] for one in tips])
    thick = [2 * np.sqrt(one.area / np.pi) for one in tips if one.envelope.within(shapely.box(-12, -12, 12, 12))]
    assert np.allclose(thick, 1.2, atol=0.06)
    gaps = np.linalg.norm(middles[:, None] - middles[None], axis=2) + 99 * np.eye(len(middles))
    assert gaps.min() > 0.7 * 4.0 - 0.05
    x, y = np.meshgrid(np.arange(-12, 12.1, 0.5), np.arange(-12, 12.1, 0.5))
    hung = np.column_stack((x.ravel(), y.ravel()))
    hung = hung[np.abs(hung).max(1) > 2 + 0.5 + 0.6]                   # beside the leg there is no room for a tip
    assert np.linalg.norm(hung[:, None] - middles[None], axis=2).min(1).max() < 4.0


@pytest.mark.parametrize(("taper", "thickest"), [(0.0, 8.0), (6.0, 8.0), (20.0, 3.0)])
def test_branches_grow_thicker_downwards(taper, thickest):
    knob = joined(prism(shapely.box(-8, -2, -4, 2), 0.0, 12.0), prism(shapely.box(-5, -0.5, 0.5, 0.5), 10.0, 12.0))
    tree = {"taper_deg": taper, "thickest_mm": thickest, "tip_distance_mm": 30.0, "branch_angle_deg": 0.0}
    layers = grown(knob, tree=tree, interface_layers=0)
    top = supported(layers)[-1]
    for k in (0, 20, 45):
        [one] = branches(layers[k])
        length = layers[top].z_mm - layers[k].z_mm
        across = min(0.8 + 2 * length * np.tan(np.radians(taper)), thickest)
        assert 2 * np.sqrt(one.area / np.pi) == pytest.approx(across, abs=0.08 + 0.03 * across)


@pytest.mark.parametrize("lean", [0.0, 20.0, 45.0])
def test_branches_lean_no_further_than_asked_and_meet(lean):
    layers = grown(table(9.0, 16.0), tree={"branch_angle_deg": lean, "taper_deg": 0.0, "tip_distance_mm": 4.0},
                   interface_layers=0)
    step = HEIGHT * np.tan(np.radians(lean))
    counts = []
    for k in supported(layers):
        here = branches(layers[k])
        counts.append(len(here))
        if k:
            below = shapely.union_all(branches(layers[k - 1]))
            # of two that meet, one goes its way, and half that or half the other's radius more
            assert all((one - below.buffer(step + max(step / 2, 0.2) + 0.03)).area < 0.02 for one in here)
    no_branch_floats(layers, bed=True)
    assert (counts[0] == counts[-1]) if lean == 0 else (counts[0] < counts[-1] * (0.8 if lean < 30 else 0.5))


def test_a_tree_takes_less_than_straight_support():
    straight, tree = (
        sum(laid(layer).area for layer in layers_of(table(12.0, 20.0), kind=kind)) for kind in ("straight", "tree")
    )
    assert tree < 0.7 * straight


@needs_models
def test_branches_of_a_real_part():
    layers = grown(place(load_mesh(MODELS / "overhang.stl")))
    keeps_clear(layers, 0.5, 0.2, 0.2)
    no_branch_floats(layers)


@settings(max_examples=10, deadline=None)
@given(shapes(16.0), shapes(10.0))
def test_branches_of_any_shape(upper, lower):
    part = joined(prisms(lower, 0.0, 2.0), prisms(upper, 1.8, 2.4))
    layers = grown(part, interface_layers=1)
    keeps_clear(layers, 0.5, 0.2, 0.2)
    no_branch_floats(layers)
