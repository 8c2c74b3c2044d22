"""Points of the set of feasible tensions in null-space coordinates, for a whole batch of poses.

Legend
    h_i      rows of the null space N (m, r)          lambda   (r,) coordinates, t = t_0 + N lambda
    strips   lower_i <= h_i . lambda <= upper_i, one a cable: between them lies the polytope (r = 2: a polygon)

Batches lie on the last axis. Incremental construction after Seidel 1991 (Small-dimensional linear programming and
convex hulls made easy), here for the nearest point: if the nearest point of the first i - 1 strips leaves strip i, the
new one lies on the side it left by, where the problem has one dimension less.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array

PARALLEL = 1e-9      # |h_i| below this: no lambda moves the tension of this cable
TOUCH = 1e-11        # N per N of range: a strip left by less than this is not left


def nearest_point(rows: Array, lower: Array, upper: Array) -> Array:
    """The point (r, K) of the polytope nearest to lambda = 0.

    rows (m, r, K), bounds (m, K). Exact, in time linear in K; at most m (m-1) ... (m-r+2) sweeps, 8 for r = 2.
    Where the polytope is empty the answer is finite and means nothing: ask reach.margin_of first.
    """
    redundancy, count = rows.shape[1:]
    if redundancy == 1:
        return _nearest_on_line(rows[:, 0], lower, upper)[None]
    point = np.zeros((redundancy, count))
    if redundancy == 0:
        return point
    touch = TOUCH * (upper - lower)
    for i in range(len(rows)):
        value = np.einsum("rk,rk->k", rows[i], point)
        over = value > upper[i] + touch[i]
        left = np.flatnonzero(over | (value < lower[i] - touch[i]))
        if len(left):
            bound = np.where(over[left], upper[i, left], lower[i, left])
            earlier = rows[:i + 1, :, left], lower[:i, left], upper[:i, left]
            point[:, left] = _nearest_on_side(*earlier, bound, point[:, left])
    return point


def _nearest_on_side(rows: Array, lower: Array, upper: Array, bound: Array, previous: Array) -> Array:
    """The point nearest to 0 with rows[-1] . lambda = bound, within the strips of the rows before it."""
    normal = rows[-1]
    size = np.sqrt(np.einsum("rk,rk->k", normal, normal))
    fixed = size < PARALLEL
    size = np.where(fixed, 1.0, size)
    normal = normal / size
    foot = normal * (bound / size)
    if len(rows) > 1:
        frame = across(normal)
        inner = np.einsum("irk,rqk->iqk", rows[:-1], frame)
        passed = np.einsum("irk,rk->ik", rows[:-1], foot)
        foot += np.einsum("rqk,qk->rk", frame, nearest_point(inner, lower - passed, upper - passed))
    return np.where(fixed, previous, foot)


def across(normal: Array) -> Array:
    """Orthonormal vectors (r, r-1, K) at right angles to unit vectors (r, K): columns of a Householder mirror."""
    mirror = normal.copy()
    mirror[0] += np.copysign(1.0, normal[0])
    frame = -mirror[:, None] * (normal[1:] / np.abs(mirror[0]))
    for axis in range(1, len(normal)):
        frame[axis, axis - 1] += 1.0
    return frame


def _nearest_on_line(slopes: Array, lower: Array, upper: Array) -> Array:
    """The number (K,) nearest to 0 with lower <= slope x <= upper for all rows; mid gap where there is none."""
    first, last = line_interval(slopes, lower, upper)
    clipped = np.minimum(np.maximum(first, 0.0), last)
    return np.where(first > last, (first + last) / 2, clipped)


def line_interval(slopes: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Ends (K,) of the interval lower <= slope x <= upper, rows (m, K); first > last where it is empty."""
    flat = np.abs(slopes) < PARALLEL
    inverse = 1.0 / np.where(flat, 1.0, slopes)
    one, other = lower * inverse, upper * inverse
    first = np.where(flat, -np.inf, np.minimum(one, other)).max(axis=0)
    last = np.where(flat, np.inf, np.maximum(one, other)).min(axis=0)
    return first, last
