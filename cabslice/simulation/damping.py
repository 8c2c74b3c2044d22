"""How much the cables of a simulated robot damp.

Legend
    zeta     damping ratio of a mode, share of critical          eta S    viscosity times section of a cable, N s
    phi      shape of the first mode, of unit modal mass          omega    its angular frequency, rad/s
    C        W diag(eta S/l0) W^T: a Kelvin-Voigt cable damps where it stretches; with eta S = b ES, C = b K_cable
    zeta = phi^T C phi / (2 omega)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.stiffness import gravity_stiffness, modes, stiffness
from cabslice.robot.winder import loaded_length

Modes = tuple[float, Array, Array]


def first_mode(robot: Robot, pose: Array, tension: Array, line: Array | float = 0.0) -> Modes:
    """Hz, shape (6,) and K_cable (6, 6) at pose (6,) under tension (m,) N. ImpossibleError where it is not held."""
    parts = stiffness(robot, pose[None], tension[None], line=line)
    hertz, shapes = modes(robot, pose[None], parts.total + gravity_stiffness(robot, pose[None]))
    if not hertz[0, 0] > 0:
        raise ImpossibleError("The cables do not hold the platform there: it has no first mode to damp.")
    return float(hertz[0, 0]), shapes[0, :, 0], parts.cable[0]


def of_ratio(robot: Robot, mode: Modes, ratio: float) -> Array:
    """(m,) N s with which the first mode has damping ratio `ratio`, the same share of the stiffness in all cables."""
    hertz, shape, cable = mode
    stretched = float(shape @ cable @ shape) / NEWTON
    return robot.axial_stiffness * ratio * 2 * (2 * np.pi * hertz) / stretched


def of_profile(printer: Any, robot: Robot, mode: Modes) -> Array:
    """(m,) N s of the profile's cables at the frequency of the first mode; 0 where it says nothing."""
    from cabslice.robot.cable import damping, laws_from_printer

    return damping(laws_from_printer(printer, robot.axial_stiffness), np.ones((1, robot.cables)), mode[0])[0]


def relaxation(printer: Any, robot: Robot) -> Array:
    """(m,) s, eta S/ES of the cables that a motor file is made for: what the profile says at the first mode at home.

    0 where it says nothing, or where the platform cannot be held at home with the reference tension.
    """
    if not any(cable.damping for cable in printer.cable) or robot.winders is None:
        return np.zeros(robot.cables)
    tension, length = robot.tension_reference, lengths(robot, robot.home[None])
    line = loaded_length(robot, length, robot.winders.home_angle[None]) - length
    try:
        mode = first_mode(robot, robot.home, tension, line)
    except ImpossibleError:
        return np.zeros(robot.cables)
    return of_profile(printer, robot, mode) / robot.axial_stiffness
