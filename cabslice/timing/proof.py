"""Plan, audit, and where the audit finds a limit broken between the places the planner looked at, slow that piece down;
where the motors are loaded too much in the mean of the print, slow them all.

A limit is never raised. Stretching the time of a piece by f divides its speeds by f and its accelerations by f^2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.findings import Verdict
from cabslice.robot.delta import Machine
from cabslice.timing.audit import Progress, examine
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import Trajectory, piece_at, slowed
from cabslice.timing.worst import ROUNDING
from cabslice.toolpath.path import Toolpath

ROUNDS = 6
MARGIN = 1.002      # stretched a little more than asked for
BOLDEST = 1.25      # at most this much in one round


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
    for _ in range(ROUNDS):
        verdict, times, shares = examine(trajectory, *given, jobs=jobs, progress=auditing)
        heat = verdict.margins.get("motor_heat_share", 0.0)
        if not len(times) and heat <= 1 + ROUNDING:
            break
        trajectory = slowed(trajectory, np.maximum(_factors(trajectory, times, shares), _cooler(heat)))
    else:
        verdict = examine(trajectory, *given, jobs=jobs, progress=auditing)[0]
    return trajectory, verdict


def _factors(trajectory: Trajectory, times: Array, shares: Array) -> Array:
    """(P,) by how much to stretch each piece."""
    factor = np.ones(len(trajectory.pieces) - 1)
    wanted = np.minimum(np.where(np.isfinite(shares), shares, BOLDEST) * MARGIN, BOLDEST)
    np.maximum.at(factor, piece_at(trajectory, times), wanted)
    return factor


def _cooler(heat: float) -> float:
    """By how much to stretch every piece: motors hold any tension of the plan for ever, what is more they turn with."""
    return min(heat * MARGIN, BOLDEST) if heat > 1 + ROUNDING else 1.0
