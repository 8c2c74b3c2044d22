"""Retiming at print scale: cost per grid point, printed seconds per planning second, and print time beside a plan with
one acceleration that is safe everywhere.

    python benchmarks/timing.py [PART ...] [-p PRINTER] [--free] [-j THREADS]

--free leaves out the cap on nozzle acceleration, so that only cables and motors limit it. Ours, toppra on the first
pieces, and the baselines (trapezoids with look-ahead, corners by junction deviation, as printer firmware does:
timing.baseline) run on the same toolpath in one run, judged by the same audit.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from cabslice import pipeline
from cabslice.cli import tables
from cabslice.timing import baseline, explain, proof, retime
from cabslice.timing.rules import rules_for

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
    beside(given, printed)
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


def beside(given, printed: float) -> None:
    """The baselines, audited as the plan was."""
    for row in baseline.compared(printed, *given, jobs=2):
        print(f"  {tables.compared_line(row)}")
    toolpath, robot, printer, material, _ = given
    bound = baseline.unhindered(toolpath, robot, printer, material)
    print(f"  the feeds alone, no limit on acceleration: {bound:.0f} s, {bound / printed:.3f} x this plan")
    trajectory = retime.plan(*given, jobs=2)
    for name, share in explain.time_by_limit(trajectory, *given).items():
        print(f"  {100 * share:5.1f} %  {name}")


if __name__ == "__main__":
    main()
