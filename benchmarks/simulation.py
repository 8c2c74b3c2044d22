"""Playing a motor file: seconds played per CPU second, fast and reference, and how far the two are apart.

    python benchmarks/simulation.py [PLAN] [--layers 20]

Without PLAN benchy is planned for cabfab-optim. One thread; the plan is turned into rows and back into poses as part of
the measured time, the integration alone is told beside it.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from cabslice import pipeline, store
from cabslice.simulation.command import of_block
from cabslice.simulation.damping import first_mode, of_profile
from cabslice.simulation.kernel import STATE, play_rows, scratch
from cabslice.simulation.plant import TOLERANCE, Plant, at_rest, columns_of
from cabslice.simulation.prints import FAST, play_stream

BENCHY = Path(__file__).parents[2] / "shared" / "models" / "benchy.stl"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", nargs="?", type=Path)
    parser.add_argument("--layers", type=int, default=20)
    asked = parser.parse_args()
    plan = store.load(asked.plan)[1] if asked.plan else planned()
    period, robot = pipeline.period_of(plan), pipeline.robot_of(plan)
    stream = pipeline.stream_of(plan, {}, period)
    path, trajectory = plan.toolpath, plan.trajectory
    last = int(np.flatnonzero(path.layer < asked.layers)[-1])
    rows = int(trajectory.time[min(np.searchsorted(trajectory.move, last), len(trajectory.move) - 1)] / period)
    pose = np.array(stream.header["start_pose"])
    mode = first_mode(robot, pose, robot.tension_reference)
    plant = Plant(robot, of_profile(pipeline.profiles_of(plan.origin).printer, robot, mode))
    play_stream(stream, robot, plant, rows=1)                                     # compiled
    runs = {}
    for name, tolerance in (("fast", FAST), ("reference", TOLERANCE)):
        begun = time.process_time()
        runs[name] = play_stream(stream, robot, plant, tolerance=tolerance, rows=rows)
        spent = time.process_time() - begun
        played = len(runs[name]) * period
        print(f"{name:10} {played:8.1f} s played in {spent:6.2f} CPU s: {played / spent:6.0f} times real time; "
              f"the integration alone {played / alone(stream, plant, pose, rows, tolerance):6.0f} times")
    apart = np.abs(runs["fast"].error - runs["reference"].error).max()
    print(f"{asked.layers} layers: fast and reference at most {1e3 * apart:.4f} um apart")


def alone(stream, plant, pose, rows, tolerance):
    """CPU s of the integrator without what is around it."""
    bot, work, spent = columns_of(plant), scratch(plant.robot.cables), 0.0
    state = at_rest(plant.robot, pose)
    for block in stream:
        if block.row >= rows:
            break
        command = of_block(plant.robot, block, stream.period_s)
        states, tension = np.empty((len(block), STATE)), np.empty((len(block), plant.robot.cables))
        begun = time.process_time()
        play_rows(bot, state, command.rows, command.period_s, tolerance, states, tension, work)
        spent += time.process_time() - begun
    return spent


def planned():
    profiles = pipeline.load_profiles("cabfab-optim", None, None)
    laid = pipeline.to_path(pipeline.read(BENCHY, profiles, pipeline.Placement()))
    return pipeline.planned(laid)


if __name__ == "__main__":
    main()
