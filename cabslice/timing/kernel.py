"""The rows of timing.limits for a level platform with two cables more than freedoms, compiled.

Same rows as the numpy path in timing.limits (which serves every other robot and is its test), about ten times faster:
benchmarks/timing.py. The maths is that of robot.pulley and robot.reach. What numba compiled of this file it keeps until
this file changes: after a change in timing.recursion, touch it.

Legend
    u_i, L', L''   direction of cable i, and derivatives of its length along the path (robot.pulley)
    G              Gauss-Jordan form of [W | w0 w1 w2], pivots where they are largest; w = w0 + w1 u + w2 x is the
                   wrench to supply. Six cables then follow from the two others: t_i = tau_i + h_i . lambda
    mu             of three cables, the combination in which lambda cancels: (h_j x h_k, h_k x h_i, h_i x h_j)
"""

from __future__ import annotations

from math import inf, nan, sqrt

import numpy as np

from cabslice.arrays import Array
from cabslice.compiled import compiled
from cabslice.robot.model import NEWTON, Robot
from cabslice.timing.recursion import fall, rise, work_for

FREEDOMS = 6
PARALLEL = 1e-9
OWN = 8            # rows that need no cables
KEPT = 2_048       # nodes of one piece whose rows are kept from the way back to the way forth


@compiled
def _line(tip, anchor, axis, r, d1, d2, unit):
    """Fills the unit vector (3,) from tip to pulley; returns L' and L''; nan where the tip is inside the pulley."""
    ax, ay, az = tip[0] - anchor[0], tip[1] - anchor[1], tip[2] - anchor[2]
    z = ax * axis[0] + ay * axis[1] + az * axis[2]
    ax, ay, az = ax - z * axis[0], ay - z * axis[1], az - z * axis[2]
    rho = sqrt(ax * ax + ay * ay + az * az)
    square = (rho - r) ** 2 + z * z
    if square <= r * r or (r > 0.0 and rho <= r):
        return nan, nan
    scale = 1.0 / rho if rho > 0.0 else 1.0
    ax, ay, az = ax * scale, ay * scale, az * scale
    free = sqrt(square - r * r)
    sine, cosine = ((rho - r) * free + z * r) / square, (z * free - (rho - r) * r) / square
    unit[0] = -sine * ax - cosine * axis[0]
    unit[1] = -sine * ay - cosine * axis[1]
    unit[2] = -sine * az - cosine * axis[2]
    vx, vy, vz = axis[1] * az - axis[2] * ay, axis[2] * ax - axis[0] * az, axis[0] * ay - axis[1] * ax
    along = unit[0] * d1[0] + unit[1] * d1[1] + unit[2] * d1[2]
    aside = vx * d1[0] + vy * d1[1] + vz * d1[2]
    lateral = sine / rho if r > 0.0 else 1.0 / free
    turning = (d1[0] ** 2 + d1[1] ** 2 + d1[2] ** 2 - along * along) / free + (lateral - 1.0 / free) * aside * aside
    return -along, turning - (unit[0] * d2[0] + unit[1] * d2[1] + unit[2] * d2[2])


@compiled
def _gauss_jordan(g, m, pivot, used):
    """Reduce g (6, m + 3) on six of its first m columns; pivot (6,) names them; False where W is singular."""
    for j in range(m):
        used[j] = False
    for row in range(FREEDOMS):
        best, best_row, best_col = 0.0, -1, -1
        for i in range(row, FREEDOMS):
            for j in range(m):
                if not used[j] and abs(g[i, j]) > best:
                    best, best_row, best_col = abs(g[i, j]), i, j
        if best < 1e-12:
            return False
        used[best_col] = True
        if best_row != row:
            for j in range(m + 3):
                g[row, j], g[best_row, j] = g[best_row, j], g[row, j]
        pivot[row] = best_col
        scale = 1.0 / g[row, best_col]
        for j in range(m + 3):
            g[row, j] *= scale
        for i in range(FREEDOMS):
            factor = g[i, best_col]
            if i != row and factor != 0.0:
                for j in range(m + 3):
                    g[i, j] -= factor * g[row, j]
    return True


@compiled
def _fill(a, b, at, slope_u, slope_x, low, high, keep):
    """Two rows of lo <= a u + b x <= hi, scaled so that rest has slack 1."""
    above, below = 1.0 / (high * keep), 1.0 / (low * keep)
    a[at], b[at] = slope_u * above, slope_x * above
    a[at + 1], b[at + 1] = slope_u * below, slope_x * below


