"""Plan so that the elastic robot stays near the motion: find where it rings, calm it there, play all, and again.

What a motor file does on a robot that is exactly as its profile says is next to nothing off: its lengths come from the
dynamic tensions, damping included. What is left is what the profile does not know. It excites the modes, in proportion
to the acceleration. Where it does so too much is found by the modes alone (ringing), and the acceleration lowered there
(calm). Whether that is enough is judged by playing the motor file in every case.

    case               the simulated robot                                held to
    as in the profile  damping of the profile                             the accuracy asked for
    modulus, mass      each 5 % lower and 5 % higher, damping 1 %         3 times that, beyond the first layer's offset
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
from cabslice.simulation.calm import Calming
from cabslice.simulation.damping import first_mode, of_profile, of_ratio
from cabslice.simulation.plant import Plant
from cabslice.simulation.prints import Run, play_all
from cabslice.simulation.ringing import Ringing
from cabslice.timing.trajectory import Trajectory

WRONG, LOOSER, RATIO = 0.05, 3.0, 0.01     # share of modulus and mass; of the accuracy; damping ratio
ROUNDS, STEP, LEAST = 5, 0.97, 0.95        # plans; how far below what is needed the next one goes, and at least
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
    one_percent, loose = of_ratio(robot, mode, RATIO), LOOSER * accuracy_mm
    wrong = [(f"modulus {100 * WRONG:g} % {word}", replace(robot, axial_stiffness=robot.axial_stiffness * (1 + share)))
             for word, share in (("lower", -WRONG), ("higher", WRONG))]
    wrong += [(f"mass {100 * WRONG:g} % {word}", replace(robot, mass=robot.mass * (1 + share),
                                                        inertia=robot.inertia * (1 + share)))
              for word, share in (("higher", WRONG), ("lower", -WRONG))]
    return (
        Case("as in the profile", Plant(robot, of_profile(printer, robot, mode)), accuracy_mm, False),
        *(Case(name, Plant(other, one_percent), loose, True) for name, other in wrong),
    )


def wrong_ones(robot: Robot, trajectory: Trajectory) -> tuple[Ringing, ...]:
    """The cases that are not as in the profile, by their modes: mass and modulus shift these alike."""
    return tuple(Ringing(robot, share, RATIO, trajectory) for share in (WRONG, -WRONG))


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
    calming: Calming, prove: Callable[[Trajectory], tuple[Trajectory, Verdict]],
    judged: Callable[[Trajectory], Judged], accuracy_mm: float, layers: Array,
) -> tuple[Trajectory, Verdict]:
    """The motion, calmed until every case keeps its bound; its verdict tells what it is held to and what that costs.

    prove: the motion slowed where its audit asks for it, and the verdict. Raises ImpossibleError where ROUNDS do not
    help.
    """
    bound, first, before = LOOSER * accuracy_mm, calming.motion.duration, calming.largest()
    for _ in range(ROUNDS):
        trajectory, verdict = prove(calming.keep(STEP * bound))
        if not verdict.ok:
            return trajectory, verdict
        found = judged(trajectory)
        if found.share <= 1:
            return trajectory, verdict.joined(told(found, trajectory.duration / first, before))
        bound *= min(STEP / found.share, LEAST)
    raise _refused(found, calming.least_mm_s2, layers)


def told(found: Judged, cost: float, before_mm: float) -> Verdict:
    parts = [f"{name} {1e3 * error:.1f} um of {1e3 * bound:g}" for name, error, bound in zip(
        found.cases, found.error_mm, found.bound_mm, strict=True)]
    spent = f"{cost:.3f} times the time; without the bound about {1e3 * before_mm:.0f} um with the modulus wrong"
    sentence = f"Nozzle of the elastic robot, simulated, rounded corners apart: {', '.join(parts)}; {spent}."
    room = [1e3 * (bound - error) for bound, error in zip(found.bound_mm, found.error_mm, strict=True)]
    return Verdict((sentence,), margins={"accuracy_um": room[0], "accuracy_wrong_um": min(room[1:])})


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
