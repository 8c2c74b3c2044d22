r"""The `.stream` file: fixed-point columns, differenced, split into byte planes (file layout: see frames).

"layout" in the header holds columns [{name, channels, quantum}]: channels is the number of cables, or 1, and q the
quantum of a column: value = integer * q.

The inflated payload has for each column in order, C channels:
    8 * 2C bytes  int64 the first two integers of each channel (zeros where n < 2)
    1 byte        P, number of byte planes
    P C (n-2)     plane b holds byte b (lowest first) of z, channel after channel, where d[i] = x[i+2] - 2 x[i+1] + x[i]
                  and z = 2d for d >= 0, -2d - 1 for d < 0 ("zigzag")
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
LARGEST = 2.0**62            # integers beyond have no second difference in 64 bits
CABLE_ERROR_MM = 2e-6        # the angle quantum moves the cable by at most this
QUANTA = {"velocity": 2.0**-20, "torque": 2.0**-6, "tension": 2.0**-14, "filament": 2.0**-16,
          "feed": 2.0**-12, "move": 1.0}
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
    x = np.ascontiguousarray(_integers(values, column).reshape(len(values), -1).T)
    seeds = np.zeros((len(x), 2), "<i8")
    seeds[:, : x.shape[1]] = x[:, :2]
    yield seeds.tobytes()
    d = x[:, 2:] - 2 * x[:, 1:-1] + x[:, :-2] if x.shape[1] > 2 else x[:, :0]
    yield from planes(zigzag(d))


def _integers(values: Array, column: dict[str, Any]) -> Array:
    if values.dtype.kind == "i":
        return values.astype(np.int64, copy=False)
    scaled = np.rint(values * (1 / column["quantum"]))
    if len(scaled) and max(scaled.max(), -scaled.min()) >= LARGEST / 4:
        most = np.abs(values).max()
        raise OutputError(f"The {column['name']} column holds {most:.6g}: too large for the stream format.")
    return scaled.astype(np.int64)


def zigzag(d: Array) -> Array:
    """Integers with small sizes of either sign as small ones >= 0: 2d, or -2d - 1 below 0."""
    return (d << 1) ^ (d >> 63)


def planes(z: Array) -> Iterator[bytes]:
    """1 byte P, then P byte planes of integers >= 0, lowest first."""
    z = z.view(np.uint64)
    count = (int(z.max()).bit_length() + 7) // 8 if z.size else 0
    yield bytes([count])
    width = 4 if count <= 4 else 8
    raw = np.ascontiguousarray(z, f"<u{width}").view(np.uint8).reshape(-1, width)
    for plane in range(count):
        yield np.ascontiguousarray(raw[:, plane]).tobytes()


# ---- reading

def unpack(payload: memoryview, row: int, rows: int, told: dict[str, Any]) -> Block:
    """The block of a payload."""
    values, at = {}, 0
    for column in told["columns"]:
        x, at = _unpack_column(payload, at, rows, column["channels"])
        shaped = x.T if column["name"] not in SINGLE else x[0]
        values[column["name"]] = shaped if column["name"] == "move" else shaped * column["quantum"]
    return Block(row, **values)


def _unpack_column(payload: memoryview, at: int, rows: int, channels: int) -> tuple[Array, int]:
    seeds = np.frombuffer(payload, "<i8", 2 * channels, at).reshape(channels, 2)
    at += seeds.nbytes
    d, at = unzigzag(payload, at, channels, max(rows - 2, 0))
    x = np.zeros((channels, rows), np.int64)
    x[:, 2:] = d
    if rows > 1:                                    # undo the differences: once for the steps, once for the values
        x[:, 1] = seeds[:, 1] - seeds[:, 0]
        np.cumsum(x[:, 1:], axis=1, out=x[:, 1:])
    x[:, 0] = seeds[:, 0]
    np.cumsum(x, axis=1, out=x)
    return x, at


def unzigzag(payload: memoryview, at: int, channels: int, count: int) -> tuple[Array, int]:
    """Integers (channels, count) of the planes at byte `at`, and where the next thing begins."""
    size, deep = channels * count, payload[at]
    at += 1
    raw = np.zeros((size, 4 if deep <= 4 else 8), np.uint8)
    for plane in range(deep):
        raw[:, plane] = np.frombuffer(payload, np.uint8, size, at)
        at += size
    z = raw.view(f"<u{raw.shape[1]}").reshape(channels, -1).astype(np.uint64)
    return ((z >> np.uint64(1)) ^ (np.uint64(0) - (z & np.uint64(1)))).view(np.int64), at


CODEC = Codec("stream", MAGIC, 1, layout, pack, unpack)
write = partial(frames.write, CODEC)
read = partial(frames.read, CODEC)
rows = partial(frames.rows, CODEC)
