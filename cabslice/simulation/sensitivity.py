"""How far the nozzle is off when the robot is not as its profile says, motors standing where the profile puts them.

The robot is homed as a real one: at its home pose, cables at the reference tension, encoders set to the home angles.
So an error that is the same at home and in print drops out, as it does on the machine. Everything is static.

    parameter     of each cable                                      unit of an error of 1
    anchor        x, y, z of the pulley's entry point                mm
    attachment    x, y, z on the platform                            mm
    zero          its length when the encoders were set              mm
    radius        of its winder, all layers                          mm
    pulley        radius of its guide pulley                         mm
    modulus       of its cable, and of all cables together           %
    mass          of the platform                                    %
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import Robot
from cabslice.robot.tension import nearest_tension
from cabslice.robot.winder import free_cable, motor_angles
from cabslice.robot.wrench import required_wrench
from cabslice.simulation.deviation import nozzle_places
from cabslice.simulation.statics import equilibrium

SMALL = {"anchor": 0.01, "attachment": 0.01, "zero": 0.01, "radius": 0.001, "pulley": 0.01, "modulus": 0.1, "mass": 0.1}
UNITS = {name: "%" if name in ("modulus", "mass") else "mm" for name in SMALL}


@dataclass(frozen=True)
class Wrong:
    """One parameter that is off: what it is called, and the robot (and zero of its cables, (m,) mm) that has it so."""

    group: str
    name: str
    apply: Callable[[Robot, float], tuple[Robot, Array]]


@dataclass(frozen=True)
class Standing:
    """Motors at rest where the profile puts them for poses (K, 6)."""

    robot: Robot
    poses: Array
    angles: Array      # (K, m) rad


def standing(robot: Robot, poses: Array) -> Standing:
    """Raises UsageError for a robot without winders; PoseError where a pose cannot be held by the winders."""
    if robot.winders is None:
        raise UsageError(f"{robot.name} has no winders: there are no motors to stand.")
    found = nearest_tension(robot, poses, required_wrench(robot, poses))
    if not found.feasible.all():
        raise UsageError("A pose has no tensions within bounds.")
    return Standing(robot, poses, motor_angles(robot, lengths(robot, poses), found.tension))


def shift(at: Standing, robot: Robot, zero: Array | float = 0.0) -> Array:
    """Where the nozzle of `robot` goes (K, 3) mm, from where it was meant, with the motors of `at`."""
    cable = free_cable(robot, at.angles, np.zeros_like(at.angles))
    poses = equilibrium(robot, cable.rest + zero, cable.line, at.poses)[0]
    return nozzle_places(robot, poses) - nozzle_places(at.robot, at.poses)


def parameters(robot: Robot) -> Iterator[Wrong]:
    """Everything that may be wrong by itself."""
    for i in range(robot.cables):
        for axis, letter in enumerate("xyz"):
            yield Wrong("anchor", f"anchor {i + 1} {letter}", _column("anchors", (i, axis)))
            yield Wrong("attachment", f"attachment {i + 1} {letter}", _column("attachments", (i, axis)))
        yield Wrong("zero", f"zero {i + 1}", partial(_zero, i))
        yield Wrong("radius", f"winder {i + 1} radius", partial(_winder, i))
        if robot.pulley_radii[i] > 0:
            yield Wrong("pulley", f"pulley {i + 1} radius", _column("pulley_radii", (i,)))
        yield Wrong("modulus", f"modulus {i + 1}", partial(_stiffer, i))
    yield Wrong("modulus", "modulus of all", partial(_stiffer, None))
    yield Wrong("mass", "mass", _heavier)


def _no(robot: Robot) -> Array:
    return np.zeros(robot.cables)


def _column(name: str, at: tuple[int, ...]) -> Callable[[Robot, float], tuple[Robot, Array]]:
    def apply(robot: Robot, size: float) -> tuple[Robot, Array]:
        column = getattr(robot, name).copy()
        column[at] += size
        return replace(robot, **{name: column}), _no(robot)

    return apply


def _zero(i: int, robot: Robot, size: float) -> tuple[Robot, Array]:
    return robot, size * np.eye(robot.cables)[i]


def _winder(i: int, robot: Robot, size: float) -> tuple[Robot, Array]:
    assert robot.winders is not None
    radii = robot.winders.radii.copy()
    radii[i] += size
    return replace(robot, winders=replace(robot.winders, radii=radii)), _no(robot)


def _stiffer(i: int | None, robot: Robot, percent: float) -> tuple[Robot, Array]:
    which = np.ones(robot.cables) if i is None else np.eye(robot.cables)[i]
    return replace(robot, axial_stiffness=robot.axial_stiffness * (1 + percent / 100 * which)), _no(robot)


def _heavier(robot: Robot, percent: float) -> tuple[Robot, Array]:
    return replace(robot, mass=robot.mass * (1 + percent / 100)), _no(robot)


@dataclass(frozen=True)
class Sensitivity:
    """Of the nozzle to P parameters at K poses."""

    names: tuple[str, ...]
    groups: tuple[str, ...]
    slope: Array       # (P, K, 3) mm per mm or per %

    def largest(self) -> Array:
        """(P,) mm per unit, over the poses."""
        return np.linalg.norm(self.slope, axis=2).max(axis=1)


def sensitivity(at: Standing) -> Sensitivity:
    """By central differences of the equilibrium."""
    given = list(parameters(at.robot))
    slope = np.empty((len(given), len(at.poses), 3))
    for row, one in enumerate(given):
        step = SMALL[one.group]
        up, down = (shift(at, *one.apply(at.robot, sign * step)) for sign in (1, -1))
        slope[row] = (up - down) / (2 * step)
    return Sensitivity(tuple(one.name for one in given), tuple(one.group for one in given), slope)


def needed(found: Sensitivity, bound_mm: float) -> dict[str, dict[str, Any]]:
    """How well the parameters of each group must be known: one alone, and all of the group at random together."""
    answer: dict[str, dict[str, Any]] = {}
    for group in dict.fromkeys(found.groups):
        rows = [i for i, name in enumerate(found.groups) if name == group]
        alone, together = found.largest()[rows], np.sqrt((found.slope[rows] ** 2).sum(axis=(0, 2)).max())
        worst = int(np.argmax(alone))
        answer[group] = {
            "unit": UNITS[group], "worst": found.names[rows[worst]], "nozzle_mm_per_unit": float(alone[worst]),
            "one_alone": bound_mm / float(alone[worst]), "standard_deviation_of_all": bound_mm / float(together)}
    return answer


def monte_carlo(at: Standing, sigma: Mapping[str, float], *, draws: int, seed: int) -> Array:
    """Nozzle shifts (draws, K, 3) mm of robots whose parameters are off at random: normal, sigma of each group.

    Each draw is a whole robot, brought to equilibrium: nothing is linearised. The same seed gives the same draws.
    """
    random, given = np.random.default_rng(seed), [one for one in parameters(at.robot) if one.name != "modulus of all"]
    found = np.empty((draws, len(at.poses), 3))
    for row in range(draws):
        robot, zero = at.robot, _no(at.robot)
        for one, size in zip(given, random.normal(size=len(given)), strict=True):
            if sigma.get(one.group):
                robot, more = one.apply(robot, size * sigma[one.group])
                zero = zero + more
        found[row] = shift(at, robot, zero)
    return found
