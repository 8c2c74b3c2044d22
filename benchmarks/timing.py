"""Retiming at print scale: cost per grid point, printed seconds per planning second, and print time beside a plan with
one acceleration that is safe everywhere.

    python benchmarks/timing.py [PART ...] [-p PRINTER] [--free] [-j THREADS]

--free leaves out the cap on nozzle acceleration, so that only cables and motors limit it. Ours, toppra on the first
pieces, and the baseline (trapezoids with look-ahead, corners by junction deviation, as printer firmware does) run on
the same toolpath in one run. The baseline turns its corners by a step of velocity; the largest one is printed.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from cabslice import pipeline
from cabslice.robot.model import nozzle_poses
from cabslice.timing import proof, retime
from cabslice.timing.rules import CompiledRules, rules_for

MODELS = Path(__file__).parents[2] / "shared" / "models"
SAMPLE = 40          # pieces given to stock toppra


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", type=Path, default=[MODELS / "benchy.stl"])
    parser.add_argument("-p", "--printer", default="cabfab-optim")
    parser.add_argument("--free", action="store_true")
    parser.add_argument("-j", "--jobs", type=int, default=2)
    asked = parser.parse_args()
    sets = ["motion.max_acceleration_mm_s2=1e6"] if asked.free else []
    for part in asked.parts:
        if part.exists():
            measure(part, asked.printer, sets, asked.jobs)
        else:
            print(f"{part}: not here, skipped")


def measure(part: Path, printer: str, sets: list[str], jobs: int) -> None:
    profiles = pipeline.load_profiles(printer, None, None, sets)
    laid = pipeline.to_path(pipeline.read(part, profiles, pipeline.Placement()))
    given = (laid.toolpath, pipeline.robot_of(laid), profiles.printer, profiles.material, profiles.process)
    retime.plan(*given, jobs=jobs)                                                # compiled, caches warm
    trajectory, plan_wall, plan_cpu = clocked(lambda: retime.plan(*given, jobs=jobs))
    (_, verdict), all_wall, all_cpu = clocked(lambda: proof.plan_proven(*given, jobs=jobs))
    nodes, printed = len(trajectory.x), trajectory.duration
    print(f"{part.name}: {len(laid.toolpath.xyz)} moves, {nodes} grid points, {printed:.0f} s printed, {jobs} threads")
    for name, wall, cpu in (("plan", plan_wall, plan_cpu), ("plan and audit", all_wall, all_cpu)):
        print(f"  {name:17} {wall:8.2f} s  {cpu / nodes * 1e6:7.2f} us/gp  RTF {printed / wall:7.0f}")
    print(f"  audit {'passed' if verdict.ok else 'FAILED'}")
    stock(*given)
    baseline(*given, printed)
    print(f"  peak memory       {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:8.0f} MiB")


def clocked(work):
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def stock(toolpath, robot, printer, material, process) -> None:
    """toppra on the first pieces, beside ours on the same block: time per grid point and largest difference."""
    ours = retime.task_for(toolpath, robot, printer, material, process, "compiled")
    theirs = replace(ours, rules=rules_for(robot, ours.limits, "toppra"))
    block = retime.block_of(ours.grid, np.arange(min(SAMPLE, len(toolpath.starts) - 1)))
    ones = np.ones(len(block.step))
    x, _, cpu = clocked(lambda: retime._solved(ours, block, ones))
    reference, _, stock_cpu = clocked(lambda: retime._solved(theirs, block, ones))
    apart, each = np.abs(x - reference).max() / reference.max(), 1e6 / len(x)
    print(f"  stock toppra      {stock_cpu * each:8.1f} us/gp on {len(x)} points, "
          f"ours {cpu * each:.2f}; apart {apart:.1e}")


def baseline(toolpath, robot, printer, material, process, printed: float) -> None:
    task = retime.task_for(toolpath, robot, printer, material, process, "compiled")
    accel = safe_everywhere(task, toolpath, robot)
    length, speed = toolpath.lengths, np.where(toolpath.lengths > 0, task.speed, 0.0)
    direction = task.path.direction
    cosine = np.clip(-(direction[:-1] * direction[1:]).sum(axis=1), -1, 1)
    half = np.sqrt((1 - cosine) / 2)                                              # sine of half the inner angle
    square = accel * process.corner_mm * half / np.maximum(1 - half, 1e-9)
    corner = np.minimum(np.sqrt(square), np.minimum(speed[:-1], speed[1:]))
    corner[toolpath.starts[:-1] - 1] = 0.0
    seconds, entry = look_ahead(length, speed, corner, accel)
    step = np.linalg.norm(direction[1:] - direction[:-1], axis=1) * entry[1:]
    print(f"  safe everywhere   {accel:8.0f} mm/s2, {seconds:.0f} s: {seconds / printed:.2f} x ours; "
          f"its corners step by up to {step.max():.0f} mm/s")


def safe_everywhere(task, toolpath, robot) -> float:
    """The largest acceleration (per axis) that no cable limit forbids anywhere on the path, whatever the direction."""
    rules = CompiledRules(robot, replace(task.limits, acceleration=1000.0))
    points = nozzle_poses(robot, toolpath.xyz[:: max(1, len(toolpath.xyz) // 5000)])[:, :3]
    share = rules.kernel.at_worst(points, 0.0, rules.columns).max()
    return float(min(1000.0 / share, task.limits.acceleration))


def look_ahead(length, speed, corner, accel) -> tuple[float, np.ndarray]:
    """Trapezoids at one acceleration: total seconds of the moves, and the speed at which each move is entered."""
    entry = np.concatenate(([0.0], corner, [0.0]))[: len(length) + 1]
    for k in range(len(length) - 1, 0, -1):
        entry[k] = min(entry[k], np.sqrt(entry[k + 1] ** 2 + 2 * accel * length[k]))
    seconds = 0.0
    for k in range(1, len(length)):
        if length[k] == 0:
            continue
        leave = min(entry[k + 1], np.sqrt(entry[k] ** 2 + 2 * accel * length[k])) if k + 1 < len(entry) else 0.0
        if k + 1 < len(entry):
            entry[k + 1] = leave
        top = min(speed[k], np.sqrt((2 * accel * length[k] + entry[k] ** 2 + leave**2) / 2))
        ramps = (2 * top**2 - entry[k] ** 2 - leave**2) / (2 * accel)
        seconds += (2 * top - entry[k] - leave) / accel + max(length[k] - ramps, 0.0) / top
    return seconds, entry[:-1]


if __name__ == "__main__":
    main()
