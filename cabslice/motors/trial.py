"""Motions that try a machine before it prints: one winder, the tensions, a circle.

Legend
    s(x)    x^3 (10 - 15 x + 6 x^2), from rest to rest        A    angle a winder is turned by, rad
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, UsageError
from cabslice.feasibility.findings import Finding
from cabslice.motors import machine
from cabslice.motors.approach import home_point
from cabslice.motors.block import Block
from cabslice.motors.start import Lead
from cabslice.motors.stream import MotorStream, make_stream
from cabslice.robot.delta import Machine
from cabslice.robot.model import Robot
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Events, Toolpath

FACETS = 360
BLOCK_ROWS = 8192
TRIAL = {
    "jog": "one motor turns to and fro: unhook its cable from the platform, or leave the drive without power and watch "
           "its encoder; wound in is positive",
    "tension": "nothing moves: the cables are tensioned at home, level by level to the reference tension, and held",
    "circle": "the nozzle follows a circle with the platform level; measure it",
}


@dataclass(frozen=True)
class Still:
    """The platform at rest."""

    pose: Array                  # (6,)
    duration: float              # s


def rest(still: Still, times: Array) -> SimpleNamespace:
    """As timing.trajectory.sample."""
    count = len(times)
    nothing = np.zeros((count, 6))
    return SimpleNamespace(poses=np.tile(still.pose, (count, 1)), rates=nothing, accels=nothing,
                           filament=np.zeros(count), move=np.zeros(count, np.int64))


def tension(robot: Robot, header: dict[str, Any], *, period_s: float, lead: Lead, hold_s: float) -> MotorStream:
    """The cables tensioned at home and held. Raises what make_stream raises."""
    told = {**header, "trial": "tension", "about": TRIAL["tension"]}
    return make_stream(Still(robot.home, hold_s), robot, period_s=period_s, header=told, sample=rest, lead=lead)


def jog(
    robot: Robot, header: dict[str, Any], *, period_s: float, cable: int, turn: float, seconds: float
) -> MotorStream:
    """Motor `cable` (from 1) turns by `turn` rad from home and back in `seconds`, no cable under tension.

    Raises UsageError for a cable there is not, ImpossibleError where the motor or its winder cannot.
    """
    if not 1 <= cable <= robot.cables:
        raise UsageError(f"There is no cable {cable}: {robot.name} has 1 to {robot.cables}.")
    base = tension(robot, header, period_s=period_s, lead=Lead(), hold_s=seconds)
    winders = robot.winders
    assert winders is not None
    angle = np.tile(winders.home_angle, (base.rows, 1))
    last = base.rows - 1                     # both ends are mirrored, as in motors.stream
    x = np.minimum((last - np.abs(last - np.abs(np.arange(-1, base.rows + 1)))) * period_s / seconds, 1.0)
    way = turn * _there_and_back(x)
    angle[:, cable - 1] += way[1:-1]
    velocity, acceleration = np.zeros((2, *angle.shape))
    velocity[:, cable - 1] = (way[2:] - way[:-2]) / (2 * period_s)
    acceleration[:, cable - 1] = (way[2:] - 2 * way[1:-1] + way[:-2]) / period_s**2
    torque = machine.moving(winders, velocity, acceleration)
    _allow(robot, cable, angle, velocity, torque)
    nothing = np.zeros_like(angle)

    def blocks() -> Iterator[Block]:
        for start in range(0, base.rows, BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            yield Block(start, angle[rows], velocity[rows], torque[rows], nothing[rows], np.zeros(len(angle[rows])))

    changed = {"trial": "jog", "about": TRIAL["jog"], "cable": cable, "start_angles_rad": angle[0].tolist(),
               "end_angles_rad": angle[-1].tolist(), "start_tensions_n": [0.0] * robot.cables}
    steps = ["take the cable of the motor off the platform and keep hands off it",
             "set every encoder to start.angles_rad, where the motors stand, then play"]
    started = {**base.header["start"], "steps": steps, "angles_rad": angle[0].tolist(),
               "tensions_n": [0.0] * robot.cables}
    return replace(base, header={**base.header, **changed, "start": started}, blocks=blocks, later=None)


def _there_and_back(x: Array) -> Array:
    """0 to 1 and back over x = 0..1, at rest at both ends and in the middle."""
    y = 1 - np.abs(2 * x - 1)
    return y**3 * (10 - 15 * y + 6 * y * y)


def _allow(robot: Robot, cable: int, angle: Array, velocity: Array, torque: Array) -> None:
    winders, one = robot.winders, cable - 1
    assert winders is not None
    low, high = winders.span[one]
    judged = (
        ("speed", float(np.abs(velocity).max()), float(winders.max_speed[one]), "rad/s", "Give it more --seconds."),
        ("torque", float(np.abs(torque).max()) / 1e3, float(winders.peak_torque[one]) / 1e3, "N m", "More --seconds."),
        ("angle", float(angle[:, one].max()), float(high), "rad", "Turn it less."),
        ("angle", -float(angle[:, one].min()), -float(low), "rad", "Turn it less."),
    )
    for what, value, limit, unit, remedy in judged:
        if value > limit:
            sentence = f"the {what} of motor {cable} would be {value:.6g} {unit}; its limit is {limit:.6g} {unit}."
            finding = Finding(f"trial-{what}", -1, (0.0, 0.0, 0.0), cable, value, limit, unit, sentence, remedy)
            raise ImpossibleError(sentence, [finding])


def circle(robot: Machine, *, radius: float, speed: float, height: float | None, filament_mm: float) -> Toolpath:
    """A circle about the bed's middle as travels, at the nozzle's homing height or `height` mm over the bed.

    To be checked, planned and audited as any path.
    """
    z = float(home_point(robot)[2]) if height is None else height
    angle = np.linspace(0, 2 * np.pi, FACETS + 1)
    xyz = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)))
    count = len(xyz)
    nothing, whole = np.zeros(count), np.zeros(count, np.int32)
    return Toolpath(
        xyz=xyz, filament=nothing, width=nothing, height=nothing, speed=np.full(count, speed),
        role=np.full(count, Role.TRAVEL), layer=whole, object=whole, starts=np.array([1, count]), events=Events.none(),
        filament_diameter_mm=filament_mm, source="circle",
    )
