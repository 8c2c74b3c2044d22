"""How every format is written: block by block, each a step that a later run can go on from, then the whole named.

An Encoder turns blocks into bytes; it knows nothing of files. Rows go to it in blocks of BLOCK_ROWS, so what it makes
of them depends on nothing but the rows.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.files import STDOUT, Unfinished, atomic
from cabslice.motors.statistics import StreamStatistics, Tally
from cabslice.motors.stream import Block, MotorStream, cut, rechunk

BLOCK_ROWS = 8192
Progress = Callable[[int], None]


@dataclass
class Sum:
    """What is known of a file so far."""

    of_all: str = ""                                     # "crc" or "sha": what is wanted of all bytes
    size: int = 0
    crc: int = 0
    sha: Any = field(default_factory=hashlib.sha256)
    ends: list[int] = field(default_factory=list)        # of head and blocks
    crcs: list[int] = field(default_factory=list)        # of head and blocks, each by itself
    tips: list[bytes] = field(default_factory=list)      # last four bytes of head and blocks

    def add(self, part: bytes) -> None:
        self.size += len(part)
        if self.of_all == "crc":
            self.crc = zlib.crc32(part, self.crc)
        elif self.of_all == "sha":
            self.sha.update(part)
        self.ends.append(self.size)
        self.crcs.append(zlib.crc32(part))
        self.tips.append(part[-4:])


@dataclass(frozen=True)
class Rows:
    """A block with the rows on either side of it; at the ends of the stream the motion is mirrored."""

    block: Block
    before: Block
    after: Block


class Encoder(Protocol):
    """Bytes for one or more files. `sums` are those of its files, head and blocks first."""

    name: str
    of_all: str             # see Sum

    def paths(self, path: Path) -> list[Path]:
        """The files, the one that is asked for first; with a sidecar, that one last."""

    def head(self, block: Block) -> list[bytes]: ...

    def rows(self, rows: Rows) -> list[bytes]: ...

    def tail(self, sums: list[Sum]) -> list[bytes]: ...


def write(
    encoder: Encoder, stream: MotorStream, path: Any, *, overwrite: bool = False, progress: Progress | None = None,
    resume: bool = False,
) -> StreamStatistics:
    """Write a stream under `path` once it is whole ("-": standard output) and return the statistics of its rows.

    `progress` is told the rows written so far. With `resume` the whole blocks of a run that was killed are kept, and
    those of this one, should it be stopped. Raises OutputError, and what going through the stream raises.
    """
    tell = progress or (lambda rows: None)
    tally = Tally(stream.period_s)
    if str(path) == STDOUT:
        return _to_stdout(encoder, stream, tally, tell)
    paths = encoder.paths(Path(path))
    sums = [Sum(encoder.of_all) for _ in paths]
    with Unfinished(paths, _key(encoder, stream), overwrite=overwrite, resume=resume) as work:
        def take(parts: list[bytes], note: Any) -> None:
            _add(sums, parts)
            tally.restore(note)

        work.found(take)
        tell(tally.rows)
        for parts in _steps(encoder, stream, tally, headed=bool(sums[0].ends)):
            _add(sums, parts)
            work.step(parts, tally.note(), [known.crcs[-1] for known in sums])
            tell(tally.rows)
        work.finish(encoder.tail(sums))
    return tally.result()


def _to_stdout(encoder: Encoder, stream: MotorStream, tally: Tally, tell: Progress) -> StreamStatistics:
    sums = [Sum(encoder.of_all) for _ in encoder.paths(Path("x"))]
    if len(sums) > 1:
        raise UsageError(f"{encoder.name} is more than one file and cannot go to standard output: give -o FILE.")
    with atomic(STDOUT) as file:
        for parts in _steps(encoder, stream, tally, headed=False):
            _add(sums, parts)
            file.write(parts[0])
            tell(tally.rows)
        file.write(encoder.tail(sums)[0])
    return tally.result()


def _add(sums: list[Sum], parts: list[bytes]) -> None:
    for known, part in zip(sums, parts, strict=True):
        known.add(part)


def _key(encoder: Encoder, stream: MotorStream) -> str:
    """Whether two runs would write the same bytes."""
    text = json.dumps([encoder.name, dict(stream.header)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _steps(encoder: Encoder, stream: MotorStream, tally: Tally, *, headed: bool) -> Iterator[list[bytes]]:
    """The bytes of head and blocks not yet written; each is in the tally when it is handed out."""
    for rows in neighbours(_blocks(stream, tally), tally.rows):
        if not headed:
            yield encoder.head(rows.block)
            headed = True
        tally.add(rows.block)
        yield encoder.rows(rows)
    if tally.rows != stream.rows:
        raise ValueError(f"the header says {stream.rows} rows, the blocks held {tally.rows}")


def _blocks(stream: MotorStream, tally: Tally) -> Iterator[Block]:
    """Blocks of BLOCK_ROWS from the last one in the tally on."""
    blocks: Iterable[Block] = stream
    if stream.later is not None and tally.last:
        blocks = stream.later(tally.last, tally.squares_before)
    return rechunk(_from_row(blocks, tally.last), BLOCK_ROWS)


def _from_row(blocks: Iterable[Block], row: int) -> Iterator[Block]:
    for block in blocks:
        if block.row + len(block) > row:
            yield cut(block, max(row - block.row, 0), len(block))


def neighbours(blocks: Iterable[Block], first: int = 0) -> Iterator[Rows]:
    """Every block from row `first` on, with the row before and the row after it; `first` begins a block."""
    before: Block | None = None
    held: Block | None = None
    for block in blocks:
        if held is not None and held.row >= first:
            yield Rows(held, before or _mirror(held, 1), cut(block, 0, 1))
        before = cut(held, len(held) - 1, len(held)) if held is not None else None
        held = block
    if held is not None and held.row >= first:
        after = cut(held, len(held) - 2, len(held) - 1) if len(held) > 1 else before or held
        yield Rows(held, before or _mirror(held, 1), after)


def _mirror(block: Block, row: int) -> Block:
    row = min(row, len(block) - 1)
    return cut(block, row, row + 1)


def feed_of(rows: Rows, period_s: float) -> Array:
    """Speed (n,) mm/s of the filament: as given, else the difference of what was fed."""
    if rows.block.feed is not None:
        return rows.block.feed
    return differences(rows.before.filament, rows.block.filament, rows.after.filament, period_s)[0]


def differences(before: Array, values: Array, after: Array, period_s: float) -> tuple[Array, Array]:
    """First and second central differences (n, ...) of rows between `before` (1, ...) and `after` (1, ...)."""
    whole = np.concatenate((before, values, after))
    return (whole[2:] - whole[:-2]) / (2 * period_s), (whole[2:] - 2 * values + whole[:-2]) / period_s**2
