"""Outlines made a little smaller or larger, so that the print has the size of the part.

Outlines and holes apart: plastic that shrinks and beads that are pressed wide make holes too small, outlines too large.
The first layer is squeezed wider than the others (an elephant's foot): its outline is drawn in, holes grow.
"""

from __future__ import annotations

from itertools import pairwise

from cabslice.profile.process import Compensation
from cabslice.slicing.region import Region, difference, offset, opening, pieces, ring_areas, to_rings, union


def compensated(outline: Region, asked: Compensation, bead_mm: float, *, first: bool) -> Region:
    """The outline as it is to be printed; `first`: it lies on the bed."""
    if asked.outlines_mm or asked.holes_mm:
        outline = union([_resized(piece, asked.outlines_mm, asked.holes_mm) for piece in pieces(outline)])
    if first and asked.first_layer_mm:
        outline = _drawn_in(outline, asked.first_layer_mm, bead_mm)
    return outline


def _resized(piece: Region, outlines: float, holes: float) -> Region:
    """A connected part whose outline moves outwards and whose holes grow, mm; both may be negative."""
    points, starts = to_rings(piece)
    areas = ring_areas(points, starts)
    loops = [points[a:b] for a, b in pairwise(starts)]
    outside = union([Region([loop]) for loop, area in zip(loops, areas, strict=True) if area > 0])
    inside = union([Region([loop[::-1]]) for loop, area in zip(loops, areas, strict=True) if area < 0])
    return difference(offset(outside, outlines), offset(inside, holes))


def _drawn_in(outline: Region, distance: float, bead: float) -> Region:
    """Smaller by a distance (mm), but for what would be narrower than a bead then: it stays."""
    thin = difference(outline, opening(outline, distance + bead / 2))
    return union([offset(outline, -distance), thin])
