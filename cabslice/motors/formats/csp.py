"""CiA 402 cyclic synchronous position: NAME.csp, int32 rows x columns, little-endian, row after row without any head.

    1..m         target position 0x607A, counts: motor angle / 2 pi x counts per turn
    m+1          filament fed since the start, um
    m+2..2m+1    velocity offset 0x60B1, counts/s                 2m+2         um/s of filament
    2m+3..3m+2   torque offset 0x60B2, 0.1 % of the rated torque (0x6076, here the continuous torque of the profile)
    3m+3..4m+2   planned cable tension, mN: not for the drive, but to supervise it with
Counts per turn are `encoder_counts_per_turn` of the header: the position unit the drives must be set to.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.motors.formats import table
from cabslice.motors.formats.table import Table, integers
from cabslice.motors.formats.writing import Rows, feed_of

MICRO, MILLI, PER_MILLE = 1e3, 1e3, 1e3


def per_rad(header: Mapping[str, Any]) -> Array:
    counts = header.get("encoder_counts_per_turn")
    if not counts:
        raise UsageError(
            "CiA 402 counts need the encoder: give cables.motor.counts_per_turn in the printer's profile, or "
            "-s cables.motor.counts_per_turn=1048576."
        )
    return np.array(counts) / (2 * np.pi)


refuse = per_rad


def _rated(header: Mapping[str, Any]) -> Array:
    return np.array(header["machine"]["winders"]["continuous_torque"])


def encode(rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block, scale = rows.block, per_rad(header)
    feed = feed_of(rows, float(header["period_s"]))
    parts = {
        "The target position in counts": block.angle * scale, "The filament in um": block.filament[:, None] * MICRO,
        "The velocity offset in counts/s": block.velocity * scale, "The feed in um/s": feed[:, None] * MICRO,
        "The torque offset": block.torque / _rated(header) * PER_MILLE, "The tension in mN": block.tension * MILLI,
    }
    return [np.hstack([integers(values, "<i4", what) for what, values in parts.items()]).tobytes()]


def decode(parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    m, scale = int(header["cables"]), per_rad(header)
    values = np.frombuffer(parts[0], "<i4").reshape(-1, 4 * m + 2)
    angle, fed, velocity, feed, torque, tension = np.split(values, (m, m + 1, 2 * m + 1, 2 * m + 2, 3 * m + 2), axis=1)
    return {"angle": angle / scale, "filament": fed[:, 0] / MICRO, "velocity": velocity / scale,
            "feed": feed[:, 0] / MICRO, "torque": torque / PER_MILLE * _rated(header), "tension": tension / MILLI}


def columns(header: Mapping[str, Any]) -> list[str]:
    every = range(1, header["cables"] + 1)
    return [*(f"q{i}_counts" for i in every), "e_um", *(f"qd{i}_counts_s" for i in every), "ed_um_s",
            *(f"tau{i}_permille_rated" for i in every), *(f"f{i}_mn" for i in every)]


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    half = 0.5 / per_rad(header)
    return {"angle": half, "velocity": float(half.max()), "torque": 0.5 * _rated(header) / PER_MILLE,
            "tension": 0.5 / MILLI, "feed": 0.5 / MICRO}


def about(header: Mapping[str, Any]) -> dict[str, Any]:
    return {"counts_per_turn": header["encoder_counts_per_turn"], "rated_torque_n_m": (_rated(header) / 1e3).tolist()}


TABLE = Table("csp", ("counts",), encode, decode, columns, per_rad, "counts", misses, about=about)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
