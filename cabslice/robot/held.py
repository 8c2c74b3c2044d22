"""How the cables hold the platform at given poses: tensions of a named distribution, stiffness in its parts, modes.

Legend
    t    tensions that carry the platform's own weight            K, M   stiffness and mass matrix (see stiffness)
    n    advantage: strands of a winder's line (see winder)       ES     axial stiffness of all strands, N
    lv   reference level, N, the same for all cables, at which the mean of t is the preload asked for

A cable is as soft as it is long, so the line from winder to pulley counts. n strands share t: the platform feels
ES / (L + line/n). The line is taken at the home radius of its winder: from the first layer to the last it changes
by a few mm, the stiffness by a part of a percent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot import stiffness, winder
from cabslice.robot.distributions import distribution
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot
from cabslice.robot.stiffness import Stiffness
from cabslice.robot.tension import Tensions
from cabslice.robot.workspace import Measure
from cabslice.robot.wrench import required_wrench, wrench_matrix

LEVELLED = ("nearest", "puncture", "qp", "slack")   # distributions that follow the reference level
CLOSE = 1e-9         # share of the tension range that a mean may miss the preload by
STEPS = 60           # of the search for a level; about ten do


@dataclass(frozen=True)
class Held:
    """K poses: tensions, stiffness and modes; nan where the distribution finds no tensions within the bounds."""

    poses: Array             # (K, 6)
    tensions: Tensions
    stiffness: Stiffness     # parts (K, 6, 6): N/mm, N, N mm/rad
    gravity: Array           # (K, 6, 6) stiffness of the weight's lever, N mm/rad
    modes_hz: Array          # (K, f) of the whole, gravity included, rising
    shapes: Array            # (K, 6, f) mode shapes, mm and rad at the platform origin
    cable_modes_hz: Array    # (K, f) of K_cable alone, as in the papers' tables


def hold(robot: Robot, poses: Array, *, method: str = "nearest", preload: float | None = None) -> Held:
    """Hold the platform's own weight at poses (K, 6) with the distribution of that name.

    preload : N, mean of the tensions; the reference level is chosen to give it (method in LEVELLED). Where the bounds
        do not allow that mean the pose counts as not feasible; see mean_range.
    Raises PoseError where a cable cannot be led, ValueError for an unknown method or one that has no level.
    """
    return _held(robot, poses, weight_tensions(robot, poses, method=method, preload=preload))


def weight_tensions(
    robot: Robot, poses: Array, *, method: str = "nearest", preload: float | None = None, refuse: bool = True
) -> Tensions:
    """Tensions that carry the platform's own weight; arguments and errors as hold.

    With ``refuse=False`` poses that a cable cannot be led to are not feasible, margin -inf or nan.
    """
    find = _finder(robot, poses, method, refuse)
    if preload is None:
        return find(robot.tension_reference)
    _levelled(method)
    low, high = _levels(robot)

    def at(level: Array) -> Tensions:
        return find(np.repeat(level[:, None], robot.cables, axis=1))

    ends = np.full(len(poses), low), np.full(len(poses), high)
    found = at(_level_of_mean(lambda level: at(level).tension.mean(axis=1), preload, *ends))
    met = found.feasible & (np.abs(found.tension.mean(axis=1) - preload) <= 1e3 * CLOSE * (high - low))
    return Tensions(np.where(met[:, None], found.tension, np.nan), met, found.margin)


def mean_range(robot: Robot, poses: Array, *, method: str = "nearest") -> tuple[Array, Array]:
    """Least and largest mean tension (K,) N that reference levels within the bounds give; nan where not feasible."""
    _levelled(method)
    find = _finder(robot, poses, method, True)
    least, most = (find(np.full(robot.cables, level)).tension.mean(axis=1) for level in _levels(robot))
    return least, most


def first_mode(*, method: str = "nearest", preload: float | None = None) -> Measure:
    """A measure (see workspace): first natural frequency (K,) Hz, nan where not held."""
    def measure(robot: Robot, poses: Array, found: Tensions) -> Array:
        return stiffness.first_modes(robot, poses, found.tension, line=_line(robot))

    return _where_held(measure, method, preload)


def nozzle_stiffness(*, method: str = "nearest", preload: float | None = None) -> Measure:
    """A measure: stiffness (K,) N/mm of the nozzle (else the origin) in its softest direction, nan where not held."""
    def measure(robot: Robot, poses: Array, found: Tensions) -> Array:
        return softest(robot, _held(robot, poses, found))

    return _where_held(measure, method, preload)


def softest(robot: Robot, held: Held) -> Array:
    """Static stiffness (K,) N/mm of the nozzle (else the origin) against forces in its softest direction."""
    out, known = np.full(len(held.poses), np.nan), held.tensions.feasible
    if known.any():
        whole = (held.stiffness.total + held.gravity)[known]
        compliance = stiffness.point_compliance(robot, held.poses[known], whole)
        out[known] = 1 / np.linalg.eigvalsh(compliance)[:, -1]
    return out


def why_not(robot: Robot, pose: Array, *, method: str = "nearest", preload: float | None = None) -> PoseError | None:
    """What keeps the cables from holding the platform at one pose (6,), or None where nothing does.

    details: margin_n, tensions_n (those that balance and miss the bounds the least) and cables, the worst of them.
    """
    poses = np.asarray(pose, dtype=float)[None]
    if weight_tensions(robot, poses, method=method, preload=preload).feasible[0]:
        return None
    best, bounds = weight_tensions(robot, poses, method="slack"), f"{_range(robot)} N"
    margin, tension = float(best.margin[0]), best.tension[0]
    if not np.isfinite(tension).all():
        return PoseError("the pose is singular: the cables leave the platform loose there")
    about: dict[str, Any] = {"margin_n": margin, "tensions_n": tension.tolist()}
    if not best.feasible[0]:
        excess = np.maximum(tension - robot.tension_max, robot.tension_min - tension)
        worst = np.flatnonzero(excess > (1 - 1e-6) * excess.max())
        forces = ", ".join(f"cable {i + 1} at {tension[i]:.2f} N" for i in worst)
        return PoseError(f"no tensions within {bounds} carry {robot.mass:g} kg there: they miss that by at least "
                         f"{-margin:.2f} N ({forces})", **about, cables=(worst + 1).tolist())
    if preload is None:
        return PoseError(f"{method} leaves {bounds} there, although there are tensions within", **about)
    least, most = (float(end[0]) for end in mean_range(robot, poses, method=method))
    return PoseError(f"a mean tension of {preload:g} N is out of reach there: within {bounds} it can be "
                     f"{least:.2f} to {most:.2f} N", **about)


def _range(robot: Robot) -> str:
    return f"{robot.tension_min.min():g}..{robot.tension_max.max():g}"


def _held(robot: Robot, poses: Array, found: Tensions) -> Held:
    parts = stiffness.stiffness(robot, poses, found.tension, line=_line(robot))
    gravity = stiffness.gravity_stiffness(robot, poses)
    modes, shapes = stiffness.modes(robot, poses, parts.total + gravity)
    return Held(poses, found, parts, gravity, modes, shapes, stiffness.modes(robot, poses, parts.cable)[0])


def _where_held(
    measure: Callable[[Robot, Array, Tensions], Array], method: str, preload: float | None
) -> Measure:
    def everywhere(robot: Robot, poses: Array) -> Array:
        found = weight_tensions(robot, poses, method=method, preload=preload, refuse=False)
        out = np.full(len(poses), np.nan)
        held = found.feasible
        if held.any():
            out[held] = measure(robot, poses[held], Tensions(found.tension[held], held[held], found.margin[held]))
        return out

    return everywhere


def _line(robot: Robot) -> Array:
    """Loaded line (m,) mm from winder to pulley at home, as it counts: one of n strands goes on to the winder."""
    if robot.winders is None:
        return np.zeros(robot.cables)
    winders = robot.winders
    return winder.line_to_pulley(robot, winder.radius(winders, winders.home_angle[None]))[0] / winders.advantage


def _finder(robot: Robot, poses: Array, method: str, refuse: bool) -> Callable[[Array], Tensions]:
    """Tensions as a function of the reference (m,) or (K, m)."""
    choose = distribution(method)
    wrench = wrench_matrix(robot, poses, masked=True, lines=cables(robot, poses, refuse=refuse))
    needed = required_wrench(robot, poses, masked=True)
    return lambda level: choose(wrench, needed, robot.tension_min, robot.tension_max, level)


def _levelled(method: str) -> None:
    if method not in LEVELLED:
        raise ValueError(f"distribution {method!r} has no reference level, expected one of: {', '.join(LEVELLED)}")


def _levels(robot: Robot) -> tuple[float, float]:
    return float(robot.tension_min.min()), float(robot.tension_max.max())


def _level_of_mean(mean_at: Callable[[Array], Array], mean: float, low: Array, high: Array) -> Array:
    """Level (K,) between low and high (K,) at which mean_at(level) is `mean`, by regula falsi (Illinois).

    The mean never falls as the level rises: nearest tensions are a projection. Where the ends do not enclose the mean
    the nearer end is given.
    """
    below, above = mean_at(low) - mean, mean_at(high) - mean
    level, last = np.where(np.abs(below) < np.abs(above), low, high), np.zeros(len(low))
    searched, scale = (below < 0) & (above > 0), CLOSE * (high - low)
    for _ in range(STEPS):
        if not searched.any():
            break
        with np.errstate(invalid="ignore", divide="ignore"):
            level = np.where(searched, (low * above - high * below) / (above - below), level)
        miss = mean_at(level) - mean
        searched &= np.abs(miss) > scale
        under = miss < 0
        # an end that stays twice in a row counts half, so that both ends move in
        above = np.where(under, np.where(last < 0, above / 2, above), miss)
        below = np.where(under, miss, np.where(last > 0, below / 2, below))
        low, high, last = np.where(under, level, low), np.where(under, high, level), np.where(under, -1.0, 1.0)
    return level