@compiled
def _own_rows(d1, d2, feed, accel, feed_accel, keep, a, b):
    """The rows that need no cables: acceleration of each axis and of the filament."""
    for axis in range(3):
        _fill(a, b, 2 * axis, d1[axis], d2[axis], -accel, accel, keep)
    _fill(a, b, 6, feed, 0.0, -feed_accel, feed_accel, keep)


@compiled
def _node(p, d1, d2, feed, accel, geometry, load, bounds, a, b, scratch):
    """Rows of one node into a, b (R,); returns the margin at rest as a share of the range (<= 0: cannot rest) and
    the largest |L'| over its cap. scratch: g (6, m+3), h (m, 2), tau (m, 3), unit (3,), tip (3,), pivot, used."""
    anchors, axes, radii, levers = geometry
    weight, mass, arm, size = load
    t_min, t_max, caps, _, feed_accel, keep = bounds
    g, h, tau, unit, tip, pivot, used = scratch
    m = len(radii)
    _own_rows(d1, d2, feed, accel, feed_accel, keep, a, b)
    at = OWN
    for i in range(m):
        for axis in range(3):
            tip[axis] = p[axis] + levers[i, axis]
        first, second = _line(tip, anchors[i], axes[i], radii[i], d1, d2, unit)
        _fill(a, b, at, first, second, -caps[i], caps[i], keep)
        at += 2
        for axis in range(3):
            g[axis, i] = unit[axis]
        g[3, i] = (levers[i, 1] * unit[2] - levers[i, 2] * unit[1]) / size
        g[4, i] = (levers[i, 2] * unit[0] - levers[i, 0] * unit[2]) / size
        g[5, i] = (levers[i, 0] * unit[1] - levers[i, 1] * unit[0]) / size
        h[i, 0] = -first
    fastest = 0.0
    for i in range(m):
        fastest = max(fastest, abs(h[i, 0]) / caps[m + i])
    for axis in range(3):
        g[axis, m], g[axis, m + 1], g[axis, m + 2] = weight[axis], mass * d1[axis], mass * d2[axis]
    for axis in range(3):
        g[3 + axis, m] = weight[3 + axis] / size
    for j in range(m + 1, m + 3):
        g[3, j] = (arm[1] * g[2, j] - arm[2] * g[1, j]) / size
        g[4, j] = (arm[2] * g[0, j] - arm[0] * g[2, j]) / size
        g[5, j] = (arm[0] * g[1, j] - arm[1] * g[0, j]) / size
    if not _gauss_jordan(g, m, pivot, used):
        return -1.0, fastest
    free = 0
    for i in range(m):
        if not used[i]:
            h[i, 0], h[i, 1] = (1.0, 0.0) if free == 0 else (0.0, 1.0)
            tau[i, 0] = tau[i, 1] = tau[i, 2] = 0.0
            unit[free] = i
            free += 1
    first_free, second_free = int(unit[0]), int(unit[1])
    for row in range(FREEDOMS):
        i = pivot[row]
        h[i, 0], h[i, 1] = -g[row, first_free], -g[row, second_free]
        tau[i, 0], tau[i, 1], tau[i, 2] = g[row, m], g[row, m + 1], g[row, m + 2]
    margin = 2.0
    for i in range(m):
        for j in range(i + 1, m):
            mu_k = h[i, 0] * h[j, 1] - h[i, 1] * h[j, 0]
            for k in range(j + 1, m):
                mu_i = h[j, 0] * h[k, 1] - h[j, 1] * h[k, 0]
                mu_j = h[k, 0] * h[i, 1] - h[k, 1] * h[i, 0]
                reach = abs(mu_i) + abs(mu_j) + abs(mu_k)
                if reach < PARALLEL:
                    a[at] = b[at] = a[at + 1] = b[at + 1] = 0.0
                    at += 2
                    continue
                still = mu_i * tau[i, 0] + mu_j * tau[j, 0] + mu_k * tau[k, 0]
                low = min(mu_i * t_min[i], mu_i * t_max[i]) + min(mu_j * t_min[j], mu_j * t_max[j])
                low += min(mu_k * t_min[k], mu_k * t_max[k]) - still
                high = max(mu_i * t_min[i], mu_i * t_max[i]) + max(mu_j * t_min[j], mu_j * t_max[j])
                high += max(mu_k * t_min[k], mu_k * t_max[k]) - still
                if not 2.0 * min(high, -low) >= margin * (high - low):
                    margin = 2.0 * min(high, -low) / (high - low)
                slope_u = mu_i * tau[i, 1] + mu_j * tau[j, 1] + mu_k * tau[k, 1]
                slope_x = mu_i * tau[i, 2] + mu_j * tau[j, 2] + mu_k * tau[k, 2]
                _fill(a, b, at, slope_u, slope_x, low, high, keep)
                at += 2
    return margin, fastest


