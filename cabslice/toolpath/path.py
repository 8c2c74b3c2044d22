"""The toolpath: one row per move into a point, in bed coordinates (z = 0 on the bed)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cabslice.arrays import SPAN, Array, Shapes, set_columns, spans
from cabslice.slicing.flow import bead_area, bead_spacing

__all__ = ["EventKind", "Events", "Toolpath", "bead_area", "bead_spacing", "piece_starts"]


class EventKind(IntEnum):
    """Values are stored in files: never renumber.

    Temperatures, fan and MIN_PRINT_SPEED hold from their row until the next event of their kind. DWELL, PAUSE and
    FILAMENT_CHANGE happen once, with the nozzle at rest: their row begins a piece (or is 0).

    MIN_LAYER_TIME stands at the first row of a layer (the rows with one value of `layer`) and speaks of that layer
    alone: it is to take at least so long from the start of its first row to the end of its last, dwells, pauses and
    filament changes not counted. Whoever plans the time slows the beads of a layer that would be shorter (travels and
    filament moves keep their speed), but no bead below MIN_PRINT_SPEED, nor at all where less was asked for it; what
    then still lacks is waited at the layer's end.
    """

    NOZZLE_TEMPERATURE = 1   # degC
    BED_TEMPERATURE = 2      # degC
    FAN = 3                  # 0..1
    DWELL = 4                # s
    PAUSE = 5                # - the user goes on
    MIN_LAYER_TIME = 6       # s
    FILAMENT_CHANGE = 7      # - the user changes the filament and goes on
    MIN_PRINT_SPEED = 8      # mm/s


RESTS = (EventKind.DWELL, EventKind.PAUSE, EventKind.FILAMENT_CHANGE)


@dataclass(frozen=True)
class Events:
    """What happens just before move `index` starts: index (E,), kind (E,) EventKind, value (E,)."""

    index: Array
    kind: Array
    value: Array

    def __post_init__(self) -> None:
        shape = Shapes("Events")
        set_columns(
            self,
            index=shape.column("index", self.index, "E", np.int64),
            kind=shape.column("kind", self.kind, "E", np.uint8),
            value=shape.column("value", self.value, "E"),
        )

    @staticmethod
    def none() -> Events:
        return Events(np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class Toolpath:
    """Columns, one row per move *into* a point.

    Row 0 is where the nozzle starts: zero length, no filament, Role.TRAVEL. Moves starts[p]:starts[p+1] are piece p:
    the nozzle starts and ends each piece at rest. Row 0 belongs to no piece, so starts[0] == 1 and starts[-1] == N.
    A piece either moves the nozzle in each of its moves, or is a single move of zero length that only moves
    filament (retract < 0, prime > 0).
    """

    xyz: Array        # (N, 3) mm, nozzle tip, bed coordinates
    filament: Array   # (N,) mm fed during the move; < 0 draws back
    width: Array      # (N,) mm, bead width; 0 in travels
    height: Array     # (N,) mm, bead height; 0 in travels
    speed: Array      # (N,) mm/s asked of the nozzle; of the filament in moves of zero length
    role: Array       # (N,) uint8, slicing.layer.Role
    layer: Array      # (N,) int32
    object: Array     # (N,) int32
    starts: Array     # (P+1,) int64
    events: Events
    filament_diameter_mm: float
    source: str = ""  # name and hash of what it was made from

    def __post_init__(self) -> None:
        shape = Shapes("Toolpath")
        set_columns(
            self,
            xyz=shape.column("xyz", self.xyz, "N 3"),
            filament=shape.column("filament", self.filament, "N"),
            width=shape.column("width", self.width, "N"),
            height=shape.column("height", self.height, "N"),
            speed=shape.column("speed", self.speed, "N"),
            role=shape.column("role", self.role, "N", np.uint8),
            layer=shape.column("layer", self.layer, "N", np.int32),
            object=shape.column("object", self.object, "N", np.int32),
            starts=shape.column("starts", self.starts, "P+1", np.int64),
        )

    @property
    def lengths(self) -> Array:
        """(N,) mm, length of each move; 0 in row 0."""
        return np.concatenate(([0.0], np.linalg.norm(np.diff(self.xyz, axis=0), axis=1)))

    def lengths_of(self, low: int, high: int) -> Array:
        """(high - low,) mm, of these moves alone."""
        before = self.xyz[max(low - 1, 0):high]
        return np.concatenate((np.zeros(0 if low else 1), np.linalg.norm(np.diff(before, axis=0), axis=1)))

    def spans(self, size: int = SPAN) -> Iterator[tuple[int, int]]:
        """Moves low..high after one another: a path that is longer than memory is gone through so."""
        return spans(len(self.role), *self.columns, size=size)

    @property
    def columns(self) -> tuple[Array, ...]:
        return self.xyz, self.filament, self.width, self.height, self.speed, self.role, self.layer, self.object

    @property
    def filament_area_mm2(self) -> float:
        return float(np.pi / 4 * self.filament_diameter_mm**2)


def piece_starts(rests: Array) -> Array:
    """The `starts` (P + 1,) of a toolpath in which the moves `rests` (N,) bool stand still: each is a piece of its own.

    rests[0] is of no account: row 0 belongs to no piece.
    """
    still = np.flatnonzero(rests[1:]) + 1
    return np.unique(np.concatenate(([1], still, still + 1, [len(rests)])))
