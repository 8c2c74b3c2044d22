"""In which direction lines over air are held best: all directions are tried.

air    what of a bridge lies over nothing      span   a line across it; held if the layer below is at both of its ends
D directions, E edges of the air, C crossings of rows with edges, S spans.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.infill import meetings
from cabslice.slicing.region import Region, contains, difference, following, to_rings

DIRECTIONS = np.radians(np.arange(0, 180, 5))
TOUCH = 0.05      # of the reach: where an edge of the air that is an edge of the layer below sees it
MOST_ROWS = 40    # in one direction
AS_GOOD = 0.02    # directions whose held shares differ by less are equals: then the shorter spans win


def bridge_angle(bridge: Region, below: Region, reach_mm: float, fallback: float) -> float:
    """Direction (rad) in which the largest share of the length of lines over air is held, with short spans.

    reach_mm is how far beyond the edge the layer below is looked for, and the least distance of the lines. Where
    nothing can be held at both ends lines meet what holds them head-on; without any hold: the fallback.
    """
    points, starts = to_rings(difference(bridge, below))
    if not len(points):
        return fallback
    held = _held(points, starts, below, reach_mm)
    if not held.any():
        return fallback
    share, longest = _spans(points, starts, held, reach_mm)
    if share.max() <= AS_GOOD:
        return _head_on(points, starts, held)
    equals = share >= share.max() - AS_GOOD
    return float(DIRECTIONS[np.argmin(np.where(equals, np.round(longest, 3), np.inf))])


def _held(points: Array, starts: Array, below: Region, reach: float) -> Array:
    """(E,) bool: edges behind which the layer below begins, at once or within reach."""
    ahead = points[following(starts)]
    along = ahead - points
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    outward = np.stack((along[:, 1], -along[:, 0]), axis=1) / length
    middle, rings = (points + ahead) / 2, to_rings(below)
    return contains(*rings, middle + TOUCH * reach * outward) | contains(*rings, middle + reach * outward)


def _spans(points: Array, starts: Array, held: Array, pitch: float) -> tuple[Array, Array]:
    """Per direction the share (D,) of the lines' length that is held, and the longest held span (D,), mm."""
    count, size = len(DIRECTIONS), len(points)
    x = np.cos(DIRECTIONS)[:, None] * points[:, 0] + np.sin(DIRECTIONS)[:, None] * points[:, 1]
    y = np.cos(DIRECTIONS)[:, None] * points[:, 1] - np.sin(DIRECTIONS)[:, None] * points[:, 0]
    low, extent = y.min(1), np.ptp(y, axis=1)
    rows = np.clip(np.ceil(extent / pitch), 1, MOST_ROWS).astype(np.int64)
    level = ((y - low[:, None]) / extent[:, None] * rows[:, None] - 0.5).ravel()    # rows at 0, 1, ..
    every = np.concatenate([starts[:-1] + k * size for k in range(count)] + [[count * size]])
    edge, row, part = meetings(every, level, np.zeros(len(level), np.int64), np.repeat(rows, size))
    ahead = following(every)[edge]
    at = x.ravel()[edge] + part * (x.ravel()[ahead] - x.ravel()[edge])
    order = np.lexsort((at, row, edge // size))
    left, right = order[0::2], order[1::2]
    direction, length = edge[left] // size, at[right] - at[left]
    both = held[edge[left] % size] & held[edge[right] % size]
    carried, whole = (np.bincount(direction, some, count) for some in (length * both, length))
    longest = np.zeros(count)
    np.maximum.at(longest, direction, length * both)
    return carried / np.maximum(whole, 1e-12), longest


def _head_on(points: Array, starts: Array, held: Array) -> float:
    """Direction that meets most of the held edge head-on, and least of the free one."""
    along = points[following(starts)] - points
    met = np.abs(np.sin(DIRECTIONS)[:, None] * along[:, 0] - np.cos(DIRECTIONS)[:, None] * along[:, 1])
    return float(DIRECTIONS[np.argmax(np.round(met @ np.where(held, 1.0, -1.0), 6))])
