"""Walls: closed lines along the outline, and the parts too thin for a pair of them.

w  bead width, mm    s  bead spacing, mm (slicing.flow)
The outer wall's centre line lies w/2 inside the outline, each further one a spacing inside the last. Where two
lines would come closer to each other than a spacing, neither is laid: that strip is handed on as `thin`, to be filled
by one bead of its own width (slicing.thin).
"""

from __future__ import annotations

from dataclasses import dataclass

from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.region import Region, difference, intersection, offset, opening

COARSE = 0.05   # of a spacing: detail that fill lines need not follow


@dataclass(frozen=True)
class Wall:
    """One level of walls: centre lines as the edge of `lines`; `thin` is what they leave unfilled at this level."""

    lines: Region
    width_mm: float
    thin: Region


@dataclass(frozen=True)
class Inside:
    """What is left inside the walls: `wide` has room for two fill lines everywhere, `thin` has not."""

    wide: Region
    thin: Region


def walls(
    outline: Region, widths_mm: tuple[float, ...], height_mm: float, thinnest_mm: float, fill_spacing_mm: float
) -> tuple[list[Wall], Inside]:
    """One Wall per width, outside first, and the inside for fill lines at fill_spacing_mm.

    Strips narrower than thinnest_mm are left out of `thin`.
    """
    steps = _steps(widths_mm, height_mm)
    depth = sum(outer + inner for outer, inner in steps)
    wide = offset(outline, -depth)
    core = offset(wide, -fill_spacing_mm)
    if not core.is_empty() and _comes_back(outline, offset(core, depth + fill_spacing_mm), thinnest_mm):
        simple = [Wall(lines, width, Region()) for lines, width in _simple(outline, steps, widths_mm)]
        return simple, Inside(wide.simplify(COARSE * fill_spacing_mm), Region())
    levels = []
    room = outline
    for (outer, inner), width in zip(steps, widths_mm, strict=True):
        lines, thin, room = _level(room, outer, inner, thinnest_mm)
        levels.append(Wall(lines, width, thin))
    wide = opening(room, fill_spacing_mm)
    return levels, Inside(wide.simplify(COARSE * fill_spacing_mm), thin_parts(room, wide, thinnest_mm))


def _comes_back(outline: Region, grown_core: Region, thinnest: float) -> bool:
    """Whether the outline is its core grown again, so that nothing in it is thin: the way most layers go."""
    if abs(grown_core.area() - outline.area()) < thinnest**2 / 2:
        return True
    return thin_parts(outline, grown_core, thinnest).is_empty()


def _steps(widths: tuple[float, ...], height: float) -> list[tuple[float, float]]:
    """Per wall: from the edge of its room to its centre line, and from there to the next room, mm."""
    half = [float(bead_spacing(width, height)) / 2 for width in widths]
    return [(width / 2 if k == 0 else half[k], half[k]) for k, width in enumerate(widths)]


def _simple(outline: Region, steps: list[tuple[float, float]], widths: tuple[float, ...]) -> list[tuple[Region, float]]:
    lines, depth = [], 0.0
    for (outer, inner), width in zip(steps, widths, strict=True):
        lines.append((offset(outline, -(depth + outer)), width))
        depth += outer + inner
    return lines


def _level(room: Region, outer: float, inner: float, thinnest: float) -> tuple[Region, Region, Region]:
    """Centre lines at `outer` inside the edge of the room, `inner` away from the next room; thin parts; next room."""
    core = offset(room, -(outer + inner))
    lines = offset(room, -outer)
    if _comes_back(room, offset(core, outer + inner), thinnest):
        return lines, Region(), core
    if not lines.is_empty():
        core = offset(room, -(outer + inner), round_corners=True)  # a mitre would take away what has room for a pair
        lines = intersection(offset(core, inner), lines)
    return lines, thin_parts(room, offset(lines, outer), thinnest), offset(lines, -inner)


def thin_parts(room: Region, covered: Region, thinnest: float) -> Region:
    """What of the room is not covered, without hairs narrower than `thinnest`."""
    left = difference(room, covered)
    if left.area() < thinnest**2:
        return Region()
    return opening(left, thinnest / 2).simplify(thinnest / 60)   # without edges too short to have a direction
