r"""The `.stream` file: fixed-point columns, differenced, packed into few bits (file layout: see frames).

"layout" in the header holds columns [{name, channels, quantum}]: channels is the number of cables, or 1, and q the
quantum of a column: value = integer * q.

The payload, stored as it is, has for each column in order, C channels, G = ceil((n - 2) / 64) groups of rows:
    8 * 2C bytes  int64 the first two integers x of each channel (zeros where n < 2)
    C G           uint8 w, bits of a number in each group, channel after channel
    8 sum(w)      uint64 words: for each group w of them, its 64 numbers of w bits each from the lowest bit on (the last
                  group is filled up with zeros); a number is z = 2d for d >= 0, -2d - 1 for d < 0 ("zigzag") of
                  d[i] = x[i] - 2 x[i-1] + x[i-2]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError
from cabslice.motors.formats import frames
from cabslice.motors.formats.frames import Codec
from cabslice.motors.formats.writing import Rows
from cabslice.motors.stream import Block, present

MAGIC = b"\x89STREAM\n"
CABLE_ERROR_MM = 2e-6        # the angle quantum moves the cable by at most this
QUANTA = {"velocity": 2.0**-16, "torque": 2.0**-4, "tension": 2.0**-12, "filament": 2.0**-14,
          "feed": 2.0**-10, "move": 1.0}
SINGLE = ("filament", "feed", "move")        # one channel whatever the number of cables


def quanta(header: Any) -> dict[str, float]:
    """Quantum of each column, in its own unit; that of the angle follows the largest winder radius in the header."""
    radius = float(header.get("largest_radius_mm", 100.0))
    return {"angle": 2.0 ** np.floor(np.log2(2 * CABLE_ERROR_MM / radius)), **QUANTA}


def layout(header: Mapping[str, Any], block: Block) -> dict[str, Any]:
    quantum = quanta(header)
    sizes = {name: column.size // len(block) for name, column in present(block).items()}
    columns = [{"name": name, "channels": channels, "quantum": quantum[name]} for name, channels in sizes.items()]
    return {"columns": columns}


# ---- writing

def pack(rows: Rows, told: dict[str, Any]) -> bytes:
    """The payload of a block. Raises OutputError where a value is too large for its quantum."""
    columns = [(getattr(rows.block, column["name"]), column) for column in told["columns"]]
    return b"".join(part for values, column in columns for part in _pack_column(values, column))


def _pack_column(values: Array, column: dict[str, Any]) -> Iterator[bytes]:
    from cabslice.motors.formats import packing

    values = values.reshape(len(values), -1)
    channels, groups = values.shape[1], _groups(len(values))
    seeds, widths = np.zeros((channels, 2), np.int64), np.zeros((channels, groups), np.uint8)
    words = np.empty(channels * groups * packing.GROUP, np.uint64)
    used = packing.pack(values, column["quantum"], seeds, widths, words)
    if used < 0:
        most = np.abs(values).max()
        raise OutputError(f"The {column['name']} column holds {most:.6g}: too large for the stream format.")
    yield seeds.astype("<i8", copy=False).tobytes()
    yield widths.tobytes()
    yield words[:used].astype("<u8", copy=False).tobytes()


def _groups(rows: int) -> int:
    return -(-max(rows - 2, 0) // 64)


# ---- reading

def unpack(payload: memoryview, row: int, rows: int, told: dict[str, Any]) -> Block:
    """The block of a payload."""
    values, at = {}, 0
    for column in told["columns"]:
        x, at = _unpack_column(payload, at, rows, column["channels"])
        shaped = x if column["name"] not in SINGLE else x[:, 0]
        values[column["name"]] = shaped if column["name"] == "move" else shaped * column["quantum"]
    return Block(row, **values)


def _unpack_column(payload: memoryview, at: int, rows: int, channels: int) -> tuple[Array, int]:
    from cabslice.motors.formats import packing

    groups = _groups(rows)
    seeds = np.frombuffer(payload, "<i8", 2 * channels, at).reshape(channels, 2).astype(np.int64)
    at += seeds.nbytes
    widths = np.frombuffer(payload, np.uint8, channels * groups, at).reshape(channels, groups)
    at += widths.nbytes
    used = int(widths.sum(dtype=np.int64))
    words = np.frombuffer(payload, "<u8", used, at).astype(np.uint64)
    out = np.empty((rows, channels), np.int64)
    packing.unpack(seeds, widths.copy(), words, out)
    return out, at + 8 * used


CODEC = Codec("stream", MAGIC, layout, pack, unpack)
write = partial(frames.write, CODEC)
read = partial(frames.read, CODEC)
rows = partial(frames.rows, CODEC)
