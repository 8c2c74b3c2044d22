"""Cable tensions that balance a wrench within the bounds, nearest to a reference level.

Legend
    W t = w, t_min <= t <= t_max      t_r   reference tension       N   orthonormal null space of W
    t_0 = t_r + W^+ (w - W t_r)       the balancing tension nearest to t_r, bounds forgotten
    t = t_0 + N lambda                feasible lambda form a polytope; |t - t_r|^2 = |t_0 - t_r|^2 + |lambda|^2

So the wanted tension is the point of the polytope nearest to lambda = 0: unique, exact, and continuous along a path
(the projection on a convex set moves no faster than what is projected). Source of the polytope: Mikelsons, Bruckmann,
Hiller and Schramm 2008; of the nearest point as command: Pott 2018, Cable-Driven Parallel Robots, 3.7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import Robot
from cabslice.robot.nullspace import balance, blocks
from cabslice.robot.polytope import nearest_point
from cabslice.robot.reach import bounds_of, margin_of, part_of
from cabslice.robot.wrench import wrench_matrix

ROUNDING = 1e-9      # share of the tension range that a feasible tension may miss its bounds by

# lambda (r, K) from the null space (m, r, K) and the bounds of N lambda (m, K), counted from t_0
Choice = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class Tensions:
    """Tensions of m cables at K poses. Nothing is clamped: where no tension within the bounds was found it is nan."""

    tension: Array       # (K, m) N, nan where not feasible
    feasible: Array      # (K,) bool
    margin: Array        # (K,) N of the pose: all cables could stay this far inside their bounds; negative: missing

    def __len__(self) -> int:
        return len(self.feasible)


def nearest_tension(robot: Robot, poses: Array, required: Array, *, margins: bool = True) -> Tensions:
    """The feasible tensions nearest to robot.tension_reference.

    poses (K, 6); required (K, 6) N and N mm, what W @ t must equal (wrench.required_wrench). Exact; continuous in pose
    and wrench. Without `margins` they are nan, at a third of the time. Raises PoseError where a cable cannot be led to
    its attachment.
    """
    wrench = wrench_matrix(robot, poses, masked=True)
    needed = np.asarray(required, dtype=float)[:, robot.freedoms]
    bounds = robot.tension_min, robot.tension_max, robot.tension_reference
    return nearest(wrench, needed, *bounds) if margins else unmeasured(wrench, needed, *bounds)


def unmeasured(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Tensions:
    """As nearest with bounds and reference (m,), margins left nan: the polygon only where the bounds bind."""
    from cabslice.robot.tension_kernel import fill_unbounded

    tension, feasible = np.empty((len(wrench), wrench.shape[2])), np.empty(len(wrench), bool)
    n = wrench.shape[1]
    fill_unbounded(np.ascontiguousarray(wrench), np.ascontiguousarray(required), reference, tension, feasible,
                   np.empty((n + 2, n)))
    feasible &= ((tension >= tension_min) & (tension <= tension_max)).all(axis=1)
    rest = np.flatnonzero(~feasible)
    if len(rest):
        careful = nearest(wrench[rest], required[rest], tension_min, tension_max, reference)
        tension[rest], feasible[rest] = careful.tension, careful.feasible
    return Tensions(tension, feasible, np.full(len(wrench), np.nan))


def nearest(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Tensions:
    """The tensions within the bounds nearest (2-norm) to a reference, with W t = required.

    wrench (K, n, m); required (K, n); bounds and reference (m,) or (K, m) N. Any m >= n; fast for m <= n + 2, and the
    steps grow as m^(m - n) beyond. Raises ValueError as reach.margins.
    """
    return choose(wrench, required, tension_min, tension_max, reference, nearest_point)


def choose(
    wrench: Array, required: Array, tension_min: Array, tension_max: Array, start: Array, choice: Choice
) -> Tensions:
    """Balancing tensions t_0 + N lambda, lambda = choice(N, t_min - t_0, t_max - t_0), t_0 nearest to `start`.

    feasible says whether this choice keeps the bounds; margin is the pose's own. Shapes and errors as nearest.
    """
    middle, half = bounds_of(tension_min, tension_max, wrench.shape[2])
    started = np.atleast_2d(np.asarray(start, dtype=float)).T
    tensions = np.empty((len(wrench), wrench.shape[2]))
    feasible, margin = np.empty(len(wrench), dtype=bool), np.empty(len(wrench))
    for part in blocks(len(wrench)):
        centre, reach = part_of(middle, part), part_of(half, part)
        null, base, margin[part] = _state(wrench[part], required[part], part_of(started, part), centre, reach)
        tension = base + np.einsum("irk,rk->ik", null, choice(null, centre - reach - base, centre + reach - base))
        excess = (np.abs(tension - centre) - (1 + ROUNDING) * reach).max(axis=0)
        feasible[part] = (excess <= ROUNDING * reach.max()) & np.isfinite(margin[part])
        tensions[part] = np.where(feasible[part], tension, np.nan).T
    return Tensions(tensions, feasible, margin)


def least_violation(
    wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array
) -> Tensions:
    """As nearest, but where nothing is feasible the bounds are widened by what is missing, the same for all cables.

    There the tension balances and leaves its bounds by exactly -margin in the worst cable, the least possible; feasible
    stays False. At singular poses tension is nan. Negative tensions mean a cable that would have to push.
    """
    found = nearest(wrench, required, tension_min, tension_max, reference)
    short = np.flatnonzero(~found.feasible & np.isfinite(found.margin))
    if len(short):
        lower, upper, wanted = (
            np.broadcast_to(column, found.tension.shape)[short] for column in (tension_min, tension_max, reference)
        )
        more = -found.margin[short, None]
        found.tension[short] = nearest(wrench[short], required[short], lower - more, upper + more, wanted).tension
    return found


def _state(wrench: Array, required: Array, start: Array, middle: Array, half: Array) -> tuple[Array, Array, Array]:
    """Null space (m, r, K), the balancing tension nearest to start (m, K) and the margin (K,) of a block."""
    missing = required - np.einsum("kij,jk->ki", wrench, np.broadcast_to(start, (wrench.shape[2], len(wrench))))
    state = balance(wrench, missing)
    state.particular[:, 0] += start
    return state.null, state.particular[:, 0], margin_of(state, middle, half)
