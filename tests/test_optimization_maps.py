"""How large a thing can be printed: against closed formulas, and as files."""

import numpy as np
import pytest
from cli_cases import answered, run
from feasibility_cases import LINC_ANCHORS, LINC_ATTACHMENTS, LINC_EDGE, robot_of
from test_feasibility_known import entering_box, entering_disc, free_height

from cabslice.mesh.load import load_mesh
from cabslice.optimization import maps


@pytest.fixture
def linc(monkeypatch):
    """Six lower lines only: nothing pulls up, so the weight is not asked for."""
    monkeypatch.setattr(maps, "held_up_to", lambda robot, outline, heights: len(heights))
    monkeypatch.setattr(maps, "highest", lambda robot: 900.0)
    return robot_of(LINC_ANCHORS, LINC_ATTACHMENTS)


def test_the_largest_cube_is_the_published_one(linc):
    assert maps.largest_cube(linc, np.zeros(6), accuracy=0.05) == pytest.approx(LINC_EDGE, abs=0.1)


def test_boxes_and_cylinders_are_as_tall_as_the_closed_formula_says(linc):
    for sides in ((400.0, 500.0), (460.0, 460.0), (520.0, 480.0)):
        exact = free_height(linc, lambda a, d, sides=sides: entering_box(a, d, sides))
        height = maps.prism_height(linc, np.zeros(6), maps.box(*sides), step=1.0)
        assert exact - 1.1 <= height <= exact + 0.1
    for radius in (230.0, 250.0, 280.0):
        around = radius / np.cos(np.pi / maps.SIDES)
        exact, wider = (free_height(linc, lambda a, d, r=r: entering_disc(a, d, r)) for r in (radius, around))
        height = maps.prism_height(linc, np.zeros(6), maps.circle(radius), step=1.0)
        assert min(wider, 900.0) - 1.1 <= height <= exact + 0.1


def test_the_volcano_narrows_upwards_and_its_mesh_is_closed_with_the_volume_of_its_rings(linc, tmp_path):
    found = maps.volcano(linc, np.zeros(6), radii=np.arange(100.0, 500.0, 50.0), step=5.0)
    assert (np.diff(found.height) <= 0).all()
    assert np.ptp(found.height) > 100
    vertices, faces = maps.surface(found)
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()
    corner = vertices[faces]
    volume = np.einsum("fi,fi->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6
    rings = np.pi * (found.radius**2 - np.append(0, found.radius[:-1]) ** 2) * found.height
    assert volume == pytest.approx(rings.sum(), rel=0.005)


def test_a_place_off_the_bed_and_a_first_layer_without_tension_give_nothing():
    robot = robot_of(LINC_ANCHORS, LINC_ATTACHMENTS, bed=(100.0, 100.0))
    assert maps.prism_height(robot, np.zeros(6), maps.circle(60.0)) == 0
    assert maps.prism_height(robot, np.zeros(6), maps.circle(40.0), top=200.0) == 0      # nothing pulls it up


def test_sizes_are_told_drawn_and_written(tmp_path, capsys):
    stl, png = tmp_path / "volcano.stl", tmp_path / "volcano.png"
    code, content = answered(
        capsys, "optimize", "size", "-p", "cabfab-optim", "--step-mm", "20", "-o", stl, "--png", png)
    assert code == 0
    numbers = content["numbers"]
    assert 150 < numbers["cube_edge_mm"] < 220      # 220 mm is too much (tests/scenarios/optim-cube-220)
    assert load_mesh(stl).bounds[1, 2] == pytest.approx(max(numbers["height_mm"]))
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert run("optimize", "size", "-p", "cabfab-optim", "-o", stl) == 5
