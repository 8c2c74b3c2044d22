"""LinuxCNC halstreamer: one line a sample, numbers separated by blanks, as many as the streamer has pins.

    q1..qm deg, [qd1..qdm deg/s,] tau1..taum N m, e mm, ed mm/s
A HAL stream has at most 21 pins: velocities are left out where there is no room for them. Load the component with
``loadrt streamer cfg=CFG``, CFG as in the sidecar ("cfg"), and run it in a thread of the stream's period.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.motors.formats import table
from cabslice.motors.formats.csv import decimals
from cabslice.motors.formats.table import DEGREES, N_M, Table
from cabslice.motors.formats.twincat_fifo import per_rad
from cabslice.motors.formats.writing import Rows, feed_of

PINS = 21
PLACES = {"angle": 9, "velocity": 7, "torque": 6, "filament": 6, "feed": 5}


def _held(header: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns there are pins for."""
    cables = int(header["cables"])
    if 2 * cables + 2 > PINS:
        raise UsageError(f"halstreamer carries {PINS} pins, {cables} winders need {2 * cables + 2}: use another.")
    return tuple(PLACES) if 3 * cables + 2 <= PINS else tuple(name for name in PLACES if name != "velocity")


refuse = _held


def encode(rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block, held = rows.block, _held(header)
    feed = feed_of(rows, float(header["period_s"]))
    values = {"angle": block.angle * DEGREES, "velocity": block.velocity * DEGREES, "torque": block.torque * N_M,
              "filament": block.filament[:, None], "feed": feed[:, None]}
    text = np.concatenate([decimals(values[name], PLACES[name]) for name in held], axis=1)
    text[:, -1] = ord("\n")
    return [text.tobytes().translate(bytes.maketrans(b",", b" "), b"\0")]


def decode(parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    values = np.loadtxt(parts[0].decode("ascii").splitlines(), ndmin=2, comments=None)
    found: dict[str, Array] = {}
    at = 0
    for name in _held(header):
        wide = int(header["cables"]) if name in ("angle", "velocity", "torque") else 1
        column = values[:, at : at + wide]
        found[name] = column if wide > 1 or name in ("angle", "velocity", "torque") else column[:, 0]
        at += wide
    found["angle"], found["torque"] = found["angle"] / DEGREES, found["torque"] / N_M
    if "velocity" in found:
        found["velocity"] = found["velocity"] / DEGREES
    return found


def columns(header: Mapping[str, Any]) -> list[str]:
    forms = {"angle": "q{}_deg", "velocity": "qd{}_deg_s", "torque": "tau{}_n_m"}
    wide = [forms[name].format(i + 1) for name in _held(header) if name in forms for i in range(header["cables"])]
    return [*wide, "e_mm", "ed_mm_s"]


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    half = {name: 0.51 * 10.0 ** -PLACES[name] for name in _held(header)}
    found: dict[str, Any] = {"angle": np.full(header["cables"], half["angle"] / DEGREES),
                             "torque": half["torque"] / N_M, "feed": half["feed"]}
    return found | ({"velocity": half["velocity"] / DEGREES} if "velocity" in half else {})


def about(header: Mapping[str, Any]) -> dict[str, Any]:
    return {"cfg": "f" * len(columns(header))}


TABLE = Table("halstreamer", ("samples",), encode, decode, columns, per_rad, "deg", misses, about=about)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
