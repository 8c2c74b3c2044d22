"""The volcano as a picture: how high can be printed over each place of the bed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cabslice.arrays import Array
from cabslice.view import charts

NODES = 201      # along each side of the bed


def save_volcano(radius: Array, height: Array, size: Array, path: str | Path, *, title: str, overwrite: bool) -> None:
    """Printable height over the bed of size (2,) mm, from cylinders radius (N,), height (N,) around its middle.

    PNG or SVG by the suffix.
    """
    x, y = (np.linspace(-side / 2, side / 2, NODES) for side in size)
    away = np.hypot(x[:, None], y)
    over = np.append(height, 0.0)[np.searchsorted(radius, away)]
    over = np.where(over > 0, over, np.nan)
    figure = charts.height_map(x, y, over, label="printable height, mm", title=title, lines=False)
    charts.save(figure, path, overwrite=overwrite)
