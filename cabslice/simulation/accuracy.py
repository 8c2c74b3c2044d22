"""Plan so that the elastic robot stays near the motion: simulate, lower the acceleration, plan again.

What a motor file does on a robot that is exactly as its profile says is next to nothing off: its lengths come from the
dynamic tensions, damping included. What is left is what the profile does not know. It excites the modes, in proportion
to the acceleration, and less where the motion is averaged over a good part of their period.

    case               the simulated robot                                held to
    as in the profile  damping of the profile                             the accuracy asked for
    softer, heavier    modulus 5 % lower, mass 5 % higher, damping 1 %    3 times that, beyond the first layer's offset
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.motors.stream import MotorStream
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import Robot
from cabslice.robot.winder import loaded_length
from cabslice.simulation.damping import first_mode, of_profile, of_ratio
from cabslice.simulation.plant import Plant
from cabslice.simulation.prints import Run, play_all
from cabslice.timing.trajectory import Trajectory, sample

WRONG, LOOSER, RATIO = 0.05, 3.0, 0.01     # share of modulus and mass; of the accuracy; damping ratio
ROUNDS, STEP, LEAST = 6, 0.95, 0.85        # plans; how far below what is needed the next one goes, and at least
FIRST = 0.7                                # power of the share the first step goes by: the window helps, too
WINDOW = 0.4                               # periods of the first mode the motion is averaged over: 24 % less excites it
COARSE = 1e-5                              # mm of error a step: agrees with the reference to 0.01 um
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Case:
    name: str
    plant: Plant
    bound_mm: float
    beyond_offset: bool


@dataclass(frozen=True)
class Judged:
    """What a motion does in every case: the largest error and where."""

    cases: tuple[str, ...]
    error_mm: tuple[float, ...]
    bound_mm: tuple[float, ...]
    row: tuple[int, ...]
    move: tuple[int, ...]
    xyz: tuple[tuple[float, float, float], ...]

    @property
    def share(self) -> float:
        """The largest error in bounds; at most 1 is good."""
        return max(error / bound for error, bound in zip(self.error_mm, self.bound_mm, strict=True))


def cases(stream: MotorStream, robot: Robot, printer: Any, accuracy_mm: float) -> tuple[Case, ...]:
    """The cases of a motor file made for `robot`."""
    header = stream.header
    pose, tension = np.array(header["start_pose"]), robot.tension_reference
    length = lengths(robot, pose[None])
    line = loaded_length(robot, length, np.array(header["start_angles_rad"])[None]) - length
    mode = first_mode(robot, pose, tension, line)
    one_percent = of_ratio(robot, mode, RATIO)
    softer = replace(robot, axial_stiffness=robot.axial_stiffness * (1 - WRONG))
    heavier = replace(robot, mass=robot.mass * (1 + WRONG), inertia=robot.inertia * (1 + WRONG))
    loose = LOOSER * accuracy_mm
    return (
        Case("as in the profile", Plant(robot, of_profile(printer, robot, mode)), accuracy_mm, False),
        Case(f"modulus {100 * WRONG:g} % lower", Plant(softer, one_percent), loose, True),
        Case(f"mass {100 * WRONG:g} % higher", Plant(heavier, one_percent), loose, True),
    )


def judge(
    stream: MotorStream, robot: Robot, given: Sequence[Case], layers: Array, progress: Progress | None = None, *,
    rows: int | None = None,
) -> Judged:
    """Play a motor file in every case; layers (N,) of the moves of its toolpath."""
    tick = None if progress is None else lambda row: progress(row, stream.rows)
    runs = play_all(stream, robot, [case.plant for case in given], tolerance=COARSE, rows=rows, tick=tick)
    found = [_largest(run, layers, case.beyond_offset) for run, case in zip(runs, given, strict=True)]
    at = tuple(row for row, _ in found)
    return Judged(
        tuple(case.name for case in given), tuple(error for _, error in found), tuple(case.bound_mm for case in given),
        at, tuple(int(runs[0].move[row]) for row in at),
        tuple((float(x), float(y), float(z)) for x, y, z in runs[0].wanted[list(at)]))


def _largest(run: Run, layers: Array, beyond_offset: bool) -> tuple[int, float]:
    laying, error = run.laying, run.error
    if beyond_offset and laying.any():
        layer = layers[run.move]
        error = error - error[laying & (layer == layer[laying][0])].mean(axis=0, dtype=np.float64)
    size = np.where(laying, np.linalg.norm(error, axis=1), 0.0)
    row = int(size.argmax())
    return row, float(size[row])


def within(
    make: Callable[[float | None], tuple[Trajectory, Verdict]],
    judged: Callable[[Trajectory], Judged], limit: float | None, layers: Array,
) -> tuple[Trajectory, Verdict]:
    """The motion that make(acceleration limit, mm/s^2) gives for the highest limit tried that keeps the accuracy.

    Its verdict tells what it is held to and what that costs in time. The first limit is None: as the profile says.
    Raises ImpossibleError where ROUNDS of lowering do not help.
    """
    asked: float | None = None
    first, tried = 0.0, []
    for _ in range(ROUNDS):
        trajectory, verdict = make(asked)
        if not verdict.ok:
            return trajectory, verdict
        found = judged(trajectory)
        first = first or trajectory.duration
        tried.append((asked, trajectory.duration, found))
        if found.share <= 1:
            return trajectory, verdict.joined(told(found, trajectory.duration, first, asked, tried[0][2]))
        if asked is None:
            asked = (limit or _fastest(trajectory)) / found.share**FIRST
        else:
            asked *= min(STEP / found.share, LEAST)
    raise _refused(found, asked or 0.0, layers)


def window_s(robot: Robot, least: float) -> float:
    """s to average a motion over where the modes are not to be excited; not below `least`."""
    if robot.winders is None:
        return least
    tension, length = robot.tension_reference, lengths(robot, robot.home[None])
    line = loaded_length(robot, length, robot.winders.home_angle[None]) - length
    return max(least, WINDOW / first_mode(robot, robot.home, tension, line)[0])


def _fastest(trajectory: Trajectory) -> float:
    """Largest acceleration, mm/s^2."""
    times = np.arange(0.0, trajectory.duration, 4e-3)
    return float(np.abs(sample(trajectory, times).accels[:, :3]).max())


def told(found: Judged, duration: float, first: float, limit: float | None, unbounded: Judged) -> Verdict:
    parts = [f"{name} {1e3 * error:.1f} um of {1e3 * bound:g}" for name, error, bound in zip(
        found.cases, found.error_mm, found.bound_mm, strict=True)]
    cost = "at no cost in time" if limit is None else (
        f"accelerations up to {limit:.0f} mm/s^2, {duration / first:.3f} times the time; without the bound "
        + ", ".join(f"{1e3 * error:.1f}" for error in unbounded.error_mm) + " um")
    sentence = f"Nozzle of the elastic robot, simulated, rounded corners apart: {', '.join(parts)}; {cost}."
    names = ("accuracy_um", "accuracy_softer_um", "accuracy_heavier_um")
    return Verdict((sentence,), margins={
        name: 1e3 * (bound - error) for name, bound, error in zip(names, found.bound_mm, found.error_mm, strict=True)})


def _refused(found: Judged, limit: float, layers: Array) -> ImpossibleError:
    findings = [
        Finding(
            "accuracy", int(layers[move]), xyz, 0, 1e3 * error, 1e3 * bound, "um",
            f"layer {int(layers[move])}: the simulated nozzle is {1e3 * error:.1f} um off near x {xyz[0]:.1f} y "
            f"{xyz[1]:.1f} z {xyz[2]:.1f} mm ({name}), even with accelerations down to {limit:.0f} mm/s^2; "
            f"{1e3 * bound:g} um were asked for.", "Ask for less, or raise the reference tension.")
        for name, error, bound, move, xyz in zip(
            found.cases, found.error_mm, found.bound_mm, found.move, found.xyz, strict=True) if error > bound]
    return ImpossibleError(findings[0].sentence, findings)