@compiled
def _rows(places, first, last, tight, rows, robot, margin, highest, a, b, scratch):
    """Rows of nodes first..last-1 into the first of a, b (KEPT, R); their margin at rest, and highest (G,) lowered."""
    q, d1, d2, feed, accel = places
    geometry, load, bounds = robot
    for at in range(first, last):
        k = at - first
        if rows == OWN:
            _own_rows(d1[at], d2[at], feed[at], accel[at], bounds[4], bounds[5], a[k], b[k])
            margin[at] = 1.0
        else:
            margin[at], fastest = _node(
                q[at], d1[at], d2[at], feed[at], accel[at], geometry, load, bounds, a[k], b[k], scratch)
            if fastest > 0.0:
                highest[at] = min(highest[at], 1.0 / (fastest * fastest))
        for row in range(rows):
            a[k, row] *= tight[at]
            b[k, row] *= tight[at]


@compiled
def _solve(places, quiet, tight, highest, step, nodes, robot, x, margin, a, b, work, scratch):
    """Rows and recursion piece by piece, so that the rows of a piece stay in the cache; of a long piece they are made
    twice, in parts of KEPT nodes that share their ends."""
    p, q, order = work
    for piece in range(len(nodes) - 1):
        begin, final = nodes[piece], nodes[piece + 1] - 1
        rows = OWN
        for at in range(begin, final + 1):
            if not quiet[at]:
                rows = a.shape[1]
                break
        for k in range(2 * rows):
            order[k] = k
        p_now, q_now, order_now = p[:2 * rows], q[:2 * rows], order[:2 * rows]
        x[begin] = x[final] = 0.0
        low = high = final
        while low > begin or high == begin:
            high, low = low, max(begin, low - len(a) + 1)
            _rows(places, low, high + 1, tight, rows, robot, margin, highest, a, b, scratch)
            fall(a[:, :rows], b[:, :rows], highest[low:high], step[low:high], x[low:high + 1], p_now, q_now, order_now)
            if high == begin:
                break
        x[begin] = 0.0
        while True:
            rise(a[:, :rows], b[:, :rows], step[low:high], x[low:high + 1], p_now, q_now)
            if high >= final:
                break
            low, high = high, min(final, high + len(a) - 1)
            _rows(places, low, high + 1, tight, rows, robot, margin, highest, a, b, scratch)


@compiled
def _used(places, quiet, u, x, robot, out, a, b, scratch):
    q, d1, d2, feed, accel = places
    geometry, load, bounds = robot
    for k in range(len(q)):
        rows, fastest = OWN, 0.0
        if quiet[k]:
            _own_rows(d1[k], d2[k], feed[k], accel[k], bounds[4], bounds[5], a, b)
        else:
            _, fastest = _node(q[k], d1[k], d2[k], feed[k], accel[k], geometry, load, bounds, a, b, scratch)
            rows = len(a)
        worst = x[k] * fastest * fastest
        for row in range(rows):
            worst = max(worst, a[row] * u[k] + b[row] * x[k])
        out[k] = worst


@compiled
def _at_worst(q, directions, speed, robot, out, a, b, total, scratch):
    geometry, load, bounds = robot
    reach = bounds[3] * bounds[5]
    for k in range(len(q)):
        worst = 0.0
        for row in range(OWN, len(a)):
            total[row] = 0.0
        for axis in range(3):
            margin, fastest = _node(
                q[k], directions[axis], directions[3], 0.0, bounds[3], geometry, load, bounds, a, b, scratch)
            if not margin > 0.0:
                worst = inf
            worst += fastest * speed
            for row in range(OWN, len(a)):
                total[row] += abs(a[row]) * reach
        for row in range(OWN, len(a)):
            worst = max(worst, total[row])
        out[k] = worst


