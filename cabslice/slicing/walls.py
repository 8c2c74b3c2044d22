"""Walls: closed lines along the outline, and the parts too thin for a pair of them.

w  bead width, mm    s  bead spacing, mm (slicing.flow)
The outer wall's centre line lies w/2 inside the outline, each further one a spacing inside the last. Where two
lines would come closer to each other than a spacing, neither is laid: that strip is handed on as `thin`, to be filled by one
bead of its own width (slicing.medial).
"""

from __future__ import annotations

from dataclasses import dataclass

from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.region import Region, difference, intersection, offset, opening

SAME = 1e-3  # mm^2: a difference in area that is only rounding


@dataclass(frozen=True)
class Wall:
    """One level of walls: centre lines as the boundary of `lines`; `thin` is what they leave unfilled at this level."""

    lines: Region
    width_mm: float
    thin: Region


def walls(outline: Region, widths_mm: tuple[float, ...], height_mm: float, thinnest_mm: float) -> tuple[list[Wall], Region]:
    """One Wall per width, outside first, and the region left inside them.

    Strips narrower than thinnest_mm are left out of `thin`.
    """
    levels: list[Wall] = []
    room = outline
    for level, width in enumerate(widths_mm):
        spacing = float(bead_spacing(width, height_mm))
        outer = width / 2 if level == 0 else spacing / 2
        lines, thin, room = _level(room, outer, spacing / 2, thinnest_mm)
        levels.append(Wall(lines, width, thin))
    return levels, room


def _level(room: Region, outer: float, inner: float, thinnest: float) -> tuple[Region, Region, Region]:
    """Centre lines at `outer` inside the edge of the room, `inner` away from the next room; thin parts; next room."""
    inside = offset(room, -(outer + inner))
    if abs(offset(inside, outer + inner).area() - room.area()) < SAME:
        return offset(room, -outer), Region(), inside
    lines = offset(room, -outer)
    if not lines.is_empty():
        lines = intersection(offset(inside, inner), lines)
    return lines, thin_parts(room, offset(lines, outer), thinnest), inside


def thin_parts(room: Region, covered: Region, thinnest: float) -> Region:
    """What of the room is not covered, without hairs narrower than `thinnest`."""
    left = difference(room, covered)
    if left.area() < thinnest**2:
        return Region()
    return opening(left, thinnest / 2)
