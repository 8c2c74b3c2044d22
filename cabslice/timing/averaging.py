"""The plan as it is moved: the nozzle's position averaged over a short window, compiled.

The mean of a motion keeps what the motion keeps: limits on velocity, acceleration and filament are convex, and on a
straight line it stays on the line. In a corner it cuts in by at most |acceleration| w^2 / 24. Acceleration then ramps
over w, in the corners too: jerk is at most twice the acceleration over w.

Legend
    w          window, s; the mean at t runs over [t - w/2, t + w/2]; before and after its piece the plan rests
    q, s, f    nozzle position (mm), path parameter (mm), filament fed (mm);   x, u   (ds/dt)^2 and d2s/dt2 of the plan
    mean of q  its first derivative is (q(t + w/2) - q(t - w/2)) / w, its second that of the velocities

On straights the sums are closed. Within a blend q is of degree 4 in s and s of degree 2 in t: five Gauss points are
exact. All sums are local to the window: an integral from the start of a piece would lose the digits that finite
differences see.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from cabslice.arrays import Array
from cabslice.compiled import compiled
from cabslice.timing.path import Path

PLACES, WEIGHTS = (tuple((column / 2 + shift).tolist()) for column, shift in zip(
    np.polynomial.legendre.leggauss(5), (0.5, 0.0), strict=True))                 # of five points on [0, 1]
NEAR = 8        # intervals to look through one by one before bisecting


@compiled
def _node_before(time, at, near, first, last):
    """The interval (its first node) of a piece that holds the time `at`: soon after `near`, or found by bisection."""
    low, high = first, last
    if first <= near < last and time[near] <= at:
        low = near
        while low + 1 < last and low < near + NEAR and time[low + 1] <= at:
            low += 1
        if low < near + NEAR:
            return low
    while high - low > 1:
        middle = (low + high) // 2
        if time[middle] <= at:
            low = middle
        else:
            high = middle
    return low


@compiled
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


@compiled
def _state(path, plan, node, at, rests, out):
    """q, velocity, acceleration, s, f and df/dt (12,) of the plan at a time within the interval at `node`."""
    vertex, direction, length, begin, half, feed, filament, before, after = path
    time, s, x, move = plan
    row, passed, span = move[node], at - time[node], s[node + 1] - s[node]
    rate, u = sqrt(x[node]), (x[node + 1] - x[node]) / (2.0 * span)
    place = s[node] + min(passed * (rate + 0.5 * u * passed), span)
    rate = max(rate + u * passed, 0.0)
    if rests:
        rate, u = 0.0, 0.0
    into = min(max(place - begin[row], 0.0), length[row])
    _curve(vertex, direction, length, half, before, after, row, into, out)
    for axis in range(3):
        out[6 + axis] = out[3 + axis] * u + out[6 + axis] * rate * rate
        out[3 + axis] *= rate
    out[9], out[10], out[11] = place, filament[row] + feed[row] * into, feed[row] * rate


@compiled
def _add(path, plan, node, start, until, total):
    """Add to total (5,) the integral over [start, until], within the interval at `node`, of q, s and f less what they
    are at `start`. Intervals do not straddle the ends of blends."""
    _, direction, length, begin, half, feed, _, before, after = path
    time, s, x, move = plan
    row, passed, took, span = move[node], start - time[node], until - start, s[node + 1] - s[node]
    rate, u = sqrt(x[node]), (x[node + 1] - x[node]) / (2.0 * span)
    run, rate = passed * (rate + 0.5 * u * passed), rate + u * passed
    way = took * took * (0.5 * rate + u * took / 6.0)
    middle, corner, h = s[node] + 0.5 * span - begin[row], row, 0.0
    if middle < half[before[row]]:
        corner = before[row]
        h = half[corner]
        run += s[node] - begin[row]
    elif length[row] - middle < half[row]:
        h = half[row]
        run += s[node] - begin[row] - length[row]
    bend = 0.0
    if h > 0.0:
        since = 0.5 * (run + h) / h
        base = since * since * since * (1.0 - 0.5 * since)
        for k in range(5):
            at = took * PLACES[k]
            t = since + 0.5 * at * (rate + 0.5 * u * at) / h
            bend += WEIGHTS[k] * (t * t * t * (1.0 - 0.5 * t) - base)
        bend *= 2.0 * h * took
    for axis in range(3):
        leaving = direction[corner, axis]
        total[axis] += way * leaving + bend * (direction[after[corner], axis] - leaving)
    total[3] += way
    total[4] += way * feed[row]


@compiled
def _moved(path, plan, first, last, times, window, motion, scratch):
    time = plan[0]
    low, high, total, node = scratch[0], scratch[1], scratch[2], 0
    for k in range(len(times)):
        begin, finish = time[first[k]], time[last[k]]
        since, until = times[k] - 0.5 * window, times[k] + 0.5 * window
        start, end = min(max(since, begin), finish), min(max(until, begin), finish)
        node = _node_before(time, start, node, first[k], last[k])
        out = motion[k]
        _state(path, plan, node, start, since <= begin or since >= finish, out)
        if window <= 0.0:
            continue
        final = _node_before(time, end, node, first[k], last[k])
        _state(path, plan, final, end, until >= finish or until <= begin, high)
        out[11] = (high[10] - out[10]) / window
        for axis in range(3):
            out[6 + axis] = (high[3 + axis] - out[3 + axis]) / window
            out[3 + axis] = (high[axis] - out[axis]) / window
        rest = until - max(since, finish) if until > finish else 0.0
        for axis in range(5):
            place = axis if axis < 3 else 6 + axis
            total[axis] = rest * (high[place] - out[place])
        at = node
        while start < end:
            stop = end if at + 1 >= last[k] else min(time[at + 1], end)
            if at > node:
                _state(path, plan, at, start, False, low)
                for axis in range(5):
                    place = axis if axis < 3 else 6 + axis
                    total[axis] += (stop - start) * (low[place] - out[place])
            _add(path, plan, at, start, stop, total)
            start, at = stop, at + 1
        for axis in range(5):
            place = axis if axis < 3 else 6 + axis
            out[place] += total[axis] / window


def moved(
    path: Path, plan: tuple[Array, Array, Array, Array], first: Array, last: Array, times: Array, window: float
) -> tuple[Array, Array, Array, Array]:
    """The motion at times (K,) s, averaged over window s: position, velocity and acceleration (K, 9) of the nozzle in
    bed coordinates, mm and s; path parameter s (K,) mm; filament fed (K,) mm and its rate (K,) mm/s.

    plan: time, s, x, move (G,) of the nodes (trajectory.Trajectory); first, last (K,) the nodes that bound the piece
    each time lies in.
    """
    motion = np.empty((len(times), 12))
    columns = (path.vertex, path.direction, path.length, path.start, path.half, path.feed, path.filament, path.before,
               path.after)
    _moved(columns, plan, first, last, np.ascontiguousarray(times, float), window, motion, np.empty((3, 12)))
    return motion[:, :9], motion[:, 9], motion[:, 10], motion[:, 11]
