"""The elastic robot in motion, compiled: forces, and an error-controlled explicit integrator (legend in plant).

The stiffest mode of such a robot is below 100 Hz and a row of a motor file lasts 1-4 ms, so an explicit method of order
5 takes one or two steps a row: nothing here is stiff. Method: Dormand and Prince 1980, RK5(4)7M.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from cabslice.arrays import Array
from cabslice.robot.pulley_kernel import lead_cables

STATE = 13           # centre of mass (mm), quaternion w x y z, its velocity (mm/s), turn rate in platform axes (rad/s)


class Columns(NamedTuple):
    """Numbers of the simulated robot, as the compiled functions take them; units and shapes in plant.Plant."""

    anchors: Any
    axes: Any
    radii: Any
    attachments: Any       # from the platform origin
    stiff: Any             # (m,) N
    viscous: Any           # (m,) N s
    advantage: Any         # (m,)
    mass: float
    inertia: Any           # (3, 3) kg mm^2
    inverse: Any           # (3, 3)
    centre: Any            # (3,) centre of mass, platform frame
    gravity: Any           # (3,) mm/s^2
    push: Any              # (6,) N, N mm: a wrench that does not change, at the platform origin, machine axes
    free: Any              # (6,) 1.0 or 0.0


class Scratch(NamedTuple):
    tip: Any               # (1, m, 3)
    lever: Any             # (m, 3)
    vectors: Any           # (3, 1, m, 3)
    numbers: Any           # (4, 1, m)
    given: Any             # (4, m): rest, line, and their rates
    tension: Any           # (m,)
    slopes: Any            # (7, STATE)
    trial: Any             # (STATE,)


_NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_STAGES = np.array([
    [0.0, 0, 0, 0, 0, 0],
    [1 / 5, 0, 0, 0, 0, 0],
    [3 / 40, 9 / 40, 0, 0, 0, 0],
    [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
# one unit of each state moves the nozzle by about this, mm (a vibration of 100 rad/s, an arm of 100 mm)
_SCALE = np.array([1.0, 1, 1, 200, 200, 200, 200, 0.01, 0.01, 0.01, 1, 1, 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(y, out):
    """The rotation matrix of the quaternion y[3:7], of any length."""
    w, x, y_, z = y[3], y[4], y[5], y[6]
    s = 2.0 / (w * w + x * x + y_ * y_ + z * z)
    out[0, 0], out[0, 1], out[0, 2] = 1 - s * (y_ * y_ + z * z), s * (x * y_ - w * z), s * (x * z + w * y_)
    out[1, 0], out[1, 1], out[1, 2] = s * (x * y_ + w * z), 1 - s * (x * x + z * z), s * (y_ * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = s * (x * z - w * y_), s * (y_ * z + w * x), 1 - s * (x * x + y_ * y_)


@njit(cache=True, nogil=True, error_model="numpy")
def _stretch(bot, y, turn, work):
    """Fill work.lever (from the centre of mass), work.tension and the lines for the cables given in work.given."""
    for i in range(len(bot.radii)):
        for j in range(3):
            lever = 0.0
            for k in range(3):
                lever += turn[j, k] * (bot.attachments[i, k] - bot.centre[k])
            work.lever[i, j] = lever
            work.tip[0, i, j] = y[j] + lever
    lead_cables(work.tip, bot.anchors, bot.axes, bot.radii, work.vectors, work.numbers)
    a = turn[0, 0] * y[10] + turn[0, 1] * y[11] + turn[0, 2] * y[12]
    b = turn[1, 0] * y[10] + turn[1, 1] * y[11] + turn[1, 2] * y[12]
    c = turn[2, 0] * y[10] + turn[2, 1] * y[11] + turn[2, 2] * y[12]
    for i in range(len(bot.radii)):
        u, lever = work.vectors[1, 0, i], work.lever[i]
        rate = -(u[0] * (y[7] + b * lever[2] - c * lever[1]) + u[1] * (y[8] + c * lever[0] - a * lever[2])
                 + u[2] * (y[9] + a * lever[1] - b * lever[0]))
        rest, n = work.given[0, i], bot.advantage[i]
        ratio = (work.given[1, i] + n * work.numbers[2, 0, i]) / rest
        ratio_rate = (work.given[3, i] + n * rate - ratio * work.given[2, i]) / rest
        work.tension[i] = max(0.0, bot.stiff[i] * (ratio - 1.0) + bot.viscous[i] * ratio_rate)


@njit(cache=True, nogil=True, error_model="numpy")
def _derivative(bot, y, work, out):
    """Fill out (STATE,) with dy/dt."""
    turn, force, moment = np.empty((3, 3)), np.empty(3), np.empty(3)
    _turn(y, turn)
    _stretch(bot, y, turn, work)
    for j in range(3):
        force[j], moment[j] = bot.push[j], bot.push[3 + j]
    for j in range(3):        # the push acts at the origin, moments are taken about the centre of mass
        a, b = (j + 1) % 3, (j + 2) % 3
        arm_a = -(turn[a, 0] * bot.centre[0] + turn[a, 1] * bot.centre[1] + turn[a, 2] * bot.centre[2])
        arm_b = -(turn[b, 0] * bot.centre[0] + turn[b, 1] * bot.centre[1] + turn[b, 2] * bot.centre[2])
        moment[j] += arm_a * bot.push[b] - arm_b * bot.push[a]
    for i in range(len(bot.radii)):
        u, lever, t = work.vectors[1, 0, i], work.lever[i], work.tension[i]
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            force[j] += t * u[j]
            moment[j] += t * (lever[a] * u[b] - lever[b] * u[a])
    _accelerate(bot, y, turn, force, moment, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _accelerate(bot, y, turn, force, moment, out):
    """Newton and Euler: force (N) and moment (N mm) at the centre of mass to dy/dt; what is not free is held."""
    spin, inner, alpha = y[10:13], np.empty(3), np.empty(3)
    for j in range(3):
        out[j] = y[7 + j]
        out[7 + j] = bot.free[j] * (1e3 * force[j] / bot.mass + bot.gravity[j])
        inner[j] = bot.inertia[j, 0] * spin[0] + bot.inertia[j, 1] * spin[1] + bot.inertia[j, 2] * spin[2]
    w, x, y_, z = y[3], y[4], y[5], y[6]
    out[3] = -0.5 * (x * spin[0] + y_ * spin[1] + z * spin[2])
    out[4] = 0.5 * (w * spin[0] + y_ * spin[2] - z * spin[1])
    out[5] = 0.5 * (w * spin[1] + z * spin[0] - x * spin[2])
    out[6] = 0.5 * (w * spin[2] + x * spin[1] - y_ * spin[0])
    rest = np.empty(3)
    for j in range(3):
        a, b = (j + 1) % 3, (j + 2) % 3
        rest[j] = 1e3 * (turn[0, j] * moment[0] + turn[1, j] * moment[1] + turn[2, j] * moment[2])
        rest[j] -= spin[a] * inner[b] - spin[b] * inner[a]
    for j in range(3):
        alpha[j] = bot.inverse[j, 0] * rest[0] + bot.inverse[j, 1] * rest[1] + bot.inverse[j, 2] * rest[2]
        out[10 + j] = alpha[j]
    if bot.free[3] * bot.free[4] * bot.free[5] == 0.0:
        for j in range(3):
            rest[j] = bot.free[3 + j] * (turn[j, 0] * alpha[0] + turn[j, 1] * alpha[1] + turn[j, 2] * alpha[2])
        for j in range(3):
            out[10 + j] = turn[0, j] * rest[0] + turn[1, j] * rest[1] + turn[2, j] * rest[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _between(command, row, share, period, given):
    """Fill given (4, m) at a share of the period after `row`: cubic Hermite pieces through values and rates."""
    s, r = share, 1.0 - share
    h00, h01 = r * r * (1 + 2 * s), s * s * (1 + 2 * r)
    h10, h11 = period * s * r * r, -period * s * s * r
    d00, d10, d11 = 6 * s * r / period, r * (1 - 3 * s), s * (3 * s - 2)
    for i in range(given.shape[1]):
        for q in range(2):
            v0, v1 = command[row, q, i], command[row + 1, q, i]
            g0, g1 = command[row, 2 + q, i], command[row + 1, 2 + q, i]
            given[q, i] = h00 * v0 + h01 * v1 + h10 * g0 + h11 * g1
            given[2 + q, i] = d00 * (v1 - v0) + d10 * g0 + d11 * g1


@njit(cache=True, nogil=True, error_model="numpy")
def _step(bot, y, command, row, share, h, period, work):
    """Fill work.slopes and work.trial with the step of h from y at row + share (slopes[0] is known); its error, mm."""
    slopes, trial = work.slopes, work.trial
    for stage in range(1, 7):
        for j in range(STATE):
            total = 0.0
            for k in range(stage):
                total += _STAGES[stage, k] * slopes[k, j]
            trial[j] = y[j] + h * total
        _between(command, row, min(share + _NODES[stage] * h / period, 1.0), period, work.given)
        _derivative(bot, trial, work, slopes[stage])
    worst = 0.0
    for j in range(STATE):
        error = 0.0
        for k in range(7):
            error += _ERROR[k] * slopes[k, j]
        worst = max(worst, abs(h * error) * _SCALE[j])
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def play_rows(bot, y, command, period, tolerance, states, tensions, work):
    """Play command (n+1, 4, m) from state y, which it moves on to the last row; fill states (n+1, STATE), tensions.

    tolerance: mm of error a step; 0: one step a row, unchecked. Returns the steps taken, or -row where a cable cannot
    run any more (its attachment is in the pulley, or numbers overflow).
    """
    _between(command, 0, 0.0, period, work.given)
    _derivative(bot, y, work, work.slopes[0])
    states[0], tensions[0] = y, work.tension
    h, steps = period, 0
    for row in range(len(command) - 1):
        share = 0.0
        while share < 1.0:
            left = (1.0 - share) * period
            whole = h >= left * (1 - 1e-9)
            error = _step(bot, y, command, row, share, left if whole else h, period, work)
            steps += 1
            good = tolerance == 0.0 or error <= tolerance
            used = left if whole else h
            if good:
                size = sqrt(work.trial[3] ** 2 + work.trial[4] ** 2 + work.trial[5] ** 2 + work.trial[6] ** 2)
                for j in range(STATE):
                    y[j] = work.trial[j] / (size if 3 <= j < 7 else 1.0)
                work.slopes[0] = work.slopes[6]
                share = 1.0 if whole else share + h / period
            elif not error > 0.0 or used < 1e-9:
                return -row - 1
            if tolerance > 0.0:
                scale = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * (tolerance / error) ** 0.2))
                h = min(period, max(used, h if good and whole else 0.0) * scale)
        states[row + 1], tensions[row + 1] = y, work.tension
        if not np.isfinite(y).all():
            return -row - 1
    return steps


def scratch(cables: int) -> Scratch:
    """Room to work in, for one call at a time."""
    return Scratch(
        np.empty((1, cables, 3)), np.empty((cables, 3)), np.empty((3, 1, cables, 3)), np.empty((4, 1, cables)),
        np.empty((4, cables)), np.empty(cables), np.empty((7, STATE)), np.empty(STATE))


def forces(bot: Columns, y: Array, given: Array) -> tuple[Array, Array]:
    """dy/dt (STATE,) and tensions (m,) of one state with cables given (4, m)."""
    work, out = scratch(len(bot.radii)), np.empty(STATE)
    work.given[:] = given
    _derivative(bot, np.ascontiguousarray(y, float), work, out)
    return out, work.tension
