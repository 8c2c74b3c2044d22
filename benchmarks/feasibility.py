"""The check of a whole print: CPU seconds, wall seconds and peak memory, beside brute force in the same run.

    python benchmarks/feasibility.py [PART.stl ...]        (default: benchy and bunny_flat beside the checkout)
    pip install python-fcl                             (the peer; without it trimesh alone is asked, about few points)

Brute force: the cables against the whole mesh (not the part printed so far) at every vertex of the path, timed on some
vertices spread over the path and scaled to all of them: as thin cylinders by trimesh's CollisionManager where
python-fcl is installed, else as POINTS points each, by trimesh's distances. It samples places where the check proves
whole moves.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

MODELS = Path(__file__).parents[2] / "shared" / "models"
PRINTER = "cabfab-optim"
SAMPLE = 300         # vertices, with fcl
FEW = 1              # without
POINTS = 20          # along a cable
AT_ONCE = 10         # points: trimesh compares each with most triangles of a mesh that is far away, all in memory


def check_alone(path: str) -> None:
    """In a process of its own, so that the peak memory is that of loading the path and checking it."""
    from cabslice import pipeline, store

    laid = store.load(path)[1]
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    before, begin = time.process_time(), time.perf_counter()
    verdict = pipeline.check_path(laid)
    cpu, wall = time.process_time() - before, time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{cpu:.2f} {wall:.2f} {peak / 1024:.0f} {base / 1024:.0f} {int(verdict.ok)}")


def brute_force(part: Any, laid: Any) -> tuple[str, float, int, int]:
    """What was used, CPU seconds for all vertices, and of the sampled cables how many touch, and how many there are."""
    import trimesh

    from cabslice import pipeline
    from cabslice.feasibility.exits import lines_at

    name, judge, count = "fcl", with_fcl, SAMPLE
    try:
        import fcl  # noqa: F401
    except ImportError:
        name, judge, count = "trimesh alone, python-fcl is not installed", with_points, FEW
    robot = pipeline.robot_of(laid)
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    rows = np.linspace(0, len(laid.toolpath.xyz) - 1, count).astype(int)
    lines = lines_at(robot, laid.toolpath.xyz[rows])
    exits, tips = (np.reshape(ends - robot.bed_origin, (-1, 3)) for ends in (lines.exit, lines.tip))
    reach = float((robot.cable_radii + robot.clearance).max())
    begin = time.process_time()
    touching = judge(mesh, exits, tips, reach)
    return name, (time.process_time() - begin) / count * len(laid.toolpath.xyz), touching, len(exits)


def with_fcl(mesh: Any, exits: Any, tips: Any, reach: float) -> int:
    """How many cables come within reach of the mesh."""
    import trimesh

    manager = trimesh.collision.CollisionManager()
    manager.add_object("part", mesh)
    rods = (trimesh.creation.cylinder(reach, segment=ends, sections=6) for ends in zip(exits, tips, strict=True))
    return sum(bool(manager.in_collision_single(rod)) for rod in rods)


def with_points(mesh: Any, exits: Any, tips: Any, reach: float) -> int:
    """How many cables have a point within reach of the mesh, of POINTS on each."""
    import trimesh

    share = np.linspace(0.0, 1.0, POINTS)[:, None]
    points = (exits[:, None] + share * (tips - exits)[:, None]).reshape(-1, 3)
    query = trimesh.proximity.ProximityQuery(mesh)
    away = np.concatenate([query.on_surface(points[i:i + AT_ONCE])[1] for i in range(0, len(points), AT_ONCE)])
    return int((away.reshape(len(exits), -1) < reach).any(axis=1).sum())


def measure(file: Path) -> None:
    from tempfile import TemporaryDirectory

    from cabslice import pipeline, store

    placed = pipeline.read(file, pipeline.load_profiles(PRINTER, None, None), pipeline.Placement())
    laid = pipeline.to_path(placed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "part.path"
        store.save(laid, path)
        for _ in ("first", "warm"):
            words = [sys.executable, __file__, "--alone", str(path)]
            run = subprocess.run(words, capture_output=True, text=True, check=True)
        cpu, wall, peak, base, ok = (float(word) for word in run.stdout.split())
    moves = len(laid.toolpath.xyz)
    print(f"{file.name}: {moves} moves, {int(laid.toolpath.layer.max()) + 1} layers, {'free' if ok else 'not free'}")
    print(f"  check, second run  {cpu:8.2f} CPU s {wall:8.2f} s wall {peak:6.0f} MB peak ({base:.0f} before)")
    name, seconds, touching, cables = brute_force(placed.part, laid)
    print(f"  brute force        {seconds:8.0f} CPU s, scaled; {seconds / cpu:.0f} times the check ({name})")
    print(f"                     {touching} of {cables} sampled cables touch")
    if "alone" in name and os.environ.get("CABSLICE_PEERS"):
        raise SystemExit("CABSLICE_PEERS is set and python-fcl is missing")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        check_alone(sys.argv[2])
    else:
        given = [Path(name) for name in sys.argv[1:]]
        for each in given or [MODELS / "benchy.stl", MODELS / "bunny_flat.stl"]:
            measure(each)
