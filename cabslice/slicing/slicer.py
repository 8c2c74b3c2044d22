"""A part becomes layers of beads, one layer at a time.

The way of a layer: outline (sections) -> walls from outside in (walls) -> the inside divided into skins, bridges, solid
and sparse parts (surfaces) -> lines that fill them (fill) -> one bead each for strips too thin for two (thin).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, groupby, islice

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError
from cabslice.profile.process import Process
from cabslice.slicing.adhesion import hull_below
from cabslice.slicing.beads import BeadList
from cabslice.slicing.bridges import bridge_angle
from cabslice.slicing.compensate import compensated
from cabslice.slicing.fill import Filling, fill_solid, iron, sparse_pitch, together
from cabslice.slicing.flow import bead_width
from cabslice.slicing.heights import Heights, heights_of, process_at
from cabslice.slicing.layer import Layer, Role
from cabslice.slicing.lightning import Lines, plan_lightning
from cabslice.slicing.parallel import in_order
from cabslice.slicing.region import Region, from_rings, pieces, to_polygons
from cabslice.slicing.sections import NO_MODIFIERS, Modifiers, Solid, cut
from cabslice.slicing.sparse import SparseLayer, lay_sparse, lay_trees
from cabslice.slicing.spiral import floors, spiral_wall, vase
from cabslice.slicing.stand import with_stand
from cabslice.slicing.support import plan_support
from cabslice.slicing.surfaces import Neighbours, Window, divide, neighbours
from cabslice.slicing.thin import Strips, segment_widths, strip_area, thin_lines
from cabslice.slicing.walls import Inside, walls

THINNEST = 0.3   # of the nozzle: narrower strips are left out
NARROWEST = 0.25 # of the nozzle: where strips end in a point, their beads end here
WIDEST = 2.2     # of the bead: wider strips take two beads
STEP = 0.35      # of the nozzle: distance of samples along the edge of thin strips
REACH = 0.5      # of a bead's radius: how far its free ends run on, between beads
REACH_OUTER = 0.25   # and at the part's surface
THIN_CORRECTION = 0.15   # share by which the volume of beads in strips may be corrected

COARSE = 0.05        # of the bead: detail of neighbouring layers that does not make a skin
TOGETHER = 16         # layers whose strips are filled in one go
RUN = 48             # layers that one process makes in one go

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Cutting:
    """What any run of layers is made from."""

    part: Solid
    process: Process
    nozzle_mm: float
    heights: Heights
    lateral: tuple[float, float]   # what sparse_pitch wants to know of the part
    low: Array                     # (F,) mm, of each face
    high: Array
    trees: Sequence[Lines] = ()    # of each layer, where infill is lightning


def slice_part(
    part: Solid, process: Process, *, nozzle_mm: float, progress: Progress | None = None, jobs: int = 1,
    modifiers: Modifiers = NO_MODIFIERS,
) -> Iterator[Layer]:
    """Layers of the part from the bed up, with what stands beside it.

    They are made a run at a time by up to `jobs` processes, which begin at once. The part stands on z = 0
    (mesh.place), and so do the modifiers of its support. progress(done, all) is called after each layer. Layers without
    beads (a gap between bodies) come too. The runs, and so the layers, are the same for any `jobs`. Raises ModelError
    at the end if no layer has a bead of the part.
    """
    process = vase(process) if process.spiral else process
    heights = heights_of(part, process)
    layers = _part_layers(part, heights, process, nozzle_mm, progress, jobs)
    asked = process.support
    support = plan_support(part, heights, asked, process.bead_mm, modifiers) if asked.kind != "none" else []
    tall = process.skirt_loops and process.skirt_layers > 1
    around = hull_below(part, float(heights.top[:process.skirt_layers][-1])) if tall else None
    return with_stand(layers, process, support, around)


def _part_layers(
    part: Solid, heights: Heights, process: Process, nozzle_mm: float, progress: Progress | None, jobs: int
) -> Iterator[Layer]:
    """Layers of the part alone."""
    lateral = _lateral_share(part.vertices, part.faces)
    z = part.vertices[:, 2][part.faces]
    trees = plan_lightning(part, heights, process) if process.pattern == "lightning" and process.infill > 0 else ()
    cutting = Cutting(part, process, nozzle_mm, heights, lateral, z.min(1), z.max(1), trees)
    made = in_order(partial(_run, cutting), _runs(heights, process), jobs)
    return _watched(chain.from_iterable(made), part.name, nozzle_mm, len(heights.top), progress)


def _watched(
    layers: Iterable[Layer], name: str, nozzle_mm: float, count: int, progress: Progress | None
) -> Iterator[Layer]:
    laid = False
    for layer in layers:
        laid = laid or bool((layer.beads.island >= 0).any())
        yield layer
        if progress is not None:
            progress(layer.index + 1, count)
    if not laid:
        raise ModelError(
            f"{name}: nothing to print: everywhere narrower than {THINNEST * nozzle_mm:.2g} mm, "
            f"{THINNEST:g} of the {nozzle_mm:g} mm nozzle. Is the unit right? See --unit and --scale.", file=name,
        )


def _runs(heights: Heights, process: Process) -> list[tuple[int, int]]:
    """First layer and end of each run: long beside what a run must know of the layers around it."""
    count = len(heights.top)
    size = max(RUN, 4 * (process.top_layers + process.bottom_layers))
    return [(first, min(first + size, count)) for first in range(0, count, size)]


def _run(cutting: Cutting, first: int, end: int) -> list[Layer]:
    """Layers first..end."""
    part, process, heights = cutting.part, cutting.process, cutting.heights
    around = slice(max(0, first - 1 - process.bottom_layers), end + process.top_layers)
    planes = heights.plane[around]
    faces = part.faces[(cutting.low <= planes[-1]) & (cutting.high >= planes[0])]
    outlines = (
        compensated(from_rings(points, starts, simplify_mm=process.resolution_mm), process.compensation,
                    process.bead_mm, first=not k)
        for k, (points, starts) in enumerate(cut(part.vertices, faces, planes), start=around.start)
    )
    known = Window(first, end, len(heights.top), process.bottom_layers, process.top_layers)
    near = neighbours(outlines, known, COARSE * process.bead_mm)
    layers: list[Layer] = []
    each_time = together(process) * max(1, TOGETHER // together(process))
    while some := [_layer(each, heights, process_at(process, float(heights.plane[each.index])), cutting.nozzle_mm)
                   for each in islice(near, each_time)]:
        _lay_sparse(some, cutting)
        _lay_strips(some, cutting.nozzle_mm)
        layers += [
            Layer(raw.index, float(heights.top[raw.index]), raw.filling.height_mm, to_polygons(raw.outline),
                  raw.beads.beads(raw.outline))
            for raw in some
        ]
    return layers


def _lateral_share(vertices: Array, faces: Array) -> tuple[float, float]:
    """Mean over the height of the outline's length (mm) and area (mm^2), from the mesh alone."""
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    height = float(np.ptp(vertices[:, 2]))
    volume = float((normal[:, 2] * corner[:, :, 2].mean(1)).sum())
    return float(np.hypot(normal[:, 0], normal[:, 1]).sum()) / height, volume / height


