"""Charts in one style, from plain arrays: readable at the width of a column, safe for the colour-blind, units on axes.

Each function takes arrays and gives a matplotlib Figure; `save` writes it as PNG or SVG (by suffix), `svg` gives text.
Lines are told apart by colour and by dash.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.files import atomic
from cabslice.view.picture import COLOURS

WIDTH = 4.6                 # inches: a column of a page
LINE, BOUND, FILL = "#0072b2", "#d55e00", "#56b4e9"
DASHES = ("-", "--")
STYLE: Any = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e3e7ec",
    "grid.linewidth": 0.6, "axes.axisbelow": True, "axes.edgecolor": "#5b6b7b", "axes.linewidth": 0.8,
    "lines.linewidth": 1.0, "legend.frameon": False, "legend.fontsize": 8, "axes.titlesize": 9, "axes.labelsize": 9,
    "svg.fonttype": "none", "svg.hashsalt": "cabslice", "path.simplify_threshold": 0.5,
}
MOST = 3000                 # points of a line: the least and the greatest of each stretch are kept


def thinned(along: Array, values: Array, most: int = MOST) -> tuple[Array, Array]:
    """The curve values (K,) over along (K,) with at most about `most` points, extremes of every stretch among them."""
    if len(along) <= most:
        return along, values
    edges = np.linspace(0, len(along), most // 2 + 1).astype(np.int64)
    spans = pairwise(edges.tolist())
    kept = [(a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))) for a, b in spans]
    rows = np.unique(np.array(kept))
    return along[rows], values[rows]


# ---- along a print

def over_time(along: Array, lines: Mapping[str, Array], label: str, *, bounds: Sequence[float] = (),
              xlabel: str = "time, s", title: str = "") -> Any:
    """Columns (K,) by name over along (K,); `bounds` are dashed. Tension over time, a velocity profile, modes."""
    figure, axes = _figure(0.5, title)
    for i, (name, values) in enumerate(lines.items()):
        colour = LINE if len(lines) == 1 else COLOURS[i % len(COLOURS)]
        dash = DASHES[i // len(COLOURS) % 2]
        x, y = thinned(np.asarray(along), np.asarray(values))
        axes.plot(x, y, color=colour, linestyle=dash, linewidth=0.8, label=name)
    for bound in bounds:
        axes.axhline(bound, color=BOUND, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set(xlabel=xlabel, ylabel=label)
    axes.margins(x=0.01)
    _legend(axes, len(lines))
    return figure


def velocity_profile(time: Array, speed: Array, asked: Array | None = None, *, title: str = "") -> Any:
    """Speed (K,) mm/s over time (K,) s, and the speed asked for where it is given."""
    lines = {"planned": speed} | ({} if asked is None else {"asked": asked})
    figure = over_time(time, lines, "nozzle speed, mm/s", title=title)
    figure.axes[0].set_ylim(bottom=0)
    return figure


def tensions(time: Array, tension: Array, bounds: Sequence[float] = (), *, title: str = "") -> Any:
    """Tensions (K, m) N over time (K,) s, with the bounds dashed."""
    lines = {f"{i + 1}": column for i, column in enumerate(np.asarray(tension).T)}
    return over_time(time, lines, "cable tension, N", bounds=bounds, title=title)


def histogram(edges: Array, share: Array, label: str, *, title: str = "") -> Any:
    """Shares (n,) in bins with edges (n + 1,)."""
    figure, axes = _figure(0.5, title)
    edges = np.asarray(edges)
    bins = {"align": "edge", "color": LINE, "edgecolor": "white", "linewidth": 0.5}
    axes.bar(edges[:-1], 100 * np.asarray(share), np.diff(edges), **bins)
    axes.set(xlabel=label, ylabel="share, %")
    return figure


def bars(values: Mapping[str, float], label: str, *, title: str = "") -> Any:
    """Lying bars by name, the longest on top."""
    rows = sorted(values.items(), key=lambda row: row[1])
    figure, axes = _figure(0.12 + 0.055 * max(len(rows), 3), title)
    axes.barh([name for name, _ in rows], [value for _, value in rows], color=LINE, height=0.7)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(label)
    return figure


# ---- over places

def error_map(xy: Array, error: Array, *, unit: str = "mm", title: str = "", label: str = "error") -> Any:
    """Errors (K,) at places xy (K, 2) mm, seen from above; the greatest is ringed and told."""
    figure, axes = _figure(0.85, title)
    xy, error = np.asarray(xy, float), np.asarray(error, float)
    order = np.argsort(error)                                     # the greatest are drawn last, over the others
    dots = axes.scatter(*xy[order].T, c=error[order], s=6, cmap="viridis", linewidths=0, rasterized=True)
    worst = int(np.argmax(error))
    axes.plot(*xy[worst], "o", color=BOUND, fillstyle="none", markersize=9)
    axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    figure.colorbar(dots, ax=axes, label=f"{label}, {unit}", shrink=0.85)
    axes.set_title("\n".join(filter(None, (title, f"greatest {error[worst]:.3g} {unit}"))))
    return figure


def ballbar(lines: Mapping[str, tuple[Array, Array]], nominal: float, *, title: str = "") -> Any:
    """Circles as they were made, by name: angle (K,) rad and radius (K,) mm. Deviation from `nominal` mm, magnified, as
    a polar plot after ISO 230-4; the nominal circle is dashed."""
    from matplotlib.figure import Figure

    with _styled():
        figure = Figure(figsize=(WIDTH, WIDTH), layout="constrained")
        axes: Any = figure.add_subplot(projection="polar")
        deviations = {name: 1e3 * (np.asarray(radius, float) - nominal) for name, (_, radius) in lines.items()}
        reach = max(float(np.abs(deviation).max()) for deviation in deviations.values()) or 1.0
        step = _round(reach / 2)
        turn = np.linspace(0, 2 * np.pi, 361)
        axes.plot(turn, np.zeros_like(turn), color=BOUND, linewidth=1.0, linestyle=(0, (4, 2)))
        for i, (name, deviation) in enumerate(deviations.items()):
            colour = LINE if len(lines) == 1 else COLOURS[i % len(COLOURS)]
            axes.plot(np.asarray(lines[name][0], float), deviation, color=colour, linewidth=1.0, label=name)
        axes.set_rlim(-4 * step, 3 * step)
        axes.set_rticks([-2 * step, 0, 2 * step])
        axes.set_rlabel_position(22.5)
        circularity = max(float(np.ptp(deviation)) for deviation in deviations.values())
        said = f"radius {nominal:g} mm, circularity {circularity:.3g} µm, rings {2 * step:g} µm apart"
        axes.set_title("\n".join(filter(None, (title, said))), fontsize=9, pad=12)
        if len(lines) > 1:
            figure.legend(loc="outside lower center", ncols=len(lines))
    return figure


def height_map(x: Array, y: Array, height: Array, *, label: str = "height, mm", title: str = "",
               base: float = 0.0, lines: bool = True) -> Any:
    """Heights (X, Y) mm over nodes x (X,) and y (Y,) mm: the volcano of what can be printed; nan is left empty.

    `lines` of equal height, where it is no staircase."""
    figure, axes = _figure(0.85, title)
    height = np.asarray(height, float)
    image = axes.pcolormesh(x, y, np.ma.masked_invalid(height).T, shading="nearest", cmap="viridis", rasterized=True,
                            vmin=base)
    known = np.where(np.isfinite(height), height, base)
    if lines and np.ptp(known) > 0 and min(known.shape) > 1:
        drawn = axes.contour(x, y, known.T, 6, colors="white", linewidths=0.6)
        axes.clabel(drawn, fontsize=7, fmt="%g")
    axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label=label, shrink=0.85)
    return figure


# ---- writing

def save(figure: Any, path: str | Path, *, overwrite: bool = False) -> None:
    """PNG or SVG by the suffix. Raises UsageError for another one, OutputError."""
    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise UsageError(f"{Path(path).name}: a chart is written as .png or .svg.")
    with atomic(path, overwrite) as file:
        file.write(_drawn(figure, kind))


def svg(figure: Any) -> str:
    """The chart as an <svg> element for a page; same arrays, same text."""
    text = _drawn(figure, "svg").decode()
    return re.sub(r"^.*?(?=<svg)", "", text, flags=re.S).replace("\n", " ")


def _drawn(figure: Any, kind: str) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    content = io.BytesIO()
    FigureCanvasAgg(figure)
    with _styled():
        figure.savefig(content, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else None)
    return content.getvalue()


def _styled() -> Any:
    from matplotlib import rc_context

    return rc_context(STYLE)


def _figure(shape: float, title: str) -> tuple[Any, Any]:
    """A figure one column wide and `shape` times as tall, and its axes."""
    from matplotlib.figure import Figure

    with _styled():
        figure = Figure(figsize=(WIDTH, WIDTH * shape), layout="constrained")
        axes = figure.add_subplot()
        axes.set_title(title)
    return figure, axes


def _legend(axes: Any, lines: int) -> None:
    if lines > 1:
        legend = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=1.2)
        for line in legend.get_lines():
            line.set_linewidth(2)


def _round(value: float) -> float:
    """The next of 1, 2, 5, 10, ... above."""
    ten = 10.0 ** np.floor(np.log10(value))
    return float(next(step for step in (ten, 2 * ten, 5 * ten, 10 * ten) if step >= value * (1 - 1e-9)))


