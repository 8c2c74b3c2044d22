"""Real meshes by brute force: points along cables against the mesh itself, at the ends of moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feasibility_cases import part_trees

from cabslice import pipeline
from cabslice.feasibility.exits import lines_at
from cabslice.feasibility.sweep import contacts
from cabslice.robot.model import robot_from_printer

SAMPLES = Path(__file__).parents[1] / "samples"
BARE = ["infill=0", "top_layers=0", "bottom_layers=0", "walls=1", "skirt_loops=0", "layer_mm=0.3", "first_layer_mm=0.3"]
PARTS = {"c-shape": 9.0, "arch": 9.5, "tower": 6.0}
POINTS = 300         # along a cable
VERTICES = 3000      # of the path
DEEP = 0.5           # mm


def deepest(mesh, exits, tips, top):
    """How deep (K,) mm below the nozzle's layer cables run in a mesh: sampled points, distance to its surface."""
    import trimesh

    share = np.linspace(0, 1, POINTS)[:, None]
    points = exits[:, None] + share * (tips - exits)[:, None]
    low, high = mesh.bounds
    rows = np.argwhere((points > low).all(axis=2) & (points < high).all(axis=2) & (points[..., 2] < top[:, None]))
    deep = np.zeros(len(exits))
    inside = points[rows[:, 0], rows[:, 1]]
    for i in range(0, len(rows), 20000):
        part = slice(i, i + 20000)
        depth = trimesh.proximity.signed_distance(mesh, inside[part])
        np.maximum.at(deep, rows[part, 0], np.minimum(depth, top[rows[part, 0]] - inside[part][:, 2]))
    return deep


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_cables_called_free_run_through_no_mesh_and_those_that_run_deep_are_called_blocked(name):
    """Clearance 0, cables without thickness; the mesh is a bead's width and a chord larger than its walls."""
    import trimesh

    profiles = pipeline.load_profiles("cabfab-init", None, "draft-0.4", BARE)
    placed = pipeline.read(SAMPLES / f"{name}.stl", profiles, pipeline.Placement(scale=PARTS[name]))
    path = pipeline.to_path(placed).toolpath
    robot = robot_from_printer(profiles.printer)
    robot = replace(robot, cable_radii=robot.cable_radii * 0, clearance=robot.clearance * 0)
    moves, beads = part_trees(path, robot)
    met = contacts(moves, beads, robot, np.zeros(robot.cables), stop=10**9)
    hits = np.zeros((len(path.xyz), robot.cables), bool)
    hits[moves.items.move[met.move], met.cable] = True
    rows = np.unique(np.linspace(1, len(path.xyz) - 1, VERTICES).astype(int))
    lines = lines_at(robot, path.xyz[rows])
    mesh = trimesh.Trimesh(placed.part.vertices, placed.part.faces, process=False)
    blocked = found = 0
    for cable in range(robot.cables):
        exits, tips = lines.exit[:, cable] - robot.bed_origin, lines.tip[:, cable] - robot.bed_origin
        deep = deepest(mesh, exits, tips, path.xyz[rows, 2] - 0.3)
        assert hits[rows[deep > DEEP], cable].all()
        blocked, found = blocked + int(hits[rows, cable].sum()), found + int((deep > DEEP).sum())
    assert found <= blocked
    assert (found > 100) == (name == "c-shape")
