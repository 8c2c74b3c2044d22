"""Nearest line ends in the plane: a uniform grid of cells from which ends can be taken away. Compiled.

ends (m, 2) mm   where lines begin and end: line i has the ends 2i (its first point) and 2i + 1 (its last)
e ^ 1            the other end of the same line
A grid is the tuple (x, y, size, columns, rows, first (cells + 1,), count (cells,), item (m,), place (m,)):
cell c holds the ends item[first[c] : first[c] + count[c]]; end e is item[place[e]].
"""

from __future__ import annotations

import numpy as np
from numba import njit

ENDS_PER_CELL = 2.0


@njit(cache=True, error_model="numpy")
def build(ends, m):
    """A grid of about two ends a cell over the first m of `ends`."""
    x, y, wide, high = extent(ends, 0, m)
    size = max(np.sqrt(wide * high * ENDS_PER_CELL / m), max(wide, high) * ENDS_PER_CELL / m, 1e-6)
    columns, rows = int(wide / size) + 1, int(high / size) + 1
    first, item, place = np.zeros(columns * rows + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.int64)
    for e in range(m):
        first[cell_of(ends, e, x, y, size, columns) + 1] += 1
    for c in range(columns * rows):
        first[c + 1] += first[c]
    count = np.zeros(columns * rows, np.int64)
    for e in range(m):
        c = cell_of(ends, e, x, y, size, columns)
        place[e] = first[c] + count[c]
        item[place[e]] = e
        count[c] += 1
    return x, y, size, columns, rows, first, count, item, place


@njit(cache=True, error_model="numpy")
def extent(points, begin, end):
    """(lowest x, lowest y, width, height) of points[begin:end]."""
    x = right = points[begin, 0]
    y = upper = points[begin, 1]
    for k in range(begin + 1, end):
        x, right = min(x, points[k, 0]), max(right, points[k, 0])
        y, upper = min(y, points[k, 1]), max(upper, points[k, 1])
    return x, y, right - x, upper - y


@njit(cache=True, error_model="numpy")
def cell_of(ends, e, x, y, size, columns):
    return int((ends[e, 1] - y) / size) * columns + int((ends[e, 0] - x) / size)


@njit(cache=True, error_model="numpy")
def take(grid, ends, e):
    """Remove end e."""
    x, y, size, columns, _, first, count, item, place = grid
    c = cell_of(ends, e, x, y, size, columns)
    count[c] -= 1
    last, at = first[c] + count[c], place[e]
    item[at], place[item[last]] = item[last], at
    item[last], place[e] = e, last


@njit(cache=True, error_model="numpy")
def nearest(grid, ends, x, y, skip, found, far):
    """Fill `found` (k,) with the ends nearest to (x, y), nearest first, then -1; never `skip` or skip ^ 1; `far`: mm.

    Rings of cells around (x, y) are searched outwards until nothing nearer can come.
    """
    left, lower, size, columns, rows, _, _, _, _ = grid
    k = len(found)
    for slot in range(k):
        far[slot], found[slot] = np.inf, -1
    cx = min(max(int((x - left) / size), 0), columns - 1)
    cy = min(max(int((y - lower) / size), 0), rows - 1)
    for ring in range(max(columns, rows)):
        if (ring - 1) * size > far[k - 1]:
            break
        for j in range(max(cy - ring, 0), min(cy + ring, rows - 1) + 1):
            step = 1 if abs(j - cy) == ring else max(2 * ring, 1)
            for i in range(cx - ring, cx + ring + 1, step):
                if 0 <= i < columns:
                    _look_into(grid, ends, j * columns + i, x, y, skip, found, far)


@njit(cache=True, error_model="numpy")
def _look_into(grid, ends, c, x, y, skip, found, far):
    _, _, _, _, _, first, count, item, _ = grid
    for at in range(first[c], first[c] + count[c]):
        e = item[at]
        gap = np.hypot(ends[e, 0] - x, ends[e, 1] - y)
        if gap < far[-1] and e != skip and e != skip ^ 1:
            slot = len(found) - 1
            while slot > 0 and far[slot - 1] > gap:
                far[slot], found[slot] = far[slot - 1], found[slot - 1]
                slot -= 1
            far[slot], found[slot] = gap, e
