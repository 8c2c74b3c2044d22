"""What cables and their motors can do together: the tension that may be used, and what a step of it asks of the motor.

Legend
    r      cable wound per motor angle, mm/rad (transmission)       M    continuous torque of the motor, N mm
    W^+    pseudo-inverse of the wrench matrix: tension per wrench  ES   axial stiffness, N
    l      loaded length of the whole cable, winder to platform, mm
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.robot.kinematics import cables
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.winder import transmission_bounds
from cabslice.robot.winder_line import line_to_pulley
from cabslice.robot.wrench import wrench_matrix

TORQUE_SHARE = 0.05     # share of the continuous torque kept for turning the winders themselves


def usable_tension_max(robot: Robot) -> Array:
    """(m,) N: the bound of the cable, or if that is less what its motor holds for ever on its longest lever.

    Raises ImpossibleError where that is not above the least tension.
    """
    if robot.winders is None:
        return robot.tension_max
    winders = robot.winders
    torque = winders.continuous_torque * (1 - TORQUE_SHARE) - winders.friction
    most = np.minimum(robot.tension_max, torque / transmission_bounds(winders)[1])
    if (most <= robot.tension_min).any():
        cable = int(np.argmin(most - robot.tension_min)) + 1
        raise ImpossibleError(
            f"cable {cable}: its motor cannot hold the least tension: {most[cable - 1]:.3g} N for ever on its longest "
            f"lever, at least {robot.tension_min[cable - 1]:.3g} N needed (min_tension_n; continuous_torque_n_m of "
            f"motor {cable})")
    return most


def usable(robot: Robot) -> Robot:
    """The robot with its highest tensions drawn in to what the motors hold; one that is drawn in stays as it is."""
    return replace(robot, tension_max=usable_tension_max(robot))


def take_up(robot: Robot, poses: Array) -> Array:
    """(K, m) mm of cable per mm/s^2 of platform acceleration in the level direction that asks most of each cable: what
    the cables stretch more there, by the balancing tensions of least change. poses (K, 6)."""
    return np.asarray(np.linalg.norm(stretch(robot, poses), axis=2))


def stretch(robot: Robot, poses: Array) -> Array:
    """(K, m, 2) mm that each cable stretches more per mm/s^2 of platform acceleration in x and in y. poses (K, 6)."""
    lines = cables(robot, poses)
    inverse = np.linalg.pinv(wrench_matrix(robot, poses, masked=True, lines=lines))     # (K, m, n)
    force = np.zeros((2, 6))
    force[:, :2] = np.eye(2) * robot.mass * NEWTON
    force[:, 3:] = np.cross(robot.centre_of_mass, force[:, :3])
    length = lines.length
    if robot.winders is not None:
        line = line_to_pulley(robot, robot.winders.radii.max(axis=1)[None])
        length = length + line / robot.winders.advantage
    return np.asarray(inverse @ force[:, robot.freedoms].T * (length / robot.axial_stiffness)[..., None])
