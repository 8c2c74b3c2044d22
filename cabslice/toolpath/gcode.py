"""A toolpath as G-code for people's eyes and printers: PrusaSlicer's comment dialect, relative E, bed coordinates.

With PrusaSlicer's thumbnails and layer tags, and the progress (M73) at the asked speeds. The middle of the bed is X0
Y0. Coordinates have three decimals, filament five; filament is rounded on its running sum, so that no error adds up.
The reader is in gcode_read and offered here too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import BinaryIO

import numpy as np

from cabslice import __version__
from cabslice.arrays import Array
from cabslice.profile.material import Material
from cabslice.profile.placeholders import filled
from cabslice.profile.process import Process
from cabslice.profile.shelf import profile_hash
from cabslice.slicing.layer import Role
from cabslice.toolpath.gcode_flavor import FLAVORS, HEAT, Flavor, ending, event_line, object_names, plain
from cabslice.toolpath.gcode_read import GcodeReading, read_gcode
from cabslice.toolpath.gcode_words import PRUSA_NAME
from cabslice.toolpath.path import Events, Toolpath
from cabslice.toolpath.thumbnail import thumbnail_lines

__all__ = ["GcodeReading", "read_gcode", "write_gcode"]

PLACES, FEED_PLACES = 1e3, 1e5       # steps in a millimetre of travel, of filament
BLOCK = 1 << 16                      # rows turned into text at a time
XY, Z, E, F = 1, 2, 4, 8             # words of a line
THUMBNAILS = (32, 32), (220, 124)    # pixels


def write_gcode(
    path: Toolpath, file: BinaryIO, *, printer_name: str, material: Material, process: Process, flavor: str = "marlin",
    bed_mm: tuple[float, float] | None = None, start: str = "", end: str = "",
) -> None:
    """Write `path` into the binary `file` as G-code: tags and moves as PrusaSlicer has them, events as M codes.

    flavor: of gcode_flavor.FLAVORS; bed_mm: size of the bed, for viewers; start, end: the printer's own lines, with
    placeholders. The same toolpath and profiles give the same bytes. Moves that round to no motion join the next one
    that lays.
    """
    words, whole, carry = FLAVORS[flavor], _totals(path), _Carry()
    own = _figures(path, whole, printer_name, material, process) if start or end else {}
    file.write(_lines(_header(path, whole, printer_name, material, process, words, filled(start, own))))
    for low, high in path.spans(BLOCK):
        notes = _notes(path, low, high, words, whole, carry)
        file.write(_text(_table(path, low, high, carry), low, notes))
    file.write(_lines(_footer(path, whole, material, process, words, bed_mm, filled(end, own))))


@dataclass(frozen=True)
class _Totals:
    """Of the whole path: time at the speeds asked for, s; filament laid, mm; objects."""

    seconds: float
    filament: float
    objects: int


def _totals(path: Toolpath) -> _Totals:
    seconds, filament, objects = 0.0, 0.0, 0
    for low, high in path.spans():
        seconds += float(_seconds(path, low, high).sum())
        filament += float(path.filament[low:high][path.role[low:high] != Role.TRAVEL].sum())
        objects = max(objects, int(path.object[low:high].max()) + 1)
    return _Totals(seconds, filament, objects)


@dataclass
class _Carry:
    """What a block of rows must know of those before it: filament fed (mm, and in steps), the speed that holds
    (mm/min), time (s) and per cent done; role, height and width of the last bead."""

    fed: float = 0.0
    steps: float = 0.0
    speed: float = 0.0
    seconds: float = 0.0
    percent: int = -1
    bead: tuple[float, float, float] = (np.nan, np.nan, np.nan)


def _figures(
    path: Toolpath, whole: _Totals, printer_name: str, material: Material, process: Process
) -> dict[str, str]:
    """What the placeholders stand for (profile.placeholders.PLACEHOLDERS)."""
    low, high, layers = np.full(3, np.inf), np.full(3, -np.inf), np.zeros(0, np.int64)
    for begin, end in path.spans():
        laid = path.role[begin:end] != Role.TRAVEL
        places = path.xyz[begin:end][laid]
        low, high = np.minimum(low, places.min(0, initial=np.inf)), np.maximum(high, places.max(0, initial=-np.inf))
        layers = np.union1d(layers, path.layer[begin:end][laid])
    heats = [path.events.value[path.events.kind == kind] for kind in HEAT]
    nozzle, bed = (plain(float(some[0])) if len(some) else "0" for some in heats)
    figures = {
        "height_mm": high[2], "filament_mm": whole.filament, "min_x_mm": low[0], "max_x_mm": high[0],
        "min_y_mm": low[1], "max_y_mm": high[1], "nozzle_mm": process.nozzle_mm, "layer_mm": process.layer_mm,
        "layers": len(layers), "print_s": round(whole.seconds),
    }
    names = {"printer": printer_name, "material": material.name, "process": process.name}
    texts = {name: plain(float(value), 3) for name, value in figures.items()}
    return texts | names | {"first_nozzle_c": nozzle, "first_bed_c": bed}


def _header(
    path: Toolpath, whole: _Totals, printer_name: str, material: Material, process: Process, flavor: Flavor,
    own: list[str],
) -> Iterator[str]:
    yield f"; generated by cabslice {__version__}"
    for width, height in THUMBNAILS:
        yield from thumbnail_lines(path, width, height)
    yield f"; source = {' '.join(path.source.split())}"
    yield f"; printer = {printer_name}"
    yield f"; material = {material.name} sha256:{profile_hash(material)}"
    yield f"; process = {process.name} sha256:{profile_hash(process)}"
    yield "; origin_mm = 0,0"
    yield "; the middle of the bed is X0 Y0"
    if own:
        yield ";TYPE:Custom"
        yield from own
    yield "G21 ; millimetres"
    yield "G90 ; absolute coordinates"
    yield "M83 ; relative filament"
    if material.pressure_advance_s is not None:
        yield flavor.advance(material.pressure_advance_s)
    if whole.objects > 1:
        yield from object_names(flavor, whole.objects)


def _footer(
    path: Toolpath, whole: _Totals, material: Material, process: Process, flavor: Flavor,
    bed: tuple[float, float] | None, own: list[str],
) -> Iterator[str]:
    yield from ending(flavor)
    if own:
        yield ";TYPE:Custom"
        yield from own
    mass = whole.filament * path.filament_area_mm2 * material.density_g_cm3 / 1000
    yield f"; filament used [g] = {mass:.2f}"
    if material.price_per_kg is not None:
        yield f"; filament cost = {mass / 1000 * material.price_per_kg:.2f}"
    yield f"; estimated printing time (normal mode) = {_clock(whole.seconds)}"
    yield f"; gcode_flavor = {flavor.name}"
    if bed is not None:
        x, y = (plain(size / 2) for size in bed)
        yield f"; bed_shape = -{x}x-{y},{x}x-{y},{x}x{y},-{x}x{y}"
    yield f"; filament used [mm] = {whole.filament:.2f}"
    yield f"; filament used [cm3] = {whole.filament * path.filament_area_mm2 / 1000:.2f}"
    yield f"; filament_diameter = {path.filament_diameter_mm!r}"
    yield f"; layer_height = {process.layer_mm:g}"
    yield f"; nozzle_diameter = {process.nozzle_mm:g}"


def _lines(lines: Iterable[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()


def _seconds(path: Toolpath, low: int, high: int) -> Array:
    """(high - low,) s of each move at the speed asked for; accelerations not counted."""
    length, speed = path.lengths_of(low, high), path.speed[low:high]
    still = length == 0
    return np.where(still, np.abs(path.filament[low:high]), length) / np.maximum(speed, 1e-6) * (speed > 0)


def _clock(seconds: float) -> str:
    whole = round(seconds)
    parts = (whole // 86400, "d"), (whole // 3600 % 24, "h"), (whole // 60 % 60, "m"), (whole % 60, "s")
    return " ".join(f"{count}{unit}" for count, unit in parts if count) or "0s"


@dataclass(frozen=True)
class _Table:
    """Per row: which words it writes (0: no line), place (N, 3) and filament (N,) in mm, speed (N,) in mm/min."""

    words: Array
    place: Array
    feed: Array
    speed: Array


def _table(path: Toolpath, low: int, high: int, carry: _Carry) -> _Table:
    """Of the rows low..high."""
    xyz = path.xyz[max(low - 1, 0):high]
    place = np.rint(xyz * PLACES).astype(np.int64)
    step, still = np.diff(place, axis=0) != 0, (np.diff(xyz, axis=0) == 0).all(1)
    if not low:
        step, still = np.vstack((np.ones((1, 3), np.bool_), step)), np.append(False, still)
    filament = path.filament[low:high]
    written = step.any(1) | still
    feeds = written & (filament != 0)
    fed = np.cumsum(np.append(carry.fed, filament))[1:]
    steps = np.rint(fed[feeds] * FEED_PLACES)
    feed = np.zeros(len(filament))
    feed[feeds] = np.diff(steps, prepend=carry.steps) / FEED_PLACES
    speed = np.maximum(np.rint(path.speed[low:high] * 60 * 1e3) / 1e3, 1e-3)
    faster = np.zeros(len(filament), np.bool_)
    faster[written] = np.diff(speed[written], prepend=carry.speed) != 0
    words = XY * step[:, :2].any(1) + Z * step[:, 2] + E * feeds + F * faster
    carry.fed, carry.steps = float(fed[-1]), float(np.append(carry.steps, steps)[-1])
    carry.speed = float(np.append(carry.speed, speed[written])[-1])
    return _Table(words * written, place[len(place) - len(filament):] / PLACES, feed, speed)


def _text(table: _Table, low: int, notes: dict[int, str]) -> bytes:
    """The lines of the rows from `low` on, the notes before theirs."""
    parts, marks, end = [], sorted(notes), low + len(table.words)
    for begin, upto in pairwise([*([] if marks[:1] == [low] else [low]), *marks, end]):
        parts.append(notes.get(begin, ""))
        parts.extend(_moves(table, slice(begin - low, upto - low)))
    return "".join(parts).encode()


def _moves(table: _Table, rows: slice) -> Iterator[str]:
    x, y, z = table.place[rows].T.tolist()
    words_of, feeds, speeds = table.words[rows].tolist(), table.feed[rows].tolist(), table.speed[rows].tolist()
    for words, *place, feed, speed in zip(words_of, x, y, z, feeds, speeds, strict=True):
        if words == XY | E:
            yield f"G1 X{place[0]:.3f} Y{place[1]:.3f} E{feed:.5f}\n"
        elif words:
            yield _move(words, place, feed, speed)


def _move(words: int, place: list[float], feed: float, speed: float) -> str:
    text = "G1"
    if words & XY:
        text += f" X{place[0]:.3f} Y{place[1]:.3f}"
    if words & Z:
        text += f" Z{place[2]:.3f}"
    if words & E:
        text += f" E{feed:.5f}"
    if words & F:
        text += f" F{plain(speed, 3)}"
    return text + "\n"


def _notes(path: Toolpath, low: int, high: int, flavor: Flavor, whole: _Totals, carry: _Carry) -> dict[int, str]:
    """Lines that come before rows low..high: layers, objects, events, roles, heights and widths, progress."""
    notes: dict[int, list[str]] = {}
    for row in _changes(path.layer, low, high):
        notes.setdefault(row, []).extend(_layer_tags(path, row))
    if whole.objects > 1:
        for row in _changes(path.object, low, high):
            notes.setdefault(row, []).append(flavor.object(int(path.object[row])))
    for row, line in _event_lines(path.events, low, high, flavor):
        notes.setdefault(row, []).append(line)
    for row, line in (*_bead_lines(path, low, high, carry), *_progress(path, low, high, whole, carry)):
        notes.setdefault(row, []).append(line)
    return {row: "".join(f"{line}\n" for line in lines) for row, lines in notes.items()}


def _bead_lines(path: Toolpath, low: int, high: int, carry: _Carry) -> Iterator[tuple[int, str]]:
    """Where the bead is of another role, height or width than the one before."""
    laid = np.flatnonzero(path.role[low:high] != Role.TRAVEL) + low
    columns = path.role[laid], np.round(path.height[laid], 4), np.round(path.width[laid], 4)
    for tag, values, before in zip(("TYPE", "HEIGHT", "WIDTH"), columns, carry.bead, strict=True):
        for k in np.flatnonzero(np.diff(values.astype(float), prepend=before) != 0).tolist():
            yield int(laid[k]), f";{tag}:{PRUSA_NAME[Role(values[k])] if tag == 'TYPE' else plain(values[k])}"
    if len(laid):
        role, height, width = (float(values[-1]) for values in columns)
        carry.bead = role, height, width


def _progress(path: Toolpath, low: int, high: int, whole: _Totals, carry: _Carry) -> Iterator[tuple[int, str]]:
    """At each per cent of the time: M73 with what is done and the minutes left."""
    took = _seconds(path, low, high)
    done = np.cumsum(np.append(carry.seconds, took))[1:]
    percent = np.floor(100 * (done - took) / max(whole.seconds, 1e-9)).astype(int)
    for k in np.flatnonzero(np.diff(percent, prepend=carry.percent)).tolist():
        left = max(whole.seconds - float(done[k]), 0.0)
        yield low + k, f"M73 P{min(percent[k], 100)} R{round(left / 60)}"
    carry.seconds, carry.percent = float(done[-1]), int(percent[-1])


def _changes(values: Array, low: int, high: int) -> list[int]:
    """Rows of low..high at which the value is another than at the row before; row 0 always."""
    first = [] if low else [0]
    begin = max(low, 1)
    return first + (np.flatnonzero(values[begin:high] != values[begin - 1:high - 1]) + begin).tolist()


def _layer_tags(path: Toolpath, row: int) -> Iterator[str]:
    yield ";LAYER_CHANGE"
    laid = row + _leading(path.role, row)
    yield f";Z:{plain(path.xyz[laid, 2])}"
    yield f";HEIGHT:{plain(path.height[laid])}"
    yield f";LAYER:{path.layer[row]}"


def _leading(role: Array, row: int) -> int:
    """How many travels come from `row` on before a bead; 0 where no bead comes."""
    for low in range(row, len(role), BLOCK):
        laid = role[low:low + BLOCK] != Role.TRAVEL
        if laid.any():
            return low - row + int(np.argmax(laid))
    return 0


def _event_lines(events: Events, low: int, high: int, flavor: Flavor) -> Iterator[tuple[int, str]]:
    some = slice(*np.searchsorted(events.index, (low, high)).tolist())
    columns = (events.index[some], events.kind[some], events.value[some])
    for row, kind, value in zip(*(column.tolist() for column in columns), strict=True):
        yield row, event_line(flavor, kind, value, wait=row == 0)
