"""Distances between convex things, for whole columns of pairs at once.

Legend
    A -> b     a cable from its exit point A (t = 0) to its attachment b (t = 1)
    b0 -> b1   the attachment during one straight move of the nozzle: with A fixed the cable sweeps the triangle A b0 b1
    bead       what one extruding move laid: all points within `half` mm of its centre line in plan, low <= z <= top
    f(t)       distance from the bead to the points A + t (b - A), b on b0 b1

f is convex, since the distance to a convex body is convex and the triangle is linear in t for each of its cables; so a
golden section finds its least value, and the last bracket with f's slope gives a proven lower bound.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.obstacles import Obstacles

GOLDEN = (np.sqrt(5) - 1) / 2
PRECISION = 1e-6     # mm, by how much a proven distance may fall short of the true one
STEPS = 4            # of the golden section between looks at what is decided


def linear_range(start: Array, slope: Array, first: Array, last: Array) -> tuple[Array, Array]:
    """The part of [first, last] where start + slope t >= 0; empty (first > last) where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -start / slope
    first = np.where(slope > 0, np.maximum(first, zero), first)
    last = np.where(slope < 0, np.minimum(last, zero), last)
    return first, np.where((slope == 0) & (start < 0), -1.0, last)


def height_range(
    start_low: Array, start_high: Array, end_low: Array, end_high: Array, low: Array, top: Array
) -> tuple[Array, Array]:
    """Where along cables (t from 0 to 1) their height may lie in [low, top]: first, last (K,); first > last: nowhere.

    Cables start between start_low and start_high and end between end_low and end_high, mm.
    """
    first, last = linear_range(start_high - low, end_high - start_high, np.zeros_like(low), np.ones_like(low))
    return linear_range(top - start_low, start_low - end_low, first, last)


def sweep_gap(
    exits: Array, tips0: Array, tips1: Array, beads: Obstacles, reach: Array
) -> tuple[Array, Array]:
    """Distance (K,) mm between the triangles that cables sweep and beads, and where along the cable, t (K,).

    exits, tips0, tips1 (K, 3) mm. The distance is a lower bound: short of the true one by at most PRECISION and the
    height the move climbs (|tips1 - tips0| in z); beyond reach (K,) mm it is any bound above reach, or inf.
    """
    end_low, end_high = np.minimum(tips0[:, 2], tips1[:, 2]), np.maximum(tips0[:, 2], tips1[:, 2])
    start = exits[:, 2]
    first, last = height_range(start, start, end_low, end_high, beads.low - reach, beads.top + reach)
    gap, at = np.full(len(beads), np.inf), np.zeros(len(beads))
    rows = np.flatnonzero(first <= last)
    if len(rows):
        pairs = _Triangles(exits[rows], tips0[rows], tips1[rows], beads.take(rows))
        gap[rows], at[rows] = _least(pairs, first[rows], last[rows], reach[rows])
    return gap, at


class _Triangles:
    """f(t) of K pairs, column by column so that each step is one sweep."""

    def __init__(self, exits: Array, tips0: Array, tips1: Array, beads: Obstacles) -> None:
        self.ax, self.ay, self.az = exits.T.copy()
        self.ux, self.uy, uz = (tips0 - exits).T.copy()
        self.vx, self.vy, vz = (tips1 - exits).T.copy()
        self.down, self.up = np.minimum(uz, vz), np.maximum(uz, vz)
        self.px, self.py = beads.first.T.copy()
        self.ex, self.ey = (beads.last - beads.first).T.copy()
        square = self.ex**2 + self.ey**2
        self.share = 1.0 / np.where(square > 0, square, 1.0)
        self.half, self.low, self.top = beads.half, beads.low, beads.top
        self.slope = np.sqrt(np.maximum(self.ux**2 + self.uy**2 + uz**2, self.vx**2 + self.vy**2 + vz**2))

    def keep(self, rows: Array) -> None:
        for name, column in vars(self).items():
            setattr(self, name, column[rows])

    def distance(self, t: Array) -> Array:
        x0, y0 = self.ax + t * self.ux - self.px, self.ay + t * self.uy - self.py
        x1, y1 = self.ax + t * self.vx - self.px, self.ay + t * self.vy - self.py
        plan = np.maximum(_plan_distance(x0, y0, x1, y1, self.ex, self.ey, self.share) - self.half, 0.0)
        above = np.maximum(self.az + t * self.down - self.top, self.low - self.az - t * self.up)
        return np.hypot(plan, np.maximum(above, 0.0))


