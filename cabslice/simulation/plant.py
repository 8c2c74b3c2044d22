"""The simulated robot, and playing commands on it.

Legend (Gueners 2021, 3.2.3)
    l0, l     rest and loaded length of a whole cable, from the point where it leaves its winder, mm; all n strands
    line      loaded length between winder and pulley, mm: l = line + n L, L from the pulley's entry to the platform
    t         pull on the platform, N: max(0, ES e + eta S de/dt), e = l/l0 - 1: a cable never pushes (Kelvin-Voigt)
    ES, eta S axial stiffness (N) and viscosity times section (N s) of all strands
    zeta      damping ratio of a mode: the share of critical damping

The strain rate is that of the cable in the span: winding in without stretching does not damp. The platform is a rigid
body with true orientation (quaternion); its state is that of its centre of mass, so that Newton and Euler separate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import PoseError
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.rotation import cross, matrix, quaternion, vector_of
from cabslice.simulation.command import Command
from cabslice.simulation.kernel import STATE, Columns, forces, play_rows, scratch

TOLERANCE = 1e-10         # mm of error a step: of the reference


def _none() -> Array:
    return np.zeros(6)


@dataclass(frozen=True)
class Plant:
    """A robot whose cables stretch and damp."""

    robot: Robot
    viscosity: Array                                  # (m,) N s, eta S of all strands
    push: Array = field(default_factory=_none)        # (6,) N, N mm at the platform origin: tube and hose

    def __post_init__(self) -> None:
        shape = Shapes("Plant")
        set_columns(self, viscosity=shape.column("viscosity", self.viscosity, "m"),
                    push=shape.column("push", self.push, "6"))


@dataclass(frozen=True)
class Played:
    """What the platform did, a row of the command each."""

    poses: Array       # (K, 6)
    rates: Array       # (K, 6) of the platform origin, machine axes
    tension: Array     # (K, m) N
    steps: int         # of the integrator

    def __len__(self) -> int:
        return len(self.poses)


def columns_of(plant: Plant) -> Columns:
    """The numbers the compiled functions need."""
    robot = plant.robot
    winders = robot.winders
    count = np.ones(robot.cables) if winders is None else winders.advantage
    return Columns(
        _own(robot.anchors), _own(robot.pulley_axes), _own(robot.pulley_radii), _own(robot.attachments),
        _own(robot.axial_stiffness), _own(plant.viscosity), _own(count), float(robot.mass), _own(robot.inertia),
        np.linalg.inv(robot.inertia), _own(robot.centre_of_mass), _own(robot.gravity), _own(plant.push + robot.pull),
        robot.freedoms.astype(float))


def _own(array: Array) -> Array:
    """Writable and in one piece, so that every robot meets the same compiled code."""
    return np.array(array, dtype=float, order="C")


def at_rest(robot: Robot, pose: Array, rates: Array | None = None) -> Array:
    """The state (STATE,) of a platform at pose (6,), at rest or moving with rates (6,) of its origin."""
    moving = np.zeros(6) if rates is None else np.asarray(rates, float)
    turn = matrix(pose[None, 3:])[0]
    arm = turn @ robot.centre_of_mass
    return np.concatenate((
        pose[:3] + arm, quaternion(pose[None, 3:])[0], moving[:3] + np.cross(moving[3:], arm), turn.T @ moving[3:]))


def _seen(robot: Robot, states: Array) -> tuple[Array, Array]:
    """Poses and rates (K, 6) of the platform origin."""
    turns = vector_of(states[:, 3:7])
    turn = matrix(turns)
    arm, spin = turn @ robot.centre_of_mass, np.einsum("kij,kj->ki", turn, states[:, 10:])
    return np.hstack((states[:, :3] - arm, turns)), np.hstack((states[:, 7:10] - cross(spin, arm), spin))


def play(plant: Plant, command: Command, start: Array, *, tolerance: float = TOLERANCE) -> Played:
    """Play a command from state start (STATE,), see at_rest. Drives are ideal: the lengths are what is commanded.

    tolerance: mm of error a step (the reference); 0: one step a row, unchecked (fast). Raises PoseError where the
    platform comes so far off that a cable cannot run.
    """
    return next(play_blocks(plant, [command], start, tolerance=tolerance))


def play_blocks(
    plant: Plant, commands: Iterable[Command], start: Array, *, tolerance: float = TOLERANCE
) -> Iterator[Played]:
    """Play consecutive commands, each beginning with the row the one before ended with; as `play`."""
    player = Player(plant, start, tolerance)
    for command in commands:
        yield player.play(command)


class Player:
    """A plant in motion: plays one command after the other, each from where the one before ended."""

    def __init__(self, plant: Plant, start: Array, tolerance: float = TOLERANCE) -> None:
        self.plant, self.tolerance, self.begun = plant, tolerance, 0
        self._bot, self._state = columns_of(plant), np.array(start, dtype=float)
        self._work = scratch(plant.robot.cables)

    def play(self, command: Command) -> Played:
        states, tension = np.empty((len(command), STATE)), np.empty((len(command), self.plant.robot.cables))
        steps = play_rows(
            self._bot, self._state, command.rows, command.period_s, self.tolerance, states, tension, self._work)
        if steps < 0:
            raise _lost(self.begun - steps - 1, command.period_s)
        self.begun += len(command) - 1
        return Played(*_seen(self.plant.robot, states), tension, steps)


def _lost(row: int, period_s: float) -> PoseError:
    return PoseError(f"at {row * period_s:.4f} s the platform is thrown so far that a cable cannot run", sample=row)


def energy(plant: Plant, played: Played, command: Command) -> Array:
    """Kinetic, elastic and potential energy (K,) N mm at the rows of a command played without damping."""
    from cabslice.robot.kinematics import lengths
    from cabslice.robot.wrench import mass_matrix

    robot, rates = plant.robot, played.rates
    count = np.ones(robot.cables) if robot.winders is None else robot.winders.advantage
    rest, line = command.rows[:, 0], command.rows[:, 1]
    strain = np.maximum(0.0, (line + count * lengths(robot, played.poses)) / rest - 1)
    stored = (robot.axial_stiffness * strain**2 * rest / count).sum(axis=1) / 2
    moving = np.einsum("ki,kij,kj->k", rates, mass_matrix(robot, played.poses), rates) * NEWTON / 2
    centre = played.poses[:, :3] + matrix(played.poses[:, 3:]) @ robot.centre_of_mass
    return stored + moving - NEWTON * robot.mass * centre @ robot.gravity


def accelerations(plant: Plant, state: Array, given: Array) -> tuple[Array, Array]:
    """dy/dt (STATE,) and tensions (m,) at one state; given (4, m): rest lengths, lines, and the rates of both."""
    return forces(columns_of(plant), state, given)
