"""Walls over air are laid at speeds of their own, by how much of their width nothing carries."""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Polygons, Role
from cabslice.slicing.unsupported import levels

HANGING = 2    # the level from which a wall is an overhang: more than half of its width is over air
WALLS = (Role.OUTER_WALL, Role.INNER_WALL)


def slowed(
    rows: dict[str, Array], start: Array, below: Polygons, width: float, speeds: list[float]
) -> dict[str, Array]:
    """The moves of a layer from `start` (3,) on, walls cut where their level changes, with its speed (mm/s).

    speeds: of walls with more than a quarter, a half, three quarters, and all of their width over air.
    """
    points = np.vstack((start, rows["xyz"]))
    walls = np.append(False, np.isin(rows["role"], WALLS))
    source, share, level = levels(points[:, :2], walls, width, below)
    row, share, level = source[1:] - 1, share[1:], level[1:]
    cut = {name: column[row] for name, column in rows.items()}
    between = points[row] + share[:, None] * (points[row + 1] - points[row])
    cut["xyz"] = np.where(share[:, None] < 1, between, points[row + 1])      # to the last bit: a prime moves nothing
    before = np.append(0.0, np.where(np.diff(row) == 0, share[:-1], 0.0))
    cut["filament"] = cut["filament"] * (share - before)
    cut["speed"] = np.where(level > 0, np.asarray(speeds)[np.maximum(level, 1) - 1], cut["speed"])
    cut["role"] = np.where(level >= HANGING, Role.OVERHANG_WALL, cut["role"]).astype(np.uint8)
    return cut
