r"""The `.stream` file: fixed-point columns, differenced, split into byte planes, deflated, checked block by block.

Layout, little-endian. CRC is CRC-32 (zlib). q is a column's quantum: value = integer * q.

    0    8   b"\x89STREAM\n"
    8    4   uint32 layout version, 1
    12   4   uint32 H, length of the header
    16   H   header, JSON with sorted keys: that of the stream and, under "layout", block_rows and columns
             [{name, channels, quantum}]; channels is the number of cables, or 1
    ..   4   uint32 CRC of everything before

    one frame for each block_rows rows (the last may be shorter):
    0    4   b"ROWS"
    4    8   uint64 first row
    12   4   uint32 n, rows in the frame
    16   4   uint32 Z, length of the payload
    20   Z   payload, deflated (zlib)
    ..   4   uint32 CRC of the frame before

    trailer:
    0    4   b"DONE"
    4    4   uint32 B, frames
    8    8B  uint64 offset of each frame in the file
    ..   8   uint64 rows
    ..   4   uint32 CRC of the CRCs of header and frames in order, each as uint32
    ..   4   uint32 CRC of the trailer before
    ..   8   uint64 offset of the trailer
    ..   8   b"\nMAERTS\x89"

The inflated payload has for each column in order, C channels:
    8 * 2C bytes  int64 the first two integers of each channel (zeros where n < 2)
    1 byte        P, number of byte planes
    P C (n-2)     plane b holds byte b (lowest first) of z, channel after channel, where d[i] = x[i+2] - 2 x[i+1] + x[i]
                  and z = 2d for d >= 0, -2d - 1 for d < 0 ("zigzag")

Every byte of the file is under a checksum or is compared, so one flipped bit is found and named with its rows.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError, ProductError
from cabslice.files import atomic
from cabslice.motors.statistics import StreamStatistics, Tally, observed
from cabslice.motors.stream import SCHEMA, Block, MotorStream, present, rechunk

MAGIC, TAIL, LAYOUT = b"\x89STREAM\n", b"\nMAERTS\x89", 1
HEAD, FRAME, CRC, END = (struct.Struct(form) for form in ("<8sII", "<4sQII", "<I", "<QIIQ8s"))
ROWS, DONE = b"ROWS", b"DONE"
BLOCK_ROWS = 8192
LEVEL = 1
LARGEST = 2.0**62            # integers beyond have no second difference in 64 bits
CABLE_ERROR_MM = 2e-6        # the angle quantum moves the cable by at most this
QUANTA = {"velocity": 2.0**-20, "torque": 2.0**-6, "tension": 2.0**-14, "filament": 2.0**-16, "move": 1.0}
AGAIN = "; export it again."


def quanta(header: Any) -> dict[str, float]:
    """Quantum of each column, in its own unit; that of the angle follows the largest winder radius in the header."""
    radius = float(header.get("largest_radius_mm", 100.0))
    return {"angle": 2.0 ** np.floor(np.log2(2 * CABLE_ERROR_MM / radius)), **QUANTA}


# ---- writing

def write(
    stream: MotorStream, path: Any, *, overwrite: bool = False, progress: Callable[[int], None] | None = None
) -> StreamStatistics:
    """Write a stream under `path` once it is whole ("-": standard output) and return the statistics of its rows.

    `progress` is told the rows of each block. Raises OutputError, and what going through the stream raises.
    """
    tally = Tally(stream.period_s)
    with atomic(path, overwrite) as file:
        out = _Out(file)
        for block in rechunk(observed(stream, tally), BLOCK_ROWS):
            if not out.places:
                columns = _columns(stream, block)
                out.put(_head(stream, columns))
            out.places.append(out.at)
            out.put(pack(block, columns))
            if progress:
                progress(tally.rows)
        if tally.rows != stream.rows:
            raise ValueError(f"the header says {stream.rows} rows, the blocks held {tally.rows}")
        file.write(_trailer(out, tally.rows))
    return tally.result()


@dataclass
class _Out:
    file: BinaryIO
    at: int = 0
    places: list[int] = field(default_factory=list)
    sums: list[int] = field(default_factory=list)

    def put(self, part: bytes) -> None:
        """Header or frame, and its checksum."""
        check = zlib.crc32(part)
        self.file.write(part + CRC.pack(check))
        self.sums.append(check)
        self.at += len(part) + CRC.size


def _columns(stream: MotorStream, block: Block) -> list[dict[str, Any]]:
    quantum = quanta(stream.header)
    sizes = {name: column.size // len(block) for name, column in present(block).items()}
    return [{"name": name, "channels": channels, "quantum": quantum[name]} for name, channels in sizes.items()]


def _head(stream: MotorStream, columns: list[dict[str, Any]]) -> bytes:
    content = {**stream.header, "layout": {"block_rows": BLOCK_ROWS, "columns": columns}}
    header = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    return HEAD.pack(MAGIC, LAYOUT, len(header)) + header


def _trailer(out: _Out, rows: int) -> bytes:
    body = DONE + struct.pack(f"<I{len(out.places)}QQI", len(out.places), *out.places, rows, _sum_of(out.sums))
    return body + struct.pack("<IQ", zlib.crc32(body), out.at) + TAIL


def _sum_of(sums: list[int]) -> int:
    return zlib.crc32(struct.pack(f"<{len(sums)}I", *sums))


def pack(block: Block, columns: list[dict[str, Any]]) -> bytes:
    """The frame of a block without its checksum. Raises OutputError where a value is too large for its quantum."""
    parts = [part for column in columns for part in _pack_column(getattr(block, column["name"]), column)]
    payload = zlib.compress(b"".join(parts), LEVEL)
    return FRAME.pack(ROWS, block.row, len(block), len(payload)) + payload


def _pack_column(values: Array, column: dict[str, Any]) -> Iterator[bytes]:
    x = np.ascontiguousarray(_integers(values, column).reshape(len(values), -1).T)
    seeds = np.zeros((len(x), 2), "<i8")
    seeds[:, : x.shape[1]] = x[:, :2]
    yield seeds.tobytes()
    d = x[:, 2:] - 2 * x[:, 1:-1] + x[:, :-2] if x.shape[1] > 2 else x[:, :0]
    yield from _planes((d << 1) ^ (d >> 63))


def _integers(values: Array, column: dict[str, Any]) -> Array:
    if values.dtype.kind == "i":
        return values.astype(np.int64, copy=False)
    scaled = np.rint(values * (1 / column["quantum"]))
    if len(scaled) and max(scaled.max(), -scaled.min()) >= LARGEST / 4:
        most = np.abs(values).max()
        raise OutputError(f"The {column['name']} column holds {most:.6g}: too large for the stream format.")
    return scaled.astype(np.int64)


def _planes(z: Array) -> Iterator[bytes]:
    z = z.view(np.uint64)
    count = (int(z.max()).bit_length() + 7) // 8 if z.size else 0
    yield bytes([count])
    width = 4 if count <= 4 else 8
    raw = np.ascontiguousarray(z, f"<u{width}").view(np.uint8).reshape(-1, width)
    for plane in range(count):
        yield np.ascontiguousarray(raw[:, plane]).tobytes()


# ---- reading

def read(path: Any) -> MotorStream:
    """A lazy stream: each pass reads and checks the file frame by frame.

    Raises ProductError at once for a file that is not ours, cut short or of another layout, and on the way for a
    damaged frame, naming its rows.
    """
    with _opened(path) as file:
        header, _ = _read_header(file, path)
        _read_trailer(file, path)
    layout = header.pop("layout")
    return MotorStream(header, partial(_blocks, path, layout["columns"]))


def _blocks(path: Any, columns: list[dict[str, Any]]) -> Iterator[Block]:
    with _opened(path) as file:
        _, check = _read_header(file, path)
        at, sums, row = file.tell(), [check], 0
        places, rows, total = _read_trailer(file, path)
        file.seek(at)
        for number, place in enumerate(places):
            if file.tell() != place:
                _damaged(path, f"block {number} of rows begins at byte {file.tell()}, not at {place} as its index says")
            frame = _read_frame(file, path, number, row)
            sums.append(CRC.unpack(frame[-CRC.size :])[0])
            block = unpack(frame, columns)
            row += len(block)
            yield block
        if (row, _sum_of(sums)) != (rows, total):
            _damaged(path, f"its {row} rows or their checksums are not the {rows} of its end")


def _opened(path: Any) -> BinaryIO:
    try:
        return open(path, "rb")
    except OSError as error:
        raise ProductError(f"{_name(path)} cannot be read: {error.strerror}.", file=_name(path)) from error


def _read_header(file: BinaryIO, path: Any) -> tuple[dict[str, Any], int]:
    head = file.read(HEAD.size)
    if head[: len(MAGIC)] != MAGIC:
        raise ProductError(f"{_name(path)} is not a .stream file of cabslice.", file=_name(path))
    if len(head) < HEAD.size:
        _damaged(path, "it ends within its first 16 bytes")
    _, layout, length = HEAD.unpack(head)
    if layout != LAYOUT:
        _damaged(path, f"it has layout {layout} at byte 8, this cabslice reads layout {LAYOUT}")
    body = file.read(length + CRC.size) if length < os.fstat(file.fileno()).st_size else b""
    if len(body) != length + CRC.size:
        _damaged(path, f"it ends within its header (bytes 16 to {16 + length})")
    if zlib.crc32(head + body[:length]) != CRC.unpack(body[length:])[0]:
        _damaged(path, f"its header (bytes 0 to {20 + length}) does not match its checksum")
    header = json.loads(body[:length])
    if header.get("schema") != SCHEMA:
        _damaged(path, f"it has schema {header.get('schema')}, this cabslice reads schema {SCHEMA}")
    return header, CRC.unpack(body[length:])[0]


def _read_trailer(file: BinaryIO, path: Any) -> tuple[tuple[int, ...], int, int]:
    """Offsets of the frames, rows, checksum of checksums."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - END.size, 0))
    end = file.read(END.size)
    if len(end) < END.size or not end.endswith(TAIL):
        _damaged(path, f"it is cut short: its end mark is not at byte {size - len(TAIL)}")
    at = END.unpack(end)[3]
    if at + END.size > size:
        _damaged(path, f"the place of its index (byte {size - 16}) is beyond its end")
    file.seek(at)
    body = file.read(size - at - 20)
    if body[:4] != DONE or zlib.crc32(body) != END.unpack(end)[2]:
        _damaged(path, f"its index (bytes {at} to {size}) does not match its checksum")
    count = CRC.unpack_from(body, 4)[0]
    *places, rows, total = struct.unpack(f"<{count}QQI", body[8:])
    return tuple(places), rows, total


