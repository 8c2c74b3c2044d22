"""Short tours over lines: in which order, and from which end, lines are drawn so that little is travelled between.

ends (2n + 1, 2) mm   line i begins at ends[2i] and ends at ends[2i + 1]; ends[2n] is where the nozzle stands before
e ^ 1                 the other end of the line of e
tour (n,)             the end at which each line is entered, in drawing order: tour[p] // 2 is the line

Nearest neighbour, then 2-opt and or-opt over the nearest ends until nothing gains (Croes 1958, Or 1976; neighbour lists
after Johnson and McGeoch 1997). The tour is open: it may end anywhere. Compiled; ties go to the first found.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cabslice.toolpath.grid import build, nearest, take

NEIGHBOURS = 6   # ends looked at around each end
GAIN = 1e-6      # mm, smaller gains are rounding
PASSES = 40
RUN = 3          # or-opt moves up to this many lines together


@njit(cache=True, error_model="numpy")
def shortest_tour(begin, end, start, reversible):
    """Entered ends (n,) int64 in drawing order for the lines begin (n, 2) -> end (n, 2), from `start` (2,), all mm.

    Entry e means line e // 2, drawn backwards where e is odd; never backwards where `reversible` is false.
    """
    n = len(begin)
    ends = np.empty((2 * n + 1, 2))
    for axis in range(2):
        for i in range(n):
            ends[2 * i, axis], ends[2 * i + 1, axis] = begin[i, axis], end[i, axis]
        ends[2 * n, axis] = start[axis]
    if n == 0:
        return np.empty(0, np.int64)
    tour = _nearest_neighbour(ends, reversible)
    if n > 1:
        _improve(ends, tour, reversible)
    return tour


@njit(cache=True, error_model="numpy")
def _nearest_neighbour(ends, reversible):
    n = len(ends) // 2
    tour, found, far = np.empty(n, np.int64), np.empty(1, np.int64), np.empty(1)
    grid = build(ends, 2 * n)
    if not reversible:
        for i in range(n):
            take(grid, ends, 2 * i + 1)
    here = 2 * n
    for p in range(n):
        nearest(grid, ends, ends[here, 0], ends[here, 1], -2, found, far)
        e = found[0]
        tour[p], here = e, e ^ 1
        take(grid, ends, e)
        if reversible:
            take(grid, ends, e ^ 1)
    return tour


@njit(cache=True, error_model="numpy")
def _neighbours(ends):
    m = len(ends) - 1
    near, far = np.empty((m, NEIGHBOURS), np.int64), np.empty(NEIGHBOURS)
    grid = build(ends, m)
    for e in range(m):
        nearest(grid, ends, ends[e, 0], ends[e, 1], e, near[e], far)
    return near


@njit(cache=True, error_model="numpy")
def _improve(ends, tour, reversible):
    n = len(tour)
    near, place = _neighbours(ends), np.empty(n, np.int64)
    for p in range(n):
        place[tour[p] >> 1] = p
    for _ in range(PASSES):
        gained = False
        for p in range(n):
            if reversible and _two_opt(ends, tour, place, near, p):
                gained = True
            if _or_opt(ends, tour, place, near, p, reversible):
                gained = True
        if not gained:
            break


@njit(cache=True, error_model="numpy")
def _gap(ends, a, b):
    """mm from end a to end b; nothing comes after the last line (-1)."""
    if a < 0 or b < 0:
        return 0.0
    return np.hypot(ends[a, 0] - ends[b, 0], ends[a, 1] - ends[b, 1])


@njit(cache=True, error_model="numpy")
def _leave(tour, p):
    """The end at which the nozzle stands after the line at p; p = -1 is the start."""
    return tour[p] ^ 1 if p >= 0 else 2 * len(tour)


@njit(cache=True, error_model="numpy")
def _enter(tour, p):
    return tour[p] if p < len(tour) else -1


@njit(cache=True, error_model="numpy")
def _reverse_gain(ends, tour, i, j):
    """What is saved when the lines at i..j are drawn backwards."""
    u, v, w, x = _leave(tour, i - 1), tour[i], _leave(tour, j), _enter(tour, j + 1)
    return _gap(ends, u, v) + _gap(ends, w, x) - _gap(ends, u, w) - _gap(ends, v, x)


@njit(cache=True, error_model="numpy")
def _reverse(tour, place, i, j):
    low, high = i, j
    while low <= high:
        tour[low], tour[high] = tour[high] ^ 1, tour[low] ^ 1
        low, high = low + 1, high - 1
    for p in range(i, j + 1):
        place[tour[p] >> 1] = p


@njit(cache=True, error_model="numpy")
def _two_opt(ends, tour, place, near, p):
    """Reverse a run that begins or ends at the gap before p, if that gains."""
    u, v, n = _leave(tour, p - 1), tour[p], len(tour)
    now = _gap(ends, u, v)
    best, low, high = GAIN, -1, -1
    if _reverse_gain(ends, tour, p, n - 1) > best:
        best, low, high = _reverse_gain(ends, tour, p, n - 1), p, n - 1
    for side in range(2):
        e = u if side == 0 else v
        for k in range(NEIGHBOURS if e < 2 * n else 0):
            w = near[e, k]
            if w < 0 or _gap(ends, e, w) >= now:
                break
            q = place[w >> 1]
            leaves = w != tour[q]
            if leaves != (side == 0):
                continue
            edge = q + 1 if leaves else q          # the gap that w borders: before line `edge`
            i, j = min(edge, p), max(edge, p) - 1
            if i <= j and _reverse_gain(ends, tour, i, j) > best:
                best, low, high = _reverse_gain(ends, tour, i, j), i, j
    if low >= 0:
        _reverse(tour, place, low, high)
    return low >= 0


@njit(cache=True, error_model="numpy")
def _or_opt(ends, tour, place, near, p, reversible):
    """Move the run of up to RUN lines that begins at p to where one of its ends has a near neighbour, if that gains."""
    n = len(tour)
    for j in range(p, min(p + RUN, n)):
        a, b, u, x = tour[p], _leave(tour, j), _leave(tour, p - 1), _enter(tour, j + 1)
        saved = _gap(ends, u, a) + _gap(ends, b, x) - _gap(ends, u, x)
        best, target, turned = GAIN, -1, False
        for side in range(2):
            e = a if side == 0 else b
            for k in range(NEIGHBOURS):
                w = near[e, k]
                if w < 0 or _gap(ends, e, w) >= saved:
                    break
                q = place[w >> 1]
                leaves = w != tour[q]
                edge, turn = q + 1 if leaves else q, leaves != (side == 0)   # insert before the line at `edge`
                if p <= q <= j or (turn and not reversible) or p <= edge <= j + 1:
                    continue
                head, tail = (b, a) if turn else (a, b)
                before, after = _leave(tour, edge - 1), _enter(tour, edge)
                gain = saved + _gap(ends, before, after) - _gap(ends, before, head) - _gap(ends, tail, after)
                if gain > best:
                    best, target, turned = gain, edge, turn
        if target >= 0:
            _move(tour, place, p, j, target, turned)
            return True
    return False


@njit(cache=True, error_model="numpy")
def _move(tour, place, i, j, edge, turned):
    """Take the lines at i..j out and put them before the line that stood at `edge`."""
    if turned:
        _reverse(tour, place, i, j)
    step = 1 if edge > j else -1
    while (j + 1 != edge) if step > 0 else (i != edge):
        other = j + 1 if step > 0 else i - 1        # one line changes sides with the run
        passed = tour[other]
        for k in range(j - i + 1):
            p = j - k if step > 0 else i + k
            tour[p + step] = tour[p]
        i, j = i + step, j + step
        back = i - 1 if step > 0 else j + 1
        tour[back] = passed
        place[passed >> 1] = back
    for p in range(i, j + 1):
        place[tour[p] >> 1] = p
