"""Stiffness, natural frequencies and tensions of a few poses, as bars side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.files import atomic
from cabslice.robot.model import Robot

PARTS = {"k_cable_": ("cables stretch", "#0072b2"), "k_lat_": ("cables swing", "#e69f00"),
         "k_force_": ("levers turn", "#cc79a7")}     # colours: Okabe & Ito 2008
BAR, LINE = "#0072b2", "#d55e00"
NUMBERED = 8          # poses whose bars carry their number


def save_picture(
    robot: Robot, columns: Mapping[str, Array], names: Sequence[str], path: str | Path, *, title: str,
    overwrite: bool = False,
) -> None:
    """Draw columns as view.stiffness.of_held gives them, K poses called `names`, into a PNG. Raises OutputError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 8), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 6)
    _stiffness(figure.add_subplot(grid[0, :3]), columns, "trans_kn_m", "xyz", "translation, kN/m")
    _stiffness(figure.add_subplot(grid[0, 3:5]), columns, "rot_n_m_deg", "xy", "rotation, N m/deg")
    _stiffness(figure.add_subplot(grid[0, 5]), columns, "rot_n_m_deg", "  z", "rotation, N m/deg")
    figure.axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=len(PARTS), fontsize="small")
    _modes(figure.add_subplot(grid[1, :3]), columns["modes_hz"])
    _tensions(figure.add_subplot(grid[1, 3:]), robot, columns["tensions_n"])
    listed = [f"{i}: {name}" for i, name in enumerate(names[:NUMBERED], start=1)]
    listed += [f"... {len(names)} in all"] if len(names) > NUMBERED else []
    figure.supxlabel("\n".join(["pose: x y z mm, psi theta phi deg", *listed]), fontsize="small")
    figure.suptitle(title, fontsize="medium")
    with atomic(path, overwrite) as file:
        figure.savefig(file, format="png", dpi=120)


def _stiffness(axes: Any, columns: Mapping[str, Array], unit: str, ways: str, label: str) -> None:
    """Parts of the diagonal stacked, negative ones downwards; a blank in `ways` leaves that direction out."""
    chosen = [i for i, way in enumerate(ways) if way != " "]
    above, below = np.zeros((2, len(columns[f"k_{unit}"]), len(chosen)))
    for prefix, (name, colour) in PARTS.items():
        part = columns[f"{prefix}{unit}"][:, chosen]
        _bars(axes, part, colour, bottom=np.where(part >= 0, above, below), label=name)
        above, below = above + np.maximum(part, 0), below + np.minimum(part, 0)
    _label(axes, [ways[i] for i in chosen], len(above))
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set_ylabel(label)


def _modes(axes: Any, hertz: Array) -> None:
    bars = _bars(axes, hertz, BAR)
    if len(hertz) == 1:
        axes.bar_label(bars, fmt="%.1f", padding=2, fontsize="small")
    _label(axes, [f"mode {i + 1}" for i in range(hertz.shape[1])], len(hertz))
    axes.set_ylabel("natural frequency, Hz")


def _tensions(axes: Any, robot: Robot, tension: Array) -> None:
    bars = _bars(axes, tension, BAR)
    if len(tension) == 1:
        axes.bar_label(bars, fmt="%.1f", padding=2, fontsize="small")
    _label(axes, [f"{i + 1}" for i in range(tension.shape[1])], len(tension))
    for bound in (robot.tension_min.min(), robot.tension_max.max()):
        axes.axhline(bound, color=LINE, linewidth=1, linestyle="--")
    axes.set(ylabel="tension, N (dashed: bounds)", xlabel="cable")


def _bars(axes: Any, values: Array, colour: str, **more: Any) -> Any:
    """Groups of K bars, values (K, n)."""
    bottom = more.pop("bottom", np.zeros_like(values))
    places = _places(*values.shape).ravel()
    return axes.bar(places, values.ravel(), width=0.85, color=colour, bottom=bottom.ravel(), **more)


def _places(poses: int, groups: int) -> Array:
    """Where the bars stand (K, n): groups with a gap of one bar between."""
    return np.arange(poses)[:, None] + (poses + 1.0) * np.arange(groups)


def _label(axes: Any, groups: Sequence[str], poses: int) -> None:
    """Names below the groups; where there are several poses but not many, their numbers below the bars."""
    places, numbered = _places(poses, len(groups)), 1 < poses <= NUMBERED
    axes.set_xticks(places.mean(axis=0), [f"\n{name}" if numbered else name for name in groups])
    axes.tick_params(axis="x", which="both", length=0)
    if numbered:
        axes.xaxis.remove_overlapping_locs = False       # else the middle bar loses its number to the group's name
        numbers = np.broadcast_to(np.arange(1, poses + 1)[:, None], places.shape)
        axes.set_xticks(places.ravel(), numbers.ravel().astype(str), minor=True, fontsize="x-small")
    axes.spines[["top", "right"]].set_visible(False)
