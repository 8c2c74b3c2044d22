"""Motions that need no part: the circle of the papers, a square, a straight line.

Legend
    tau      time over duration, 0..1             sigma    share of the way, by a law of tau
    cubic    3 tau^2 - 2 tau^3 (Gueners 2021, 3.2.3): acceleration steps at both ends
    quintic  10 tau^3 - 15 tau^4 + 6 tau^5: it does not      even    tau: speed steps at both ends
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import ImpossibleError, UsageError
from cabslice.robot.distributions import distribute
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import Robot, WinderColumns
from cabslice.robot.winder import free_cable, motor_angles, radius, wound
from cabslice.robot.wrench import required_wrench
from cabslice.simulation.command import Command, of_lengths

Law = Callable[[Array], tuple[Array, Array, Array]]
LAWS: dict[str, Law] = {
    "cubic": lambda x: (3 * x**2 - 2 * x**3, 6 * x - 6 * x**2, 6 - 12 * x),
    "quintic": lambda x: (
        10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2, 60 * x - 180 * x**2 + 120 * x**3),
    "even": lambda x: (x, np.ones_like(x), np.zeros_like(x)),
}
DYNAMIC = "-dynamic"      # a distribution that carries the inertia of the platform, too


@dataclass(frozen=True)
class Motion:
    """Platform poses, rates and accelerations (K, 6) at multiples of the period."""

    period_s: float
    poses: Array
    rates: Array
    accels: Array

    def __post_init__(self) -> None:
        shape = Shapes("Motion")
        set_columns(self, **{name: shape.column(name, getattr(self, name), "K 6") for name in (
            "poses", "rates", "accels")})

    @property
    def times(self) -> Array:
        """(K,) s"""
        return np.arange(len(self.poses)) * self.period_s


def circle(
    radius: float, centre: Array, duration_s: float, *, law: str = "cubic", period_s: float = 2e-3,
    backwards: bool = False,
) -> Motion:
    """Once round a level circle about centre (3,) mm of the platform origin, from its point of largest x.

    The period is shortened so that the last row is the end. UsageError for an unknown law.
    """
    sigma, speed, gain, period = _along(duration_s, law, period_s)
    way = -2 * np.pi if backwards else 2 * np.pi
    angle, turn, spin = way * sigma, way * speed, way * gain
    out, aside = (np.stack(pair, axis=1) for pair in (
        (np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))))
    poses, rates, accels = np.zeros((3, len(sigma), 6))
    poses[:, :3] = centre
    poses[:, :2] += radius * out
    rates[:, :2] = radius * turn[:, None] * aside
    accels[:, :2] = radius * (spin[:, None] * aside - (turn**2)[:, None] * out)
    return Motion(period, poses, rates, accels)


def line(start: Array, end: Array, duration_s: float, *, law: str = "quintic", period_s: float = 2e-3) -> Motion:
    """Straight from start (3,) mm of the platform origin to end (3,)."""
    *share, period = _along(duration_s, law, period_s)
    poses, rates, accels = np.zeros((3, len(share[0]), 6))
    for columns, value in zip((poses, rates, accels), share, strict=True):
        columns[:, :3] = value[:, None] * (np.asarray(end, float) - start)
    poses[:, :3] += start
    return Motion(period, poses, rates, accels)


def _along(duration_s: float, law: str, period_s: float) -> tuple[Array, Array, Array, float]:
    """Share of the way and its derivatives by time at every row, and the period."""
    if law not in LAWS:
        raise UsageError(f"There is no law {law!r}; expected one of: {', '.join(LAWS)}.")
    steps = max(2, math.ceil(duration_s / period_s - 1e-9))
    sigma, speed, gain = LAWS[law](np.arange(steps + 1) / steps)
    return sigma, speed / duration_s, gain / duration_s**2, duration_s / steps


def tensions(robot: Robot, motion: Motion, distribution: str) -> Array:
    """Planned tensions (K, m) N of a distribution by name; "none": 0, so that cables are as long as the geometry says.

    Names of robot.distributions.METHODS carry the weight; with "-dynamic" behind them the inertia too.
    Raises ImpossibleError where the distribution does not keep the bounds.
    """
    if distribution == "none":
        return np.zeros((len(motion.poses), robot.cables))
    method = distribution.removesuffix(DYNAMIC)
    moving = (motion.rates, motion.accels) if distribution.endswith(DYNAMIC) else ()
    found = distribute(robot, motion.poses, required_wrench(robot, motion.poses, *moving), method=method)
    if not found.feasible.all():
        row = int(np.argmin(found.feasible))
        place = ", ".join(f"{x:.1f}" for x in motion.poses[row, :3])
        margin = float(np.min(found.margin))
        why = (f"{-margin:.3f} N are missing" if margin < 0 else f"tensions exist (margin {margin:.2f} N), but not by "
               f"{method}: another --distribution finds them")
        raise ImpossibleError(f"At {row * motion.period_s:.3f} s, platform at ({place}) mm, {method} finds no tensions "
                              f"within bounds: {why}.")
    return found.tension


def commanded(robot: Robot, motion: Motion, tension: Array, *, divide: bool = False) -> Command:
    """What puts the platform at rest on the poses of a motion at tensions (K, m) N.

    Through the motor angles where the robot has winders, as a motor file says them; `divide`: as `divided` does.
    Raises PoseError as motor_angles.
    """
    loaded = lengths(robot, motion.poses)
    if robot.winders is None:
        return of_lengths(loaded, tension, robot, motion.period_s)
    angle = motor_angles(robot, loaded, tension)
    return of_angles(robot, divided(robot.winders, angle) if divide else angle, motion.period_s)


def divided(winders: WinderColumns, exact: Array) -> Array:
    """Angles (K, m) by the published short cut: all that was wound since the first row (by the exact angles), divided
    by the radius at the angle before. Wrong where a winder changes its layer (Gueners 2021, 6.2.3)."""
    taken, angle = wound(winders, exact) - wound(winders, exact[:1]), exact.copy()
    for row in range(1, len(exact)):
        angle[row] = exact[0] + taken[row] / radius(winders, angle[row - 1:row])[0]
    return angle


def of_angles(robot: Robot, angle: Array, period_s: float) -> Command:
    """Motor angles (K, m) rad, played with the velocities of the cubic spline through them."""
    from scipy.interpolate import CubicSpline

    rows = np.arange(len(angle)) * period_s
    cable = free_cable(robot, angle, CubicSpline(rows, angle)(rows, 1))
    return Command(period_s, np.stack((cable.rest, cable.line, cable.rest_rate, cable.line_rate), axis=1))
