"""What happens along a toolpath besides moving: temperatures, fan, layer times, pauses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabslice.arrays import Array, spans
from cabslice.errors import ModelError
from cabslice.profile.material import Material
from cabslice.profile.process import Process
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import EventKind, Events, Toolpath

Row = tuple[int, EventKind, float]
OVER_AIR = (Role.BRIDGE, Role.OVERHANG_WALL)


def events_of(
    layer: Array, role: Array, part: Array, material: Material, process: Process, rests: dict[int, int]
) -> Events:
    """The events of a path with these columns (N,), part the object; `rests`: where the nozzle rests before a layer.

    Raises ModelError where a pause is asked for before a layer that the path has not.
    """
    heads = _heads(layer, role, part)
    layer, role, part = layer[heads], role[heads], part[heads]
    first = heads[layer > layer[0]][:1].tolist()
    rows = [*_heat(first, material), *_fan(heads, layer, role, part, material), *_layer_times(heads, layer, material)]
    rows += _stops(process, rests)
    rows.sort(key=lambda row: row[0])
    return Events(*np.array(rows, np.float64).T)


def _heads(layer: Array, role: Array, part: Array) -> Array:
    """Rows at which layers begin, and beads that differ from the one before in layer, part, or in lying over air."""
    found, last = [np.zeros(1, np.int64)], np.full(3, -1)
    for low, high in spans(len(layer), layer, role, part):
        before = max(low - 1, 0)
        begins = np.flatnonzero(np.diff(layer[before:high])) + before + 1
        laid = np.flatnonzero(role[low:high] != Role.TRAVEL) + low
        kinds = np.stack((layer[laid], part[laid], np.isin(role[laid], OVER_AIR)), axis=1)
        found += [begins, laid[(np.diff(kinds, axis=0, prepend=last[None]) != 0).any(1)]]
        last = kinds[-1] if len(kinds) else last
    return np.unique(np.concatenate(found))


def _heat(second: list[int], material: Material) -> list[Row]:
    found: list[Row] = []
    for kind, usual, later, first in (
        (EventKind.BED_TEMPERATURE, material.bed_c, material.print_bed_c, material.first_bed_c),
        (EventKind.NOZZLE_TEMPERATURE, material.nozzle_c, material.print_nozzle_c, material.first_nozzle_c),
    ):
        lasting = float(np.mean(usual)) if later is None else later
        found.append((0, kind, lasting if first is None else first))
        if first is not None and first != lasting:
            found += [(row, kind, lasting) for row in second]
    return found


def _fan(heads: Array, layer: Array, role: Array, part: Array, material: Material) -> list[Row]:
    """The fan of each bead, layers counted in each object; travels keep it as it was. `heads` (H,): see _heads."""
    rows = np.flatnonzero(role != Role.TRAVEL)
    above_air = material.fan if material.bridge_fan is None else material.bridge_fan
    wanted = np.where(np.isin(role[rows], OVER_AIR), above_air, material.fan)
    number = np.unique(layer[rows], return_inverse=True)[1]
    _, first, own = np.unique(part[rows], return_index=True, return_inverse=True)
    wanted[number - number[first][own] < material.fan_after_layers] = 0.0
    begin = heads[rows]
    new = np.diff(number, prepend=0) > 0
    begin[new] = heads[np.searchsorted(layer, layer[rows[new]])]     # with the layer, before the travel into it
    changes = np.flatnonzero(np.diff(wanted, prepend=0.0))
    head = [] if len(changes) and begin[changes[0]] <= 1 else [(0, EventKind.FAN, 0.0)]
    return [*head, *((int(begin[k]) if begin[k] > 1 else 0, EventKind.FAN, float(wanted[k])) for k in changes)]


def _layer_times(heads: Array, layer: Array, material: Material) -> list[Row]:
    if not material.min_layer_s:
        return []
    begins = heads[np.flatnonzero(np.diff(layer, prepend=layer[0] - 1))].tolist()
    return [
        (0, EventKind.MIN_PRINT_SPEED, material.min_speed_mm_s),
        *((row, EventKind.MIN_LAYER_TIME, material.min_layer_s) for row in begins),
    ]


def _stops(process: Process, rests: dict[int, int]) -> list[Row]:
    wanted = (
        (EventKind.FILAMENT_CHANGE, "filament_change_layers", process.filament_change_layers),
        (EventKind.PAUSE, "pause_layers", process.pause_layers),
    )
    for _, key, layers in wanted:
        for number in layers:
            if number not in rests:
                raise ModelError(
                    f"{key}: there is no layer {number} to stop before; the layers are {min(rests)} to {max(rests)}."
                )
    return [(rests[number], kind, 0.0) for kind, _, layers in wanted for number in sorted(set(layers))]


def with_stops(path: Toolpath, process: Process) -> Toolpath:
    """A path that was read from a file, with the pauses that the process asks for at the first row of their layers."""
    begins = np.flatnonzero(np.diff(path.layer, prepend=path.layer[:1] - 1))
    rows = _stops(process, {int(path.layer[row]): max(int(row), 1) for row in begins})
    if not rows:
        return path
    old = path.events
    index, kind, value = np.array(rows, np.float64).T
    order = np.argsort(np.append(index, old.index), kind="stable")
    columns = zip((index, kind, value), (old.index, old.kind, old.value), strict=True)
    events = Events(*(np.append(new, before)[order] for new, before in columns))
    return replace(path, events=events, starts=np.union1d(path.starts, index.astype(np.int64)))
