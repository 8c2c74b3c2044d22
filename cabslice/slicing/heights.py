"""Where the layers lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns

BELOW = 1e-6   # mm: planes lie this far under the middle, so that not rounding decides where faces in the plane belong


@dataclass(frozen=True)
class Heights:
    """top (L,) above the bed, height (L,), plane (L,) where the outline is cut: the middle of the beads; all mm."""

    top: Array
    height: Array
    plane: Array

    def __post_init__(self) -> None:
        shape = Shapes("Heights")
        set_columns(self, **{name: shape.column(name, getattr(self, name), "L") for name in ("top", "height", "plane")})


def layer_heights(part_mm: float, first_mm: float, layer_mm: float) -> Heights:
    """Layers of a part (part_mm high): the first, then equal ones as long as their middle is still inside the part.

    So the print ends within half a layer of the part. A part lower than half the first layer gets that one layer,
    cut at half its own height.
    """
    more = max(0, int(np.ceil((part_mm - first_mm) / layer_mm - 0.5 - 1e-9)))
    top = first_mm + layer_mm * np.arange(more + 1)
    height = np.full(more + 1, float(layer_mm))
    height[0] = first_mm
    plane = top - height / 2
    plane[0] = min(plane[0], part_mm / 2)
    plane -= min(BELOW, plane[0] / 2)
    return Heights(top, height, plane)
