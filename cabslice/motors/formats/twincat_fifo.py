"""TwinCAT NC FIFO axes (TF5060): NAME.fifo, LREAL rows x axes, little-endian, row after row without any head.

    column 1..m   position of winder 1..m, degrees        column m+1   filament fed since the start, mm
The FIFO plays positions only. Feed-forward torque for the drives' additive torque command stands beside it, row by row:
NAME.torque.fifo, LREAL rows x m, N m.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.formats import table
from cabslice.motors.formats.table import DEGREES, N_M, Table
from cabslice.motors.formats.writing import Rows

ROUNDING = 2.0**-52


def encode(rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block = rows.block
    positions = np.column_stack((block.angle * DEGREES, block.filament))
    return [positions.astype("<f8").tobytes(), (block.torque * N_M).astype("<f8").tobytes()]


def decode(parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    cables = int(header["cables"])
    positions = np.frombuffer(parts[0], "<f8").reshape(-1, cables + 1)
    torque = np.frombuffer(parts[1], "<f8").reshape(-1, cables)
    return {"angle": positions[:, :-1] / DEGREES, "filament": positions[:, -1], "torque": torque / N_M}


def columns(header: Mapping[str, Any]) -> list[str]:
    return [*(f"q{i + 1}_deg" for i in range(header["cables"])), "e_mm"]


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    return {"angle": ROUNDING * table.largest_angles(header), "torque": 1e-9}


def per_rad(header: Mapping[str, Any]) -> Array:
    return np.full(header["cables"], DEGREES)


TABLE = Table("twincat-fifo", ("positions", "torque"), encode, decode, columns, per_rad, "deg", misses)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
