"""The volcano as a picture: how high can be printed over each place of the bed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cabslice.arrays import Array
from cabslice.files import atomic


def save_volcano(radius: Array, height: Array, size: Array, path: str | Path, *, title: str, overwrite: bool) -> None:
    """PNG: printable height over the bed of size (2,) mm, from cylinders radius (N,), height (N,) around its middle."""
    from matplotlib.figure import Figure

    x, y = (np.linspace(-side / 2, side / 2, 201) for side in size)
    away = np.hypot(*np.meshgrid(x, y))
    over = np.append(height, 0.0)[np.searchsorted(radius, away)]
    figure = Figure(figsize=(11, 5))
    plan, side = figure.subplots(1, 2)
    drawn = plan.pcolormesh(x, y, np.where(over > 0, over, np.nan), shading="nearest", rasterized=True)
    plan.set(aspect="equal", xlabel="x mm", ylabel="y mm", title="printable height over the bed, mm")
    figure.colorbar(drawn, ax=plan)
    side.step(np.append(0, radius), np.append(height[:1], height), where="pre")
    side.set(xlabel="radius mm", ylabel="height mm", title="tallest centred cylinder", ylim=(0, None))
    figure.suptitle(title)
    figure.tight_layout()
    with atomic(path, overwrite) as file:
        figure.savefig(file, format="png", dpi=110, metadata={"Software": None})
