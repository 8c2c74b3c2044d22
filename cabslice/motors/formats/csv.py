r"""Motor streams as text: a header of '# key: value' lines, a line of column names, then one line a row.

    # cabslice motor stream
    # cables: 8                         (keys sorted; values are JSON on one line)
    ...
    t_s,q1_rad,..,qd1_rad_s,..,tau1_n_m,..,f1_n,..,e_mm,ed_mm_s
    0.000000,12.345678901,...
    # rows: 512, crc32: 89abcdef        CRC-32 of every byte before this line

Numbers are decimal fixed point without padding, PLACES digits after the point; f is the planned tension, e the filament
fed since the start and ed its speed (absent where not known), the torque is in N m. The row of the toolpath (`move`) is
not in this format. Lines end in \n.

Digits are made for whole blocks at once: integers of value * 10^places are cut into groups of four digits, each looked
up in a table of characters; leading zeros and absent signs are NUL characters, dropped at the end.
"""

from __future__ import annotations

import itertools
import json
import zlib
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError, ProductError
from cabslice.motors.formats import writing
from cabslice.motors.formats.reading import damaged, opened
from cabslice.motors.formats.writing import BLOCK_ROWS, Rows, Sum
from cabslice.motors.statistics import StreamStatistics
from cabslice.motors.stream import SCHEMA, UNITS, Block, MotorStream

MAGIC = b"# cabslice motor stream\n"
PLACES = {"time": 6, "angle": 9, "velocity": 6, "torque": 6, "tension": 4, "filament": 5, "feed": 4}
N_M = 1e-3                   # N m per N mm
GROUP = np.uint64(10_000)
UNITS_HERE = {**UNITS, "torque": "N m"}
DIGITS = 17                  # of the integer value * 10^places, at most


def names(cables: int, *, feed: bool = True) -> list[str]:
    """Column names in order."""
    forms = ("q{}_rad", "qd{}_rad_s", "tau{}_n_m", "f{}_n")
    last = ["e_mm", "ed_mm_s"] if feed else ["e_mm"]
    return ["t_s", *(form.format(cable) for form in forms for cable in range(1, cables + 1)), *last]


# ---- writing

def write(stream: MotorStream, path: Any, **options: Any) -> StreamStatistics:
    """Write a stream (see writing.write for the options and errors)."""
    return writing.write(_Encoder(stream), stream, path, **options)


class _Encoder:
    name, of_all = "csv", "crc"

    def __init__(self, stream: MotorStream) -> None:
        self.stream = stream

    def paths(self, path: Path) -> list[Path]:
        return [path]

    def head(self, block: Block) -> list[bytes]:
        header = sorted({**self.stream.header, "units": UNITS_HERE}.items())
        words = [f"# {key}: {json.dumps(value, sort_keys=True, allow_nan=False)}\n" for key, value in header]
        columns = ",".join(names(self.stream.cables, feed=block.feed is not None)) + "\n"
        return [MAGIC + "".join((*words, columns)).encode("ascii")]

    def rows(self, rows: Rows) -> list[bytes]:
        return [lines(rows.block, self.stream.period_s)]

    def tail(self, sums: list[Sum]) -> list[bytes]:
        return [b"# rows: %d, crc32: %08x\n" % (self.stream.rows, sums[0].crc)]


def lines(block: Block, period_s: float) -> bytes:
    """The rows of a block as text."""
    columns = {
        "time": (block.row + np.arange(len(block)))[:, None] * period_s, "angle": block.angle,
        "velocity": block.velocity, "torque": block.torque * N_M, "tension": block.tension,
        "filament": block.filament[:, None],
    }
    if block.feed is not None:
        columns["feed"] = block.feed[:, None]
    texts = [decimals(column, PLACES[name]) for name, column in columns.items()]
    rows = np.concatenate(texts, axis=1)
    rows[:, -1] = ord("\n")
    return rows.tobytes().translate(None, b"\0")


def decimals(values: Array, places: int) -> Array:
    """(n, c) numbers as (n, c * width) characters, each number followed by a comma; NUL where nothing stands."""
    scaled = np.rint(values * 10.0**places)
    if not (np.abs(scaled) < 10.0 ** (DIGITS - 1)).all():
        raise OutputError(f"A value of {np.abs(values).max():.6g} is too large for {places} decimals in CSV.")
    integers = scaled.astype(np.int64)
    digits = _characters(np.abs(integers), places)
    out = np.zeros((*values.shape, digits.shape[-1] + 3), np.uint8)     # sign, point, comma
    out[..., 0] = np.where(integers < 0, ord("-"), 0)
    whole = digits.shape[-1] - places
    out[..., 1 : whole + 1] = digits[..., :whole]
    out[..., whole + 1] = ord(".")
    out[..., whole + 2 : -1] = digits[..., whole:]
    out[..., -1] = ord(",")
    return out.reshape(len(values), -1)


