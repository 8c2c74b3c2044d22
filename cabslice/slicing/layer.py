"""What slicing makes: per layer an outline, and the beads that fill it, not yet in printing order."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns


class Role(IntEnum):
    """What a bead is for. Values are stored in files: never renumber."""

    TRAVEL = 0
    OUTER_WALL = 1
    INNER_WALL = 2
    SOLID_INFILL = 3
    TOP_SKIN = 4
    SPARSE_INFILL = 5
    BRIDGE = 6
    GAP_FILL = 7
    SKIRT = 8
    SUPPORT = 9
    SUPPORT_INTERFACE = 10
    IRONING = 11
    OVERHANG_WALL = 12
    CUSTOM = 13


@dataclass(frozen=True)
class Polygons:
    """Closed rings as columns: ring r is points[starts[r]:starts[r+1]], not repeating its first point.

    Counter-clockwise rings bound material, clockwise rings bound holes. points (N, 2) mm, starts (R+1,).
    """

    points: Array
    starts: Array

    def __post_init__(self) -> None:
        shape = Shapes("Polygons")
        set_columns(
            self,
            points=shape.column("points", self.points, "N 2"),
            starts=shape.column("starts", self.starts, "R", np.int64),
        )


@dataclass(frozen=True)
class Beads:
    """Lines to lay in one layer, as columns.

    Line b is points[starts[b]:starts[b+1]] (N, 2) mm; a closed line does not repeat its first point.
    width (N,) mm at each point (the segment *into* a point has that point's width); role (B,), closed (B,) bool;
    island (B,) int: which connected region of the layer it belongs to; -1 for what stands beside the part (skirt).
    height (B,) mm of beads that fill several layers from below; 0, or no column at all: as high as the layer.
    """

    points: Array
    starts: Array
    width: Array
    role: Array
    closed: Array
    island: Array
    height: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        shape = Shapes("Beads")
        height = self.height if len(self.height) else np.zeros(len(self.role))
        set_columns(
            self,
            points=shape.column("points", self.points, "N 2"),
            width=shape.column("width", self.width, "N"),
            starts=shape.column("starts", self.starts, "B+1", np.int64),
            role=shape.column("role", self.role, "B", np.uint8),
            closed=shape.column("closed", self.closed, "B", np.bool_),
            island=shape.column("island", self.island, "B", np.int32),
            height=shape.column("height", height, "B"),
        )


@dataclass(frozen=True)
class Layer:
    """One layer in bed coordinates: top at z_mm, height_mm thick; its outline, and the beads that fill it."""

    index: int
    z_mm: float
    height_mm: float
    outline: Polygons
    beads: Beads
