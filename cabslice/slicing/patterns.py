"""Sparse infill by pattern: which lines run where, before their beads are given their volume (slicing.fill).

pitch    mm^2 of region for each mm of line of one family      a, b   direction of the first lines, and across, rad
cubic    walls of cubes that stand on a corner: at height z the three families of lines, 60 deg apart, lie z / 2^1/2
         from where they are on the bed (the wall's normal makes atan 2^1/2 with z)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.curves import gyroid, honeycomb, wave_lines
from cabslice.slicing.infill import Lines, fixed_lines, no_lines
from cabslice.slicing.region import Region, offset, to_rings

FAMILIES = {"grid": 2, "triangles": 3, "cubic": 3}   # lines that cross in one layer; others have one family
UNLINKED = ("concentric", "lightning")                          # lines that are not linked along the edge
LINK = 2.5            # pitches along the edge up to which neighbouring lines are linked


@dataclass(frozen=True)
class Sparse:
    """What is the same for all sparse infill of a layer: direction (rad), pitch and bead width (mm), its number, z."""

    pattern: str
    angle: float
    pitch_mm: float
    bead_mm: float
    index: int
    z_mm: float


def sparse_lines(region: Region, sparse: Sparse) -> list[Lines]:
    """One Lines for each family of the pattern, none of them outside the region."""
    pitch, angle = sparse.pitch_mm, sparse.angle
    link, across = LINK * pitch, angle + np.pi / 2
    if sparse.pattern == "concentric":
        return [rings(region, pitch)]
    if sparse.pattern == "honeycomb":
        return [wave_lines(region, honeycomb(pitch, sparse.bead_mm), angle, link)]
    if sparse.pattern == "gyroid":
        return [wave_lines(region, gyroid(pitch, sparse.z_mm), angle, link)]
    if sparse.pattern in ("triangles", "cubic"):
        shift = sparse.z_mm / np.sqrt(2) if sparse.pattern == "cubic" else 0.0
        return [fixed_lines(region, pitch, angle + k * 2 * np.pi / 3, link, shift) for k in range(3)]
    turned = across if sparse.index % 2 else angle
    angles = {"grid": (angle, across), "aligned": (angle,)}.get(sparse.pattern, (turned,))
    return [fixed_lines(region, pitch, each, link) for each in angles]


def layer_share(sparse: Sparse) -> float:
    """What a layer holds of the pattern's mean over all heights: a gyroid's lines are longer near its saddles."""
    if sparse.pattern == "gyroid":
        return gyroid(sparse.pitch_mm, sparse.z_mm).length_per_mm2 * sparse.pitch_mm
    return 1.0


def rings(region: Region, pitch: float) -> Lines:
    """Closed lines along the edge, the first half a pitch (mm) inside, each further one a pitch."""
    points: list[Array] = []
    sizes: list[Array] = []
    while not (region := offset(region, -pitch if points else -pitch / 2)).is_empty():
        ring, starts = to_rings(region)
        points.append(ring)
        sizes.append(np.diff(starts))
    if not points:
        return no_lines()
    starts = np.concatenate(([0], np.cumsum(np.concatenate(sizes))))
    return Lines(np.concatenate(points), starts, np.full(len(starts) - 1, pitch), closed=True)
