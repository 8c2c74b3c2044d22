"""How near cables come to slabs of a part, and the least of a field over the places the nozzle goes. Compiled.

Legend
    points, starts   outlines of the slabs of what is printed, in its frame (see solid)
    pose             (c, s, x, y): cosine and sine of the turn, shift on the bed, mm
    A_x, A_y, A_z    exit point of a cable, by interpolation over nodes; b attachment, nozzle + offset
    h, share         height of the middle of a slab; share of the way from A to b at which the cable is there
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAR = 1e6
ENOUGH = 25.0        # mm: gaps are not looked for beyond this


@njit(cache=True, nogil=True, error_model="numpy")
def node_of(x, y, low, step, columns, rows):
    """Cell and place in it (i, j, u, v) of a grid; clamped to the grid."""
    u = min(max((x - low[0]) / step[0], 0.0), columns - 1.000001)
    v = min(max((y - low[1]) / step[1], 0.0), rows - 1.000001)
    i, j = int(u), int(v)
    return i, j, u - i, v - j


@njit(cache=True, nogil=True, error_model="numpy")
def distance_at(field, low, pixel, x, y):
    """Signed distance at (x, y): bilinear; outside the grid a bound from below."""
    rows, columns = field.shape
    u, v = (x - low[0]) / pixel, (y - low[1]) / pixel
    cu, cv = min(max(u, 0.0), columns - 1.000001), min(max(v, 0.0), rows - 1.000001)
    i, j = int(cu), int(cv)
    a, b = cu - i, cv - j
    inner = (field[j, i] * (1 - a) + field[j, i + 1] * a) * (1 - b) + (
        field[j + 1, i] * (1 - a) + field[j + 1, i + 1] * a) * b
    beyond = np.hypot(u - cu, v - cv) * pixel
    return max(inner, beyond) if beyond > 0 else inner


@njit(cache=True, nogil=True, error_model="numpy")
def least_gap(
    points, starts, pose, dz, order, exits, low, step, offsets, field, field_low, pixel, radius, solid, enough
):
    """Least distance, mm, of any cable to slabs laid before or with the nozzle's; stops below `enough`.

    exits (L, R, C, m, 3) mm at nozzle places low + step (i, j), slab by slab; field (S, rows, columns) of what lies
    within radius of its origin; solid: its pose; order: the slabs of the nozzle, the telling ones first.
    """
    best, cables = ENOUGH, offsets.shape[0]
    for k in order:
        for n in range(starts[k], starts[k + 1]):
            qx = pose[0] * points[n, 0] - pose[1] * points[n, 1] + pose[2]
            qy = pose[1] * points[n, 0] + pose[0] * points[n, 1] + pose[3]
            i, j, u, v = node_of(qx, qy, low, step, exits.shape[2], exits.shape[1])
            for c in range(cables):
                tip = (k + 1) * dz + offsets[c, 2]
                if exits[k, j, i, c, 2] >= tip:
                    continue
                ax, ay, az = 0.0, 0.0, 0.0
                for q in range(4):
                    w = (u if q & 1 else 1 - u) * (v if q & 2 else 1 - v)
                    ax += w * exits[k, j + (q >> 1), i + (q & 1), c, 0]
                    ay += w * exits[k, j + (q >> 1), i + (q & 1), c, 1]
                    az += w * exits[k, j + (q >> 1), i + (q & 1), c, 2]
                bx, by = qx + offsets[c, 0] - ax, qy + offsets[c, 1] - ay
                before, last = 0.0, min(k, len(field) - 1)
                highest = last + min(int(best / dz), int((tip - (last + 1) * dz) / dz)) + 1
                for slab in range(highest, -1, -1):
                    share = ((slab + 0.5) * dz - az) / (tip - az)
                    if share > 1:
                        continue
                    if share < 0:
                        break
                    x, y = ax + share * bx - solid[2], ay + share * by - solid[3]
                    away = x * x + y * y
                    if away > (radius + best) ** 2:
                        if away > before > 0.0:
                            break            # a straight line that leaves a disc does not come back
                        before = away
                        continue
                    before = away
                    x, y = solid[0] * x + solid[1] * y, solid[0] * y - solid[1] * x
                    near = distance_at(field[min(slab, last)], field_low, pixel, x, y)
                    if slab > last:
                        near = np.hypot(max(near, 0.0), (slab - last - 0.5) * dz)
                    best = min(best, near)
                    if best < enough:
                        return best
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def least_over(points, starts, pose, values, low, step, out):
    """Fill out (F,) with the least of the fields values (F, L, R, C) over all places of the nozzle."""
    out[:] = FAR
    for k in range(len(starts) - 1):
        for n in range(starts[k], starts[k + 1]):
            qx = pose[0] * points[n, 0] - pose[1] * points[n, 1] + pose[2]
            qy = pose[1] * points[n, 0] + pose[0] * points[n, 1] + pose[3]
            i, j, u, v = node_of(qx, qy, low, step, values.shape[3], values.shape[2])
            for f in range(len(out)):
                grid = values[f, k]
                value = (grid[j, i] * (1 - u) + grid[j, i + 1] * u) * (1 - v) + (
                    grid[j + 1, i] * (1 - u) + grid[j + 1, i + 1] * u) * v
                out[f] = min(out[f], value)


@njit(cache=True, nogil=True, error_model="numpy")
def least_apart(points, starts, pose, field, field_low, pixel, solid):
    """Least plan distance, mm, of outlines to the slabs of another part at the same heights."""
    best = FAR
    for k in range(min(len(starts) - 1, len(field))):
        for n in range(starts[k], starts[k + 1]):
            x = pose[0] * points[n, 0] - pose[1] * points[n, 1] + pose[2] - solid[2]
            y = pose[1] * points[n, 0] + pose[0] * points[n, 1] + pose[3] - solid[3]
            x, y = solid[0] * x + solid[1] * y, solid[0] * y - solid[1] * x
            best = min(best, distance_at(field[k], field_low, pixel, x, y))
    return best
