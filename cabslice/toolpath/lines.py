"""Lines as they are drawn: begun at their place, turned round where asked, without useless points. Compiled.

points (N, 2) mm, width (N,) mm, starts (B + 1,), closed (B,)   as in slicing.layer.Beads
lines, first, part, back (L,)   which lines are drawn, where those that are rings begin, which are reversed
"""

from __future__ import annotations

import numpy as np
from numba import njit

TINY = 2e-3         # mm, nearer points are one; more than a G-code file's last digit, so that none collapses there
SAME_WIDTH = 1e-6   # mm


@njit(cache=True, error_model="numpy")
def draw(points, width, starts, closed, lines, first, part, back, tolerance):
    """The lines one after another as (points (M, 2), width (M,), starts (L + 1,)); points from starts[L] on are waste.

    A ring ends where it began. The width at a point is that of the segment into it. Points nearer than TINY to the one
    before go, and so do those that lie within `tolerance` mm of the segment without them, never where the width
    changes. A line shorter than TINY has no points left.
    """
    room = 0
    for k in range(len(lines)):
        room += starts[lines[k] + 1] - starts[lines[k]] + 2
    out, wide, ends = np.empty((room, 2)), np.empty(room), np.zeros(len(lines) + 1, np.int64)
    m = 0
    for k in range(len(lines)):
        low, high = starts[lines[k]], starts[lines[k] + 1]
        xy, w = points[low:high], width[low:high]
        if closed[lines[k]]:
            size = _unroll(xy, w, first[k], part[k], out[m:], wide[m:])
        else:
            size = _run(xy, w, back[k], out[m:], wide[m:])
        m += _tidy(out[m:m + size], wide[m:m + size], tolerance)
        ends[k + 1] = m
    return out, wide, ends


@njit(cache=True, error_model="numpy")
def _unroll(xy, w, first, part, out, wide):
    n, after = len(xy), (first + 1) % len(xy)
    size = n + 1 if part == 0.0 else n + 2
    for k in range(size):
        at = (first + k) % n
        out[k, 0], out[k, 1], wide[k] = xy[at, 0], xy[at, 1], w[at]
    for k in (0, size - 1):
        out[k, 0] = xy[first, 0] + part * (xy[after, 0] - xy[first, 0])
        out[k, 1] = xy[first, 1] + part * (xy[after, 1] - xy[first, 1])
        wide[k] = w[first] if k and part == 0.0 else w[after]
    return size


@njit(cache=True, error_model="numpy")
def _run(xy, w, back, out, wide):
    n = len(xy)
    for k in range(n):
        at = n - 1 - k if back else k
        out[k, 0], out[k, 1], wide[k] = xy[at, 0], xy[at, 1], w[min(n - k, n - 1) if back else k]
    return n


@njit(cache=True, error_model="numpy")
def _tidy(xy, w, tolerance):
    """Move the points that stay to the front; how many they are.

    From the last kept point a wedge of directions is narrowed by every point passed over: a later point inside it sees
    all of them within `tolerance` of its segment (the sleeve of Imai and Iri 1988).
    """
    n, kept, run = len(xy), 1, False      # run: the point at `kept` ends a segment that may still grow
    low, high, far = -np.inf, np.inf, 0.0
    bx = by = 0.0
    for k in range(1, n):
        last = kept if run else kept - 1
        step = np.hypot(xy[k, 0] - xy[last, 0], xy[k, 1] - xy[last, 1])
        if step < TINY:
            if k == n - 1 and run:        # the end stays where it is: it takes the place of the point before
                xy[kept, 0], xy[kept, 1] = xy[k, 0], xy[k, 1]
            continue
        if run:
            gap, angle = _seen(xy, kept - 1, k, bx, by)
            grows = gap >= far and low <= angle <= high and abs(angle) < np.pi / 2 and abs(w[k] - w[kept]) <= SAME_WIDTH
            if not grows:
                kept, run = kept + 1, False
        if not run:
            low, high = -np.inf, np.inf
            bx, by = xy[k, 0] - xy[kept - 1, 0], xy[k, 1] - xy[kept - 1, 1]
        xy[kept, 0], xy[kept, 1], w[kept], run = xy[k, 0], xy[k, 1], w[k], True
        far, angle = _seen(xy, kept - 1, kept, bx, by)
        slack = np.arcsin(tolerance / far) if far > tolerance else np.pi / 2
        low, high = max(low, angle - slack), min(high, angle + slack)
    return kept + 1 if run else 0


@njit(cache=True, error_model="numpy")
def _seen(xy, anchor, k, bx, by):
    """Distance mm of point k from the anchor, and its angle from the direction (bx, by)."""
    dx, dy = xy[k, 0] - xy[anchor, 0], xy[k, 1] - xy[anchor, 1]
    return np.hypot(dx, dy), np.arctan2(bx * dy - by * dx, bx * dx + by * dy)
