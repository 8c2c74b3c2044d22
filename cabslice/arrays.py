"""Shape-checked, read-only arrays: what frozen values are made of.

A shape is written as in the docstrings: ``column(x, "K 3")`` wants two axes, the second of length 3; a letter
that comes back must mean the same length, so one `Shapes` is shared by the columns of one value.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


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
        if finite and array.dtype.kind == "f" and not np.isfinite(array).all():
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
