"""Ways to choose among the tensions that balance a wrench, by name.

Legend as in tension: t = t_0 + N lambda, t_0 the balancing tension nearest to the method's starting level.

    name                  starts at   takes                                                    keeps the bounds
    nearest               t_r         the feasible tension nearest to t_r (default)            always
    least-norm            0           the feasible tension of least norm                       always
    closed-form           t_m         t_0 itself (Pott, Bruckmann and Mikelsons 2009)          sometimes
    improved-closed-form  t_m         t_0, worst cable set to its bound, again (Pott 2013)     nearly always
    barycentre            t_m         centre of area of the polygon (Mikelsons et al. 2008)    always, m <= n + 2
    puncture              t_r         where the line from the barycentre towards t_0 leaves
                                      the polygon (Mueller, Reichert and Bruckmann 2015)       always, m <= n + 2
    qp                    t_r         as nearest, one pose at a time by NNLS: a reference      always
    lp                    -           least sum of tensions, by HiGHS: a reference; jumps      always
    slack                 t_r         nearest; bounds widened by what is missing               balances, may leave them

t_m = (t_min + t_max)/2. All but lp are continuous along a path where they keep the bounds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import Robot
from cabslice.robot.polytope import barycentre, improved_closed_form, nearest_on_line, nearest_point
from cabslice.robot.reach import margins
from cabslice.robot.tension import Choice, Tensions, choose, least_violation
from cabslice.robot.wrench import wrench_matrix

SOLVER = 1e-6        # share of the tension range: what the reference solvers hold their bounds to

Distribution = Callable[[Array, Array, Array, Array, Array], Tensions]


def distribute(robot: Robot, poses: Array, required: Array, *, method: str = "nearest") -> Tensions:
    """Tensions of the method of that name; t_r is robot.tension_reference.

    poses (K, 6); required (K, 6) N and N mm: what W @ t must equal. feasible says whether the method kept the bounds;
    margin whether any could. ValueError naming the methods for an unknown name; PoseError as wrench_matrix.
    """
    wrench, needed = wrench_matrix(robot, poses, masked=True), np.asarray(required, dtype=float)[:, robot.freedoms]
    chosen = distribution(method)
    return chosen(wrench, needed, robot.tension_min, robot.tension_max, robot.tension_reference)


def distribution(method: str) -> Distribution:
    """The function (wrench (K, n, m), required (K, n), t_min, t_max, t_r) -> Tensions of that name."""
    if method not in METHODS:
        raise ValueError(f"no tension distribution is called {method!r}, expected one of: {', '.join(METHODS)}")
    return METHODS[method]


def _origin(rows: Array, lower: Array, upper: Array) -> Array:
    return np.zeros(rows.shape[1:])


def _puncture(rows: Array, lower: Array, upper: Array) -> Array:
    centre = barycentre(rows, lower, upper)
    return centre * nearest_on_line(np.einsum("irk,rk->ik", rows, centre), lower, upper)


def _from_reference(choice: Choice) -> Distribution:
    return lambda wrench, required, low, high, level: choose(wrench, required, low, high, level, choice)


def _from_middle(choice: Choice) -> Distribution:
    return lambda wrench, required, low, high, level: choose(
        wrench, required, low, high, (np.asarray(low) + np.asarray(high)) / 2, choice)


def least_norm(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Tensions:
    """The feasible tensions of least 2-norm, whatever the reference; shapes as tension.nearest."""
    return choose(wrench, required, tension_min, tension_max, np.zeros(wrench.shape[2]), nearest_point)


def least_sum(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Tensions:
    """The feasible tensions of least sum, one linear programme a pose (HiGHS). A reference: slow, and it jumps."""
    from scipy.optimize import linprog

    def solve(matrix: Array, side: Array, low: Array, high: Array, level: Array) -> Array:
        scale = 1 / np.abs(matrix).max(axis=1)
        answer = linprog(np.ones(len(low)), A_eq=matrix * scale[:, None], b_eq=side * scale,
                         bounds=np.stack((low, high), axis=1), method="highs")
        return answer.x if answer.status == 0 else np.full(len(low), np.nan)

    return _pose_by_pose(solve, wrench, required, tension_min, tension_max, reference)


def quadratic(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Tensions:
    """As tension.nearest for any m, one pose at a time, by least distance programming on NNLS. A reference: slow.

    Source: Lawson and Hanson 1974, Solving Least Squares Problems, ch. 23.
    """
    from scipy.linalg import null_space, pinv
    from scipy.optimize import nnls

    def solve(matrix: Array, side: Array, low: Array, high: Array, level: Array) -> Array:
        null = null_space(matrix)
        start = level + pinv(matrix) @ (side - matrix @ level)
        table = np.column_stack((np.vstack((null, -null)), np.concatenate((low - start, start - high)))).T
        target = np.append(np.zeros(null.shape[1]), 1.0)
        left = table @ nnls(table, target)[0] - target
        return start + null @ (-left[:-1] / left[-1]) if left[-1] < -1e-12 else np.full(len(low), np.nan)

    return _pose_by_pose(solve, wrench, required, tension_min, tension_max, reference)


def _pose_by_pose(solve: Callable[..., Array], wrench: Array, required: Array, *levels: Array) -> Tensions:
    count, _, cables = wrench.shape
    low, high, level = (np.broadcast_to(np.asarray(column, dtype=float), (count, cables)) for column in levels)
    margin = margins(wrench, required, low, high)
    tension = np.full((count, cables), np.nan)
    for k in np.flatnonzero(np.isfinite(margin)):
        tension[k] = solve(wrench[k], required[k], low[k], high[k], level[k])
    slip = SOLVER * (high - low)
    feasible = ((tension >= low - slip) & (tension <= high + slip)).all(axis=1)
    tension[~feasible] = np.nan
    return Tensions(tension, feasible, margin)


METHODS: dict[str, Distribution] = {
    "nearest": _from_reference(nearest_point),
    "least-norm": least_norm,
    "closed-form": _from_middle(_origin),
    "improved-closed-form": _from_middle(improved_closed_form),
    "barycentre": _from_middle(barycentre),
    "puncture": _from_reference(_puncture),
    "qp": quadratic,
    "lp": least_sum,
    "slack": least_violation,
}
