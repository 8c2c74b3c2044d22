"""Collecting the beads of one layer."""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Beads, Role
from cabslice.slicing.region import Region, contains, pieces, to_rings


class BeadList:
    """Grows line by line; `beads` freezes it."""

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._sizes: list[Array] = []
        self._width: list[Array] = []
        self._role: list[Array] = []
        self._closed: list[Array] = []
        self._height: list[Array] = []

    def __bool__(self) -> bool:
        return bool(self._points)

    def add(
        self, points: Array, starts: Array, width: Array | float, role: Role, closed: Array | bool = False,
        height: float = 0.0,
    ) -> None:
        """Lines points[starts[b]:starts[b+1]] (N, 2); width mm, one or per point (N,); closed one or per line (B,).

        height is 0 for beads as high as the layer.
        """
        if len(points):
            lines = len(starts) - 1
            self._points.append(points)
            self._sizes.append(np.diff(starts))
            self._width.append(np.broadcast_to(np.asarray(width, dtype=np.float64), len(points)))
            self._role.append(np.full(lines, role, dtype=np.uint8))
            self._closed.append(np.broadcast_to(np.asarray(closed, dtype=np.bool_), lines))
            self._height.append(np.full(lines, height))

    def add_rings(self, region: Region, width: float, role: Role) -> None:
        """The edges of a region as closed lines."""
        self.add(*to_rings(region), width, role, closed=True)

    def beads(self, outline: Region) -> Beads:
        """Frozen, each bead with the island of the outline it is in."""
        if not self._points:
            none = np.zeros(0)
            return Beads(np.zeros((0, 2)), np.zeros(1), none, none, none, none)
        points = np.concatenate(self._points)
        starts = np.concatenate(([0], np.cumsum(np.concatenate(self._sizes))))
        role = np.concatenate(self._role)
        island = islands(outline, points[starts[:-1]])
        width, closed, height = (np.concatenate(some) for some in (self._width, self._closed, self._height))
        return Beads(points, starts, width, role, closed, island, height)


def beside(beads: Beads, more: BeadList) -> Beads:
    """The beads of a layer with those of what stands beside the part, which are on no island."""
    extra = more.beads(Region())
    columns = {name: np.concatenate((getattr(beads, name), getattr(extra, name)))
               for name in ("points", "width", "role", "closed", "height")}
    starts = np.concatenate((beads.starts, extra.starts[1:] + beads.starts[-1]))
    return Beads(starts=starts, island=np.append(beads.island, np.full(len(extra.role), -1)), **columns)


def islands(outline: Region, query: Array) -> Array:
    """(Q,) which connected part of the outline each point (Q, 2) is in; 0 where it is in none."""
    parts = pieces(outline)
    found = np.zeros(len(query), dtype=np.int64)
    for k, part in enumerate(parts[1:], start=1):
        found[contains(*to_rings(part), query)] = k
    return found