def _characters(integers: Array, places: int) -> Array:
    """(..., k) decimal digits of integers >= 0, leading zeros as NUL but for the last one before the point."""
    groups: list[Array] = []
    rest = integers.astype(np.uint64)
    while 4 * len(groups) <= places or rest.any():
        whole = rest // GROUP
        groups.append(_table()[rest - whole * GROUP])
        rest = whole
    text = np.stack(groups[::-1], axis=-1).view(np.uint8)
    head = text.shape[-1] - places - 1
    leading = np.logical_and.accumulate(text[..., :head] == ord("0"), axis=-1)
    text[..., :head][leading] = 0
    return text


@cache
def _table() -> Array:
    """(10000,) uint32: the four characters of 0000..9999."""
    return np.frombuffer(b"".join(b"%04d" % i for i in range(int(GROUP))), np.uint32)


# ---- reading

def read(path: Any) -> MotorStream:
    """A lazy stream: each pass reads the file a block of lines at a time.

    Raises ProductError at once where the header is wrong, and on the way where a line, the number of rows or the
    checksum is.
    """
    with opened(path) as file:
        header = _read_header(file, path)[0]
    return MotorStream({**header, "units": UNITS}, partial(_blocks, path))


def _blocks(path: Any) -> Iterator[Block]:
    with opened(path) as file:
        header, at, check, width = _read_header(file, path)
        cables, row = int(header["cables"]), 0
        while True:
            text = list(itertools.islice(file, BLOCK_ROWS))
            end = text.pop() if text and text[-1].startswith(b"#") else b""
            check = zlib.crc32(b"".join(text), check)
            if text:
                yield _block(_numbers(text, path, at + row, width), row, cables)
                row += len(text)
            if end or not text:
                break
        _finish(path, end, file.read(1), row, header["rows"], check)


def _finish(path: Any, end: bytes, after: bytes, row: int, rows: int, check: int) -> None:
    if not end:
        damaged(path, f"it is cut short: it ends after {row} of {rows} rows")
    if row != rows or end + after != b"# rows: %d, crc32: %08x\n" % (rows, check):
        damaged(path, f"its {row} rows are not the {rows} that were written, or a character of them was changed")


def _numbers(text: list[bytes], path: Any, line: int, width: int) -> Array:
    """(n, width) numbers of the lines from `line` on."""
    try:
        values = np.loadtxt(text, delimiter=",", ndmin=2, comments=None, encoding="ascii")
    except ValueError as error:
        damaged(path, f"of its {len(text)} lines from {line + 1} on one is not {width} numbers ({error})")
    if values.shape[1] != width or not np.isfinite(values).all():
        damaged(path, f"the lines from {line + 1} on hold {values.shape[1]} finite numbers each, expected {width}")
    return values


def _block(values: Array, row: int, cables: int) -> Block:
    angle, velocity, torque, tension = np.split(values[:, 1 : 4 * cables + 1], 4, axis=1)
    feed = values[:, 4 * cables + 2] if values.shape[1] > 4 * cables + 2 else None
    return Block(row, angle, velocity, torque / N_M, tension, values[:, 4 * cables + 1], feed=feed)


def _read_header(file: BinaryIO, path: Any) -> tuple[dict[str, Any], int, int, int]:
    """Header, number of lines and CRC up to the line of names, and the number of names."""
    if file.readline(len(MAGIC)) != MAGIC:
        sentence = f"{Path(path).name} is not a CSV motor stream: its first line is not {MAGIC.decode().strip()!r}."
        raise ProductError(sentence, file=Path(path).name)
    check, at, header = zlib.crc32(MAGIC), 1, {}
    for line in file:
        check, at = zlib.crc32(line, check), at + 1
        if not line.startswith(b"# "):
            break
        key, value = _key_value(line, path, at)
        header[key] = value
    if header.get("schema") != SCHEMA:
        damaged(path, f"it has schema {header.get('schema')}, this cabslice reads schema {SCHEMA}")
    if not all(isinstance(header.get(key), int) for key in ("rows", "cables")):
        damaged(path, "its header does not say how many rows and cables it has")
    known = (names(header["cables"], feed=feed) for feed in (True, False))
    widths = {(",".join(row) + "\n").encode(): len(row) for row in known}
    if line not in widths:
        damaged(path, f"line {at} is not the names of its columns")
    return header, at, check, widths[line]


def _key_value(line: bytes, path: Any, at: int) -> tuple[str, Any]:
    try:
        key, value = line.decode("ascii")[2:].split(": ", 1)
        return key, json.loads(value)
    except ValueError as error:
        damaged(path, f"line {at} is not '# key: value' ({error})")
