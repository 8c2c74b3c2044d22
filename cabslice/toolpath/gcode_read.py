"""G-code of this program and of other slicers, read into a toolpath.

Read: PrusaSlicer, OrcaSlicer, BambuStudio, CuraEngine, Slic3r and whoever writes like them: G0-G4, G20/G21, G28,
G90-G92, M82/M83, temperatures, fan, pauses, speed and flow factors; roles, layers, widths and heights
from comments, or from the filament where there are none.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import GcodeError
from cabslice.slicing.flow import bead_width
from cabslice.slicing.layer import Role
from cabslice.toolpath.gcode_machine import Machine
from cabslice.toolpath.path import EventKind, Events, Toolpath, piece_starts

USUAL_FILAMENT_MM = 1.75
SAME_Z = 1e-6   # mm
LASTING = (EventKind.NOZZLE_TEMPERATURE, EventKind.BED_TEMPERATURE, EventKind.FAN, EventKind.MIN_PRINT_SPEED)


@dataclass(frozen=True)
class GcodeReading:
    """The toolpath of a G-code file, and sentences about what was assumed or left out.

    line (N,) of the file for each row; sized (N,) whether comments gave the width of its bead; settings: what the
    slicer wrote down of its own.
    """

    toolpath: Toolpath
    warnings: tuple[str, ...]
    line: Array
    sized: Array
    settings: Mapping[str, str]


def read_gcode(
    source: str | Path, *, origin: tuple[float, float] | None = None, filament_diameter_mm: float | None = None,
    name: str = "G-code", usual_filament_mm: float = USUAL_FILAMENT_MM,
) -> GcodeReading:
    """G-code as a toolpath in bed coordinates; `source` is a Path, or the text itself (then `name` is its name).

    `origin` (x, y) mm is the middle of the bed in the file's coordinates; where absent it is taken from the bed shape
    the slicer wrote down, else the middle of what is extruded. `filament_diameter_mm` is the filament E is meant for,
    else what the file says, else `usual_filament_mm`. Homing, parking and purging without motion before the
    first and after the last extrusion belong to another machine and are left out. Raises GcodeError with the line.
    """
    if isinstance(source, Path):
        name = source.name
        data = _bytes(source)
    else:
        data = source.encode()
    machine = _obey(data, name)
    warnings: list[str] = []
    if filament_diameter_mm is None:
        filament_diameter_mm = _diameter(machine, name, usual_filament_mm, warnings)
    path, line, sized = _assemble(
        machine, name, origin, filament_diameter_mm, warnings, hashlib.sha256(data).hexdigest()
    )
    if machine.unread:
        first = ", ".join(f"{command} (line {line})" for command, line in list(machine.unread.items())[:5])
        warnings.append(f"{name}: {len(machine.unread)} commands were not understood and left out: {first}")
    return GcodeReading(path, tuple(warnings), line, sized, machine.settings)


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise GcodeError(f"{path}: cannot be read: {error.strerror}; expected a G-code file", file=path.name) from error
    if data[:4] == b"GCDE":
        raise GcodeError(f"{path.name}: binary G-code; expected text: turn it off in the slicer", file=path.name)
    return data


def _obey(data: bytes, name: str) -> Machine:
    machine = Machine()
    try:
        for line in io.TextIOWrapper(io.BytesIO(data), "utf-8", "replace"):
            machine.obey(line)
    except ValueError as error:
        raise GcodeError(f"{name}, line {machine.number}: {error}", file=name, line=machine.number) from error
    return machine


def _assemble(
    machine: Machine, name: str, origin: tuple[float, float] | None, diameter: float, warnings: list[str], sha256: str,
) -> tuple[Toolpath, Array, Array]:
    rows = np.frombuffer(machine.rows).reshape(-1, 5) if machine.rows else np.empty((0, 5))
    line, tag_of = np.array(machine.line_of, np.int64), np.array(machine.tag_of, np.int64)
    bad = np.flatnonzero(~np.isfinite(rows).all(1))
    if len(bad):
        raise GcodeError(f"{name}, line {line[bad[0]]}: a number is not finite", file=name, line=int(line[bad[0]]))
    xyz, filament = np.vstack((np.zeros((1, 3)), rows[:, :3])), np.append(0.0, rows[:, 3])
    moved = np.append(False, (np.diff(xyz, axis=0) != 0).any(1))
    laid = moved & (filament > 0)
    if not laid.any():
        raise GcodeError(f"{name}: nothing is extruded; expected moves with a word E", file=name)
    first, last = _span(laid, machine.own, name, warnings)
    kept = slice(first, last + 1)
    tags = np.array([(t.role, t.layer, t.width, t.height, t.object) for t in machine.tags])[np.append(0, tag_of)][kept]
    laid, filament, xyz = laid[kept], filament[kept].copy(), xyz[kept].copy()
    laid[0], filament[0] = False, 0.0
    layer = tags[:, 1] if machine.layers else _layers_from_z(xyz[:, 2], laid)
    width, height = _bead_sizes(xyz, filament, laid, tags, layer, np.pi / 4 * diameter**2)
    xyz[:, :2] -= _origin(machine, xyz[laid, :2], name, warnings) if origin is None else origin
    rests = ~moved[kept]
    starts = np.union1d(piece_starts(rests), [b for b in np.array(machine.breaks) + 1 - first if 1 <= b < len(xyz)])
    path = Toolpath(
        xyz, filament, width, height, np.append(rows[:1, 4], rows[:, 4])[kept], np.where(laid, tags[:, 0], Role.TRAVEL),
        layer, tags[:, 4], starts, _events(machine, first, last), diameter, f"{name} sha256:{sha256}",
    )
    return path, np.append(0, line)[kept], tags[:, 2] > 0


def _span(laid: Array, own: bool, name: str, warnings: list[str]) -> tuple[int, int]:
    """The row at which the nozzle stands before the first extrusion, and the last row that counts."""
    first, last = np.flatnonzero(laid)[[0, -1]]
    if own:
        return 1, len(laid) - 1
    left_out = first - 1 + len(laid) - 1 - last
    if left_out > 0:
        warnings.append(f"{name}: {left_out} moves before the first and after the last extrusion were left out")
    return int(first) - 1, int(last)


def _layers_from_z(z: Array, laid: Array) -> Array:
    """A layer for every height at which something is laid; a travel counts to the layer it leads to."""
    rows = np.flatnonzero(laid)
    number = np.cumsum(np.abs(np.diff(z[rows], prepend=z[rows[0]])) > SAME_Z)
    return number[np.minimum(np.searchsorted(rows, np.arange(len(z))), len(rows) - 1)]


def _diameter(machine: Machine, name: str, usual: float, warnings: list[str]) -> float:
    text = machine.settings.get("filament_diameter", "").split(",")[0]
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if 0 < found < 100:
        return found
    warnings.append(f"{name}: does not tell the filament diameter; {usual:g} mm was taken")
    return usual


def _bead_sizes(
    xyz: Array, filament: Array, laid: Array, tags: Array, layer: Array, area: float
) -> tuple[Array, Array]:
    """Width and height (N,) mm: from the comments; else the height from the layers' z, the width from the filament."""
    number, index = np.unique(layer[laid], return_inverse=True)
    top = np.full(len(number), -np.inf)
    np.maximum.at(top, index, xyz[laid, 2])
    step = np.diff(top, prepend=0.0)
    step = np.where(step > SAME_Z, step, np.maximum(top, SAME_Z))     # a next object begins at the bed again
    height = tags[:, 3].copy()
    height[laid] = np.where(height[laid] > 0, height[laid], step[index])
    length = np.append(1.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1))
    section = np.where(laid, filament * area / np.where(laid, length, 1.0), 0.0)
    width = np.where(tags[:, 2] > 0, tags[:, 2], bead_width(section / np.where(laid, height, 1.0), height))
    return np.where(laid, width, 0.0), np.where(laid, height, 0.0)


