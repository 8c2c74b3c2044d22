"""What stands beside and under the part, put into its layers as they come: skirt, support.

Layers in which nothing stands are handed on as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cabslice.profile.process import Process
from cabslice.profile.stand import Support
from cabslice.slicing.adhesion import skirt
from cabslice.slicing.beads import BeadList, beside
from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.infill import fixed_lines
from cabslice.slicing.layer import Layer, Polygons, Role
from cabslice.slicing.region import Region, difference, from_rings, offset, union
from cabslice.slicing.support import Standing

LINK = 1.5       # distances of support lines, along the edge of support, up to which they are linked
HOLD = 0.15      # bead widths by which support lines reach into the loop around them


def with_stand(layers: Iterator[Layer], process: Process, support: Sequence[Standing]) -> Iterator[Layer]:
    """The same layers with skirt and support; `support` has one region per layer, or none at all."""
    for layer in layers:
        width = process.bead_mm if layer.index else process.first_bead_mm
        beads = BeadList()
        if not layer.index:
            _add_skirt(beads, union([region_of(layer.outline), *(one.region for one in support[:1])]), process, layer)
        if support and not support[layer.index].region.is_empty():
            add_support(beads, support[layer.index], process.support, width, layer.height_mm)
        yield replace(layer, beads=beside(layer.beads, beads)) if beads else layer


def region_of(outline: Polygons) -> Region:
    return from_rings(outline.points, outline.starts)


def _add_skirt(beads: BeadList, outline: Region, process: Process, layer: Layer) -> None:
    width = process.first_bead_mm
    spacing = float(bead_spacing(width, layer.height_mm))
    for loop in skirt(outline, process.skirt_loops, process.skirt_gap_mm, width, spacing):
        beads.add_rings(loop, width, Role.SKIRT)


def add_support(beads: BeadList, standing: Standing, asked: Support, width: float, height: float) -> None:
    """The beads of one layer's support: loops and lines of its body, lines of its interface. All lie inside it."""
    spacing = float(bead_spacing(width, height))
    along = np.radians(asked.line_angle_deg)
    across = along + np.pi / 2
    _lines(beads, standing.interface, spacing / asked.interface_density, (across,), width, Role.SUPPORT_INTERFACE)
    body = difference(standing.region, standing.interface)
    for loop in range(asked.walls):
        beads.add_rings(offset(body, -width / 2 - loop * spacing), width, Role.SUPPORT)
    inside = offset(body, HOLD * width - asked.walls * spacing) if asked.walls else body
    angles = (along, across) if asked.pattern == "grid" else (along,)
    _lines(beads, inside, spacing / asked.density * len(angles), angles, width, Role.SUPPORT)


def _lines(
    beads: BeadList, region: Region, pitch: float, angles: tuple[float, ...], width: float, role: Role
) -> None:
    room = offset(region, -width / 2)
    for angle in angles:
        lines = fixed_lines(room, pitch, angle, LINK * pitch)
        beads.add(lines.points, lines.starts, width, role)

