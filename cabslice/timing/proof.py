"""Plan, audit, and where the audit finds a limit broken between the places the planner looked at, slow down around it;
where that does not help, the whole piece; where the motors are loaded too much in the mean of the print, all of it.

A limit is never raised. Stretching time by f divides speeds by f, accelerations by f^2. Around a broken place f falls
back to 1 by SLOPE a second: that takes v SLOPE of acceleration more, v the speed, below what the plan keeps back.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.findings import Verdict
from cabslice.robot.delta import Machine
from cabslice.timing.audit import Progress, examine
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import Trajectory, eased, piece_at, slowed
from cabslice.timing.worst import ROUNDING
from cabslice.toolpath.path import Toolpath

ROUNDS = 6
MARGIN = 1.002      # stretched a little more than asked for
BOLDEST = 1.25      # at most this much in one round
LOCAL = 4           # of the rounds slow down around the places alone
SLOPE = 0.2         # 1/s
AROUND_S = 5e-3     # and half the window, on each side of a place, are slowed as much as the place itself


def plan_proven(
    toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any,
    *, engine: str = "compiled", jobs: int = 1, planning: Progress | None = None, auditing: Progress | None = None,
) -> tuple[Trajectory, Verdict]:
    """The motion and the verdict of its audit; a verdict that is not ok is one that slowing down does not cure.

    Arguments and errors as timing.retime.plan.
    """
    given = toolpath, robot, printer, material, process
    trajectory = plan(*given, engine=engine, jobs=jobs, progress=planning)
    return proven(trajectory, *given, jobs=jobs, auditing=auditing)


def proven(
    trajectory: Trajectory, toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any,
    *, jobs: int = 1, auditing: Progress | None = None,
) -> tuple[Trajectory, Verdict]:
    """A planned motion, slowed where its audit asks for it, and the verdict; as plan_proven."""
    given = toolpath, robot, printer, material, process
    for round_ in range(ROUNDS):
        verdict, times, shares = examine(trajectory, *given, jobs=jobs, progress=auditing)
        heat = verdict.margins.get("motor_heat_share", 0.0)
        if not len(times) and heat <= 1 + ROUNDING:
            break
        if round_ < LOCAL:
            trajectory = eased(trajectory, np.maximum(_around(trajectory, times, shares), _cooler(heat)))
        else:
            trajectory = slowed(trajectory, np.maximum(_factors(trajectory, times, shares), _cooler(heat)))
    else:
        verdict = examine(trajectory, *given, jobs=jobs, progress=auditing)[0]
    return trajectory, verdict


def _factors(trajectory: Trajectory, times: Array, shares: Array) -> Array:
    """(P,) by how much to stretch each piece."""
    factor = np.ones(len(trajectory.pieces) - 1)
    np.maximum.at(factor, piece_at(trajectory, times), _wanted(shares))
    return factor


def _wanted(shares: Array) -> Array:
    return np.minimum(np.where(np.isfinite(shares), shares, BOLDEST) * MARGIN, BOLDEST)


def _around(trajectory: Trajectory, times: Array, shares: Array) -> Array:
    """(G,) by how much to stretch the time at each node: around every place as asked for, falling off within its
    piece."""
    factor, time, pieces = np.ones(len(trajectory.time)), trajectory.time, trajectory.pieces
    piece, reach = piece_at(trajectory, times), AROUND_S + trajectory.window / 2
    low = np.maximum(np.searchsorted(time, times - reach, side="right") - 1, pieces[piece])
    high = np.minimum(np.searchsorted(time, times + reach), pieces[piece + 1] - 1)
    for first, last, most in zip(low.tolist(), high.tolist(), _wanted(shares).tolist(), strict=True):
        np.maximum(factor[first:last + 1], most, out=factor[first:last + 1])
    apart = np.repeat(np.arange(len(pieces) - 1), np.diff(pieces)) * (BOLDEST / SLOPE) + time
    fall = SLOPE * apart
    after = np.maximum.accumulate(factor + fall) - fall
    before = (np.maximum.accumulate((factor - fall)[::-1])[::-1]) + fall
    return np.maximum(np.maximum(after, before), 1.0)


def _cooler(heat: float) -> float:
    """By how much to stretch every piece: motors hold any tension of the plan for ever, what is more they turn with."""
    return min(heat * MARGIN, BOLDEST) if heat > 1 + ROUNDING else 1.0
