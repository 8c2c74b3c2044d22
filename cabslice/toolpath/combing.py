"""Travels kept inside the part: straight where that crosses no outline, else led along the walls. Compiled.

outer (N, 2), (R + 1,)   rings of the layer's outline, which a travel inside the part does not cross
guard                    the same shrunk a little: what shortcuts keep within
rail                     the same shrunk further: the rings a travel is led along
A way is led from the last point it reaches straight to the rail, round each ring it meets the shorter way, and is then
pulled taut within the guard (after the crossing-boundary walk of Lumelsky and Stepanov 1987, "Bug 2", with both ways
round known).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cabslice.arrays import Array

STEP_IN = 0.01   # mm: how far past the rail a way begins, so that it begins inside


@njit(cache=True, error_model="numpy")
def crosses(points, starts, ax, ay, bx, by):
    """Whether the segment a - b meets an edge of the rings."""
    left, right, low, high = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    for r in range(len(starts) - 1):
        k = starts[r + 1] - 1
        px, py = points[k, 0], points[k, 1]
        for j in range(starts[r], starts[r + 1]):
            qx, qy = points[j, 0], points[j, 1]
            if not (max(px, qx) < left or min(px, qx) > right or max(py, qy) < low or min(py, qy) > high):
                one = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
                two = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
                if one * two <= 0:
                    three = (qx - px) * (ay - py) - (qy - py) * (ax - px)
                    four = (qx - px) * (by - py) - (qy - py) * (bx - px)
                    if three * four <= 0:
                        return True
            px, py = qx, qy
    return False


@njit(cache=True, error_model="numpy")
def straight_inside(points, starts, here, there, wanted):
    """(T,) bool: which of the wanted travels here (T, 2) - there (T, 2) cross no ring."""
    free = np.zeros(len(here), np.bool_)
    for t in range(len(here)):
        if wanted[t]:
            free[t] = not crosses(points, starts, here[t, 0], here[t, 1], there[t, 0], there[t, 1])
    return free


@njit(cache=True, error_model="numpy")
def _stand_in(points, starts, x, y, reach):
    """(x, y) itself where it is inside the rings, else a place just inside next to it; nan where none is in reach."""
    inside, best, bx, by = False, np.inf, np.nan, np.nan
    for r in range(len(starts) - 1):
        k = starts[r + 1] - 1
        px, py = points[k, 0], points[k, 1]
        for j in range(starts[r], starts[r + 1]):
            qx, qy = points[j, 0], points[j, 1]
            if (py > y) != (qy > y) and px + (y - py) / (qy - py) * (qx - px) > x:
                inside = not inside
            dx, dy = qx - px, qy - py
            long = dx * dx + dy * dy
            t = min(max(((x - px) * dx + (y - py) * dy) / long, 0.0), 1.0) if long > 0 else 0.0
            gap = np.hypot(px + t * dx - x, py + t * dy - y)
            if gap < best:
                best, bx, by = gap, px + t * dx, py + t * dy
            px, py = qx, qy
    if inside:
        return x, y
    if best > reach:
        return np.nan, np.nan
    share = 1 + STEP_IN / max(best, STEP_IN)
    return x + (bx - x) * share, y + (by - y) * share


@njit(cache=True, error_model="numpy")
def _meetings(points, starts, ax, ay, bx, by, part, ring, edge):
    """Where a - b crosses the rings, sorted along it: its part (0..1), the ring and the edge; how many."""
    n = 0
    for r in range(len(starts) - 1):
        k = starts[r + 1] - 1
        for j in range(starts[r], starts[r + 1]):
            one = (bx - ax) * (points[k, 1] - ay) - (by - ay) * (points[k, 0] - ax)
            two = (bx - ax) * (points[j, 1] - ay) - (by - ay) * (points[j, 0] - ax)
            if (one > 0) != (two > 0):
                s = one / (one - two)
                x = points[k, 0] + s * (points[j, 0] - points[k, 0])
                y = points[k, 1] + s * (points[j, 1] - points[k, 1])
                t = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
                if 0 <= t <= 1 and n < len(part):
                    m = n
                    while m > 0 and part[m - 1] > t:
                        part[m], ring[m], edge[m] = part[m - 1], ring[m - 1], edge[m - 1]
                        m -= 1
                    part[m], ring[m], edge[m] = t, r, k
                    n += 1
            k = j
    return n


@njit(cache=True, error_model="numpy")
def _round(points, low, high, ax, ay, e, bx, by, f, way, n):
    """Add the vertices of the ring low..high from a, on the edge from vertex e, to b, on the edge from f."""
    if e == f:                                          # one edge: straight on
        return n
    size, best, turn = high - low, np.inf, 1
    for way_round in (1, -1):
        x, y, long = ax, ay, 0.0
        for c in range((way_round * (f - e)) % size):
            v = low + (e - low + (1 + c if way_round > 0 else -c)) % size
            long += np.hypot(points[v, 0] - x, points[v, 1] - y)
            x, y = points[v, 0], points[v, 1]
        long += np.hypot(bx - x, by - y)
        if long < best:
            best, turn = long, way_round
    for c in range((turn * (f - e)) % size):
        if n < len(way) - 3:
            v = low + (e - low + (1 + c if turn > 0 else -c)) % size
            way[n, 0], way[n, 1] = points[v, 0], points[v, 1]
            n += 1
    return n


@njit(cache=True, error_model="numpy")
def _led(points, starts, ax, ay, bx, by, way, part, ring, edge):
    """Fill `way` from a to b, both inside the rails, along them; the number of its points."""
    way[0, 0], way[0, 1] = ax, ay
    n, m, count = 1, 0, _meetings(points, starts, ax, ay, bx, by, part, ring, edge)
    while m < count:
        last = m
        for k in range(m + 1, count):
            if ring[k] == ring[m]:
                last = k
        if last > m and n < len(way) - 3:
            x, y = ax + part[m] * (bx - ax), ay + part[m] * (by - ay)
            u, v = ax + part[last] * (bx - ax), ay + part[last] * (by - ay)
            way[n, 0], way[n, 1] = x, y
            n = _round(points, starts[ring[m]], starts[ring[m] + 1], x, y, edge[m], u, v, edge[last], way, n + 1)
            way[n, 0], way[n, 1] = u, v
            n += 1
        m = last + 1
    way[n, 0], way[n, 1] = bx, by
    return n + 1


@njit(cache=True, error_model="numpy")
def _taut(guard, guard_starts, way, n):
    """Leave out points of the way that need not be gone through; the number left."""
    kept, here, ahead = 1, 0, 1
    while ahead < n - 1:
        if crosses(guard, guard_starts, way[here, 0], way[here, 1], way[ahead + 1, 0], way[ahead + 1, 1]):
            way[kept, 0], way[kept, 1] = way[ahead, 0], way[ahead, 1]
            kept, here = kept + 1, ahead
        ahead += 1
    way[kept, 0], way[kept, 1] = way[n - 1, 0], way[n - 1, 1]
    return kept + 1


@njit(cache=True, error_model="numpy")
def lead(guard, guard_starts, rail, rail_starts, ax, ay, bx, by, reach, way, part, ring, edge):
    """Fill `way` (len(rail) + 8, 2) with the points of a way along the rail from a to b, between them; their number.

    0 where an end lies more than `reach` mm outside the rail. Whether the ends see the first and the last point is not
    looked at. part, ring, edge (any, any, any) are room to work in.
    """
    ax, ay = _stand_in(rail, rail_starts, ax, ay, reach)
    bx, by = _stand_in(rail, rail_starts, bx, by, reach)
    if not (ax == ax and bx == bx):
        return 0
    return _taut(guard, guard_starts, way, _led(rail, rail_starts, ax, ay, bx, by, way, part, ring, edge))


def _ways(
    guard: tuple[Array, Array], rail: tuple[Array, Array], here: Array, there: Array, reach: float
) -> list[Array]:
    room = np.empty((len(rail[0]) + 8, 2)), np.empty(256), np.empty(256, np.int64), np.empty(256, np.int64)
    found = []
    for a, b in zip(here, there, strict=True):
        size = lead(*guard, *rail, a[0], a[1], b[0], b[1], reach, *room)
        found.append(room[0][:size].copy())
    return found


def comb(
    outer: tuple[Array, Array], guard: tuple[Array, Array], rail: tuple[Array, Array], here: Array, there: Array,
    reach: float, detour: float,
) -> tuple[Array, Array]:
    """Ways inside the part for travels here (T, 2) -> there (T, 2): points (M, 2), starts (T + 1,).

    A way holds the points between here and there; none where there is no way inside, or none at most `detour` times as
    long as the straight one. An end lies at most `reach` mm outside the rail.
    """
    ways = _ways(guard, rail, here, there, reach)
    points, starts = np.concatenate(ways), np.cumsum([0, *map(len, ways)])
    led = np.flatnonzero(np.diff(starts))
    size = np.diff(starts)[led] + 2
    first = np.cumsum(size) - size
    whole = np.empty((int(size.sum()), 2))
    inner = np.ones(len(whole), np.bool_)
    inner[first] = inner[first + size - 1] = False
    whole[first], whole[inner], whole[first + size - 1] = here[led], points, there[led]
    legs = np.linalg.norm(np.diff(whole, axis=0), axis=1)
    within = np.ones(len(legs), np.bool_)
    within[first[1:] - 1] = False                                    # from one way to the next
    clear = straight_inside(*outer, whole[:-1], whole[1:], within) | ~within
    legs[~within] = 0
    long = np.add.reduceat(np.append(legs, 0.0), first) if len(led) else legs
    crossing = np.add.reduceat(np.append(~clear, False), first) if len(led) else legs
    good = np.zeros(len(here), np.bool_)
    good[led] = (crossing == 0) & (long <= detour * np.linalg.norm(there - here, axis=1)[led])
    sizes = np.where(good, np.diff(starts), 0)
    return points[np.repeat(good, np.diff(starts))], np.append(0, np.cumsum(sizes))
