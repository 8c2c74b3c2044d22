"""The plan as it is moved: the nozzle's position averaged over a short window, compiled.

The mean of a motion keeps what the motion keeps: limits on velocity, acceleration and filament are convex, and on a
straight line it stays on the line. In a corner it cuts in by at most |acceleration| w^2 / 24. Acceleration then ramps
over w, in the corners too: jerk is at most twice the acceleration over w.

Legend
    w          window, s; the mean at t runs over [t - w/2, t + w/2]; before and after its piece the plan rests
    q, s, f    nozzle position (mm), path parameter (mm), filament fed (mm);   x, u   (ds/dt)^2 and d2s/dt2 of the plan
    mean of q  its first derivative is (q(t + w/2) - q(t - w/2)) / w, its second that of the velocities

Within a blend q is of degree 4 in s and s of degree 2 in t: five Gauss points are exact; on straights two are. All
sums are local to the window: an integral from the start of a piece would lose the digits that finite differences see.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

from cabslice.arrays import Array
from cabslice.timing.path import Path

FIVE = tuple(np.concatenate([column / 2 + shift for column, shift in zip(
    np.polynomial.legendre.leggauss(5), (0.5, 0.0), strict=True)]).tolist())      # places and weights on [0, 1]
TWO = (0.5 - sqrt(1 / 12), 0.5 + sqrt(1 / 12), 0.5, 0.5)


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


@njit(cache=True, nogil=True, error_model="numpy")
def _curve(vertex, direction, length, half, before, follow, move, sigma, out):
    """q, q', q'' into out (9,) at sigma mm into a move (timing.path); True where it bends."""
    after = sigma - length[move]
    corner, h, along = move, 0.0, after
    if sigma < half[before[move]]:
        corner, along = before[move], sigma
        h = half[corner]
    elif -after < half[move]:
        h = half[move]
    t = (along + h) / (2.0 * h) if h > 0.0 else 0.0
    for axis in range(3):
        base = direction[corner, axis] if h > 0.0 else direction[move, axis]
        turn = direction[follow[corner], axis] - base if h > 0.0 else 0.0
        out[axis] = vertex[corner, axis] + along * base + 2.0 * h * t * t * t * (1.0 - 0.5 * t) * turn
        out[3 + axis] = base + t * t * (3.0 - 2.0 * t) * turn
        out[6 + axis] = 3.0 * t * (1.0 - t) / h * turn if h > 0.0 else 0.0
    return h > 0.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _place(time, s, x, node, at):
    """s, its rate and u at a time within the interval that starts at `node`."""
    rate, span, passed = sqrt(x[node]), s[node + 1] - s[node], at - time[node]
    u = (x[node + 1] - x[node]) / (2.0 * span)
    return s[node] + min(passed * (rate + 0.5 * u * passed), span), max(rate + u * passed, 0.0), u


@njit(cache=True, nogil=True, error_model="numpy")
def _state(path, plan, node, at, rests, out):
    """q, velocity, acceleration (9,), s, f and df/dt of the plan at a time within the interval at `node`."""
    vertex, direction, length, begin, half, feed, filament, before, after = path
    time, s, x, move = plan
    place, rate, u = _place(time, s, x, node, at)
    if rests:
        rate, u = 0.0, 0.0
    into = min(max(place - begin[move[node]], 0.0), length[move[node]])
    _curve(vertex, direction, length, half, before, after, move[node], into, out)
    for axis in range(3):
        out[6 + axis] = out[3 + axis] * u + out[6 + axis] * rate * rate
        out[3 + axis] *= rate
    return place, filament[move[node]] + feed[move[node]] * into, feed[move[node]] * rate


@njit(cache=True, nogil=True, error_model="numpy")
def _add(path, plan, node, start, until, base, gauss, total, out):
    """Add to total (5,) the integral over [start, until], within one interval, of q, s and f less base (5,)."""
    points = len(gauss) // 2
    for k in range(points):
        at = start + gauss[k] * (until - start)
        place, fed, _ = _state(path, plan, node, at, False, out)
        weight = gauss[points + k] * (until - start)
        for axis in range(3):
            total[axis] += weight * (out[axis] - base[axis])
        total[3] += weight * (place - base[3])
        total[4] += weight * (fed - base[4])


@njit(cache=True, nogil=True, error_model="numpy")
def _bends(path, plan, node):
    """Whether the interval at `node` lies in a blend: intervals do not straddle the ends of blends."""
    _, _, length, begin, half, _, _, before, _ = path
    _, s, _, move = plan
    sigma = 0.5 * (s[node] + s[node + 1]) - begin[move[node]]
    return sigma < half[before[move[node]]] or length[move[node]] - sigma < half[move[node]]


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(path, plan, first, last, times, window, motion, place, fed, feed):
    time = plan[0]
    low, high, base, total = np.empty(9), np.empty(9), np.empty(5), np.empty(5)
    for k in range(len(times)):
        begin, finish = time[first[k]], time[last[k]]
        since, until = times[k] - 0.5 * window, times[k] + 0.5 * window
        start, end = min(max(since, begin), finish), min(max(until, begin), finish)
        node = _node_before(time, start, first[k], last[k])
        base[3], base[4], feed0 = _state(path, plan, node, start, since <= begin or since >= finish, low)
        if window <= 0.0:
            motion[k], place[k], fed[k], feed[k] = low, base[3], base[4], feed0
            continue
        base[:3] = low[:3]
        final = _node_before(time, end, first[k], last[k])
        s1, fed1, _ = _state(path, plan, final, end, until >= finish or until <= begin, high)
        for axis in range(3):
            motion[k, 3 + axis] = (high[axis] - low[axis]) / window
            motion[k, 6 + axis] = (high[3 + axis] - low[3 + axis]) / window
        feed[k] = (fed1 - base[4]) / window
        rest = until - max(since, finish) if until > finish else 0.0
        for axis in range(3):
            total[axis] = rest * (high[axis] - base[axis])
        total[3], total[4] = rest * (s1 - base[3]), rest * (fed1 - base[4])
        while start < end:
            stop = end if node + 1 >= last[k] else min(time[node + 1], end)
            if _bends(path, plan, node):
                _add(path, plan, node, start, stop, base, FIVE, total, low)
            else:
                _add(path, plan, node, start, stop, base, TWO, total, low)
            start, node = stop, node + 1
        for axis in range(3):
            motion[k, axis] = base[axis] + total[axis] / window
        place[k], fed[k] = base[3] + total[3] / window, base[4] + total[4] / window


def moved(
    path: Path, plan: tuple[Array, Array, Array, Array], first: Array, last: Array, times: Array, window: float
) -> tuple[Array, Array, Array, Array]:
    """The motion at times (K,) s, averaged over window s: position, velocity and acceleration (K, 9) of the nozzle in
    bed coordinates, mm and s; path parameter s (K,) mm; filament fed (K,) mm and its rate (K,) mm/s.

    plan: time, s, x, move (G,) of the nodes (trajectory.Trajectory); first, last (K,) the nodes that bound the piece
    each time lies in.
    """
    motion, place, fed, feed = np.empty((len(times), 9)), *np.empty((3, len(times)))
    columns = (path.vertex, path.direction, path.length, path.start, path.half, path.feed, path.filament, path.before,
               path.after)
    _moved(columns, plan, first, last, np.ascontiguousarray(times, float), window, motion, place, fed, feed)
    return motion, place, fed, feed
