"""Columns of a toolpath as they come, layer by layer: few stay in memory, many go to temporary files without a name.

A column that went to a file is mapped from it, so that it is read like any other, and takes memory only where it was
read and not let go (arrays.let_go).
"""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Sequence
from typing import BinaryIO, cast

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError

HELD = 1 << 20   # rows that stay in memory


class Spool:
    """Blocks of columns, put end to end: add(block), and at the end columns()."""

    def __init__(self, names: Sequence[str], held: int = HELD) -> None:
        self.names, self.held, self.rows = names, held, 0
        self._blocks: list[dict[str, Array]] = []
        self._waiting = 0
        self._files: dict[str, BinaryIO] = {}

    def add(self, block: dict[str, Array]) -> None:
        """Raises OutputError where the folder for temporary files is full."""
        size = len(block[self.names[0]])
        self.rows, self._waiting = self.rows + size, self._waiting + size
        self._blocks.append(block)
        if self._waiting > self.held:
            self._write()

    def columns(self) -> dict[str, Array]:
        """Each column from end to end, of the types of the first block."""
        if not self._files:
            return {name: np.concatenate([block.pop(name) for block in self._blocks]) for name in self.names}
        like = self._blocks[-1] if self._blocks else self._last
        if self._blocks:
            self._write()
        return {name: _mapped(self._files[name], like[name], self.rows) for name in self.names}

    def _write(self) -> None:
        try:
            for name in self.names:
                if name not in self._files:
                    self._files[name] = cast(BinaryIO, tempfile.TemporaryFile())  # noqa: SIM115
                for block in self._blocks:
                    self._files[name].write(np.ascontiguousarray(block[name]).data)
                self._files[name].flush()
        except OSError as fault:
            raise OutputError(
                f"{tempfile.gettempdir()} has no room for the path in the making ({fault.strerror}): free some, or set "
                "TMPDIR to another folder."
            ) from fault
        self._last, self._blocks, self._waiting = self._blocks[-1], [], 0


def _mapped(file: BinaryIO, like: Array, rows: int) -> Array:
    content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(content, like.dtype).reshape(rows, *like.shape[1:])