def _scratch(m: int) -> tuple:
    return (np.empty((FREEDOMS, m + 3)), np.empty((m, 2)), np.empty((m, 3)), np.empty(3), np.empty(3),
            np.empty(FREEDOMS, np.int64), np.empty(m, np.bool_))


def _row_count(m: int) -> int:
    return OWN + 2 * m + m * (m - 1) * (m - 2) // 3


def columns(robot: Robot, t_max: Array, winding: Array, winding_speed: Array, accel: float, feed_accel: float,
            keep: float) -> tuple[tuple, tuple, tuple]:
    """Geometry, load and bounds of a robot as the compiled functions take them.

    t_max (m,) N; winding (m,) mm/s^2 and winding_speed (m,) mm/s of cable; accel mm/s^2 per axis of the platform;
    feed_accel mm/s^2 of filament; keep: share of every range that may be used.
    """
    geometry = tuple(np.ascontiguousarray(column, float) for column in (
        robot.anchors, robot.pulley_axes, robot.pulley_radii, robot.attachments))
    size = max(float(np.linalg.norm(robot.attachments, axis=1).max()), 1e-9)
    weight = NEWTON * robot.mass * robot.gravity
    still = -np.concatenate((weight, np.cross(robot.centre_of_mass, weight))) - robot.pull
    load = (still, robot.mass * NEWTON, np.ascontiguousarray(robot.centre_of_mass), size)
    caps = np.concatenate((winding, winding_speed))
    bounds = (np.ascontiguousarray(robot.tension_min), np.ascontiguousarray(t_max), caps, accel, feed_accel, keep)
    return geometry, load, bounds


def solve(q: Array, d1: Array, d2: Array, feed: Array, accel: Array, quiet: Array, tight: Array, top: Array,
          step: Array, nodes: Array, robot_columns: tuple[tuple, tuple, tuple]) -> tuple[Array, Array]:
    """x (G,) at the nodes of a block of pieces and the margin (G,) at rest as a share of the range (<= 0: cannot rest).

    q, d1, d2 (G, 3) platform origin in the machine frame and its derivatives by s; feed (G,) filament per mm;
    accel (G,) mm/s^2 per axis; quiet (G,) bool: the rows of the cables are known to follow from those of the axes
    (at_worst), and are left out where that holds for a whole piece; tight (G,) factors on the rows; top (G,),
    step (G,), nodes (P+1,) as in recursion.retime.
    """
    x, margin = np.empty((2, len(q)))
    m = len(robot_columns[0][2])
    a, b = np.empty((2, max(2, min(KEPT, int(np.diff(nodes).max()))), _row_count(m)))
    _solve((q, d1, d2, feed, accel), quiet, tight, top.copy(), step, nodes, robot_columns, x, margin, a, b,
           work_for(a.shape[1]), _scratch(m))
    return x, margin


def used(q: Array, d1: Array, d2: Array, feed: Array, accel: Array, quiet: Array, u: Array, x: Array,
         robot_columns: tuple) -> Array:
    """(K,) largest share of any limit that (u, x) uses; nan where a cable cannot run."""
    out, m = np.empty(len(q)), len(robot_columns[0][2])
    a, b = np.empty((2, _row_count(m)))
    _used((q, d1, d2, feed, accel), quiet, u, x, robot_columns, out, a, b, _scratch(m))
    return out


def at_worst(q: Array, speed: float, robot_columns: tuple) -> Array:
    """(K,) largest share of the cables' limits at any acceleration the axes allow and any direction at `speed` mm/s.

    Turning of the cables at that speed is not in it: leave room. inf where the platform cannot rest. q (K, 3).
    """
    out, m = np.empty(len(q)), len(robot_columns[0][2])
    a, b, total = np.empty((3, _row_count(m)))
    _at_worst(np.ascontiguousarray(q), np.eye(4, 3), speed, robot_columns, out, a, b, total, _scratch(m))
    return out


def compiled_to() -> str:
    """Folder in which numba keeps what it compiled of this module."""
    return str(_solve.stats.cache_path)


def serves(robot: Robot) -> bool:
    """Six freedoms and two cables more."""
    return bool(robot.freedoms.all()) and robot.cables == FREEDOMS + 2