def _read_frame(file: BinaryIO, path: Any, number: int, row: int) -> bytes:
    at = file.tell()
    head = file.read(FRAME.size)
    where = f"block {number} of rows (from row {row}, byte {at})"
    if len(head) < FRAME.size or head[:4] != ROWS:
        _damaged(path, f"{where} has no head")
    _, first, _, length = FRAME.unpack(head)
    if length > os.fstat(file.fileno()).st_size:
        _damaged(path, f"{where} is longer than the file")
    frame = head + file.read(length + CRC.size)
    if zlib.crc32(frame[: -CRC.size]) != CRC.unpack(frame[-CRC.size :])[0]:
        _damaged(path, f"{where} does not match its checksum")
    if first != row:
        _damaged(path, f"{where} holds the rows from {first} on")
    return frame


def unpack(frame: bytes, columns: list[dict[str, Any]]) -> Block:
    """The block of a frame whose checksum is right."""
    _, row, rows, length = FRAME.unpack_from(frame)
    payload = memoryview(zlib.decompress(memoryview(frame)[FRAME.size : FRAME.size + length]))
    values, at = {}, 0
    for column in columns:
        x, at = _unpack_column(payload, at, rows, column["channels"])
        shaped = x.T if column["name"] not in ("filament", "move") else x[0]
        values[column["name"]] = shaped if column["name"] == "move" else shaped * column["quantum"]
    return Block(row, **values)


