"""The way from the homing pose to the print and back, and a print taken up again at a layer: toolpaths in and out.

    home            where the nozzle stands with the platform at home      lift    height over a point before going down
    way in          home, [up, across,] over the first point, down to it   way out  up from the last point, across, home
Rows of the way in and out are travels with `object` MACHINE, in a layer of their own before the first and after the
last one. They go through check, planning and audit as all others. At a pause or a change of filament the nozzle waits
HOLD_S, so that there are rows in which nothing moves, where a player can stop. Heat and fan are off on the way out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, UsageError
from cabslice.feasibility.findings import Finding
from cabslice.robot.delta import Machine
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import EventKind, Events, Toolpath

MACHINE = -2                   # Toolpath.object of the machine's own moves
SAME = 1e-6                    # mm
HOLD_S = 0.1
LASTING = (EventKind.NOZZLE_TEMPERATURE, EventKind.BED_TEMPERATURE, EventKind.FAN, EventKind.MIN_PRINT_SPEED)
SWITCHED = LASTING[:3]
PARTS = ("index", "kind", "value")
STOPS = (EventKind.PAUSE, EventKind.FILAMENT_CHANGE)
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer", "object")


def home_point(robot: Machine) -> Array:
    """(3,) mm, bed coordinates: the nozzle with the platform at home. Raises ValueError where there is no nozzle."""
    if robot.nozzle is None or robot.bed_origin is None:
        raise ValueError("the robot has no nozzle or no bed")
    return robot.home[:3] + robot.nozzle - robot.bed_origin


def has_ends(path: Toolpath) -> bool:
    return len(path.object) > 0 and bool(path.object[0] == MACHINE)


def with_ends(path: Toolpath, robot: Machine, start: Any, *, printed_mm: float = 0.0) -> Toolpath:
    """The toolpath on the bed as it lies, with the way from home before it and the way home after it.

    As it is where it has them.

    start: profile.printer.Start. printed_mm: height of what stands on the bed before the first move. Raises
    ImpossibleError where home lies lower than what stands there: then the nozzle cannot begin at it.
    """
    if has_ends(path):
        return path
    path = _sheared(path, robot.bed_slope)
    home, top = home_point(robot), float(path.xyz[:, 2].max())
    if printed_mm and home[2] < printed_mm + start.lift_mm:
        raise _in_the_part(home, printed_mm + start.lift_mm)
    inward = _way_in(home, path.xyz[0], printed_mm, start.lift_mm)
    outward = _way_out(path.xyz[-1], home, top, start.lift_mm)
    return _joined(path, inward, outward, start.speed_mm_s)


def _way_in(home: Array, first: Array, printed: float, lift: float) -> Array:
    """Points from home to the first one: straight to a place over it; from a home as low as that, upwards first."""
    over = np.array([first[0], first[1], max(first[2], printed) + lift])
    risen = np.array([home[0], home[1], max(home[2], over[2])])
    return _without_repeats(np.vstack((home, risen, over, first)))


def _way_out(last: Array, home: Array, top: float, lift: float) -> Array:
    """Points after the last one: home where it lies over the part, else the nozzle stays over the last point."""
    up = np.array([last[0], last[1], max(last[2], top) + lift])
    return _without_repeats(np.vstack((last, up, *([home] if home[2] >= top + lift else []))))[1:]


def _without_repeats(points: Array) -> Array:
    """Points (n, 3) without those that are where the one before is."""
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME
    return points[np.concatenate(([True], moved))]


def _joined(path: Toolpath, inward: Array, outward: Array, speed: float) -> Toolpath:
    before, after = len(inward) - 1, len(outward)
    rows: dict[str, Any] = {
        "xyz": np.vstack((inward, path.xyz[1:], outward)), "speed": _padded(path.speed, before, after, speed),
        "role": _padded(path.role, before, after, Role.TRAVEL), "object": _padded(path.object, before, after, MACHINE),
        "layer": np.concatenate((np.repeat(path.layer[:1] - 1, before), path.layer,
                                 np.repeat(path.layer[-1:] + 1, after))),
    }
    rows |= {name: _padded(getattr(path, name), before, after, 0.0) for name in ("filament", "width", "height")}
    rows["object"][: before + 1] = MACHINE
    rows["speed"][: before + 1] = speed
    ends = ([1] if before else []), ([len(rows["xyz"])] if after else [])
    rows["layer"][before] -= before > 0
    events = _with_holds(_moved(path.events, before))
    events = _with_off(events, len(path.xyz) + before) if after else events
    starts = np.concatenate((ends[0], path.starts + before, ends[1]))
    return replace(path, **rows, starts=starts, events=events)


def _moved(events: Events, before: int) -> Events:
    """What belongs to a layer begins with it; all else of row 0 happens at home."""
    own = np.isin(events.kind, (EventKind.MIN_LAYER_TIME, EventKind.MIN_PRINT_SPEED))
    return _in_order(np.where((events.index > 0) | (own & (before > 0)), events.index.clip(1) + before, 0), events)


def _with_holds(events: Events) -> Events:
    stops = np.unique(events.index[np.isin(events.kind, STOPS)])
    holds = Events(stops, np.full(len(stops), EventKind.DWELL), np.full(len(stops), HOLD_S))
    columns = (np.concatenate((getattr(events, name), getattr(holds, name))) for name in PARTS)
    found = Events(*columns)
    return _in_order(found.index, found)


def _with_off(events: Events, index: int) -> Events:
    """Heaters and fan off at row `index`, those that are spoken of at all."""
    kinds = [kind for kind in SWITCHED if (events.kind == kind).any()]
    more = Events(np.full(len(kinds), index), np.array(kinds, np.int64), np.zeros(len(kinds)))
    return Events(*(np.concatenate((getattr(events, name), getattr(more, name))) for name in PARTS))


def _in_order(index: Array, events: Events) -> Events:
    order = np.argsort(index, kind="stable")
    return Events(index[order], events.kind[order], events.value[order])


def _padded(column: Array, before: int, after: int, value: float) -> Array:
    return np.concatenate((np.full(before, value, column.dtype), column, np.full(after, value, column.dtype)))


def _in_the_part(home: Array, needed: float) -> ImpossibleError:
    x, y, z = (float(value) for value in home)
    sentence = f"At home the nozzle stands at {z:.1f} mm; what is printed already asks for {needed:.1f} mm."
    finding = Finding("start-home", -1, (x, y, z), 0, z, needed, "mm", sentence, "Home the machine higher.")
    return ImpossibleError(sentence, [finding])


# ---- a print taken up again

def from_layer(path: Toolpath, layer: int) -> Toolpath:
    """The moves of layers `layer` and up, of a toolpath without ends; what was switched before is switched at once.

    Raises UsageError where there is no such layer, or nothing below it.
    """
    found = np.flatnonzero(path.layer[1:] >= layer) + 1
    lowest, highest = int(path.layer[1:].min()), int(path.layer[1:].max())
    if not lowest < layer <= highest:
        raise UsageError(f"There is no layer {layer} to begin with: expected {lowest + 1} to {highest}.")
    first = int(found[0])
    keep = slice(first - 1, None)
    columns = _copied(path, keep)
    columns["filament"][0] = columns["width"][0] = columns["height"][0] = 0.0
    columns["role"][0], columns["layer"][0] = Role.TRAVEL, path.layer[first]
    starts = np.concatenate(([1], path.starts[path.starts > first] - first + 1))
    return replace(path, **columns, starts=starts, events=_events_from(path.events, first))


def _copied(path: Toolpath, rows: slice) -> dict[str, Any]:
    return {name: getattr(path, name)[rows].copy() for name in COLUMNS}


def _events_from(events: Events, first: int) -> Events:
    """Those at row `first` or later; of those before the last of each kind that lasts, at row 0."""
    before = events.index < first
    lasting = np.isin(events.kind, LASTING)
    earlier = np.flatnonzero(before & lasting)
    last = [int(earlier[events.kind[earlier] == kind][-1]) for kind in np.unique(events.kind[earlier])]
    later = np.flatnonzero(~before)
    index = np.concatenate((np.zeros(len(last), np.int64), events.index[later] - first + 1))
    rows = np.concatenate((np.array(last, np.int64), later))
    return Events(index, events.kind[rows], events.value[rows])


def resumed(path: Toolpath, robot: Machine, start: Any, layer: int) -> tuple[Toolpath, Toolpath]:
    """What is moved when a print is taken up at `layer`, and the same after all that stands already, to be checked.

    In the second one the nozzle prints what is below `layer`, goes home, and comes back as the first one begins.
    """
    path = without_ends(path, robot)
    rest = from_layer(path, layer)
    rows = len(path.xyz) - len(rest.xyz) + 1
    ends = np.append(path.starts[path.starts < rows], rows)
    below = replace(path, **_copied(path, slice(rows)), starts=ends, events=Events.none())
    taken_up = with_ends(rest, robot, start, printed_mm=float(below.xyz[below.role != Role.TRAVEL, 2].max()))
    return taken_up, _after(with_ends(below, robot, start), taken_up)


def _after(first: Toolpath, second: Toolpath) -> Toolpath:
    """One toolpath after another; the second one begins where the first one ends."""
    columns: dict[str, Any] = {
        name: np.concatenate((getattr(first, name), getattr(second, name)[1:])) for name in COLUMNS
    }
    columns["layer"] = np.maximum.accumulate(columns["layer"])
    shift = len(first.xyz) - 1
    return replace(first, **columns, starts=np.concatenate((first.starts[:-1], second.starts + shift)),
                   events=Events.none())


def without_ends(path: Toolpath, robot: Machine) -> Toolpath:
    """The toolpath as it was before `with_ends`, on a level bed and without the machine's own moves."""
    if not has_ends(path):
        return path
    own = np.flatnonzero(path.object != MACHINE)
    first, stop = int(own[0]) - 1, int(own[-1]) + 1
    columns = _copied(path, slice(first, stop))
    columns["object"][0], columns["layer"][0] = columns["object"][1], columns["layer"][1]
    starts = path.starts[(path.starts > first) & (path.starts <= stop)] - first
    kept = path.events.index < stop
    events = _without_holds(Events(*(getattr(path.events, name)[kept] for name in PARTS)))
    index = np.where(events.index <= first + 1, np.where(events.index, 1, 0), events.index - first)
    inner = replace(path, **columns, starts=starts, events=replace(events, index=index))
    return _sheared(inner, -robot.bed_slope)


def _sheared(path: Toolpath, slope: Array) -> Toolpath:
    """On the plane of a bed that rises by `slope` (2,) per mm along x and y."""
    if not slope.any():
        return path
    xyz = path.xyz.copy()
    xyz[:, 2] += xyz[:, :2] @ slope
    return replace(path, xyz=xyz)


def _without_holds(events: Events) -> Events:
    """As before _with_holds: of the dwells at a stop the last one goes."""
    keep = np.ones(len(events.index), np.bool_)
    for index in np.unique(events.index[np.isin(events.kind, STOPS)]):
        keep[np.flatnonzero((events.index == index) & (events.kind == EventKind.DWELL))[-1]] = False
    return Events(events.index[keep], events.kind[keep], events.value[keep])
