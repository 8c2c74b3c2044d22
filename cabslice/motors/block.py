"""Consecutive rows of a motor stream, and how they are cut and joined. Symbols as in motors.stream."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns


@dataclass(frozen=True)
class Block:
    """Consecutive rows from `row` on."""

    row: int
    angle: Array                # (n, m) rad
    velocity: Array             # (n, m) rad/s
    torque: Array               # (n, m) N mm
    tension: Array              # (n, m) N, planned
    filament: Array             # (n,) mm since the start
    move: Array | None = None   # (n,) int64, row of the toolpath
    feed: Array | None = None   # (n,) mm/s of filament: (filament[i+1] - filament[i-1]) / 2T

    def __post_init__(self) -> None:
        shape = Shapes("Block")
        names = ("angle", "velocity", "torque", "tension")
        columns = {name: shape.column(name, getattr(self, name), "n m") for name in names}
        columns["filament"] = shape.column("filament", self.filament, "n")
        if self.move is not None:
            columns["move"] = shape.column("move", self.move, "n", np.int64)
        if self.feed is not None:
            columns["feed"] = shape.column("feed", self.feed, "n")
        set_columns(self, **columns)

    def __len__(self) -> int:
        return len(self.filament)


def present(block: Block) -> dict[str, Array]:
    """The columns a block has, in order."""
    columns = {field.name: getattr(block, field.name) for field in fields(block) if field.name != "row"}
    return {name: column for name, column in columns.items() if column is not None}


def rechunk(blocks: Iterable[Block], size: int) -> Iterator[Block]:
    """The same rows in blocks of `size`, the last one shorter."""
    waiting: list[Block] = []
    for block in blocks:
        waiting.append(block)
        while sum(map(len, waiting)) >= size:
            whole = waiting[0] if len(waiting) == 1 else joined(waiting)
            waiting = [cut(whole, size, len(whole))] if len(whole) > size else []
            yield cut(whole, 0, size)
    if waiting:
        yield joined(waiting)


def cut(block: Block, start: int, stop: int) -> Block:
    """Rows start:stop of a block."""
    if (start, stop) == (0, len(block)):
        return block
    return Block(block.row + start, **{name: column[start:stop] for name, column in present(block).items()})


def joined(blocks: list[Block]) -> Block:
    columns = {name: np.concatenate([getattr(block, name) for block in blocks]) for name in present(blocks[0])}
    return Block(blocks[0].row, **columns)
