"""What dividing the length change by the present radius costs where a winder changes its layer (Gueners 2021, 6.2.3).

    python benchmarks/winder.py [--printer NAME] [--radius MM ...] [--height MM ...]

The nozzle goes round circles about the bed's middle; for each cable whose winder changes its layer on the way, the
largest error in cable of the short cut, and of the exact inverse.
"""

from __future__ import annotations

import argparse

import numpy as np

from cabslice.profile import shelf
from cabslice.robot import kinematics, winder
from cabslice.robot.model import Robot, nozzle_poses, robot_from_printer

STEPS = 4001


def errors(robot: Robot, radius: float, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m,) mm of the short cut, (m,) mm of the inverse, (m,) changes of layer."""
    turn = np.linspace(0, 2 * np.pi, STEPS)
    xyz = np.column_stack((radius * np.cos(turn), radius * np.sin(turn), np.full(STEPS, height)))
    length = kinematics.lengths(robot, nozzle_poses(robot, xyz))
    angle = winder.motor_angles(robot, length, np.tile(robot.tension_reference, (STEPS, 1)))
    assert robot.winders is not None
    wound = winder.wound(robot.winders, angle)
    divided = angle[0] + (wound - wound[0]) / winder.radius(robot.winders, angle)
    again = winder.angle_of(robot.winders, wound)
    short, exact = (np.abs(winder.wound(robot.winders, found) - wound).max(axis=0) for found in (divided, again))
    return short, exact, np.abs(np.diff(winder.layer(robot.winders, angle), axis=0)).sum(axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--printer", default="cabfab-optim-measured")
    parser.add_argument("--radius", type=float, nargs="*", default=[100.0, 150.0])
    parser.add_argument("--height", type=float, nargs="*", default=[100.0, 200.0, 300.0])
    given = parser.parse_args()
    robot = robot_from_printer(shelf.load_printer(given.printer))
    print(f"{'radius mm':>10}{'height mm':>11}  cable: changes of layer, divided mm, exact mm")
    for radius in given.radius:
        for height in given.height:
            short, exact, changes = errors(robot, radius, height)
            cells = [f"{k + 1}: {changes[k]}, {short[k]:.2f}, {exact[k]:.0e}" for k in np.flatnonzero(changes)]
            print(f"{radius:10g}{height:11g}  {';  '.join(cells)}")


if __name__ == "__main__":
    main()
