"""Plane cuts against solids whose sections are known, and against each other."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from slicing_kit import Mesh, joined, prism, prisms, region_of, ring_area, shapes

from cabslice.mesh.load import load_mesh
from cabslice.slicing import sections
from cabslice.slicing.heights import layer_heights
from cabslice.slicing.region import from_rings
from cabslice.slicing.sections import cut

MODELS = Path(__file__).parents[2] / "shared" / "models"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")


def areas(mesh, planes, **options):
    return [from_rings(*rings, **options).area() for rings in cut(mesh.vertices, mesh.faces, np.asarray(planes, float))]


@settings(max_examples=40, deadline=None)
@given(shapes(), st.lists(st.floats(-1, 3), min_size=1, max_size=8, unique=True))
def test_prism_sections_are_the_polygon(shape, planes):
    planes = sorted(planes)
    mesh = prisms(shape, 0.0, 2.0)
    for z, area in zip(planes, areas(mesh, planes), strict=True):
        # a vertex on the plane counts as above it: the lid at z = 2 is still cut, the foot at 0 is not
        assert area == pytest.approx(shape.area if 0 < z <= 2 else 0, rel=1e-6, abs=1e-6)


def stairs(steps):
    """A pyramid of square steps of height 1 on top of each other, as one body with coplanar faces on every plane."""
    return joined(*[prism(shapely.box(-side, -side, side, side), k, k + 1) for k, side in enumerate(steps)])


def test_faces_in_the_plane_follow_the_layer_below():
    steps = [5.0, 3.0, 4.0, 1.0]                # an overhang too
    mesh = stairs(steps)
    exact = [4 * side**2 for side in steps]
    assert areas(mesh, [1.0, 2.0, 3.0, 4.0]) == pytest.approx(exact)
    assert areas(mesh, [0.0, 4.0 + 1e-9]) == [0, 0]


@settings(max_examples=25, deadline=None)
@given(st.floats(0.5, 50), st.integers(3, 60), st.lists(st.floats(0.01, 0.99), min_size=1, max_size=9, unique=True))
def test_cone_sections(radius, sides, shares):
    turn = 2 * np.pi * np.arange(sides) / sides
    foot = np.column_stack((radius * np.cos(turn), radius * np.sin(turn), np.zeros(sides)))
    vertices = np.concatenate((foot, [[0, 0, 0], [0, 0, 10]]))
    loop, ahead = np.arange(sides), np.roll(np.arange(sides), -1)
    middle, tip = np.full(sides, sides), np.full(sides, sides + 1)
    faces = np.concatenate((np.stack((ahead, loop, middle), 1), np.stack((loop, ahead, tip), 1)))
    planes = 10 * np.sort(shares)
    polygon = sides / 2 * radius**2 * np.sin(2 * np.pi / sides)
    exact = polygon * (1 - planes / 10) ** 2
    np.testing.assert_allclose(areas(Mesh(vertices, faces), planes), exact, rtol=1e-6, atol=1e-7)


def test_sphere_sections_and_volume():
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=10)
    mesh = Mesh(ball.vertices, ball.faces)
    planes = np.linspace(-9.9, 9.9, 199)
    found = np.array(areas(mesh, planes))
    np.testing.assert_allclose(found, np.pi * (100 - planes**2), atol=0.5)
    thick = 20 / 4000
    fine = areas(mesh, -10 + thick * (np.arange(4000) + 0.5))
    assert sum(fine) * thick == pytest.approx(ball.volume, rel=1e-5)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_overlapping_bodies_are_their_union(seed):
    """Sections of bodies that intersect are the union of their sections (shapely is the other method)."""
    rng = np.random.default_rng(seed)
    parts = [shapely.box(*low, *(low + rng.uniform(1, 6, 2))) for low in rng.uniform(-5, 5, (5, 2))]
    mesh = joined(*[prism(part, -k, 1.0 + k) for k, part in enumerate(parts)])
    assert areas(mesh, [0.5]) == pytest.approx([shapely.union_all(parts).area], rel=1e-7)


def test_boxes_sharing_an_edge_are_cut_like_two():
    mesh = joined(prism(shapely.box(0, 0, 2, 2), 0, 2), prism(shapely.box(2, 2, 4, 4), 0, 2))
    vertices, inverse = np.unique(mesh.vertices, axis=0, return_inverse=True)
    mesh = Mesh(vertices, inverse.reshape(-1)[mesh.faces])        # the edge at (2, 2) now has four faces
    assert areas(mesh, [0.5, 1.0]) == pytest.approx([8, 8])


def test_an_open_mesh_is_an_error():
    mesh = prism(shapely.box(0, 0, 2, 2), 0, 2)
    with pytest.raises(ValueError, match="not closed"):
        list(cut(mesh.vertices, mesh.faces[:-1], np.array([1.0])))


@needs_models
@pytest.mark.parametrize("name", ["benchy", "bridgetest"])
def test_blocks_do_not_change_the_result(name, monkeypatch):
    part = load_mesh(MODELS / f"{name}.stl")
    planes = layer_heights(part.bounds[1, 2], 0.2, 0.2).plane
    whole = list(cut(part.vertices, part.faces, planes))
    monkeypatch.setattr(sections, "BLOCK", 7000)
    for (points, starts), (again, starts_again) in zip(whole, cut(part.vertices, part.faces, planes), strict=True):
        np.testing.assert_array_equal(starts, starts_again)
        np.testing.assert_array_equal(points, again)


@needs_models
def test_sections_add_up_to_the_volume():
    """bunny_flat does not intersect itself: the sum of its sections is its volume."""
    from cabslice.mesh.topology import signed_volumes

    part = load_mesh(MODELS / "bunny_flat.stl")
    planes = layer_heights(part.bounds[1, 2], 0.2, 0.2).plane
    total = 0.2 * sum(ring_area(*rings) for rings in cut(part.vertices, part.faces, planes))
    assert total == pytest.approx(signed_volumes(part.vertices, part.faces).sum(), rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.002, 0.1))
def test_simplified_outlines_stay_within_the_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(20, 2000)))
    radius = 10 + sum(rng.normal(0, 0.5) * np.cos(k * turn + rng.uniform(0, 6)) for k in range(1, 7))
    curve = radius[:, None] * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    region = from_rings(curve, np.array([0, len(curve)]), simplify_mm=tolerance)
    line = shapely.LinearRing(region.to_polygons()[0])
    assert shapely.distance(shapely.points(curve), line).max() <= tolerance
    assert region.num_vert() <= len(curve)


@given(st.floats(0.01, 500), st.floats(0.05, 2), st.floats(0.05, 2))
def test_layers_end_within_half_a_layer_of_the_part(part, first, layer):
    heights = layer_heights(part, first, layer)
    assert (heights.plane < part).all()
    assert (heights.plane > 0).all()
    np.testing.assert_allclose(np.diff(heights.top), layer)
    np.testing.assert_allclose(heights.top[0], first)
    if len(heights.top) > 1:
        assert abs(heights.top[-1] - part) <= layer / 2 + 1e-6


def test_whole_numbers_of_layers_are_not_lost_to_rounding():
    assert len(layer_heights(48.0, 0.2, 0.2).top) == 240
    assert len(layer_heights(20.0, 0.3, 0.1).top) == 198
    assert len(layer_heights(0.6, 0.2, 0.2).top) == 3


def test_region_of_the_kit_is_the_shape():
    shape = shapely.box(0, 0, 5, 5).difference(shapely.box(1, 1, 2, 2))
    assert region_of(shape).area() == pytest.approx(shape.area)
