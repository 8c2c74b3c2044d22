"""Text for a PLC that feeds MC_ExtSetPointGenFeed every cycle: a line of names, then a line a row, comma-separated.

    q1_deg,qd1_deg_s,qdd1_deg_s2,tau1_n_m, ... for each winder, then e_mm,ed_mm_s,edd_mm_s2 of the filament
Fixed point, PLACES digits after the point; lines end in \\r\\n. Everything else is in the sidecar (see table).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.formats import table
from cabslice.motors.formats.csv import decimals
from cabslice.motors.formats.table import DEGREES, N_M, Table
from cabslice.motors.formats.twincat_fifo import per_rad
from cabslice.motors.formats.writing import Rows, differences, feed_of

PLACES = {"position": 9, "velocity": 7, "acceleration": 4, "torque": 6, "e": 6, "ed": 5, "edd": 4}


def encode(rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block, period = rows.block, float(header["period_s"])
    bend = differences(rows.before.angle, block.angle, rows.after.angle, period)[1]
    change = differences(rows.before.filament, block.filament, rows.after.filament, period)[1]
    axes = {"position": block.angle * DEGREES, "velocity": block.velocity * DEGREES, "acceleration": bend * DEGREES,
            "torque": block.torque * N_M}
    words = [decimals(column, PLACES[name]).reshape(*column.shape, -1) for name, column in axes.items()]
    winders = np.concatenate(words, axis=2).reshape(len(block), -1)
    last = {"e": block.filament, "ed": feed_of(rows, period), "edd": change}
    ends = [decimals(column[:, None], PLACES[name]) for name, column in last.items()]
    ends[-1][:, -1] = ord("\r")
    text = np.concatenate((winders, *ends, np.full((len(block), 1), ord("\n"), np.uint8)), axis=1)
    return [text.tobytes().translate(None, b"\0")]


def decode(parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    cables = int(header["cables"])
    values = np.loadtxt(parts[0].decode("ascii").splitlines(), delimiter=",", ndmin=2, comments=None)
    angle, velocity, _, torque = np.moveaxis(values[:, : 4 * cables].reshape(len(values), cables, 4), 2, 0)
    return {"angle": angle / DEGREES, "velocity": velocity / DEGREES, "torque": torque / N_M,
            "filament": values[:, 4 * cables], "feed": values[:, 4 * cables + 1]}


def columns(header: Mapping[str, Any]) -> list[str]:
    forms = ("q{}_deg", "qd{}_deg_s", "qdd{}_deg_s2", "tau{}_n_m")
    return [*(form.format(i + 1) for i in range(header["cables"]) for form in forms), "e_mm", "ed_mm_s", "edd_mm_s2"]


def head(header: Mapping[str, Any]) -> bytes:
    return (",".join(columns(header)) + "\r\n").encode()


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    half = {name: 0.51 * 10.0**-places for name, places in PLACES.items()}
    return {"angle": np.full(header["cables"], half["position"] / DEGREES), "velocity": half["velocity"] / DEGREES,
            "torque": half["torque"] / N_M, "feed": half["ed"]}


TABLE = Table("twincat-csv", ("set-points",), encode, decode, columns, per_rad, "deg", misses, head)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
