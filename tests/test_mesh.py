"""Loading and mending: what comes out is closed and faces outwards, with words for what was changed or refused."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice.errors import ModelError, UsageError
from cabslice.mesh.load import load_mesh
from cabslice.mesh.mend import mend
from cabslice.mesh.place import place, turn_matrix
from cabslice.mesh.topology import bodies, edge_balance, signed_volumes, weld, winding_number

MODELS = Path(__file__).parents[2] / "shared" / "models"
SAMPLES = Path(__file__).parents[1] / "samples"
BROKEN = sorted(MODELS.glob("broken/*")) if MODELS.exists() else []
REFUSED = {
    "empty_file", "invalid_stl_ascii", "text_file", "plane", "plane_flat", "soup", "vertical_line", "zero_size_cube",
}
UNTOUCHED = {"busted", "subdivided_cube", "too_large"}
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")


def volume(vertices, faces):
    return float(signed_volumes(vertices, faces).sum())


def box(low, high, cuts=1):
    """Triangles of a box, each side cut into 2 cuts^2 triangles."""
    low, high = np.array(low, float), np.array(high, float)
    t = np.linspace(0, 1, cuts + 1)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            for i in range(cuts):
                for j in range(cuts):
                    corner = np.zeros((4, 3))
                    corner[:, axis] = side
                    corner[:, u] = t[[i, i + 1, i + 1, i]]
                    corner[:, v] = t[[j, j, j + 1, j + 1]]
                    corner = corner if side else corner[::-1]
                    triangles += [corner[[0, 1, 2]], corner[[0, 2, 3]]]
    return low + np.array(triangles) * (high - low)


def is_closed(vertices, faces):
    return len(edge_balance(faces, len(vertices))[0]) == 0


@needs_models
@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_broken_file_is_mended_in_sentences_or_refused_with_one(path):
    if path.stem in REFUSED:
        with pytest.raises(ModelError) as refusal:
            load_mesh(path)
        assert path.name in refusal.value.sentence
        assert refusal.value.exit_code == 3
        return
    part = load_mesh(path)
    assert is_closed(part.vertices, part.faces)
    assert volume(part.vertices, part.faces) > 0
    assert bool(part.repairs) == (path.stem not in UNTOUCHED)
    assert all(sentence.endswith(".") and any(c.isdigit() for c in sentence) for sentence in part.repairs)


@needs_models
def test_known_volumes_of_broken_files():
    for name, whole, least in (
        ("cube_missing_corner", 51.19906**3, 0.96), ("missing_triangle", 1000, 1.0), ("moved_plane", 1000, 1.0),
        ("cube_and_plane", 1000, 1.0), ("extra_surface", 10239.52, 1.0), ("open_cube_stuck_to_side", 9000, 1.0),
    ):
        part = load_mesh(MODELS / "broken" / f"{name}.stl")
        held = volume(part.vertices, part.faces)
        assert least * whole * (1 - 1e-6) <= held <= whole * (1 + 1e-6), name
        assert f"{held:.6g} mm3" in part.repairs[-1]


@needs_models
def test_benchy_stays_whole_and_inches_are_inches():
    benchy = load_mesh(MODELS / "benchy.stl")
    assert benchy.faces.shape == (225_146, 3)          # 8 of 225,154 have no area
    assert is_closed(benchy.vertices, benchy.faces)
    data = (MODELS / "benchy.stl").read_bytes()
    assert benchy.sha256 == hashlib.sha256(data).hexdigest()
    feature = load_mesh(MODELS / "featuretype.stl", unit="inch", scale=2)
    np.testing.assert_allclose(np.ptp(feature.bounds, axis=0), 2 * 25.4 * np.array([5, 2.5, 1.375]), rtol=1e-6)


@needs_models
def test_a_part_in_metres_is_noticed():
    assert "--unit" in load_mesh(MODELS / "broken/bunny_holes.stl").warnings[0]
    assert not load_mesh(MODELS / "broken/bunny_holes.stl", unit="m").warnings


@settings(max_examples=40, deadline=None)
@given(st.sets(st.integers(0, 107), min_size=1, max_size=30), st.integers(0, 2**32 - 1))
def test_holes_in_flat_sides_are_filled_without_changing_the_volume(missing, seed):
    whole = box((-3, 0, 2), (4, 5, 9), cuts=3)
    kept = np.delete(whole, sorted(missing), axis=0)
    np.random.default_rng(seed).shuffle(kept)
    vertices, faces, repairs = mend(kept, "box")
    assert is_closed(vertices, faces)
    across_edges = abs(volume(vertices, faces) - 7 * 5 * 7)
    # a hole over an edge or a corner of the box may lose or win what lies between its rim and the edge
    assert across_edges <= len(missing) * (7 / 3) ** 3 / 2
    assert "Closed" in repairs[0]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 5), st.integers(1, 4), st.integers(0, 3))
def test_a_hole_within_one_side_is_filled_exactly(side, number, seed):
    whole = box((-3, 0, 2), (4, 5, 9), cuts=4)
    per_side = 32
    inner = [2 * (4 * i + j) + k for i in (1, 2) for j in (1, 2) for k in (0, 1)]  # not at the side's edge
    missing = side * per_side + np.random.default_rng(seed).choice(inner, number, replace=False)
    vertices, faces, _ = mend(np.delete(whole, missing, axis=0), "box")
    assert is_closed(vertices, faces)
    assert volume(vertices, faces) == pytest.approx(7 * 5 * 7, rel=1e-12)


def test_a_missing_corner_comes_back():
    whole = box((0, 0, 0), (8, 8, 8), cuts=2)
    at_corner = (whole >= 4).all((1, 2))
    vertices, faces, repairs = mend(whole[~at_corner], "box")
    assert volume(vertices, faces) == pytest.approx(512, rel=1e-9)
    assert any("missing corner" in sentence for sentence in repairs)


def test_cracks_are_welded():
    whole = box((0, 0, 0), (10, 10, 10), cuts=3)
    cracked = whole + np.random.default_rng(1).uniform(-2e-5, 2e-5, whole.shape)
    vertices, faces, repairs = mend(cracked, "box")
    assert is_closed(vertices, faces)
    assert volume(vertices, faces) == pytest.approx(1000, rel=1e-4)
    assert "Welded" in repairs[0]


def test_faces_turned_the_wrong_way_are_turned_back():
    whole = box((0, 0, 0), (10, 10, 10), cuts=2)
    whole[5:12] = whole[5:12, ::-1]
    vertices, faces, repairs = mend(whole, "box")
    assert is_closed(vertices, faces)
    assert volume(vertices, faces) == pytest.approx(1000)
    assert any("Turned 7 triangles" in sentence for sentence in repairs)


def test_doubled_faces_are_dropped():
    whole = box((0, 0, 0), (10, 10, 10), cuts=2)
    vertices, faces, repairs = mend(np.concatenate((whole, whole[:3])), "box")
    assert len(faces) == len(whole)
    assert volume(vertices, faces) == pytest.approx(1000)
    assert any("Dropped 3 triangles" in sentence for sentence in repairs)


def test_inside_out_bodies_are_turned_but_cavities_stay():
    outer, inner, beside = box((0, 0, 0), (10, 10, 10)), box((3, 3, 3), (6, 6, 6)), box((20, 0, 0), (24, 4, 4))
    for soup in (
        np.concatenate((outer, inner[:, ::-1], beside[:, ::-1])),        # a cavity, and a body inside out
        np.concatenate((outer[:, ::-1], inner, beside[:, ::-1])),        # all of it inside out
    ):
        vertices, faces, repairs = mend(soup, "boxes")
        assert volume(vertices, faces) == pytest.approx(1000 - 27 + 64)
        assert any("inside out" in sentence for sentence in repairs)


def test_a_loose_sheet_is_left_out_and_a_heap_of_sheets_refused():
    whole = box((0, 0, 0), (10, 10, 10))
    sheet = np.array([[[20, 0, 0], [30, 0, 0], [30, 10, 5]], [[20, 0, 0], [30, 10, 5], [20, 10, 5]]], float)
    vertices, faces, repairs = mend(np.concatenate((whole, sheet)), "box")
    assert volume(vertices, faces) == pytest.approx(1000)
    assert any("Left out 1 surface without thickness" in sentence for sentence in repairs)
    with pytest.raises(ModelError, match="wide open"):
        mend(np.concatenate([sheet + np.array([0, 0, 20 * k]) for k in range(9)]), "sheets")


def test_a_flap_is_left_out_but_a_holey_neighbour_is_closed():
    """Both hang on the body along an edge; one is a surface, the other a box that lacks a side's half."""
    whole = box((0, 0, 0), (10, 10, 10))
    flap = np.array([[[10, 10, 0], [16, 12, 0], [16, 12, 10]], [[10, 10, 0], [16, 12, 10], [10, 10, 10]]], float)
    vertices, faces, repairs = mend(np.concatenate((whole, flap)), "box")
    assert volume(vertices, faces) == pytest.approx(1000)
    assert len(faces) == 12
    assert "Left out 2 triangles" in repairs[0]
    holey = np.delete(box((10, 10, 0), (15, 15, 10)), 3, axis=0)
    vertices, faces, repairs = mend(np.concatenate((whole, holey)), "boxes")
    assert volume(vertices, faces) == pytest.approx(1250)
    assert "Closed 1 hole" in repairs[0]


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda t: t[:0], "no triangles"),
    (lambda t: np.where(np.arange(3) == 1, np.nan, t), "triangle 1"),
    (lambda t: t * [1, 0, 1], "flat"),
    (lambda t: t * 0, "one point"),
    (lambda t: t * 1e30, "damaged"),
])
def test_nonsense_is_refused(spoil, words):
    with pytest.raises(ModelError, match=words):
        mend(spoil(box((0, 0, 0), (1, 2, 3))), "box.stl")


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_any_heap_of_triangles_is_closed_or_refused(number, seed):
    rng = np.random.default_rng(seed)
    points = np.round(rng.uniform(-5, 5, (max(4, number // 4), 3)), 1)
    soup = points[rng.integers(0, len(points), (number, 3))]
    try:
        vertices, faces, _ = mend(soup, "soup")
    except ModelError:
        return
    assert is_closed(vertices, faces)
    assert len(faces)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 400), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_weld_makes_one_of_equal_points_only(number, different, seed):
    rng = np.random.default_rng(seed)
    pool = rng.normal(size=(different, 3))
    pool[0] = [0.0, -0.0, 0.0]
    points = pool[rng.integers(0, different, number)]
    vertices, of_point = weld(points)
    assert len(vertices) == len(np.unique(points, axis=0))
    np.testing.assert_array_equal(vertices[of_point], points)


def test_bodies_and_winding():
    soup = np.concatenate([box((3 * k, 0, 0), (3 * k + 2, 2, 2), cuts=2) for k in range(5)])
    vertices, of_corner = weld(soup.reshape(-1, 3))
    faces = of_corner.reshape(-1, 3)
    label, number = bodies(faces, len(vertices))
    assert number == 5
    np.testing.assert_array_equal(label, np.repeat(np.arange(5), 48))
    assert winding_number(vertices, faces, np.array([7.0, 1.0, 1.0])) == 1      # straight under edges and a vertex
    assert winding_number(vertices, faces, np.array([8.5, 1.0, 1.0])) == 0
    assert winding_number(vertices, faces[:, ::-1], np.array([0.3, 0.7, 0.1])) == -1


def test_place_rests_on_the_bed():
    part = load_mesh(SAMPLES / "arch.stl")
    stood = place(part, turn_deg=(90, 0, 30), at_mm=(12.0, -7.0))
    low, high = stood.bounds
    assert low[2] == 0
    np.testing.assert_allclose((low + high)[:2] / 2, [12, -7], atol=1e-12)
    assert volume(stood.vertices, stood.faces) == pytest.approx(volume(part.vertices, part.faces))
    quarter = place(load_mesh(SAMPLES / "cube.stl"), turn_deg=(90, -180, 270))
    np.testing.assert_array_equal(quarter.bounds, [[-10, -10, 0], [10, 10, 20]])  # no rounding


@given(st.tuples(*[st.floats(-720, 720)] * 3))
def test_turns_are_rotations(turn):
    matrix = turn_matrix(turn)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    from scipy.spatial.transform import Rotation

    np.testing.assert_allclose(matrix, Rotation.from_euler("xyz", turn, degrees=True).as_matrix(), atol=1e-9)


def test_wrong_options_and_files():
    with pytest.raises(UsageError, match="furlong"):
        load_mesh(SAMPLES / "cube.stl", unit="furlong")
    with pytest.raises(UsageError, match="scale"):
        load_mesh(SAMPLES / "cube.stl", scale=0)
    with pytest.raises(ModelError, match="cannot be read"):
        load_mesh(SAMPLES / "none.stl")
    with pytest.raises(ModelError, match=r"\.step"):
        load_mesh("part.step")
