"""The plan s(t) averaged over a short window, compiled. All sums are local to the window: the integral of s from the
start of a piece would lose the digits that finite differences of the motion see.

Legend
    w          window, s; the mean at t runs over [t - w/2, t + w/2]; before and after its piece the plan rests
    s, x, u    path parameter (mm), (ds/dt)^2 and d2s/dt2 of the plan; u is constant between two nodes
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

from cabslice.arrays import Array


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _node_before(time, at, first, last):
    """The interval (its first node) that holds the time `at`, by bisection within the piece."""
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if time[middle] <= at:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _place(time, s, x, node, at):
    """s, its rate and u at a time within the interval that starts at `node`."""
    rate, span, passed = sqrt(x[node]), s[node + 1] - s[node], at - time[node]
    u = (x[node + 1] - x[node]) / (2.0 * span)
    return s[node] + min(passed * (rate + 0.5 * u * passed), span), max(rate + u * passed, 0.0), u


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _integral(time, s, x, node, last, start, end, base):
    """Integral of s - base over [start, end], both within the piece, start within the interval at `node`."""
    total = 0.0
    while start < end:
        until = end if node + 1 >= last else min(time[node + 1], end)
        rate, u = sqrt(x[node]), (x[node + 1] - x[node]) / (2.0 * (s[node + 1] - s[node]))
        p, q = start - time[node], until - time[node]
        total += (q - p) * (s[node] - base + 0.5 * rate * (q + p) + u * (q * q + q * p + p * p) / 6.0)
        start, node = until, node + 1
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _averaged(time, s, x, first, last, times, window, out):
    for k in range(len(times)):
        begin, finish = time[first[k]], time[last[k]]
        low, high = times[k] - 0.5 * window, times[k] + 0.5 * window
        start, end = min(max(low, begin), finish), min(max(high, begin), finish)
        node = _node_before(time, start, first[k], last[k])
        s0, rate0, u0 = _place(time, s, x, node, start)
        if low <= begin or low >= finish:
            s0, rate0, u0 = s[first[k]] if low <= begin else s[last[k]], 0.0, 0.0
        if window <= 0.0:
            out[0, k], out[1, k], out[2, k] = s0, rate0, u0
            continue
        s1, rate1, _ = _place(time, s, x, _node_before(time, end, first[k], last[k]), end)
        if high >= finish or high <= begin:
            s1, rate1 = s[last[k]] if high >= finish else s[first[k]], 0.0
        area = _integral(time, s, x, node, last[k], start, end, s0)
        area += (s[last[k]] - s0) * (high - max(low, finish)) if high > finish else 0.0
        out[0, k], out[1, k], out[2, k] = s0 + area / window, (s1 - s0) / window, (rate1 - rate0) / window


def average(time: Array, s: Array, x: Array, first: Array, last: Array, times: Array, window: float) -> Array:
    """(3, K): s mm, its rate mm/s and second rate mm/s^2 at times (K,) s, averaged over window s.

    time, s, x (G,) of the nodes; first, last (K,) the nodes that bound the piece each time lies in.
    """
    out = np.empty((3, len(times)))
    _averaged(time, s, x, first, last, np.ascontiguousarray(times, float), window, out)
    return out
