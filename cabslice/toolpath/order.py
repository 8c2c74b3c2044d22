"""Layers in, toolpath out: every bead laid once, in an order that travels little.

A travel shorter than the process' min_travel_mm inside one island (or up to the next layer) goes straight and the
nozzle does not stop; any other draws the filament back, lifts, travels, lowers and primes: the two filament moves at
rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError
from cabslice.profile.material import Material
from cabslice.profile.process import Process
from cabslice.slicing.layer import Layer, Role
from cabslice.toolpath.events import events_of
from cabslice.toolpath.path import RESTS, Events, Toolpath, bead_area, piece_starts
from cabslice.toolpath.sequence import Drawn, draw_layer

SPEED_OF = {
    Role.OUTER_WALL: "outer_wall", Role.INNER_WALL: "inner_wall", Role.SOLID_INFILL: "solid_infill",
    Role.TOP_SKIN: "top_skin", Role.SPARSE_INFILL: "sparse_infill", Role.BRIDGE: "bridge", Role.GAP_FILL: "gap_fill",
    Role.SKIRT: "skirt", Role.SUPPORT: "support", Role.SUPPORT_INTERFACE: "support_interface",
    Role.IRONING: "top_skin", Role.OVERHANG_WALL: "bridge", Role.CUSTOM: "outer_wall", Role.TRAVEL: "travel",
}
INSTEAD = {"support": "sparse_infill", "support_interface": "solid_infill"}   # where the process does not say
SAME_PLACE = 1e-3  # mm: lines that meet so closely are laid without a travel between; less than lines.TINY
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer")


@dataclass
class _Nozzle:
    """Where it stands between two layers."""

    xyz: Array | None = None
    layer: int = 0
    seams: Array = field(default_factory=lambda: np.empty((0, 2)))


def lay_toolpath(
    layers: Iterable[Layer], process: Process, material: Material, *, filament_diameter_mm: float, source: str = ""
) -> Toolpath:
    """The order in which the beads of all layers are laid, with travels, filament, asked speeds and events.

    Layers come from the bed upwards and are taken one at a time. Speeds are those the process asks for (in the first
    layer at most its first_layer); melt flow and machine lower them later. Raises ModelError where no layer holds a
    bead.
    """
    nozzle, area = _Nozzle(), np.pi / 4 * filament_diameter_mm**2
    blocks: list[dict[str, Array]] = []
    rests: dict[int, int] = {}
    rows = 0
    for layer in layers:
        if len(layer.beads.role):
            drawn, nozzle.seams = _draw(layer, nozzle, process)
            if len(drawn.role):
                blocks.append(_moves(drawn, layer, nozzle, process, area, first=not blocks))
                rests[layer.index] = rows + _rest(blocks[-1], first=not rows)
                rows += len(blocks[-1]["role"])
    if not blocks:
        raise ModelError(
            f"{source or 'the part'}: no layer holds a bead; expected a part at least one bead wide and one layer high"
        )
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in COLUMNS}
    events = events_of(columns["layer"], columns["role"], material, process, rests)
    return Toolpath(
        **columns, object=np.zeros(rows, np.int32), starts=_pieces(columns["xyz"], events), events=events,
        filament_diameter_mm=filament_diameter_mm, source=source,
    )


def _pieces(xyz: Array, events: Events) -> Array:
    still = np.append(False, (np.diff(xyz, axis=0) == 0).all(1))
    rests = events.index[np.isin(events.kind, RESTS)]
    return np.union1d(piece_starts(still), rests[rests > 0])


def _rest(rows: dict[str, Array], *, first: bool) -> int:
    """The row of a layer before which the nozzle may stand and wait: drawn back and lifted, where it is."""
    if first:
        return 1
    lead = int(np.argmax(rows["role"] != Role.TRAVEL))
    rise = rows["xyz"][:lead, 2]
    return 0 if rows["filament"][0] >= 0 else min(lead - 1, 2 if len(rise) > 2 and (rise[1] > rise[2:]).any() else 1)


def _draw(layer: Layer, nozzle: _Nozzle, process: Process) -> tuple[Drawn, Array]:
    position = np.zeros(2) if nozzle.xyz is None else nozzle.xyz[:2]
    drawn, seams = draw_layer(
        layer.beads, position, nozzle.seams, bead_mm=process.bead_mm, tolerance_mm=process.resolution_mm,
        seam=process.seam, outer_first=process.outer_wall_first, layer=layer.index,
    )
    return drawn, seams if len(seams) else nozzle.seams


def _speeds(process: Process, first: bool) -> Array:
    """(roles,) mm/s asked for each role."""
    table = process.speeds_mm_s
    names = [SPEED_OF[role] for role in Role]
    speed = np.array([getattr(table, name) or getattr(table, INSTEAD.get(name, name)) for name in names])
    if first:
        speed[1:] = np.minimum(speed[1:], table.first_layer)
    return speed


def _moves(
    drawn: Drawn, layer: Layer, nozzle: _Nozzle, process: Process, area: float, *, first: bool
) -> dict[str, Array]:
    """The rows of one layer; moves `nozzle` to their end."""
    heads, tails = drawn.points[drawn.starts[:-1]], drawn.points[drawn.starts[1:] - 1]
    z, z_before = layer.z_mm, layer.z_mm if nozzle.xyz is None else nozzle.xyz[2]
    before = np.vstack((heads[:1] if nozzle.xyz is None else nozzle.xyz[None, :2], tails[:-1]))
    stops = layer.index in (*process.pause_layers, *process.filament_change_layers)
    retracted, direct = _travels(drawn, heads, before, z != z_before, process, stops=stops and not first)
    hop = process.retraction.hop_mm if process.retraction.hop_mm > SAME_PLACE else 0.0
    lead = np.where(retracted, 5 if hop else 3, direct)
    lead[0] += first
    size = lead + np.diff(drawn.starts) - 1
    offset = np.cumsum(size) - size
    rows = _blank(int(size.sum()), layer)
    _put_beads(rows, drawn, offset + lead, z, layer.height_mm)
    rows["speed"] = _speeds(process, first)[rows["role"]]
    rows["xyz"][offset[direct]] = _at(heads[direct], z)
    rows["xyz"][0, :] = _at(heads[:1], z) if first else rows["xyz"][0]
    z_from = np.full(len(heads), z)
    z_from[0] = z_before
    _put_travels(rows, offset[retracted], before[retracted], heads[retracted], z_from[retracted], z, hop, process)
    if retracted[0]:
        rows["layer"][0] = nozzle.layer
    start = rows["xyz"][:1] if nozzle.xyz is None else nozzle.xyz[None]
    long = np.linalg.norm(np.diff(rows["xyz"], axis=0, prepend=start), axis=1)
    laid = rows["role"] != Role.TRAVEL
    rows["filament"][laid] = (bead_area(rows["width"], rows["height"]) * long)[laid] / area
    nozzle.xyz, nozzle.layer = rows["xyz"][-1], layer.index
    useful = (long > 0) | (rows["filament"] != 0)
    useful[0] |= first
    return {name: column[useful] for name, column in rows.items()}


def _travels(
    drawn: Drawn, heads: Array, before: Array, climbs: bool, process: Process, *, stops: bool
) -> tuple[Array, Array]:
    """Before which lines (L,) the filament is drawn back, and which are reached straight; others begin on the spot."""
    gap = np.linalg.norm(heads - before, axis=1)
    inside = np.diff(drawn.island, prepend=drawn.island[:1]) == 0
    apart = gap > SAME_PLACE
    drawing_back = process.retraction.length_mm > 0
    retracted = apart & (~inside | (gap >= process.retraction.min_travel_mm)) & drawing_back
    retracted[0] |= stops and drawing_back
    direct = apart & ~retracted
    direct[0] |= climbs and not retracted[0]
    return retracted, direct


def _blank(size: int, layer: Layer) -> dict[str, Array]:
    rows = {name: np.zeros(size) for name in ("filament", "width", "height", "speed")}
    return rows | {
        "xyz": np.zeros((size, 3)), "role": np.zeros(size, np.uint8), "layer": np.full(size, layer.index, np.int32)
    }


def _put_beads(rows: dict[str, Array], drawn: Drawn, offset: Array, z: float, height: float) -> None:
    """Lines begin at the rows `offset` (L,); their first point is where the row before has brought the nozzle."""
    size = np.diff(drawn.starts)
    row = np.arange(len(drawn.points)) + np.repeat(offset - 1 - drawn.starts[:-1], size)
    inner = np.ones(len(drawn.points), np.bool_)
    inner[drawn.starts[:-1]] = False
    row = row[inner]
    rows["xyz"][row], rows["role"][row] = _at(drawn.points[inner], z), np.repeat(drawn.role, size)[inner]
    rows["width"][row], rows["height"][row] = drawn.width[inner], height


def _put_travels(
    rows: dict[str, Array], row: Array, here: Array, there: Array, z_from: Array, z: float, hop: float, process: Process
) -> None:
    """Draw back, lift, travel, lower, prime: from `here` (T, 2) to `there` (T, 2), beginning at `row` (T,)."""
    top = np.maximum(z_from, z) + hop
    places = [_at(here, z_from), _at(here, top), _at(there, top), _at(there, z), _at(there, z)]
    if not hop:
        places = [places[0], places[3], places[4]]
    for step, place in enumerate(places):
        rows["xyz"][row + step] = place
    last, retraction = row + len(places) - 1, process.retraction
    rows["filament"][row], rows["filament"][last] = -retraction.length_mm, retraction.length_mm
    rows["speed"][row], rows["speed"][last] = retraction.speed_mm_s, retraction.prime_speed_mm_s


def _at(xy: Array, z: Array | float) -> Array:
    return np.column_stack((xy, np.broadcast_to(z, len(xy))))
