"""What makes the first layer hold: loops around it, and layers under it.

Loops are given as regions whose edges are the centre lines of beads.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np

from cabslice.profile.process import Process
from cabslice.profile.stand import Brim
from cabslice.slicing.beads import BeadList, beside
from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.infill import fixed_lines
from cabslice.slicing.layer import Layer, Role
from cabslice.slicing.region import (
    Region,
    difference,
    edge_length,
    intersection,
    offset,
    ring_areas,
    to_polygons,
    to_rings,
    union,
)
from cabslice.slicing.sections import Solid, cut

LINK = 2.5       # distances of raft lines, along its edge, up to which they are linked
HOLD = 0.15      # bead widths by which raft lines reach into the loop around them


def skirt(
    outline: Region, loops: int, gap_mm: float, bead_mm: float, spacing_mm: float, least_mm: float = 0.0
) -> list[Region]:
    """Loops around what stands there, outermost first; the innermost bead's edge is gap_mm from the outline's hull.

    More than `loops` where that is not least_mm long in all.
    """
    if outline.is_empty() or not loops:
        return []
    hull, found, length = outline.hull(), [], 0.0
    for k in count():
        if k >= loops and length >= least_mm:
            break
        found.append(offset(hull, gap_mm + bead_mm / 2 + k * spacing_mm, round_corners=True))
        length += edge_length(found[-1])
    return found[::-1]


def hull_below(part: Solid, z_mm: float) -> Region:
    """The convex hull, seen from above, of what of a part is not higher than z_mm."""
    section = next(cut(part.vertices, part.faces, np.array([z_mm])))[0]
    return Region.hull_points(np.concatenate((part.vertices[part.vertices[:, 2] <= z_mm, :2], section)))


def brim(outline: Region, support: Region, asked: Brim, bead_mm: float, spacing_mm: float) -> list[Region]:
    """Loops along the edges of the first layer and its support, nearest first."""
    if not asked.width_mm or outline.is_empty():
        return []
    loops = max(1, round((asked.width_mm - bead_mm) / spacing_mm) + 1)
    steps = [asked.gap_mm + bead_mm / 2 + k * spacing_mm for k in range(loops)]
    found: list[Region] = []
    base = filled(union([outline, support]))
    if asked.where != "holes":
        found += [offset(base, step, round_corners=True) for step in steps]
    if asked.where != "outside":
        free = difference(filled(outline), outline, support)
        found += [offset(free, -step) for step in steps]
    return [loop for loop in found if not loop.is_empty()]


def filled(region: Region) -> Region:
    """Without its holes."""
    points, starts = to_rings(region)
    outer = np.flatnonzero(ring_areas(points, starts) > 0)
    return Region([points[starts[k]:starts[k + 1]] for k in outer]) if len(outer) else Region()


def raft_region(outline: Region, support: Region, margin_mm: float) -> Region:
    return filled(offset(union([outline, support]), margin_mm, round_corners=True))


def raft_layers(region: Region, process: Process) -> Iterator[Layer]:
    """The layers of a raft: sparse ones with a loop around them, then dense ones; each crosses the one below."""
    asked, z = process.raft, 0.0
    for index in range(asked.layers):
        height = process.layer_mm if index else process.first_layer_mm
        z += height
        width = process.bead_mm if index else process.first_bead_mm
        dense = index >= asked.layers - asked.interface_layers
        beads = BeadList()
        _add_raft(beads, region, width, height, asked.interface_density if dense else asked.density, index, dense)
        nothing = BeadList().beads(Region())
        yield Layer(index, z, height, to_polygons(region), beside(nothing, beads))


def raft_height(process: Process) -> float:
    """How far a raft lifts the part, mm."""
    asked = process.raft
    return process.first_layer_mm + (asked.layers - 1) * process.layer_mm + asked.gap_mm if asked.layers else 0.0


def _add_raft(
    beads: BeadList, region: Region, width: float, height: float, density: float, index: int, dense: bool
) -> None:
    role = Role.SUPPORT_INTERFACE if dense else Role.SUPPORT
    spacing = float(bead_spacing(width, height))
    beads.add_rings(offset(region, -width / 2), width, role)
    room = offset(region, HOLD * width - spacing - width / 2)
    pitch = spacing / density
    lines = fixed_lines(intersection(room, region), pitch, index % 2 * np.pi / 2, LINK * pitch)
    beads.add(lines.points, lines.starts, width, role)
