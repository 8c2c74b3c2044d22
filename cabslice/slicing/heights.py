"""Where the layers lie, and which values hold in each.

n_z  vertical part of a facet's unit normal    h  layer height, mm    c = h |n_z|  cusp: how far the step between two
layers stands off the surface, square to it (Dolenc & Maekelae 1994, Computer-Aided Design 26(2)). So h <= c / |n_z|;
level facets have no steps and ask for nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.profile.process import Process
from cabslice.profile.stand import Range
from cabslice.slicing.sections import Solid

BELOW = 1e-6     # mm: planes lie this far under the middle, so that not rounding decides where faces in them belong
LEVEL = 1e-9     # 1 - |n_z| of a facet that is level
CELLS = 8        # of the thinnest layer: how finely slopes are known
EXACT = 1e-9     # mm: rounding

Ceiling = Callable[[float], float]   # how high a layer may be that begins at z, mm


@dataclass(frozen=True)
class Heights:
    """top (L,) above the bed, height (L,), plane (L,) where the outline is cut: the middle of the beads; all mm."""

    top: Array
    height: Array
    plane: Array

    def __post_init__(self) -> None:
        shape = Shapes("Heights")
        set_columns(self, **{name: shape.column(name, getattr(self, name), "L") for name in ("top", "height", "plane")})


def heights_of(part: Solid, process: Process) -> Heights:
    """The layers of a part that stands on z = 0: alike, or by ranges and slopes where the process asks for that."""
    part_mm = float(part.vertices[:, 2].max())
    if not process.adaptive.cusp_mm and all(one.layer_mm is None for one in process.ranges):
        return layer_heights(part_mm, process.first_layer_mm, process.layer_mm)
    return _stacked(part_mm, process.first_layer_mm, _sections(part, part_mm, process))


def layer_heights(part_mm: float, first_mm: float, layer_mm: float) -> Heights:
    """Layers of a part (part_mm high): the first, then equal ones as long as their middle is still inside the part.

    So the print ends within half a layer of the part. A part lower than half the first layer gets that one layer,
    cut at half its own height.
    """
    more = max(0, int(np.ceil((part_mm - first_mm) / layer_mm - 0.5 - 1e-9)))
    top = first_mm + layer_mm * np.arange(more + 1)
    height = np.full(more + 1, float(layer_mm))
    height[0] = first_mm
    return _cut_at(part_mm, top, height)


def _cut_at(part_mm: float, top: Array, height: Array) -> Heights:
    plane = top - height / 2
    plane[0] = min(plane[0], part_mm / 2)
    plane -= min(BELOW, plane[0] / 2)
    return Heights(top, height, plane)


def process_at(process: Process, z_mm: float) -> Process:
    """The values that hold at a height over the part's bottom."""
    for one in process.ranges:
        if one.from_mm <= z_mm < one.to_mm:
            own = {name: getattr(one, name) for name in ("walls", "infill")}
            return process.model_copy(update={name: value for name, value in own.items() if value is not None})
    return process


@dataclass(frozen=True)
class _Section:
    """A stretch of heights whose layers end exactly at its end; inf for the last."""

    end: float
    ceiling: Ceiling


def _sections(part: Solid, part_mm: float, process: Process) -> list[_Section]:
    plain: Ceiling = lambda z: process.layer_mm  # noqa: E731
    free = _by_slope(part, part_mm, process) if process.adaptive.cusp_mm else plain
    own: list[Range] = sorted((one for one in process.ranges if one.layer_mm is not None), key=lambda one: one.from_mm)
    found: list[_Section] = []
    for one in own:
        found += [_Section(one.from_mm, free), _Section(one.to_mm, _always(one.layer_mm or process.layer_mm))]
    return [*found, _Section(np.inf, free)]


def _always(height: float) -> Ceiling:
    return lambda z: height


def _stacked(part_mm: float, first_mm: float, sections: list[_Section]) -> Heights:
    """Layer upon layer as long as their middle is inside the part; those of a section fit it.

    A section that ends less than half a layer from where it would begin is left out.
    """
    bounds = [0.0, first_mm]
    for section in sections:
        run, high = [bounds[-1]], section.ceiling(bounds[-1])
        if section.end - run[0] < high / 2:
            continue
        while run[-1] < section.end - EXACT and run[-1] + high / 2 < part_mm - EXACT:
            run.append(run[-1] + high)
            high = section.ceiling(run[-1])
        fit = (section.end - run[0]) / (run[-1] - run[0]) if run[-1] > section.end else 1.0
        bounds += [run[0] + fit * (z - run[0]) for z in run[1:]]
        if run[-1] < section.end - EXACT:
            break
    return _cut_at(part_mm, np.array(bounds[1:]), np.diff(bounds))


def _by_slope(part: Solid, part_mm: float, process: Process) -> Ceiling:
    """The highest layer from z on that has no cusp beyond what is asked for, between the thinnest and the thickest."""
    asked = process.adaptive
    least, most = asked.min_mm or process.layer_mm / 2, asked.max_mm or process.layer_mm
    cell = least / CELLS
    steep = _steepest(part, part_mm, cell)
    allowed = np.clip(asked.cusp_mm / np.maximum(steep, 1e-9), least, most)
    count = int(np.ceil(most / cell)) + 1

    def ceiling(z: float) -> float:
        begin = min(int(z / cell), len(allowed) - 1)
        near = np.minimum.accumulate(allowed[begin:begin + count])
        ends = cell * (begin + 1 + np.arange(len(near))) - z
        ends[-1] = np.inf if begin + count >= len(allowed) else ends[-1]
        return float(max(least, np.minimum(ends, near).max()))

    return ceiling


def _steepest(part: Solid, part_mm: float, cell: float) -> Array:
    """(C,) the largest |n_z| of the sloping facets in each cell of height.

    Facets are entered at powers of two of cells, twice, so that the two together are their extent; then handed down.
    """
    corner = part.vertices[part.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    long = np.linalg.norm(normal, axis=1)
    slope = np.abs(normal[:, 2]) / np.where(long > 0, long, 1.0)
    count = int(np.ceil(part_mm / cell)) + 1
    low, high = (np.clip(edge / cell, 0, count - 1).astype(np.int64) for edge in (
        corner[:, :, 2].min(1), corner[:, :, 2].max(1)))
    chosen = (slope < 1 - LEVEL) & (long > 0)
    low, high, slope = low[chosen], high[chosen], slope[chosen]
    power = np.log2(high - low + 1).astype(np.int64)
    found = np.zeros(count)
    for level in range(int(power.max(initial=0)), -1, -1):
        half = 1 << level
        if level < int(power.max(initial=0)):
            found[half:] = np.maximum(found[half:], found[:-half])
        mine = power == level
        np.maximum.at(found, low[mine], slope[mine])
        np.maximum.at(found, high[mine] - half + 1, slope[mine])
    return found

