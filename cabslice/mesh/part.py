"""A part: a closed, outward-oriented triangle mesh and what was done to get it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns


@dataclass(frozen=True)
class Part:
    """vertices (V, 3) mm in bed coordinates (z = 0 on the bed); faces (F, 3) int, counter-clockwise from outside."""

    vertices: Array
    faces: Array
    name: str                       # file name without folder
    sha256: str                     # of the file
    repairs: tuple[str, ...] = ()   # sentences: what was changed
    warnings: tuple[str, ...] = ()  # sentences: what a user should know

    def __post_init__(self) -> None:
        shape = Shapes("Part")
        set_columns(
            self,
            vertices=shape.column("vertices", self.vertices, "V 3"),
            faces=shape.column("faces", self.faces, "F 3", np.int64),
        )

    @property
    def bounds(self) -> Array:
        """(2, 3) mm, lowest and highest corner."""
        return np.array([self.vertices.min(0), self.vertices.max(0)])