def _plan_distance(x0: Array, y0: Array, x1: Array, y1: Array, ex: Array, ey: Array, share: Array) -> Array:
    """Distance in the plane between segments (x0, y0)-(x1, y1) and (0, 0)-(ex, ey); share = 1/|e|^2."""
    dx, dy = x1 - x0, y1 - y0
    size = dx * dx + dy * dy
    side0, side1 = ex * y0 - ey * x0, ex * y1 - ey * x1
    near, far = dy * x0 - dx * y0, dy * (x0 - ex) - dx * (y0 - ey)
    crossing = (side0 * side1 < 0) & (near * far < 0)
    t = np.clip((x0 * ex + y0 * ey) * share, 0.0, 1.0)
    least = (x0 - t * ex) ** 2 + (y0 - t * ey) ** 2
    t = np.clip((x1 * ex + y1 * ey) * share, 0.0, 1.0)
    least = np.minimum(least, (x1 - t * ex) ** 2 + (y1 - t * ey) ** 2)
    share = 1.0 / np.where(size > 0, size, 1.0)
    t = np.clip(-(x0 * dx + y0 * dy) * share, 0.0, 1.0)
    least = np.minimum(least, (x0 + t * dx) ** 2 + (y0 + t * dy) ** 2)
    t = np.clip(((ex - x0) * dx + (ey - y0) * dy) * share, 0.0, 1.0)
    least = np.minimum(least, (x0 + t * dx - ex) ** 2 + (y0 + t * dy - ey) ** 2)
    return np.where(crossing, 0.0, np.sqrt(least))


def _least(pairs: _Triangles, first: Array, last: Array, enough: Array) -> tuple[Array, Array]:
    """Golden section on [first, last]: proven least f and where it was met; ends where f > enough is proven."""
    gap, at, rows = np.empty(len(first)), np.empty(len(first)), np.arange(len(first))
    left, right = last - GOLDEN * (last - first), first + GOLDEN * (last - first)
    state = np.stack((first, last, left, right, pairs.distance(left), pairs.distance(right)))
    while True:
        best = np.minimum(state[4], state[5])
        width = pairs.slope * (state[1] - state[0])
        bound = np.maximum(best - width, 0.0)
        done = (width <= PRECISION) | (bound > enough)
        gap[rows[done]] = bound[done]
        at[rows[done]] = np.where(state[4] <= state[5], state[2], state[3])[done]
        go = np.flatnonzero(~done)
        if not len(go):
            return gap, at
        if len(go) < len(rows):
            rows, enough, state = rows[go], enough[go], state[:, go]
            pairs.keep(go)
        for _ in range(STEPS):
            state = _narrowed(pairs, *state)


def _narrowed(
    pairs: _Triangles, first: Array, last: Array, left: Array, right: Array, at_left: Array, at_right: Array
) -> Array:
    """One step of the golden section: ends of the bracket, the two places within and f there."""
    lower = at_left <= at_right
    last, first = np.where(lower, right, last), np.where(lower, first, left)
    fresh = np.where(lower, last - GOLDEN * (last - first), first + GOLDEN * (last - first))
    value = pairs.distance(fresh)
    return np.stack((
        first, last, np.where(lower, fresh, right), np.where(lower, left, fresh),
        np.where(lower, value, at_right), np.where(lower, at_left, value),
    ))