def _origin(machine: Machine, laid: Array, name: str, warnings: list[str]) -> Array:
    """Middle of the bed in the file's coordinates, mm."""
    own = machine.settings.get("origin_mm")
    shape = machine.settings.get("bed_shape") or machine.settings.get("printable_area")
    try:
        if own:
            return np.array([float(number) for number in own.split(",")])
        if shape:
            corners = np.array([[float(number) for number in corner.split("x")] for corner in shape.split(",")])
            middle = (corners.min(0) + corners.max(0)) / 2
            if middle.any():
                warnings.append(
                    f"{name}: x {middle[0]:g} y {middle[1]:g} mm, the middle of the slicer's bed, was set on the "
                    "middle of the bed; --gcode-origin chooses another place"
                )
            return middle
    except ValueError:
        warnings.append(f"{name}: the shape of the bed, {own or shape!r}, could not be read")
    middle = (laid.min(0) + laid.max(0)) / 2
    warnings.append(
        f"{name}: does not tell where the middle of the bed is; the middle of what is extruded was taken, "
        f"x {middle[0]:.3f} y {middle[1]:.3f} mm; --gcode-origin says where it is"
    )
    return middle


def _events(machine: Machine, first: int, last: int) -> Events:
    """Events up to the last row, those before the first row at the first; settings that do not change anything go."""
    kept: list[tuple[int, int, float]] = []
    current: dict[int, float] = {}
    for row, kind, value in machine.events:
        at = max(row + 1 - first, 0) if row else 0
        lasting = kind in LASTING
        if row + 1 > last or (lasting and current.get(kind) == value):
            continue
        if lasting:
            current[kind] = value
        elif row + 1 <= first and not machine.own:
            continue
        kept.append((at, kind, value))
    kept = [event for event, after in pairwise([*kept, (-1, 0, 0.0)]) if event[:2] != after[:2]]
    return Events(*np.array(kept, np.float64).reshape(-1, 3).T)
