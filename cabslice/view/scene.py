"""What a page shows, whatever the product: moves with values, a mesh, cells of a map, the machine, findings.

All places are in bed coordinates, mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.feasibility.findings import Finding
from cabslice.robot.model import Robot
from cabslice.slicing.layer import Layer, Role
from cabslice.toolpath.path import EventKind, Toolpath

HIGH, LOW, FAR = "high", "low", "far"     # which of several values is told; far: from the middle


@dataclass(frozen=True)
class Field:
    """A value of each move (or face, or cell). `worst` of several is shown where there is room for one only."""

    key: str
    label: str
    unit: str
    values: Array
    worst: str = HIGH
    cable: int = 0           # from 1; 0: of no single cable

    def __post_init__(self) -> None:
        set_columns(self, values=Shapes(f"Field {self.key}").column("values", self.values, "N"))


@dataclass(frozen=True)
class Moves:
    """Row k is the move into xyz[k]; row 0 only says where the first one begins."""

    xyz: Array                       # (N, 3) mm
    role: Array                      # (N,) uint8, slicing.layer.Role
    layer: Array                     # (N,) int32
    width: Array                     # (N,) mm
    height: Array                    # (N,) mm
    time: Array                      # (N,) s at the end of each move, never falling
    clock: str = ""                  # what the time is: "planned", "asked"; "": there is none
    fields: tuple[Field, ...] = ()

    def __post_init__(self) -> None:
        shape = Shapes("Moves")
        columns = {name: shape.column(name, getattr(self, name), "N") for name in ("width", "height", "time")}
        columns["xyz"] = shape.column("xyz", self.xyz, "N 3")
        columns["role"] = shape.column("role", self.role, "N", np.uint8)
        columns["layer"] = shape.column("layer", self.layer, "N", np.int32)
        set_columns(self, **columns)


@dataclass(frozen=True)
class Mesh:
    vertices: Array                  # (V, 3) mm
    faces: Array                     # (F, 3) int
    fields: tuple[Field, ...] = ()   # of faces


@dataclass(frozen=True)
class Cells:
    """Cubes of one size around their middles."""

    centres: Array                   # (C, 3) mm
    size: Array                      # (3,) mm
    fields: tuple[Field, ...] = ()


@dataclass(frozen=True)
class Scene:
    title: str
    kind: str
    facts: Mapping[str, str] = field(default_factory=dict)    # shown beside, words: value
    robot: Robot | None = None
    moves: Moves | None = None
    mesh: Mesh | None = None
    cells: Cells | None = None
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()                               # sentences: what was checked, what was mended


# ---- toolpaths

def of_path(path: Toolpath) -> Moves:
    """The speed asked for, flow and bead of a path; time as if every move ran at the speed asked."""
    time = asked_time(path)
    fields = tuple(path_fields(path, time))
    return Moves(path.xyz, path.role, path.layer, path.width, path.height, time, "asked", fields)


def path_fields(path: Toolpath, time: Array) -> Iterator[Field]:
    moved = path.lengths > 0
    flow = np.where(moved, np.maximum(path.filament, 0), 0) * path.filament_area_mm2
    spent = np.diff(time, prepend=0.0)
    yield Field("asked_mm_s", "speed asked", "mm/s", np.where(moved, path.speed, 0.0))
    yield Field("flow_mm3_s", "flow", "mm³/s", flow / np.maximum(spent, 1e-9) * (spent > 0))
    yield Field("width_mm", "bead width", "mm", path.width, FAR)
    yield Field("layer_time_s", "layer time", "s", _layer_time(path.layer, spent), LOW)


def asked_time(path: Toolpath) -> Array:
    """(N,) s at the end of each move at the speed asked, dwells included, no acceleration."""
    length = path.lengths
    spent = np.where(length > 0, length, np.abs(path.filament)) / np.maximum(path.speed, 1e-9)
    spent[0] = 0.0
    dwell = path.events.kind == EventKind.DWELL
    np.add.at(spent, path.events.index[dwell], path.events.value[dwell])
    return np.cumsum(spent)


def _layer_time(layer: Array, spent: Array) -> Array:
    """(N,) s that the layer of each move takes in all."""
    low = int(layer.min(initial=0))
    return np.bincount(layer - low, spent)[layer - low]


# ---- layers without a path

def of_layers(layers: Sequence[Layer]) -> Moves:
    """The beads of layers in the order they are stored, joined by travel that nothing is known of; no time."""
    xyz, role, width, height, index = (np.concatenate(column) for column in zip(*map(_beads, layers), strict=True))
    moves = np.diff(xyz, axis=0, prepend=xyz[:1])
    length = np.cumsum(np.linalg.norm(moves, axis=1) * (role != Role.TRAVEL))
    return Moves(xyz, role, index, width, height, length, "", (Field("width_mm", "bead width", "mm", width, FAR),))


def _beads(layer: Layer) -> tuple[Array, ...]:
    """xyz, role, width, height, layer of the moves that draw the beads of one layer."""
    beads = layer.beads
    count = np.diff(beads.starts)
    keep = count > 0
    first, last = beads.starts[:-1][keep], beads.starts[1:][keep]
    closed = beads.closed[keep].astype(np.int64)
    each = count[keep] + closed
    begin = np.cumsum(each) - each
    within = np.arange(int(each.sum())) - np.repeat(begin, each)
    row = np.repeat(first, each) + within % np.repeat(last - first, each)
    role = np.where(within == 0, Role.TRAVEL, np.repeat(beads.role[keep], each)).astype(np.uint8)
    laid = role != Role.TRAVEL
    z = np.full((len(row), 1), layer.z_mm)
    constant = np.full(len(row), layer.index, np.int32)
    return (np.hstack((beads.points[row], z)), role, beads.width[row] * laid, layer.height_mm * laid, constant)


# ---- what carries no moves

def of_mesh(vertices: Array, faces: Array) -> Mesh:
    """A part, with how far each face overhangs: 0 deg upright or facing up, 90 deg facing down."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    down = np.degrees(np.arcsin(np.clip(-normal[:, 2] / np.where(length > 0, length, 1.0), 0.0, 1.0)))
    return Mesh(vertices, faces, (Field("overhang_deg", "overhang", "deg", down),))


def of_grid(nodes: tuple[Array, Array, Array], inside: Array, maps: Mapping[str, tuple[str, str, Array]], shift: Array,
            ) -> Cells:
    """Cells of a grid (X, Y, Z) that are inside; `maps` by key: what it is called, its unit, its values (X, Y, Z).

    shift (3,) mm is taken off the nodes: the bed's middle.
    """
    at = np.nonzero(inside)
    centres = np.stack([axis[place] for axis, place in zip(nodes, at, strict=True)], axis=1) - shift
    size = np.array([np.diff(axis).mean() if len(axis) > 1 else 1.0 for axis in nodes])
    fields = tuple(Field(key, label, unit, np.nan_to_num(values[at]), LOW)
                   for key, (label, unit, values) in maps.items())
    return Cells(centres, size, fields)


def facts_of(numbers: Mapping[str, Any], shown: Mapping[str, tuple[str, Any]]) -> dict[str, str]:
    """Words and values of those `numbers` that `shown` (key: words, how it is said) has."""
    return {words: show(numbers[key]) for key, (words, show) in shown.items() if key in numbers}
