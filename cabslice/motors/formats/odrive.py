"""ODrive set-points: NAME.odrive, for each row and axis the 8 bytes of the CAN message Set_Input_Pos (command 0x00C).

    float32   Input_Pos, turns                int16   Vel_FF, 0.001 turns/s              int16   Torque_FF, 0.001 N m
Little-endian, winder 1..m, then the extruder: float32 mm of filament, int16 0.01 mm/s, int16 0. Row after row, no head.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.formats import table
from cabslice.motors.formats.table import Table, integers
from cabslice.motors.formats.writing import Rows, feed_of

RECORD = np.dtype([("position", "<f4"), ("velocity", "<i2"), ("torque", "<i2")])
TURN = 2 * np.pi
VELOCITY, TORQUE, FEED = 1e-3 * TURN, 1.0, 1e-2     # rad/s, N mm and mm/s of filament per integer


def encode(rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block = rows.block
    feed = feed_of(rows, float(header["period_s"]))
    out = np.zeros((len(block), block.angle.shape[1] + 1), RECORD)
    out["position"][:, :-1], out["position"][:, -1] = block.angle / TURN, block.filament
    out["velocity"][:, :-1] = integers(block.velocity / VELOCITY, "<i2", "The velocity in 0.001 turns/s")
    out["velocity"][:, -1] = integers(feed / FEED, "<i2", "The feed in 0.01 mm/s")
    out["torque"][:, :-1] = integers(block.torque / TORQUE, "<i2", "The torque in 0.001 N m")
    return [out.tobytes()]


def decode(parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    values = np.frombuffer(parts[0], RECORD).reshape(-1, int(header["cables"]) + 1)
    position, velocity = values["position"].astype(float), values["velocity"].astype(float)
    return {"angle": position[:, :-1] * TURN, "filament": position[:, -1], "velocity": velocity[:, :-1] * VELOCITY,
            "feed": velocity[:, -1] * FEED, "torque": values["torque"][:, :-1] * TORQUE}


def columns(header: Mapping[str, Any]) -> list[str]:
    return [*(f"Set_Input_Pos of winder {i + 1}" for i in range(header["cables"])), "extruder"]


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    """float32 has 24 bits: the error follows the largest angle the winders hold."""
    angle = table.largest_angles(header) * 2.0**-24
    return {"angle": angle, "velocity": VELOCITY / 2, "torque": TORQUE / 2, "feed": FEED / 2}


def per_rad(header: Mapping[str, Any]) -> Array:
    return np.full(header["cables"], 1 / TURN)


TABLE = Table("odrive", ("set-points",), encode, decode, columns, per_rad, "turns", misses)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