@dataclass(frozen=True)
class _Strip:
    """A region too thin for two beads; `outer`: its edge is the part's outline, not another bead."""

    region: Region
    role: Role
    outer: bool


@dataclass(frozen=True)
class _RawLayer:
    """A layer before its thin strips are filled."""

    index: int
    outline: Region
    filling: Filling
    widest_mm: float
    beads: BeadList
    strips: list[_Strip]
    sparse: Region = field(default_factory=Region)


def _layer(near: Neighbours, heights: Heights, process: Process, nozzle: float) -> _RawLayer:
    first = near.index == 0
    height = float(heights.height[near.index])
    inner = process.first_bead_mm if first else process.bead_mm
    outer = process.first_bead_mm if first else process.outer_bead_mm
    filling = Filling(inner, height, process.infill_overlap * inner, THINNEST * nozzle)
    beads = BeadList()
    if process.spiral and near.index >= floors(process):
        beads.add_rings(spiral_wall(near.outline, outer, float(heights.top[near.index])), outer, Role.OUTER_WALL)
        return _RawLayer(near.index, near.outline, filling, outer, beads, [])
    widths = tuple(outer if k == 0 else inner for k in range(process.walls))
    levels, inside = walls(near.outline, widths, height, filling.thinnest_mm, filling.spacing_mm)
    strips: list[_Strip] = []
    for k, level in enumerate(levels):
        beads.add_rings(level.lines, level.width_mm, Role.INNER_WALL if k else Role.OUTER_WALL)
        strips.append(_Strip(level.thin, Role.GAP_FILL if k else Role.OUTER_WALL, k == 0))
    more, sparse = _fill(beads, inside, near, process, filling)
    strips = [strip for strip in strips + more if not strip.region.is_empty()]
    return _RawLayer(near.index, near.outline, filling, WIDEST * max(inner, outer), beads, strips, sparse)


