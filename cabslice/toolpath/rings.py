"""Where closed lines begin: seams of outer walls, and inner walls that begin beside them. Compiled.

points (N, 2) mm, starts (B + 1,)   the lines of one layer, as in slicing.layer.Beads
A place on a ring is (first, part): on the segment from its vertex `first` to the next one, part in [0, 1) of the way.
turn    rad, how far the line turns within `arm` mm on either side of a vertex; < 0 to the right, which is a concave
        corner where material lies on the left, as it does along outlines and holes
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cabslice.toolpath.grid import extent

SHARP = np.radians(25.0)   # smaller turns are not corners
SNAP = 0.05                # mm, a place this near to a vertex is the vertex
STEP = np.radians(1.0)     # turns are compared in steps, so that rounding does not choose the seam


@njit(cache=True, error_model="numpy")
def nearest_on_ring(ring, x, y):
    """(gap mm, first, part) of the place on the closed `ring` (V, 2) nearest to (x, y)."""
    best, first, part = np.inf, 0, 0.0
    n = len(ring)
    for k in range(n):
        ax, ay = ring[k, 0], ring[k, 1]
        dx, dy = ring[(k + 1) % n, 0] - ax, ring[(k + 1) % n, 1] - ay
        long = dx * dx + dy * dy
        t = min(max(((x - ax) * dx + (y - ay) * dy) / long, 0.0), 1.0) if long > 0 else 0.0
        gap = np.hypot(ax + t * dx - x, ay + t * dy - y)
        if gap < best:
            best, first, part = gap, k, t
    following = (first + 1) % n
    long = np.hypot(ring[following, 0] - ring[first, 0], ring[following, 1] - ring[first, 1])
    if part * long <= SNAP:
        part = 0.0
    elif (1 - part) * long <= SNAP:
        first, part = following, 0.0
    return best, first, part


@njit(cache=True, error_model="numpy")
def _along(ring, k, step, arm):
    """The point `arm` mm along the ring from vertex k, forwards (step 1) or backwards (-1)."""
    n, left, here = len(ring), arm, k
    for _ in range(n):
        after = (here + step) % n
        dx, dy = ring[after, 0] - ring[here, 0], ring[after, 1] - ring[here, 1]
        long = np.hypot(dx, dy)
        if long >= left:
            return ring[here, 0] + dx * left / long, ring[here, 1] + dy * left / long
        left -= long
        here = after
    return ring[here, 0], ring[here, 1]


@njit(cache=True, error_model="numpy")
def corner(ring, k, arm):
    """How well vertex k hides a seam: steps of turn from SHARP on, concave before all convex ones; 0 is no corner."""
    bx, by = _along(ring, k, -1, arm)
    fx, fy = _along(ring, k, 1, arm)
    x, y = ring[k, 0], ring[k, 1]
    turn = np.arctan2((x - bx) * (fy - y) - (y - by) * (fx - x), (x - bx) * (fx - x) + (y - by) * (fy - y))
    if abs(turn) < SHARP:
        return 0.0
    return np.floor(abs(turn) / STEP + 0.5) + (1000.0 if turn < 0 else 0.0)


@njit(cache=True, error_model="numpy")
def seams(points, starts, lines, earlier, arm, reach):
    """Where the rings `lines` (R,) begin: (first (R,), part (R,)).

    A ring that passes within `reach` mm of a seam of the layer before, `earlier` (S, 2), keeps it: at the best corner
    within `reach`, else at its nearest place. Any other begins at its best corner, else at its rearmost vertex.
    """
    first, part = np.zeros(len(lines), np.int64), np.zeros(len(lines))
    for r in range(len(lines)):
        ring = points[starts[lines[r]]:starts[lines[r] + 1]]
        s = _earlier_seam(ring, earlier, reach)
        if s >= 0:
            first[r], part[r] = _kept_seam(ring, earlier[s, 0], earlier[s, 1], arm, reach)
        else:
            first[r] = _fresh_seam(ring, arm)
    return first, part


@njit(cache=True, error_model="numpy")
def _earlier_seam(ring, earlier, reach):
    """Which of the `earlier` seams the ring passes nearest to; -1 where none is within `reach`."""
    left, lower, wide, high = extent(ring, 0, len(ring))
    best, found = reach, -1
    for s in range(len(earlier)):
        x, y = earlier[s, 0], earlier[s, 1]
        if -reach <= x - left <= wide + reach and -reach <= y - lower <= high + reach:
            gap = nearest_on_ring(ring, x, y)[0]
            if gap < best:
                best, found = gap, s
    return found


@njit(cache=True, error_model="numpy")
def _kept_seam(ring, x, y, arm, reach):
    _, first, part = nearest_on_ring(ring, x, y)
    best, nearest = 0.0, np.inf
    for k in range(len(ring)):
        gap = np.hypot(ring[k, 0] - x, ring[k, 1] - y)
        if gap <= reach:
            score = corner(ring, k, arm)
            if score > best or (score == best and score > 0 and gap < nearest - SNAP):
                best, nearest, first, part = score, gap, k, 0.0
    return first, part


@njit(cache=True, error_model="numpy")
def _fresh_seam(ring, arm):
    chosen, best = 0, corner(ring, 0, arm)
    for k in range(1, len(ring)):
        score = corner(ring, k, arm)
        behind = ring[k, 1] - ring[chosen, 1]
        rearmost = behind > SNAP or (abs(behind) <= SNAP and ring[k, 0] > ring[chosen, 0] + SNAP)
        if score > best or (score == best and rearmost):
            best, chosen = score, k
    return chosen


@njit(cache=True, error_model="numpy")
def hosts(points, starts, guests, guest_island, walls, wall_island):
    """The outer wall each guest ring runs along: (host (G,) index into walls or -1, depth (G,) mm between them).

    Nearest to the guest's first vertex among the rings `walls` of the same island.
    """
    host, depth = np.empty(len(guests), np.int64), np.zeros(len(guests))
    box = np.empty((len(walls), 4))
    for w in range(len(walls)):
        box[w, 0], box[w, 1], box[w, 2], box[w, 3] = extent(points, starts[walls[w]], starts[walls[w] + 1])
    for g in range(len(guests)):
        x, y = points[starts[guests[g]], 0], points[starts[guests[g]], 1]
        best, host[g] = np.inf, -1
        for w in range(len(walls)):
            dx, dy = x - box[w, 0], y - box[w, 1]
            away = np.hypot(max(-dx, 0.0, dx - box[w, 2]), max(-dy, 0.0, dy - box[w, 3]))
            if wall_island[w] == guest_island[g] and away < best:
                gap = nearest_on_ring(points[starts[walls[w]]:starts[walls[w] + 1]], x, y)[0]
                if gap < best:
                    best, host[g], depth[g] = gap, w, gap
    return host, depth


@njit(cache=True, error_model="numpy")
def starts_beside(points, starts, lines, beside):
    """Where the rings `lines` (G,) come nearest to `beside` (G, 2): (gap (G,) mm, first (G,), part (G,))."""
    gap, first, part = np.empty(len(lines)), np.zeros(len(lines), np.int64), np.zeros(len(lines))
    for g in range(len(lines)):
        ring = points[starts[lines[g]]:starts[lines[g] + 1]]
        gap[g], first[g], part[g] = nearest_on_ring(ring, beside[g, 0], beside[g, 1])
    return gap, first, part
