r"""Binary motor files: a header, frames of rows, an index; checked frame by frame, read from any row.

Layout, little-endian. CRC is CRC-32 (zlib).

    0    8   b"\x89STREAM\n" or b"\x89CUBICS\n": what the frames hold (see binary, hermite)
    8    4   uint32 layout version, 2
    12   4   uint32 H, length of the header
    16   H   header, JSON with sorted keys: that of the stream and, under "layout", block_rows and what the
             frames need to be read
    ..   4   uint32 CRC of everything before

    one frame for each block_rows rows (the last may be shorter):
    0    4   b"ROWS"
    4    8   uint64 first row
    12   4   uint32 n, rows in the frame
    16   4   uint32 Z, length of the payload
    20   Z   payload, as the kind of file says
    ..   4   uint32 CRC of the frame before

    trailer:
    0    4   b"DONE"
    4    4   uint32 B, frames
    8    8B  uint64 offset of each frame in the file
    ..   8   uint64 rows
    ..   4   uint32 CRC of the CRCs of header and frames in order, each as uint32
    ..   4   uint32 CRC of the trailer before
    ..   8   uint64 offset of the trailer
    ..   8   the first 8 bytes backwards

Every byte of the file is under a checksum or is compared, so one flipped bit is found and named with its rows.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from cabslice.errors import ProductError
from cabslice.motors.formats import writing
from cabslice.motors.formats.reading import damaged, opened
from cabslice.motors.formats.writing import BLOCK_ROWS, Rows, Sum
from cabslice.motors.statistics import StreamStatistics
from cabslice.motors.stream import SCHEMA, Block, MotorStream, cut

LAYOUT = 2
HEAD, FRAME, CRC, END = (struct.Struct(form) for form in ("<8sII", "<4sQII", "<I", "<QIIQ8s"))
ROWS, DONE = b"ROWS", b"DONE"


@dataclass(frozen=True)
class Codec:
    """What the frames of a kind of file hold."""

    name: str
    magic: bytes                                                          # 8
    layout: Callable[[Mapping[str, Any], Block], dict[str, Any]]          # for the header: what unpack needs
    pack: Callable[[Rows, dict[str, Any]], bytes]                         # the payload of a frame
    unpack: Callable[[memoryview, int, int, dict[str, Any]], Block]       # payload, first row, rows, layout
    finish: Callable[[Iterable[Block], Mapping[str, Any]], Iterable[Block]] = lambda blocks, header: blocks

    @property
    def tail(self) -> bytes:
        return self.magic[::-1]


# ---- writing

def write(codec: Codec, stream: MotorStream, path: Any, **options: Any) -> StreamStatistics:
    """Write a stream (see writing.write for the options and errors)."""
    return writing.write(_Encoder(codec, stream), stream, path, **options)


class _Encoder:
    of_all = ""

    def __init__(self, codec: Codec, stream: MotorStream) -> None:
        self.codec, self.stream, self.name = codec, stream, codec.name
        self.layout: dict[str, Any] = {}

    def paths(self, path: Path) -> list[Path]:
        return [path]

    def _known(self, block: Block) -> dict[str, Any]:
        self.layout = self.layout or self.codec.layout(self.stream.header, block)
        return self.layout

    def head(self, block: Block) -> list[bytes]:
        content = {**self.stream.header, "layout": {"block_rows": BLOCK_ROWS, **self._known(block)}}
        header = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
        return [_checked(HEAD.pack(self.codec.magic, LAYOUT, len(header)) + header)]

    def rows(self, rows: Rows) -> list[bytes]:
        payload = self.codec.pack(rows, self._known(rows.block))
        return [_checked(FRAME.pack(ROWS, rows.block.row, len(rows.block), len(payload)) + payload)]

    def tail(self, sums: list[Sum]) -> list[bytes]:
        return [_trailer(sums[0], self.stream.rows, self.codec.tail)]


def _checked(part: bytes) -> bytes:
    """Header or frame, and its checksum."""
    return part + CRC.pack(zlib.crc32(part))


def _trailer(known: Sum, rows: int, mark: bytes) -> bytes:
    """`known`: of the header, then of each frame."""
    places, total = known.ends[:-1], _sum_of([CRC.unpack(tip)[0] for tip in known.tips])
    body = DONE + struct.pack(f"<I{len(places)}QQI", len(places), *places, rows, total)
    return body + struct.pack("<IQ", zlib.crc32(body), known.size) + mark


def _sum_of(sums: list[int]) -> int:
    return zlib.crc32(struct.pack(f"<{len(sums)}I", *sums))


# ---- reading

def read(codec: Codec, path: Any) -> MotorStream:
    """A lazy stream: each pass reads and checks the file frame by frame.

    Raises ProductError at once for a file that is not ours, cut short or of another layout, and on the way for a
    damaged frame, naming its rows.
    """
    with opened(path) as file:
        header, _ = _read_header(codec, file, path)
        _read_trailer(codec, file, path)
    layout = header.pop("layout")


    def begin(first: int = 0) -> Iterable[Block]:
        return codec.finish(_blocks(codec, path, layout, first), header)

    return MotorStream(header, begin, lambda row, squares: begin(row // layout["block_rows"]))


def rows(codec: Codec, path: Any, start: int, stop: int) -> Iterator[Block]:
    """The rows start:stop of a file, by its index: nothing else of it is read. Raises ProductError as `read` does."""
    with opened(path) as file:
        layout = _read_header(codec, file, path)[0]["layout"]
        places, total, _ = _read_trailer(codec, file, path)
        size, stop = layout["block_rows"], min(stop, total)
        for number in range(max(start, 0) // size, -(-stop // size)):
            file.seek(places[number])
            block = _unpack(codec, _read_frame(file, path, number, number * size), layout)
            yield cut(block, max(start - block.row, 0), min(stop - block.row, len(block)))


def _blocks(codec: Codec, path: Any, layout: dict[str, Any], first: int = 0) -> Iterator[Block]:
    """The blocks from number `first` on; from the first one on the checksum of all is compared too."""
    with opened(path) as file:
        _, check = _read_header(codec, file, path)
        at, sums = file.tell(), [check]
        places, rows, total = _read_trailer(codec, file, path)
        at = places[first] if 0 < first < len(places) else at
        row = first * BLOCK_ROWS
        file.seek(at)
        for number, place in enumerate(places[first:], start=first):
            if file.tell() != place:
                damaged(path, f"block {number} of rows begins at byte {file.tell()}, not at {place} as its index says")
            frame = _read_frame(file, path, number, row)
            sums.append(CRC.unpack(frame[-CRC.size :])[0])
            block = _unpack(codec, frame, layout)
            row += len(block)
            yield block
        if row != rows or (not first and _sum_of(sums) != total):
            damaged(path, f"its {row} rows or their checksums are not the {rows} of its end")


def _read_header(codec: Codec, file: BinaryIO, path: Any) -> tuple[dict[str, Any], int]:
    head = file.read(HEAD.size)
    if head[:8] != codec.magic:
        raise ProductError(f"{Path(path).name} is not a .{codec.name} file of cabslice.", file=Path(path).name)
    if len(head) < HEAD.size:
        damaged(path, "it ends within its first 16 bytes")
    _, layout, length = HEAD.unpack(head)
    if layout != LAYOUT:
        damaged(path, f"it has layout {layout} at byte 8, this cabslice reads layout {LAYOUT}")
    body = file.read(length + CRC.size) if length < os.fstat(file.fileno()).st_size else b""
    if len(body) != length + CRC.size:
        damaged(path, f"it ends within its header (bytes 16 to {16 + length})")
    if zlib.crc32(head + body[:length]) != CRC.unpack(body[length:])[0]:
        damaged(path, f"its header (bytes 0 to {20 + length}) does not match its checksum")
    header = json.loads(body[:length])
    if header.get("schema") != SCHEMA:
        damaged(path, f"it has schema {header.get('schema')}, this cabslice reads schema {SCHEMA}")
    return header, CRC.unpack(body[length:])[0]


def _read_trailer(codec: Codec, file: BinaryIO, path: Any) -> tuple[tuple[int, ...], int, int]:
    """Offsets of the frames, rows, checksum of checksums."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - END.size, 0))
    end = file.read(END.size)
    if len(end) < END.size or not end.endswith(codec.tail):
        damaged(path, f"it is cut short: its end mark is not at byte {size - 8}")
    at = END.unpack(end)[3]
    if at + END.size > size:
        damaged(path, f"the place of its index (byte {size - 16}) is beyond its end")
    file.seek(at)
    body = file.read(size - at - 20)
    if body[:4] != DONE or zlib.crc32(body) != END.unpack(end)[2]:
        damaged(path, f"its index (bytes {at} to {size}) does not match its checksum")
    count = CRC.unpack_from(body, 4)[0]
    *places, rows, total = struct.unpack(f"<{count}QQI", body[8:])
    return tuple(places), rows, total


def _read_frame(file: BinaryIO, path: Any, number: int, row: int) -> bytes:
    at = file.tell()
    head = file.read(FRAME.size)
    where = f"block {number} of rows (from row {row}, byte {at})"
    if len(head) < FRAME.size or head[:4] != ROWS:
        damaged(path, f"{where} has no head")
    _, first, _, length = FRAME.unpack(head)
    if length > os.fstat(file.fileno()).st_size:
        damaged(path, f"{where} is longer than the file")
    frame = head + file.read(length + CRC.size)
    if zlib.crc32(frame[: -CRC.size]) != CRC.unpack(frame[-CRC.size :])[0]:
        damaged(path, f"{where} does not match its checksum")
    if first != row:
        damaged(path, f"{where} holds the rows from {first} on")
    return frame


def _unpack(codec: Codec, frame: bytes, layout: dict[str, Any]) -> Block:
    """The block of a frame whose checksum is right."""
    _, row, rows, length = FRAME.unpack_from(frame)
    return codec.unpack(memoryview(frame)[FRAME.size : FRAME.size + length], row, rows, layout)
