"""Which parts of a layer hang over air: what support must hold.

S_i  outline of layer i, cut at the plane p_i    d  how far S_i may reach beyond S_(i-1): (p_i - p_(i-1)) tan(angle)
The overhang of layer i is what of S_i lies further than d outside S_(i-1), together with all that is between that and
S_(i-1). Overhangs of neighbouring layers that touch are one patch; it counts by the area it covers, seen from below.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from cabslice.arrays import Array
from cabslice.profile.stand import Support
from cabslice.slicing.bridges import bridge_angle
from cabslice.slicing.infill import fixed_lines
from cabslice.slicing.region import (
    Region,
    contains,
    difference,
    from_rings,
    intersection,
    offset,
    opening,
    pieces,
    to_rings,
    union,
)

FINE = 0.005     # mm: less than this is no overhang
TOUCH = 0.05     # mm: overhangs this near to each other are one patch
COARSE = 0.02    # mm: detail of what lies further down


@dataclass(frozen=True)
class Marks:
    """Outlines of each layer in which overhangs must not, or must be held, whatever their slope."""

    blocked: Iterable[Region]
    enforced: Iterable[Region]


NO_MARKS = Marks(repeat(Region()), repeat(Region()))


def overhangs(
    outlines: Iterable[Region], planes: Array, asked: Support, bead_mm: float, marks: Marks = NO_MARKS
) -> list[Region]:
    """Per layer what of it support must hold; outlines and marks come one per plane (L,) mm, from the bed up."""
    patches = _Patches(asked.smallest_mm2, bead_mm)
    below, shadow = Region(), Region()
    slack = np.diff(planes, prepend=planes[:1]) * np.tan(np.radians(asked.angle_deg)) + FINE
    for index, (outline, no, yes) in enumerate(zip(outlines, marks.blocked, marks.enforced, strict=False)):
        found, forced, barred = Region(), Region(), no
        if index:
            found, forced = _overhang(outline, below, float(slack[index]), asked, bead_mm, no, yes)
        if asked.where == "bed":
            barred = union([no, offset(shadow, asked.xy_gap_mm)])
            found, forced = difference(found, barred), difference(forced, barred)
            shadow = union([shadow, outline]).simplify(COARSE)
        patches.add(found, forced, barred, below, float(slack[index]))
        below = outline
    return patches.worthwhile()


def _overhang(
    outline: Region, below: Region, slack: float, asked: Support, bead: float, blocked: Region, enforced: Region
) -> tuple[Region, Region]:
    """What is found by its slope, and what is enforced."""
    hanging = difference(outline, below, blocked)
    if hanging.is_empty():
        return hanging, hanging
    found = Region()
    if asked.overhangs == "all":
        beyond = difference(hanging, offset(below, slack))
        found = intersection(offset(beyond, slack + FINE), hanging)
        if asked.bridge_mm and not found.is_empty():
            found = union([unbridged(piece, below, asked.bridge_mm, bead) for piece in pieces(found)])
    return found, intersection(hanging, enforced)


def unbridged(piece: Region, below: Region, longest: float, bead: float) -> Region:
    """What of an overhang lines in the direction of its bridge (bridges.bridge_angle) do not span.

    A line spans where both its ends lie on the layer below and it is not longer than `longest` (mm).
    """
    angle = bridge_angle(piece, below, bead, np.nan)
    if not np.isfinite(angle):
        return piece
    ends = fixed_lines(piece, bead, angle, 0.0).points.reshape(-1, 2, 2)
    along = np.array([np.cos(angle), np.sin(angle)])
    ends = np.where(((ends[:, 1] - ends[:, 0]) @ along)[:, None, None] < 0, ends[:, ::-1], ends)
    rings = to_rings(below)
    held = contains(*rings, ends[:, 0] - bead / 2 * along) & contains(*rings, ends[:, 1] + bead / 2 * along)
    held &= np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) <= longest
    if not held.any():
        return piece
    start, stop = ends[held, 0] - bead * along, ends[held, 1] + bead * along
    aside = 0.51 * bead * np.array([-along[1], along[0]])
    spans = np.stack((start - aside, stop - aside, stop + aside, start + aside), axis=1)
    covered = from_rings(spans.reshape(-1, 2), 4 * np.arange(len(spans) + 1))
    return opening(difference(piece, covered), bead / 2)


def _widened(found: Region, bead: float) -> Region:
    """With a bead more on all sides of what is narrower than three: what stands under it must be able to stand."""
    if found.is_empty():
        return found
    narrow = difference(found, opening(found, 1.5 * bead))
    return union([found, offset(narrow, bead)])


@dataclass(frozen=True)
class _Piece:
    """One connected piece of a layer's overhang: as it is, and as wide as its support shall be."""

    bare: Region
    wide: Region
    patch: int


class _Patches:
    """Overhangs of all layers, with the patch each of their pieces belongs to."""

    def __init__(self, smallest: float, bead: float) -> None:
        self._smallest, self._bead = smallest, bead
        self._layers: list[list[_Piece]] = []
        self._parent: list[int] = []
        self._needed: list[bool] = []      # of a patch, at its root: enforced, or nothing else holds it

    def add(self, found: Region, forced: Region, barred: Region, below: Region, slack: float) -> None:
        before, layer = self._layers[-1] if self._layers else [], []
        for piece in pieces(union([found, forced]).simplify(COARSE / 4)):
            name = len(self._parent)
            self._parent.append(name)
            enforced = not intersection(piece, forced).is_empty()
            alone = piece.area() < self._smallest and intersection(offset(piece, slack + TOUCH), below).is_empty()
            self._needed.append(enforced or alone)
            wide = offset(piece, TOUCH)
            for other in before:
                if _near(wide, other.bare) and not intersection(wide, other.bare).is_empty():
                    self._join(other.patch, name)
            layer.append(_Piece(piece, difference(_widened(piece, self._bead), barred), name))
        self._layers.append(layer)

    def _root(self, name: int) -> int:
        while self._parent[name] != name:
            self._parent[name] = name = self._parent[self._parent[name]]
        return name

    def _join(self, one: int, other: int) -> None:
        one, other = self._root(one), self._root(other)
        if one != other:
            self._parent[other] = one
            self._needed[one] |= self._needed[other]

    def worthwhile(self) -> list[Region]:
        """Per layer what belongs to patches that are large enough, and somewhere wider than a bead, or needed."""
        patches: dict[int, list[Region]] = {}
        for piece in (piece for layer in self._layers for piece in layer):
            patches.setdefault(self._root(piece.patch), []).append(piece.bare)
        kept = {root for root, bare in patches.items() if self._needed[root] or self._worth(union(bare))}
        return [union([piece.wide for piece in layer if self._root(piece.patch) in kept]) for layer in self._layers]

    def _worth(self, patch: Region) -> bool:
        return patch.area() >= self._smallest and not opening(patch, self._bead / 2).is_empty()


def _near(one: Region, other: Region) -> bool:
    a, b = one.bounds(), other.bounds()
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]