def _fill(
    beads: BeadList, inside: Inside, near: Neighbours, process: Process, filling: Filling
) -> tuple[list[_Strip], Region]:
    """Fills what the walls leave; returns the strips in it that are too thin for lines, and what is to be sparse."""
    skin = process.infill_angle_deg if process.skin_angle_deg is None else process.skin_angle_deg
    turned = np.radians(skin + 90 * (near.index % 2))
    strips = [inside.thin] if process.walls or process.infill else []
    parts = divide(inside.wide, near, filling.width_mm, sparse=process.infill > 0, solid=process.infill >= 1,
                   bridges=process.bridge_over_infill,
                   least_mm2=process.min_infill_area_mm2 if process.infill > 0 else 0.0)
    for bridge in pieces(parts.bridge) if near.below is not None else ():
        over = bridge_angle(bridge, near.below, filling.width_mm, turned)
        strips.append(fill_solid(beads, bridge, filling, over, Role.BRIDGE))
    strips.append(fill_solid(beads, parts.top, filling, turned, Role.TOP_SKIN))
    if process.ironing.enabled:
        iron(beads, parts.top, filling, process.ironing.spacing_mm, process.ironing.flow, turned + np.pi / 2)
    strips.append(fill_solid(beads, parts.solid, filling, turned, Role.SOLID_INFILL))
    strips.append(fill_solid(beads, parts.over_sparse, filling, _across_sparse(process, near.index), Role.BRIDGE))
    return [_Strip(strip, Role.GAP_FILL, False) for strip in strips], parts.sparse if process.infill > 0 else Region()


def _across_sparse(process: Process, index: int) -> float:
    """Direction (rad) across the sparse lines of the layer below; across one family of patterns that have several."""
    turned = {"aligned": 0, "rectilinear": (index - 1) // together(process) % 2}.get(process.pattern, index % 2)
    return float(np.radians(process.infill_angle_deg + 90 * (1 - turned)))


def _lay_sparse(layers: list[_RawLayer], cutting: Cutting) -> None:
    """The sparse infill of some layers; of those of a range with the values of the range."""
    heights, process = cutting.heights, cutting.process
    for own, run in groupby(layers, lambda raw: process_at(process, float(heights.plane[raw.index]))):
        some = [SparseLayer(raw.index, float(heights.top[raw.index]), raw.sparse, raw.filling, raw.beads)
                for raw in run]
        if own.pattern != "lightning":
            lay_sparse(some, own, sparse_pitch(own, *cutting.lateral))
        elif cutting.trees:
            lay_trees(some, cutting.trees)


def _lay_strips(layers: list[_RawLayer], nozzle: float) -> None:
    """One bead along each strip of some layers, looked at together because that is faster."""
    both = [(layer, strip) for layer in layers for strip in layer.strips]
    lines = thin_lines(
        [_search(layer.filling, strip) for layer, strip in both], narrowest_mm=NARROWEST * nozzle,
        widest_mm=max(layer.widest_mm for layer in layers), step_mm=STEP * nozzle,
    )
    for k, (layer, strip) in enumerate(both):
        points, starts, diameter, closed = lines.of_group(k)
        if len(points):
            width = _strip_widths(strip, points, starts, diameter, closed, layer.filling.height_mm)
            layer.beads.add(points, starts, width, strip.role, closed)


def _search(filling: Filling, strip: _Strip) -> Strips:
    if strip.outer:
        return Strips(strip.region, REACH_OUTER, filling.thinnest_mm**2)
    return Strips(strip.region, REACH, (filling.width_mm / 2) ** 2)


def _strip_widths(strip: _Strip, points: Array, starts: Array, diameter: Array, closed: Array, height: float) -> Array:
    """(M,) mm. Between beads a bead holds the strip's volume; on the outline it has the strip's width."""
    width = segment_widths(diameter, starts, closed)
    if strip.outer:
        return width
    held = strip_area(points, starts, diameter, closed)
    return bead_width(width * np.clip(strip.region.area() / held, 1 - THIN_CORRECTION, 1 + THIN_CORRECTION), height)
