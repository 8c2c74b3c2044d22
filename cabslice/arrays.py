"""Shape-checked, read-only arrays: what frozen values are made of.

A shape is written as in the docstrings: ``column(x, "K 3")`` wants two axes, the second of length 3; a letter
that comes back must mean the same length, so one `Shapes` is shared by the columns of one value.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SPAN = 1 << 18   # rows looked at together


class Shapes:
    """Checks the columns of one value against each other.

    >>> shape = Shapes("Path")
    >>> shape.column("xyz", [[0, 0, 0]], "N 3").shape
    (1, 3)
    """

    def __init__(self, owner: str) -> None:
        self.owner = owner
        self.sizes: dict[str, int] = {}

    def column(self, name: str, values: Any, shape: str, dtype: Any = np.float64, *, finite: bool = True) -> Array:
        """A read-only contiguous copy-if-needed of `values`; ValueError names owner, column and what was expected."""
        array = np.ascontiguousarray(values, dtype=dtype)
        wanted = shape.split()
        if array.ndim != len(wanted):
            raise ValueError(f"{self.owner}.{name} has {array.ndim} axes, expected shape ({shape.replace(' ', ', ')})")
        for axis, (token, length) in enumerate(zip(wanted, array.shape, strict=True)):
            size = int(token) if token.isdigit() else self._size(token, length)
            if length != size:
                raise ValueError(f"{self.owner}.{name} has length {length} on axis {axis}, expected {token} = {size}")
        if finite and array.dtype.kind == "f" and not _is_finite(array):
            raise ValueError(f"{self.owner}.{name} holds a value that is not finite")
        if array.flags.writeable:
            array = array.view()
            array.flags.writeable = False
        return array

    def _size(self, token: str, length: int) -> int:
        letter, plus, more = token.partition("+")
        extra = int(more) if plus else 0
        return self.sizes.setdefault(letter, length - extra) + extra


def set_columns(value: Any, /, **columns: Array) -> None:
    """Store checked columns into a frozen dataclass from its __post_init__."""
    for name, column in columns.items():
        object.__setattr__(value, name, column)


def _is_finite(array: Array) -> bool:
    return all(np.isfinite(array[low:high]).all() for low, high in spans(len(array), array))


def spans(count: int, *columns: Array, size: int = SPAN) -> Iterator[tuple[int, int]]:
    """Begin and end of `size` rows after another, up to `count`; after each the columns are let go (see let_go)."""
    for low in range(0, count, size):
        yield low, min(low + size, count)
        let_go(*columns)


def let_go(*columns: Array) -> None:
    """Columns that are mapped from a file leave memory; they come back where they are asked for. Others stay."""
    for column in columns:
        base: Any = column
        while isinstance(base, np.ndarray):
            base = base.base
        base = base.obj if isinstance(base, memoryview) else base
        if isinstance(base, mmap.mmap) and hasattr(base, "madvise"):
            base.madvise(mmap.MADV_DONTNEED)
