"""Time-optimal speed along the path by reachability (TOPP-RA: Pham & Pham 2018), compiled.

Legend
    i          interval from node i to node i+1, length D_i mm
    x, y       (ds/dt)^2 at its two ends, so u = (y - x) / 2 D_i
    rows       a u + b x <= 1 at each node: scaled so that rest (u = x = 0) has slack 1 in every row
    top        largest x a node may have whatever u is
    reach      largest x at a node from which the end of the piece can still be reached at rest

In the plane (x, y) the rows of both ends of an interval are half-planes that contain the origin, so every x below
`reach` is controllable and the backward pass is one linear program in two variables per interval, solved by
Seidel's incremental method (Seidel 1991) starting with the rows that were tight in the interval before.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from cabslice.arrays import Array
from cabslice.compiled import compiled

TOLERANCE = 1e-11


@compiled
def _half_planes(a, b, step, i, p, q):
    """Rows of both ends of interval i as p x + q y <= 1."""
    rows = a.shape[1]
    gain = 0.5 / step
    for k in range(rows):
        p[k] = b[i, k] - a[i, k] * gain
        q[k] = a[i, k] * gain
        p[rows + k] = -a[i + 1, k] * gain
        q[rows + k] = b[i + 1, k] + a[i + 1, k] * gain


@compiled
def _best_on_line(p, q, order, upto, line, x_top, y_top):
    """Largest x on p x + q y = 1 of row `line` within the box and the first `upto` rows of `order`; x < 0: none."""
    pl, ql = p[line], q[line]
    norm = pl * pl + ql * ql
    x0, y0 = pl / norm, ql / norm
    dx, dy = -ql, pl
    low, high = -np.inf, np.inf
    for side in range(4):
        if side == 0:
            rate, room = dx, x_top - x0
        elif side == 1:
            rate, room = -dx, x0
        elif side == 2:
            rate, room = dy, y_top - y0
        else:
            rate, room = -dy, y0
        if rate > 0:
            high = min(high, room / rate)
        elif rate < 0:
            low = max(low, room / rate)
        elif room < 0:
            return -1.0, 0.0
    for j in range(upto):
        k = order[j]
        rate = p[k] * dx + q[k] * dy
        room = 1.0 - p[k] * x0 - q[k] * y0
        if rate > 0:
            high = min(high, room / rate)
        elif rate < 0:
            low = max(low, room / rate)
    if low > high:
        if low > high + 1e-9 * (1.0 + abs(low)):
            return -1.0, 0.0
        low = high
    at = high if dx > 0 else low
    return x0 + dx * at, y0 + dy * at


@compiled
def _largest_x(p, q, order, x_top, y_top):
    """max x with 0 <= x <= x_top, 0 <= y <= y_top and every row; rows that cut move to the front of `order`."""
    x, y = x_top, 0.0
    for j in range(len(order)):
        k = order[j]
        if p[k] * x + q[k] * y > 1.0 + TOLERANCE:
            x, y = _best_on_line(p, q, order, j, k, x_top, y_top)
            if x < 0.0:
                return 0.0
            if j > 1:
                for back in range(j, 0, -1):
                    order[back] = order[back - 1]
                order[0] = k
    return x


@compiled
def _largest_y(p, q, x, y_top):
    y = y_top
    for k in range(len(p)):
        if q[k] > 0.0:
            y = min(y, (1.0 + TOLERANCE - p[k] * x) / q[k])     # a row that is tight in x alone has q = rounding
    return max(y, 0.0)


@compiled
def fall(a, b, top, step, x, p, q, order):
    """Fill x (n,) of nodes 0..n-1 with `reach`, backwards from that of node n. a, b (n+1, R) rows, top (n,), step (n,)
    mm; work p, q, order (2 R,)."""
    for i in range(len(step) - 1, -1, -1):
        _half_planes(a, b, step[i], i, p, q)
        x[i] = _largest_x(p, q, order, top[i], x[i + 1])


@compiled
def rise(a, b, step, x, p, q):
    """Lower x (n+1,) to what can be reached from node 0 on; arguments as fall."""
    for i in range(len(step)):
        _half_planes(a, b, step[i], i, p, q)
        x[i + 1] = _largest_y(p, q, x[i], x[i + 1])


@compiled
def _spread(source, top, step, window):
    """Lower `top` (n+1,) around every node of `source` as far as the nozzle runs in half of `window` s there."""
    for i in range(len(top)):
        reach = 0.5 * window * sqrt(source[i])
        run, k = 0.0, i
        while k < len(step) and run < reach:
            run += step[k]
            k += 1
            top[k] = min(top[k], source[i])
        run, k = 0.0, i
        while k > 0 and run < reach:
            k -= 1
            run += step[k]
            top[k] = min(top[k], source[i])


@compiled
def _retime(a, b, top, step, nodes, x, p, q, order):
    for piece in range(len(nodes) - 1):
        first, last = nodes[piece], nodes[piece + 1]
        x[first] = x[last - 1] = 0.0
        for k in range(len(order)):
            order[k] = k
        rows, cut = slice(first, last), slice(first, last - 1)
        fall(a[rows], b[rows], top[cut], step[cut], x[rows], p, q, order)
        x[first] = 0.0
        rise(a[rows], b[rows], step[cut], x[rows], p, q)


@compiled
def _widen(source, top, step, nodes, window):
    for piece in range(len(nodes) - 1):
        first, last = nodes[piece], nodes[piece + 1]
        _spread(source[first:last], top[first:last], step[first:last - 1], window)


def widened(top: Array, step: Array, nodes: Array, window: float) -> Array:
    """top (G,) of a motion that will be averaged over window s: speeds asked for in one move hold around it too."""
    lowered = top.copy()
    if window > 0:
        _widen(top, lowered, step, nodes, window)
    return lowered


def work_for(rows: int) -> tuple[Array, Array, Array]:
    """p, q, order of as many rows."""
    return np.empty(2 * rows), np.empty(2 * rows), np.arange(2 * rows)


def retime(a: Array, b: Array, top: Array, step: Array, nodes: Array) -> Array:
    """Largest x (G,) at every node of a block of pieces that each start and end at rest.

    a, b (G, R) rows a u + b x <= 1; top (G,) mm^2/s^2; step (G,) mm to the next node (unused at piece ends);
    nodes (P+1,) offsets: piece p has nodes nodes[p]:nodes[p+1].
    Source: Pham & Pham 2018, eq. 14-17, with rows at both ends of each interval.
    """
    x = np.empty(len(top))
    _retime(np.ascontiguousarray(a), np.ascontiguousarray(b), top, step, nodes, x, *work_for(a.shape[1]))
    return x
