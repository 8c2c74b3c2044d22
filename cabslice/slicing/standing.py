"""What straight support and trees have in common: outlines of the part as they go down, gaps in layers, the room left.

Legend
    S_k      outline of layer k
    z_k      its top, h_k its height, mm
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.profile.stand import Support
from cabslice.slicing.heights import Heights
from cabslice.slicing.overhang import COARSE
from cabslice.slicing.region import Region, difference, from_rings, offset, opening, union
from cabslice.slicing.sections import Solid, cut

EXACT = 1e-6     # mm: heights nearer than this are one
DETAIL = 0.01    # mm: outlines are simplified by this before support is looked for


@dataclass(frozen=True)
class Standing:
    """Support of one layer: all of it, and what of it is interface."""

    region: Region
    interface: Region


def outlines_of(solids: Sequence[Solid], planes: Array) -> Iterator[Region]:
    """The union of some solids at each plane (L,) mm, ascending."""
    cuts = [cut(solid.vertices, solid.faces, planes) for solid in solids]
    for _ in planes:
        yield union([from_rings(*next(each), simplify_mm=DETAIL) for each in cuts])


def from_above(solid: Solid, planes: Array) -> Iterator[Region]:
    """The outlines of a solid at planes (L,) mm, ascending as ever, but the topmost first."""
    mirrored = solid.vertices * np.array([1.0, 1.0, -1.0])
    for points, starts in cut(mirrored, solid.faces[:, ::-1], -planes[::-1]):
        yield from_rings(points, starts, simplify_mm=DETAIL)


class Nearby:
    """Outlines around one layer after the other, from the top down: a few are held at a time."""

    def __init__(self, outlines: Iterator[Region], layers: int, above: int, below: int) -> None:
        self._outlines, self._layers, self._above, self._below = outlines, layers, above, below
        self._held: dict[int, Region] = {}
        self._next = layers - 1

    def move(self, index: int) -> None:
        """To layer `index`; never upwards."""
        while self._next >= max(index - self._below, 0):
            self._held[self._next] = next(self._outlines)
            self._next -= 1
        self._held.pop(index + self._above + 1, None)

    def at(self, first: int, last: int) -> list[Region]:
        """Outlines first..last, as far as there are any."""
        return [self._held[k] for k in range(max(first, 0), min(last, self._layers - 1) + 1)]


@dataclass(frozen=True)
class Clear:
    """Per layer: `above` (L,) and `below` (L,) how many layers within the gaps; `contact` (L,) the topmost layer that
    may bear support for its overhang, -1 for none."""

    above: Array
    below: Array
    contact: Array


def clearances(heights: Heights, asked: Support) -> Clear:
    """Gaps in layers, rounded up."""
    top, bottom = heights.top, heights.top - heights.height
    index = np.arange(len(top))
    above = np.searchsorted(bottom, top + asked.z_gap_mm - EXACT) - 1 - index
    below = index - np.searchsorted(top, bottom - asked.bottom_gap_mm + EXACT)
    contact = np.searchsorted(top, bottom - asked.z_gap_mm + EXACT) - 1
    return Clear(np.maximum(above, 0), np.maximum(below, 0), contact)


def room_for(wanted: Region, near: Nearby, k: int, clear: Clear, asked: Support, bead: float) -> Region:
    """What of a wanted region may be printed in layer k: clear of the part, and nowhere narrower than a bead."""
    if wanted.is_empty():
        return wanted
    beside = [offset(one, asked.xy_gap_mm + DETAIL) for one in near.at(k, k)]
    over, under = near.at(k + 1, k + int(clear.above[k])), near.at(k - int(clear.below[k]), k - 1)
    return opening(difference(wanted, *beside, *over, *under), bead / 2).simplify(COARSE / 4)
