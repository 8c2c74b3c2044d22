"""Apache Parquet, for those who analyse: one column a channel, float64, a row group for each block of rows.

Columns as in csv, the torque in N m, and `move` where it is known. The header of the stream is JSON under the key
"cabslice" of the file's metadata, with "crc32": CRC-32 of the float64 columns of all blocks, one after the other.
Needs pyarrow (``pip install cabslice[parquet]``). Written at one go: a run that was killed begins anew.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ProductError, UsageError
from cabslice.files import atomic
from cabslice.motors.formats.csv import N_M, names
from cabslice.motors.formats.reading import damaged
from cabslice.motors.formats.writing import BLOCK_ROWS
from cabslice.motors.statistics import StreamStatistics, Tally, observed
from cabslice.motors.stream import SCHEMA, Block, MotorStream, rechunk

KEY, SUM = b"cabslice", b"cabslice.crc32"


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise UsageError("The format parquet needs pyarrow: pip install pyarrow, or take another --format.") from error
    return pyarrow


def refuse(header: Any) -> None:
    _pyarrow()


def write(
    stream: MotorStream, path: Any, *, overwrite: bool = False, progress: Callable[[int], None] | None = None,
    resume: bool = False,
) -> StreamStatistics:
    """Write a stream (see writing.write for the options and errors). Raises UsageError where pyarrow is missing."""
    arrow, tally = _pyarrow(), Tally(stream.period_s)
    tell = progress or (lambda rows: None)
    with atomic(path, overwrite) as file:
        blocks = rechunk(observed(stream, tally), BLOCK_ROWS)
        first = next(blocks)
        schema, check = _schema(arrow, _columns(first, stream.period_s)), 0
        with arrow.parquet.ParquetWriter(
            file, schema, compression="zstd", use_dictionary=False, write_statistics=False, write_page_checksum=True,
            store_schema=False, use_byte_stream_split=True,
        ) as writer:
            for block in chain([first], blocks):
                columns = _columns(block, stream.period_s)
                writer.write_table(arrow.table(list(columns.values()), schema=schema), row_group_size=BLOCK_ROWS)
                check = _sum(columns, check)
                tell(tally.rows)
            if tally.rows != stream.rows:
                raise ValueError(f"the header says {stream.rows} rows, the blocks held {tally.rows}")
            header = json.dumps(dict(stream.header), sort_keys=True, allow_nan=False)
            writer.add_key_value_metadata({KEY: header.encode(), SUM: str(check).encode()})
    return tally.result()


def _columns(block: Block, period_s: float) -> dict[str, Array]:
    """Columns by name, float64, `move` int64."""
    groups = [(block.row + np.arange(len(block)))[:, None] * period_s, block.angle, block.velocity, block.torque * N_M,
              block.tension, block.filament[:, None]]
    groups += [] if block.feed is None else [block.feed[:, None]]
    flat = [np.ascontiguousarray(column) for group in groups for column in group.T]
    found = dict(zip(names(block.angle.shape[1], feed=block.feed is not None), flat, strict=True))
    return found | ({} if block.move is None else {"move": block.move})


def _schema(arrow: Any, columns: dict[str, Array]) -> Any:
    wide = {"i": arrow.int64(), "f": arrow.float64()}
    return arrow.schema([(name, wide[column.dtype.kind]) for name, column in columns.items()])


def _sum(columns: dict[str, Array], check: int) -> int:
    for column in columns.values():
        check = zlib.crc32(np.ascontiguousarray(column).view(np.uint8).data, check)
    return check


def read(path: Any) -> MotorStream:
    """A lazy stream, row group by row group. Raises ProductError for a file that is damaged or not ours."""
    arrow = _pyarrow()
    with _opened(arrow, path) as file:
        told = file.metadata.metadata or {}
        header = _header(path, told.get(KEY))
        if file.metadata.num_rows != header["rows"]:
            damaged(path, f"it has {file.metadata.num_rows} rows, its header says {header['rows']}")
    return MotorStream(header, partial(_blocks, arrow, path, header))


def _opened(arrow: Any, path: Any) -> Any:
    try:
        return arrow.parquet.ParquetFile(path, page_checksum_verification=True)
    except (OSError, arrow.ArrowException) as error:
        damaged(path, f"it is not whole ({str(error).splitlines()[0]})")


def _header(path: Any, text: bytes | None) -> dict[str, Any]:
    name = Path(path).name
    if text is None:
        raise ProductError(f"{name} is a Parquet file, but not a motor stream of cabslice.", file=name)
    try:
        header = json.loads(text)
    except ValueError as error:
        damaged(path, f"its header is not JSON ({error})")
    if header.get("schema") != SCHEMA:
        damaged(path, f"it has schema {header.get('schema')}, this cabslice reads schema {SCHEMA}")
    return dict(header)


def _blocks(arrow: Any, path: Any, header: dict[str, Any]) -> Iterator[Block]:
    row, check = 0, 0
    with _opened(arrow, path) as file:
        for number in range(file.num_row_groups):
            try:
                table = file.read_row_group(number)
            except (OSError, arrow.ArrowException) as error:
                damaged(path, f"block {number} of rows (from row {row}): {str(error).splitlines()[0]}")
            columns = {name: table[name].to_numpy() for name in table.column_names}
            check = _sum(columns, check)
            yield _block(path, row, int(header["cables"]), columns)
            row += table.num_rows
        told = (file.metadata.metadata or {}).get(SUM, b"")
        if (str(check).encode(), row) != (told, header["rows"]):
            damaged(path, f"its {row} rows are not those whose checksum it holds")


def _block(path: Any, row: int, cables: int, columns: dict[str, Array]) -> Block:
    known = names(cables, feed="ed_mm_s" in columns)
    if list(columns)[: len(known)] != known:
        damaged(path, "its columns are not those of a motor stream")
    angle, velocity, torque, tension = (
        np.stack([columns[name] for name in known[1 + cables * i : 1 + cables * (i + 1)]], axis=1) for i in range(4)
    )
    filament, feed, move = columns["e_mm"], columns.get("ed_mm_s"), columns.get("move")
    return Block(row, angle, velocity, torque / N_M, tension, filament, move, feed)
