"""The numbers of a product against sums done by hand, and the curve that is drawn against the product it is of."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice.mesh.part import Part
from cabslice.slicing.layer import Beads, Layer, Polygons, Role
from cabslice.toolpath.path import Events, Toolpath
from cabslice.view import numbers
from cabslice.view.picture import curve_of_path

NO_OUTLINE = Polygons(np.zeros((0, 2)), np.zeros(1))
LINE = st.tuples(
    st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=6),
    st.booleans(), st.sampled_from([Role.OUTER_WALL, Role.SPARSE_INFILL, Role.SKIRT]),
)


@given(st.lists(LINE, max_size=5))
def test_bead_lengths_are_those_of_the_lines_one_by_one(lines):
    points = np.array([point for line, _, _ in lines for point in line]).reshape(-1, 2)
    starts = np.cumsum([0, *(len(line) for line, _, _ in lines)])
    closed, role = [closed for _, closed, _ in lines], [role for _, _, role in lines]
    beads = Beads(points, starts, np.ones(len(points)), np.array(role), np.array(closed), np.zeros(len(lines)))
    found = numbers.of_layers((Layer(0, 0.2, 0.2, NO_OUTLINE, beads),))
    expected = {}
    for line, is_closed, kind in lines:
        ring = np.array([*line, line[0]] if is_closed else line)
        name = Role(kind).name.lower()
        expected[name] = expected.get(name, 0.0) + float(np.linalg.norm(np.diff(ring, axis=0), axis=1).sum())
    assert found["extruded_mm"] == pytest.approx(sum(expected.values()), abs=1e-9)
    assert found["extruded_mm_by_feature"] == pytest.approx({k: v for k, v in expected.items() if v > 0}, abs=1e-9)


@given(st.tuples(*[st.floats(0.1, 100)] * 3), st.tuples(*[st.floats(-500, 500)] * 3))
def test_a_tetrahedron_has_a_sixth_of_its_box_wherever_it_is(size, shift):
    vertices = np.vstack([np.zeros(3), np.diag(size)]) + shift
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    found = numbers.of_part(Part(vertices, faces, "t.stl", "0" * 64))
    assert found["part_mm3"] == pytest.approx(np.prod(size) / 6, rel=1e-6, abs=1e-4)
    assert found["size_mm"] == pytest.approx(size, abs=1e-9)


@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=2, max_size=8, unique=True))
@settings(max_examples=30)
def test_the_drawn_points_lie_on_the_path_evenly(points):
    xyz = np.array(points)
    rows = len(xyz)
    one, row = np.ones(rows), np.arange(rows)
    path = Toolpath(xyz, one, one, one, row + 1.0, one, one, one, np.array([1, rows]), Events.none(), 1.75)
    curve = curve_of_path(path, "title")
    steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    assert curve.along[-1] * 1e3 == pytest.approx(steps.sum())
    for point, speed in zip(curve.xyz[1:-1:7], curve.speed[1:-1:7], strict=True):
        along = np.einsum("ij,ij->i", point - xyz[:-1], np.diff(xyz, axis=0))
        share = np.clip(along / np.maximum(steps**2, 1e-300), 0, 1)
        distance = np.linalg.norm(point - xyz[:-1] - share[:, None] * np.diff(xyz, axis=0), axis=1)
        assert distance[round(speed) - 2] < 1e-6
