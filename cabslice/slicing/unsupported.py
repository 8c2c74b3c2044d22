"""How much of a wall's width lies over air: walls cut where that passes a quarter, a half, three quarters and all.

w   bead width, mm     d   distance of the wall's middle outside the outline of the layer below, mm (< 0 inside)
The share of the width over air is 1/2 + d / w, within 0..1, where the outline below is straight; its level is 0 up to a
quarter, 1 up to a half, 2 up to three quarters, 3 below all, 4 all of it.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Polygons
from cabslice.slicing.region import contains, following, from_rings, offset, to_rings

LEVELS = 4
SHORTEST = 0.1   # of w: cuts nearer to each other, or to a point of the wall, are not made


def levels(points: Array, walls: Array, width: float, below: Polygons) -> tuple[Array, Array, Array]:
    """The line through points (N, 2), of which segments into points with walls (N,) true are cut at the levels.

    Returned per point of the cut line: source (M,) and share (M,) in (0, 1]: it lies `share` of the way from the point
    before source to it; and level (M,) of the segment into it, 0 where that is no wall. `below` is the outline of the
    layer below. The first point's segment is never a wall.
    """
    outline = from_rings(below.points, below.starts)
    rings = [to_rings(offset(outline, (k / LEVELS - 0.5) * width)) for k in range(1, LEVELS + 1)]
    ends = np.flatnonzero(walls[1:]) + 1
    source, share = _cuts(points, ends, rings, SHORTEST * width)
    before = np.maximum(source - 1, 0)
    place = points[before] + share[:, None] * (points[source] - points[before])
    rows = np.flatnonzero(np.isin(source, ends))
    middle = (place[rows] + place[rows - 1]) / 2
    level = np.zeros(len(source), np.uint8)
    for ring in rings:
        level[rows] += ~contains(*ring, middle)
    return source, share, level


def _cuts(points: Array, ends: Array, rings: list[tuple[Array, Array]], least: float) -> tuple[Array, Array]:
    """All points, and the places on the segments into `ends` (S,) where they meet the rings, in order."""
    tail = np.concatenate([ring for ring, _ in rings])
    head = np.concatenate([ring[following(starts)] for ring, starts in rings])
    if len(tail):
        which, share = segments_meeting(tail, head, points[ends - 1], points[ends])
    else:
        which, share = np.zeros(0, np.int64), np.zeros(0)
    length = np.linalg.norm(points[ends] - points[ends - 1], axis=1)
    far = least / np.maximum(length[which], 1e-12)
    kept = (share > far) & (share < 1 - far)
    which, share = which[kept], share[kept]
    order = np.lexsort((share, which))
    which, share = which[order], share[order]
    apart = np.ones(len(which), np.bool_)
    apart[1:] = (np.diff(which) > 0) | (np.diff(share) * length[which[1:]] > least)
    source = np.concatenate((ends[which[apart]], np.arange(len(points))))
    at = np.concatenate((share[apart], np.ones(len(points))))
    order = np.lexsort((at, source))
    return source[order], at[order]


def segments_meeting(a: Array, b: Array, p: Array, q: Array) -> tuple[Array, Array]:
    """Segments p q (S, 2) that cross edges a b (E, 2): which segment (C,), and where on it (C,), 0..1."""
    low, high = np.minimum(p, q), np.maximum(p, q)
    order = np.argsort(low[:, 0], kind="stable")
    low, high, p, along = low[order], high[order], p[order], (q - p)[order]
    widest = float((high[:, 0] - low[:, 0]).max(initial=0.0))
    left, right = np.minimum(a, b), np.maximum(a, b)
    first = np.searchsorted(low[:, 0], left[:, 0] - widest)
    count = np.searchsorted(low[:, 0], right[:, 0], side="right") - first
    which = np.repeat(np.arange(len(a)), count)
    edge = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(len(which))
    near = ((low[edge] <= right[which]) & (high[edge] >= left[which])).all(1)
    which, edge = which[near], edge[near]
    step, gap, run = (b - a)[which], p[edge] - a[which], along[edge]
    cross = step[:, 0] * run[:, 1] - step[:, 1] * run[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        on_edge = (gap[:, 0] * run[:, 1] - gap[:, 1] * run[:, 0]) / cross
        on_segment = (gap[:, 0] * step[:, 1] - gap[:, 1] * step[:, 0]) / cross
    meets = (on_edge >= 0) & (on_edge <= 1) & (on_segment >= 0) & (on_segment <= 1)
    return order[edge[meets]], on_segment[meets]
