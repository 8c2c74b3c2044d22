"""The check of a whole print: CPU seconds, wall seconds and peak memory, beside brute force with fcl in the same run.

    python benchmarks/feasibility.py [PART.stl ...]        (default: benchy and bunny_flat beside the checkout)

Brute force: the cables as thin cylinders against the whole mesh (not the part printed so far), at every vertex of the
path, by trimesh's CollisionManager; timed on SAMPLE vertices spread over the path and scaled to all of them. It samples
points where the check proves whole moves.
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
PRINTER, SAMPLE = "cabfab-optim", 300


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


def brute_force(part: Any, laid: Any) -> tuple[float, int] | None:
    """CPU seconds for all vertices, and how many of the sampled ones touch; None without python-fcl."""
    try:
        import fcl  # noqa: F401
        import trimesh
    except ImportError:
        return None
    from cabslice import pipeline
    from cabslice.feasibility.exits import lines_at

    robot = pipeline.robot_of(laid)
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    manager = trimesh.collision.CollisionManager()
    manager.add_object("part", mesh)
    rows = np.linspace(0, len(laid.toolpath.xyz) - 1, SAMPLE).astype(int)
    lines = lines_at(robot, laid.toolpath.xyz[rows])
    exits, tips = lines.exit - robot.bed_origin, lines.tip - robot.bed_origin
    begin, touching = time.process_time(), 0
    for k in range(len(rows)):
        for cable in range(robot.cables):
            rod = trimesh.creation.cylinder(2.3, segment=(exits[k, cable], tips[k, cable]), sections=6)
            touching += manager.in_collision_single(rod)
    return (time.process_time() - begin) / SAMPLE * len(laid.toolpath.xyz), touching


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
    other = brute_force(placed.part, laid)
    if other is None:
        print("  brute force: python-fcl is not installed")
        if os.environ.get("CABSLICE_PEERS"):
            raise SystemExit("CABSLICE_PEERS is set and python-fcl is missing")
    else:
        ratio = f"{other[0] / cpu:.0f} times the check"
        print(f"  brute force (fcl)  {other[0]:8.0f} CPU s, from {SAMPLE} vertices; {ratio}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        check_alone(sys.argv[2])
    else:
        given = [Path(name) for name in sys.argv[1:]]
        for each in given or [MODELS / "benchy.stl", MODELS / "bunny_flat.stl"]:
            measure(each)
