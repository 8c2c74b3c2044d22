"""What stands beside and under the part, put into its layers as they come: skirt, brim, raft, support.

Layers in which nothing stands are handed on as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cabslice.profile.process import Process
from cabslice.profile.stand import Support
from cabslice.slicing.adhesion import brim, raft_height, raft_layers, raft_region, skirt
from cabslice.slicing.beads import BeadList, beside
from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.infill import even_lines, fixed_lines
from cabslice.slicing.layer import Layer, Polygons, Role
from cabslice.slicing.region import Region, difference, from_rings, offset, union
from cabslice.slicing.standing import Standing

LINK = 1.5       # distances of support lines, along the edge of support, up to which they are linked
HOLD = 0.15      # bead widths by which support lines reach into the loop around them
EVEN = 0.05      # bead widths from the edge of their room to the first and last line of an interface


def with_stand(
    layers: Iterator[Layer], process: Process, support: Sequence[Standing], around: Region | None = None
) -> Iterator[Layer]:
    """The same layers with skirt, brim and support, over the layers of a raft.

    `support` has one region per layer, or none at all; `around` is what the skirt goes around in more than one layer.
    """
    lift = raft_height(process)
    for layer in layers:
        if not layer.index:
            below, loops = _first(layer, process, support[0].region if support else Region(), around)
            yield from below
        beads = BeadList()
        if not process.raft.layers:
            _add_loops(beads, layer, process, loops)
        if support and not support[layer.index].region.is_empty():
            width = process.bead_mm if layer.index else process.first_bead_mm
            add_support(beads, support[layer.index], process.support, width, layer.height_mm)
        made = replace(layer, beads=beside(layer.beads, beads)) if beads else layer
        yield replace(made, index=made.index + process.raft.layers, z_mm=made.z_mm + lift) if lift else made


@dataclass(frozen=True)
class _Loops:
    """Around the first layer, and around some more."""

    brim: list[Region]
    skirt: list[Region]


def _first(layer: Layer, process: Process, support: Region, around: Region | None) -> tuple[list[Layer], _Loops]:
    """The layers of the raft, if there is one, and the loops around the first layer on the bed."""
    width, outline = process.first_bead_mm, region_of(layer.outline)
    spacing = float(bead_spacing(width, layer.height_mm))
    raft = raft_region(outline, support, process.raft.margin_mm) if process.raft.layers else Region()
    rings = brim(outline, support, process.brim, width, spacing)
    edge = [offset(ring, width / 2) for ring in rings]
    ground = union([outline, support, raft, *edge, *([around] if around else [])])
    loops = _Loops(rings, skirt(
        ground, process.skirt_loops, process.skirt_gap_mm, width, spacing, process.skirt_min_mm,
    ))
    below = []
    for one in raft_layers(raft, process):
        beads = BeadList()
        _add_loops(beads, one, process, loops)
        below.append(replace(one, beads=beside(one.beads, beads)))
    return below, loops


def _add_loops(beads: BeadList, layer: Layer, process: Process, loops: _Loops) -> None:
    """The skirt of a layer as high as the skirt, and the brim of the first."""
    width = process.bead_mm if layer.index else process.first_bead_mm
    if layer.index < process.skirt_layers:
        for loop in loops.skirt[-process.skirt_loops:] if layer.index else loops.skirt:
            beads.add_rings(loop, width, Role.SKIRT)
    for ring in loops.brim if not layer.index else ():
        beads.add_rings(ring, width, Role.SKIRT)


def region_of(outline: Polygons) -> Region:
    return from_rings(outline.points, outline.starts)


def add_support(beads: BeadList, standing: Standing, asked: Support, width: float, height: float) -> None:
    """The beads of one layer's support: loops and lines of its body and of its interface. All lie inside it."""
    spacing = float(bead_spacing(width, height))
    along = np.radians(asked.line_angle_deg)
    across = along + np.pi / 2
    angles = (along, across) if asked.pattern == "grid" else (along,)
    body = difference(standing.region, standing.interface)
    _filled(beads, standing.interface, min(asked.walls, 1), spacing, asked.interface_density, (across,), width,
            Role.SUPPORT_INTERFACE)
    _filled(beads, body, asked.walls, spacing, asked.density, angles, width, Role.SUPPORT)


def _filled(
    beads: BeadList, region: Region, loops: int, spacing: float, density: float, angles: tuple[float, ...],
    width: float, role: Role,
) -> None:
    for loop in range(loops):
        beads.add_rings(offset(region, -width / 2 - loop * spacing), width, role)
    inside = offset(region, HOLD * width - loops * spacing) if loops else region
    room, pitch = offset(inside, -width / 2), spacing / density * len(angles)
    for angle in angles:
        lines = (
            even_lines(room, pitch, angle, EVEN * width, LINK * pitch) if role == Role.SUPPORT_INTERFACE
            else fixed_lines(room, pitch, angle, LINK * pitch)
        )
        beads.add(lines.points, lines.starts, width, role)
