"""Layers in, toolpath out: every bead laid once, in an order that travels little.

A travel that stays inside the part, or is shorter than min_travel_mm inside one island, is made without stopping; any
other draws the filament back (at rest, or wiping), lifts, travels, lowers and primes. Which way it takes is told by
travel.travels.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import tee, zip_longest

import numpy as np

from cabslice.arrays import Array, spans
from cabslice.errors import ModelError
from cabslice.profile.material import Material
from cabslice.profile.process import Process
from cabslice.slicing.layer import Layer, Polygons, Role
from cabslice.slicing.spiral import floors
from cabslice.toolpath.events import events_of
from cabslice.toolpath.overhang import slowed
from cabslice.toolpath.path import RESTS, Events, Toolpath, bead_area, piece_starts
from cabslice.toolpath.sequence import Drawn, draw_layer
from cabslice.toolpath.spiral import blended, divided, drawn_ring, flat, rise, spiral_ring
from cabslice.toolpath.spool import Spool
from cabslice.toolpath.travel import SAME_PLACE, Travels, coasted, travels

SPEED_OF = {
    Role.OUTER_WALL: "outer_wall", Role.INNER_WALL: "inner_wall", Role.SOLID_INFILL: "solid_infill",
    Role.TOP_SKIN: "top_skin", Role.SPARSE_INFILL: "sparse_infill", Role.BRIDGE: "bridge", Role.GAP_FILL: "gap_fill",
    Role.SKIRT: "skirt", Role.SUPPORT: "support", Role.SUPPORT_INTERFACE: "support_interface",
    Role.IRONING: "ironing", Role.OVERHANG_WALL: "bridge", Role.CUSTOM: "outer_wall", Role.TRAVEL: "travel",
}
INSTEAD = {   # where the process does not say
    "support": "sparse_infill", "support_interface": "solid_infill", "ironing": "top_skin",
}
NOTHING = Polygons(np.empty((0, 2)), np.zeros(1))
OVER_MM = 2.0      # over all that stands, on the way to the next object
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer", "object")


@dataclass
class _Nozzle:
    """Where it stands between two layers."""

    xyz: Array | None = None
    layer: int = 0
    top: float = 0.0         # mm, of all that is laid
    object: int = 0
    seams: Array = field(default_factory=lambda: np.empty((0, 2)))
    ring: Array | None = None        # (N, 2) the last of a spiral
    below: Polygons | None = None    # outline of the last layer
    covers: Sequence[Polygons] = ()
    above: Polygons | None = None    # and of the next, of the same object


def lay_toolpath(
    layers: Iterable[Layer], process: Process, material: Material, *, filament_diameter_mm: float, source: str = ""
) -> Toolpath:
    """The order in which the beads of all layers are laid, with travels, filament, asked speeds and events.

    Layers come from the bed upwards and are taken one at a time; one that begins lower than the one before is the next
    object, to which the nozzle goes above all that stands. Speeds are those the process asks for (in the first
    layer at most its first_layer); melt flow and machine lower them later. Raises ModelError where no layer holds a
    bead.
    """
    nozzle, area = _Nozzle(), np.pi / 4 * filament_diameter_mm**2
    spool = Spool(COLUMNS)
    rests: dict[int, int] = {}
    for layer, after in _with_next(layers):
        nozzle.above = None if after is None or after.z_mm < layer.z_mm else after.outline
        if process.spiral and layer.index >= floors(process) + process.raft.layers:
            made = [_wind(layer, nozzle, process, area)]
            spiral = layer
        else:
            made = _flat(layer, nozzle, process, area, first=not spool.rows)
        for block in made:
            rests[layer.index] = spool.rows + _rest(block, first=not spool.rows)
            spool.add(block)
    if nozzle.ring is not None:
        spool.add(_wind(spiral, nozzle, process, area, last=True))
    if not spool.rows:
        raise ModelError(
            f"{source or 'the part'}: no layer holds a bead; expected a part at least one bead wide and one layer high"
        )
    columns = spool.columns()
    events = events_of(columns["layer"], columns["role"], columns["object"], material, process, rests)
    return Toolpath(
        **columns, starts=_pieces(columns["xyz"], events), events=events,
        filament_diameter_mm=filament_diameter_mm, source=source,
    )


def _with_next(layers: Iterable[Layer]) -> Iterator[tuple[Layer, Layer | None]]:
    """Each layer with the one after it, read no further ahead."""
    one, other = tee(layers)
    next(other, None)
    return zip_longest(one, other)


def _flat(layer: Layer, nozzle: _Nozzle, process: Process, area: float, *, first: bool) -> list[dict[str, Array]]:
    """The rows of a layer, if it has any."""
    below, nozzle.below = nozzle.below, layer.outline
    if not len(layer.beads.role):
        return []
    drawn, nozzle.seams = _draw(layer, nozzle, process)
    if not len(drawn.role):
        return []
    start = nozzle.xyz
    nozzle.covers = [below or NOTHING, nozzle.above or NOTHING]
    rows = _moves(drawn, layer, nozzle, process, area, first=first)
    on_bed = start is not None and layer.z_mm < start[2] - SAME_PLACE     # the next object
    if process.overhang_speeds_mm_s and below is not None and start is not None and not on_bed:
        rows = slowed(rows, start, below, process.outer_bead_mm, process.overhang_speeds_mm_s)
    return [rows]


def _wind(layer: Layer, nozzle: _Nozzle, process: Process, area: float, *, last: bool = False) -> dict[str, Array]:
    """The rows of a ring of a spiral; `last`: of the one that levels the rim."""
    assert nozzle.xyz is not None
    below, here = nozzle.ring, nozzle.xyz
    points = spiral_ring(layer.beads, here[:2], f"the layer at z = {layer.z_mm:.2f} mm")
    nozzle.ring = points
    if below is not None:
        points = blended(points, below, here[:2])
    if below is None or last:
        points = divided(points)
    ground = layer.z_mm - layer.height_mm if below is None else float(here[2])
    rows = _moves(drawn_ring(points, layer), flat(layer, ground), nozzle, process, area, first=False)
    rise(rows, points, layer, first=below is None, last=last)
    _feed(rows, here, area)
    nozzle.xyz = rows["xyz"][-1]
    return rows


def _feed(rows: dict[str, Array], start: Array, area: float) -> Array:
    """Gives beads their filament; returns the lengths (N,) of the rows, mm, from `start` (3,) on."""
    long = np.linalg.norm(np.diff(rows["xyz"], axis=0, prepend=start[None]), axis=1)
    laid = rows["role"] != Role.TRAVEL
    rows["filament"][laid] = (bead_area(rows["width"], rows["height"]) * long)[laid] / area
    return long


def _pieces(xyz: Array, events: Events) -> Array:
    still = np.zeros(len(xyz), np.bool_)
    for low, high in spans(len(xyz) - 1, xyz):
        still[low + 1:high + 1] = (np.diff(xyz[low:high + 1], axis=0) == 0).all(1)
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
    anew = nozzle.xyz is not None and z < z_before - SAME_PLACE
    nozzle.object += anew
    way = travels(
        drawn, layer, before, process, climbs=z != z_before, stops=(stops and not first) or anew, anew=anew,
        covers=nozzle.covers,
    )
    drawn, dry = coasted(drawn, way.retracted, process.retraction)
    hop = np.full(len(heads), process.retraction.hop_mm if process.retraction.hop_mm > SAME_PLACE else 0.0)
    if anew:
        hop[0] = nozzle.top - max(z, z_before) + max(OVER_MM, hop[0])
    lead = _lead(way, hop)
    lead[0] += first
    size = lead + np.diff(drawn.starts) - 1
    offset = np.cumsum(size) - size
    rows = _blank(int(size.sum()), layer, nozzle.object)
    _put_beads(rows, drawn, offset + lead, z, layer.height_mm)
    on_bed = first or z - layer.height_mm < SAME_PLACE
    rows["speed"] = _speeds(process, on_bed)[rows["role"]]
    if dry.any():
        _coast(rows, drawn, dry, offset + lead)
    rows["xyz"][0, :] = _at(heads[:1], z) if first else rows["xyz"][0]
    z_from = np.full(len(heads), z)
    z_from[0] = z_before
    _put_travels(rows, way, offset, before, heads, z_from, z, hop, process)
    if way.retracted[0]:
        rows["layer"][:max(int(way.wipe_starts[1]), 1)] = nozzle.layer
    long = _feed(rows, rows["xyz"][0] if nozzle.xyz is None else nozzle.xyz, area)
    nozzle.xyz, nozzle.layer, nozzle.top = rows["xyz"][-1], layer.index, max(nozzle.top, z)
    useful = (long > 0) | (rows["filament"] != 0)
    useful[0] |= first
    return {name: column[useful] for name, column in rows.items()}


def _blank(size: int, layer: Layer, number: int) -> dict[str, Array]:
    rows = {name: np.zeros(size) for name in ("filament", "width", "height", "speed")}
    return rows | {
        "xyz": np.zeros((size, 3)), "role": np.zeros(size, np.uint8), "layer": np.full(size, layer.index, np.int32),
        "object": np.full(size, number, np.int32),
    }


def _put_beads(rows: dict[str, Array], drawn: Drawn, offset: Array, z: float, height: float) -> None:
    """Lines begin at the rows `offset` (L,); their first point is where the row before has brought the nozzle."""
    size = np.diff(drawn.starts)
    row = np.arange(len(drawn.points)) + np.repeat(offset - 1 - drawn.starts[:-1], size)
    inner = np.ones(len(drawn.points), np.bool_)
    inner[drawn.starts[:-1]] = False
    row = row[inner]
    rows["xyz"][row], rows["role"][row] = _at(drawn.points[inner], z), np.repeat(drawn.role, size)[inner]
    high = np.where(drawn.height > 0, drawn.height, height)
    rows["width"][row], rows["height"][row] = drawn.width[inner], np.repeat(high, size)[inner]


def _coast(rows: dict[str, Array], drawn: Drawn, dry: Array, offset: Array) -> None:
    """Segments (M,) `dry` are travelled at the speed of their bead."""
    row = np.flatnonzero(dry) + np.repeat(offset - 1 - drawn.starts[:-1], np.diff(drawn.starts))[dry]
    for name in ("role", "width", "height"):
        rows[name][row] = 0


def _lead(way: Travels, hop: Array) -> Array:
    """(L,) rows before each line: draw back (or wipe), lift, travel, lower, prime; or travel; or none."""
    wiping, passing = np.diff(way.wipe_starts), np.diff(way.way_starts)
    drawn_back = np.maximum(wiping, 1) + 2 * (hop > 0) + passing + 2
    return np.where(way.retracted, drawn_back, np.where(way.direct, passing + 1, 0))


def _put_travels(
    rows: dict[str, Array], way: Travels, row: Array, here: Array, there: Array, z_from: Array, z: float,
    hop: Array, process: Process,
) -> None:
    """The rows before each line, from `here` (L, 2) to `there` (L, 2), beginning at `row` (L,); hop (L,) mm."""
    back, retraction = way.retracted, process.retraction
    here, now = here.copy(), row.copy()
    wiping = np.diff(way.wipe_starts) > 0
    still = back & ~wiping
    rows["xyz"][now[still]], rows["filament"][now[still]] = _at(here[still], z_from[still]), -retraction.length_mm
    rows["speed"][now[still]] = retraction.speed_mm_s
    if wiping.any():
        _put_wipes(rows, way, now, here, z_from, process)
    now += np.where(back, np.maximum(np.diff(way.wipe_starts), 1), 0)
    level = np.where(back & (hop > 0), np.maximum(z_from, z) + hop, z)
    lifted = back & (hop > 0)
    rows["xyz"][now[lifted]] = _at(here[lifted], level[lifted])
    now += lifted
    moving = back | way.direct
    passing = np.where(moving, np.diff(way.way_starts), 0)
    points = np.repeat(moving, np.diff(way.way_starts))
    begin = np.cumsum(passing) - passing
    step = np.repeat(now - begin, passing) + np.arange(passing.sum())
    rows["xyz"][step] = _at(way.ways[points], np.repeat(level, passing))
    now += passing
    rows["xyz"][now[moving]] = _at(there[moving], level[moving])
    last = now[back] + np.where(lifted, 2, 1)[back]
    rows["xyz"][now[back] + 1] = rows["xyz"][last] = _at(there[back], z)
    rows["filament"][last] = retraction.length_mm + retraction.prime_extra_mm
    rows["speed"][last] = retraction.prime_speed_mm_s


def _put_wipes(
    rows: dict[str, Array], way: Travels, row: Array, here: Array, z_from: Array, process: Process
) -> None:
    """Draw back while going back along the bead; moves `here` to where that ends."""
    retraction = process.retraction
    for line in np.flatnonzero(np.diff(way.wipe_starts)).tolist():
        low, high = way.wipe_starts[line:line + 2]
        places, at = way.wipes[low:high], slice(row[line], row[line] + high - low)
        long = np.linalg.norm(np.diff(places, axis=0, prepend=here[line:line + 1]), axis=1)
        rows["xyz"][at] = _at(places, z_from[line])
        rows["filament"][at] = -retraction.length_mm * long / long.sum()
        rows["speed"][at] = min(process.speeds_mm_s.travel, long.sum() * retraction.speed_mm_s / retraction.length_mm)
        here[line] = places[-1]


def _at(xy: Array, z: Array | float) -> Array:
    return np.column_stack((xy, np.broadcast_to(z, len(xy))))
