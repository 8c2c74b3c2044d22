"""Filling the inside of a layer: solid and sparse lines, each laid in the volume its region asks for.

A region of area A is filled by lines of total length l: their spacing is then A / l (times the density), and the bead's
width follows from it (slicing.flow). Solid lines hold a little more, to bond with the walls (BOND). Rows are laid at
an even spacing near the nominal one, so the correction is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.profile.process import Process
from cabslice.slicing.beads import BeadList
from cabslice.slicing.flow import bead_spacing, bead_width
from cabslice.slicing.infill import Lines, even_lines
from cabslice.slicing.layer import Role
from cabslice.slicing.patterns import FAMILIES, UNLINKED, Sparse, layer_share, sparse_lines
from cabslice.slicing.region import Region, edge_length, offset, opening
from cabslice.slicing.walls import thin_parts

CORRECTION = 0.15   # share by which the volume of solid lines may be corrected
CORRECTION_SPARSE = 0.25
WIDER = 1.25        # sparse lines may lie this much further apart, to make up for the links along the edge
BOND = 0.25         # share of the overlap with walls that is laid as volume of its own, to press the lines against them
LINK_SOLID = 8.0    # spacings along the edge up to which neighbouring lines are linked


@dataclass(frozen=True)
class Filling:
    """What is the same for all regions of a layer, mm; overlap is how far lines reach into the walls."""

    width_mm: float
    height_mm: float
    overlap_mm: float
    thinnest_mm: float
    several: bool = False    # the beads fill several layers

    @property
    def spacing_mm(self) -> float:
        return float(bead_spacing(self.width_mm, self.height_mm))


def fill_solid(beads: BeadList, region: Region, filling: Filling, angle: float, role: Role) -> Region:
    """Adds lines side by side; returns the strips too narrow for two of them, still to be filled."""
    if region.is_empty():
        return region
    s = filling.spacing_mm
    wide = opening(region, s)
    thin = thin_parts(region, wide, filling.thinnest_mm)
    if wide.is_empty():
        return thin
    lines = even_lines(offset(wide, filling.overlap_mm - s / 2), s, angle, filling.overlap_mm, LINK_SOLID * s)
    _lay(beads, [lines], wide.area() + BOND * filling.overlap_mm * edge_length(wide), filling, role)
    return thin


def iron(beads: BeadList, region: Region, filling: Filling, spacing: float, flow: float, angle: float) -> None:
    """Adds close lines (spacing, mm) over a top skin, that together hold the share `flow` of a layer; half a bead off
    its edge, so that nothing is pressed over it."""
    lines = even_lines(offset(region, -filling.width_mm / 2), spacing, angle, 0.0, LINK_SOLID * filling.spacing_mm)
    width = float(bead_width(spacing * flow, filling.height_mm))
    beads.add(lines.points, lines.starts, width, Role.IRONING)


def together(process: Process) -> int:
    """Layers whose sparse infill is laid as one: as many as asked, but not higher than the nozzle is wide."""
    thickest = max([process.layer_mm, *(one.layer_mm or 0.0 for one in process.ranges)])
    if process.adaptive.cusp_mm:
        thickest = max(thickest, process.adaptive.max_mm or 0.0)
    return max(1, min(process.infill_every, int(process.nozzle_mm / thickest + 1e-6)))


def sparse_pitch(process: Process, length: float, area: float) -> float:
    """Distance of sparse lines (mm), one for the whole part so that they stack, for a mean outline of length and area.

    Half of the inside's edge will be linked at each angle; lines lie further apart to make up for it, within WIDER.
    """
    spacing = float(bead_spacing(process.bead_mm, process.layer_mm * together(process)))
    density = process.infill / FAMILIES.get(process.pattern, 1)
    if density <= 0:
        return spacing
    if process.pattern in UNLINKED:
        return spacing / density
    inside = max(area - length * process.walls * spacing, 0.1 * area)
    per_mm = max(density / spacing - length / (2 * inside), density / spacing / WIDER)
    return 1 / per_mm


def fill_sparse(beads: BeadList, region: Region, filling: Filling, sparse: Sparse, density: float) -> None:
    """Adds the lines of a pattern, holding together `density` of the region's volume (in the mean over layers).

    The region is as high as the filling.
    """
    if region.is_empty():
        return
    families = sparse_lines(offset(region, filling.overlap_mm - filling.spacing_mm / 2), sparse)
    _lay(beads, families, density * layer_share(sparse) * region.area(), filling, Role.SPARSE_INFILL)


def _lay(beads: BeadList, families: list[Lines], area: float, filling: Filling, role: Role) -> None:
    """Bead widths so that the lines hold area * height, within CORRECTION of what their spacing asks for."""
    sparse = role == Role.SPARSE_INFILL
    most = CORRECTION_SPARSE if sparse else CORRECTION
    spacings = [np.full(len(lines.spacing), filling.spacing_mm) if sparse else lines.spacing for lines in families]
    held = sum(float((lines.lengths * spacing).sum()) for lines, spacing in zip(families, spacings, strict=True))
    share = np.clip(area / held, 1 - most, 1 + most) if held > 0 else 1.0
    for lines, spacing in zip(families, spacings, strict=True):
        width = bead_width(spacing * share, filling.height_mm)
        widths = np.repeat(width, np.diff(lines.starts))
        beads.add(lines.points, lines.starts, widths, role, lines.closed, filling.height_mm if filling.several else 0.0)
