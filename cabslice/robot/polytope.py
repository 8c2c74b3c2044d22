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
TOUCH = 1e-11        # share of a strip: left by less than this, it is not left
TWIN = 1e-9          # share of a strip: parallel edges nearer than this are one edge
NEEDLE = 1e-9        # area over squared perimeter below this: the polygon is a needle


def nearest_point(rows: Array, lower: Array, upper: Array) -> Array:
    """The point (r, K) of the polytope nearest to lambda = 0.

    rows (m, r, K), bounds (m, K). Exact, in time linear in K; at most m (m-1) ... (m-r+2) sweeps, 8 for r = 2.
    Where the polytope is empty the answer is finite and means nothing: ask reach.margin_of first.
    """
    redundancy, count = rows.shape[1:]
    if redundancy == 1:
        return nearest_on_line(rows[:, 0], lower, upper)[None]
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
    normal, size = _unit(rows[-1])
    foot = normal * (bound / size)
    if len(rows) > 1:
        frame = across(normal)
        inner = np.einsum("irk,rqk->iqk", rows[:-1], frame)
        passed = np.einsum("irk,rk->ik", rows[:-1], foot)
        foot += np.einsum("rqk,qk->rk", frame, nearest_point(inner, lower - passed, upper - passed))
    return np.where(size <= PARALLEL, previous, foot)


def across(normal: Array) -> Array:
    """Orthonormal vectors (r, r-1, K) at right angles to unit vectors (r, K): columns of a Householder mirror."""
    mirror = normal.copy()
    mirror[0] += np.copysign(1.0, normal[0])
    frame = -mirror[:, None] * (normal[1:] / np.abs(mirror[0]))
    for axis in range(1, len(normal)):
        frame[axis, axis - 1] += 1.0
    return frame


def nearest_on_line(slopes: Array, lower: Array, upper: Array) -> Array:
    """The number (K,) nearest to 0 with lower <= slope x <= upper for all rows; mid gap where there is none."""
    first, last = line_interval(slopes, lower, upper)
    empty, clipped = first > last, np.minimum(np.maximum(first, 0.0), last)
    return np.where(empty, (np.where(empty, first, 0.0) + np.where(empty, last, 0.0)) / 2, clipped)


def line_interval(slopes: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Ends (K,) of the interval lower <= slope x <= upper, rows (m, K); first > last where it is empty."""
    flat = np.abs(slopes) < PARALLEL
    inverse = 1.0 / np.where(flat, 1.0, slopes)
    one, other = lower * inverse, upper * inverse
    first = np.where(flat, -np.inf, np.minimum(one, other)).max(axis=0)
    last = np.where(flat, np.inf, np.maximum(one, other)).min(axis=0)
    return first, last


def improved_closed_form(rows: Array, lower: Array, upper: Array) -> Array:
    """From lambda = 0, put the cable that is most outside on its bound, then anew with the rest, at most r times.

    Shapes as nearest_point. May end outside of a polytope that is not empty. Source: Pott 2013, An improved force
    distribution algorithm for over-constrained cable-driven parallel robots.
    """
    redundancy, count = rows.shape[1:]
    point, poses = np.zeros((redundancy, count)), np.arange(count)
    frame, inner = np.repeat(np.eye(redundancy)[..., None], count, axis=2), rows
    for _ in range(redundancy):
        value = np.einsum("irk,rk->ik", rows, point)
        excess = np.maximum(lower - value, value - upper)
        worst = excess.argmax(axis=0), poses
        bound = np.where(value[worst] > upper[worst], upper[worst], lower[worst])
        normal, size = _unit(inner[worst[0], :, poses].T)
        moves = (size > PARALLEL) & (excess[worst] > 0)
        step = np.where(moves, (bound - value[worst]) / np.where(moves, size, 1.0), 0.0)
        point += np.einsum("rqk,qk->rk", frame, normal) * step
        turn = across(normal)
        frame, inner = np.einsum("rqk,qpk->rpk", frame, turn), np.einsum("iqk,qpk->ipk", inner, turn)
    return point


def barycentre(rows: Array, lower: Array, upper: Array) -> Array:
    """Centre of area of the polygon (r = 2) or middle of the interval (r = 1), shapes as nearest_point.

    Sums the triangles between a point of the polygon and its edges; a needle gives the middle of its length.
    Raises ValueError for r > 2. Source: Mikelsons, Bruckmann, Hiller and Schramm 2008.
    """
    redundancy, count = rows.shape[1:]
    if redundancy > 2:
        raise ValueError(f"the barycentre is for at most two cables more than freedoms, not {redundancy}")
    if redundancy == 0:
        return np.zeros((0, count))
    if redundancy == 1:
        return np.mean(line_interval(rows[:, 0], lower, upper), axis=0)[None]
    apex = nearest_point(rows, lower, upper)
    passed = np.einsum("irk,rk->ik", rows, apex)
    lower, upper = lower - passed, upper - passed
    distance, length, middle = (np.stack(column) for column in zip(
        *(_edge(rows, lower, upper, i, side) for i in range(len(rows)) for side in (False, True)), strict=True))
    area, total = (distance * length).sum(axis=0), length.sum(axis=0)
    weight = np.where(area > NEEDLE * total**2, 2 / 3 * distance * length, length)
    whole = np.where(area > NEEDLE * total**2, area, np.where(total > 0, total, 1.0))
    return apex + np.einsum("ek,erk->rk", weight, middle) / whole


def _edge(rows: Array, lower: Array, upper: Array, i: int, above: bool) -> tuple[Array, Array, Array]:
    """Distance from 0 (K,), length (K,) and middle (2, K) of the polygon's edge on one side of strip i."""
    normal, size = _unit(rows[i])
    distance = (upper if above else lower)[i] / size
    along, aside = np.stack((-normal[1], normal[0])), np.einsum("irk,rk->ik", rows, normal)
    slopes, passed = np.einsum("irk,rk->ik", rows, along), aside * distance
    first, last = line_interval(slopes, lower - passed, upper - passed)
    same, near = np.abs(slopes) < PARALLEL, TWIN * (upper - lower)
    beyond = same & ((passed < lower - near) | (passed > upper + near))
    twin = same & (np.abs(passed - np.where((aside > 0) == above, upper, lower)) < near)
    gone = (size <= PARALLEL) | beyond.any(axis=0) | twin[:i].any(axis=0)
    length = np.where(gone, 0.0, np.maximum(last - first, 0.0))
    return np.abs(distance), length, normal * distance + along * (first + last) / 2


def _unit(vectors: Array) -> tuple[Array, Array]:
    """Unit vectors and sizes of columns (r, K); the first axis and PARALLEL where a vector has hardly any length."""
    size = np.sqrt(np.einsum("rk,rk->k", vectors, vectors))
    unit = vectors / np.maximum(size, PARALLEL)
    unit[:, size <= PARALLEL] = np.eye(len(vectors))[:, :1]
    return unit, np.maximum(size, PARALLEL)