def _unpack_column(payload: memoryview, at: int, rows: int, channels: int) -> tuple[Array, int]:
    seeds = np.frombuffer(payload, "<i8", 2 * channels, at).reshape(channels, 2)
    at += seeds.nbytes
    count, size = payload[at], channels * max(rows - 2, 0)
    at += 1
    raw = np.zeros((size, 4 if count <= 4 else 8), np.uint8)
    for plane in range(count):
        raw[:, plane] = np.frombuffer(payload, np.uint8, size, at)
        at += size
    z = raw.view(f"<u{raw.shape[1]}").reshape(channels, -1).astype(np.uint64)
    x = np.zeros((channels, rows), np.int64)
    x[:, 2:] = ((z >> np.uint64(1)) ^ (np.uint64(0) - (z & np.uint64(1)))).view(np.int64)
    if rows > 1:                                    # undo the differences: once for the steps, once for the values
        x[:, 1] = seeds[:, 1] - seeds[:, 0]
        np.cumsum(x[:, 1:], axis=1, out=x[:, 1:])
    x[:, 0] = seeds[:, 0]
    np.cumsum(x, axis=1, out=x)
    return x, at


def _name(path: Any) -> str:
    return Path(path).name


def _damaged(path: Any, what: str) -> NoReturn:
    raise ProductError(f"{_name(path)} is damaged: {what}{AGAIN}", file=_name(path))
