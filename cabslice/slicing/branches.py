"""Loops of lightning infill (slicing.lightning). Compiled.

G places to be held, E edges of walls, N nodes. Nodes are sorted into square cells, side `cell` mm, as linked lists.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def nearest_on_edges(query, tail, head):
    """Per query point (G, 2) the nearest place (G, 2) on edges tail -> head (E, 2), and how far (G,) it is."""
    found, away = np.empty((len(query), 2)), np.empty(len(query))
    for k in range(len(query)):
        best = np.inf
        for e in range(len(tail)):
            dx, dy = head[e, 0] - tail[e, 0], head[e, 1] - tail[e, 1]
            square = dx * dx + dy * dy
            part = 0.0
            if square > 0.0:
                part = ((query[k, 0] - tail[e, 0]) * dx + (query[k, 1] - tail[e, 1]) * dy) / square
                part = min(max(part, 0.0), 1.0)
            x, y = tail[e, 0] + part * dx, tail[e, 1] + part * dy
            gap = (query[k, 0] - x) ** 2 + (query[k, 1] - y) ** 2
            if gap < best:
                best, found[k, 0], found[k, 1] = gap, x, y
        away[k] = np.sqrt(best)
    return found, away


@njit(cache=True, error_model="numpy")
def _nearest(node, first, after, count, x, y, column, row, cell, low, far):
    """The node nearest to (x, y), if it is nearer than `far`; else -1. Cells around are looked at, or all nodes."""
    best, found = far * far, -1
    for i in range(max(column - 1, 0), min(column + 2, first.shape[0])):
        for j in range(max(row - 1, 0), min(row + 2, first.shape[1])):
            k = first[i, j]
            while k >= 0:
                gap = (node[k, 0] - x) ** 2 + (node[k, 1] - y) ** 2
                if gap < best:
                    best, found = gap, k
                k = after[k]
    if best > cell * cell:
        for k in range(count):
            gap = (node[k, 0] - x) ** 2 + (node[k, 1] - y) ** 2
            if gap < best:
                best, found = gap, k
    return found


@njit(cache=True, error_model="numpy")
def grow(node, parent, count, places, feet, away, reach, cell, low, first, after):
    """Branches to the places, in order, into node (C, 2) and parent (C,), of which `count` are there already.

    first (columns, rows) and after (C,) are the cells' lists, empty. Returns how many nodes there are then; -1 where
    they do not fit.
    """
    for k in range(count):
        _sort_in(node, k, first, after, cell, low)
    for k in range(len(places)):
        x, y = places[k, 0], places[k, 1]
        column, row = int((x - low[0]) / cell), int((y - low[1]) / cell)
        found = _nearest(node, first, after, count, x, y, column, row, cell, low, away[k])
        fx, fy = (feet[k, 0], feet[k, 1]) if found < 0 else (node[found, 0], node[found, 1])
        far = np.hypot(x - fx, y - fy)
        if far <= reach:
            continue
        steps = int(np.ceil(far / (reach / 2)))
        if count + steps + 1 > len(node):
            return -1
        last = found
        for s in range(0 if found < 0 else 1, steps + 1):
            node[count, 0], node[count, 1] = fx + (x - fx) * s / steps, fy + (y - fy) * s / steps
            parent[count] = last
            _sort_in(node, count, first, after, cell, low)
            last, count = count, count + 1
    return count


@njit(cache=True, error_model="numpy")
def _sort_in(node, k, first, after, cell, low):
    i = min(max(int((node[k, 0] - low[0]) / cell), 0), first.shape[0] - 1)
    j = min(max(int((node[k, 1] - low[1]) / cell), 0), first.shape[1] - 1)
    after[k], first[i, j] = first[i, j], k
