"""Maps over the workspace as pictures: each map in three slices, from above, from the front and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import UsageError
from cabslice.files import atomic
from cabslice.robot.model import Robot
from cabslice.robot.workspace import Grid

LABELS = {     # key of a map: what it is called, its unit, its colours (all of even lightness, safe for colour-blind)
    "margin_n": ("tension margin", "N", "viridis"), "closure_share": ("wrench closure", "share", "viridis"),
    "first_mode_hz": ("first natural frequency", "Hz", "plasma"),
    "stiffness_n_mm": ("nozzle's stiffness, softest direction", "N/mm", "cividis"),
    "cable_gap_mm": ("air between the nearest cables", "mm", "cividis"),
    "free_radius_mm": ("free radius around the bed's axis", "mm", "viridis"),
}
VIEWS = ((0, 1, "from above"), (0, 2, "from the front"), (1, 2, "from the side"))
PANEL = 3.2           # inches, width of a panel with its labels
OUTSIDE, MARK = "#dddddd", "#d55e00"
CUT: dict[str, Any] = {"color": "white", "linewidth": 0.7, "linestyle": ":"}


@dataclass(frozen=True)
class Chart:
    """One map: values on a grid, nan (or outside) where there is nothing to show."""

    key: str                       # of LABELS
    grid: Grid
    value: Array                   # (X, Y, Z)
    inside: Array | None = None    # (X, Y, Z) bool: shown there only, with an outline
    title: str = ""                # instead of what LABELS says
    cylinder: tuple[float, float, float, float, float] | None = None   # drawn: x, y, z of its foot, radius, height, mm
    through: tuple[float, float, float] | None = None    # mm, where it is cut; default: the middle of what is shown

    def __post_init__(self) -> None:
        shape = Shapes("Chart")
        set_columns(self, value=shape.column("value", self.value, "X Y Z", finite=False))
        if self.inside is not None:
            set_columns(self, inside=shape.column("inside", self.inside, "X Y Z", np.bool_))

    @property
    def shown(self) -> Array:
        """Values with nan where nothing is shown."""
        inside = np.isfinite(self.value) if self.inside is None else self.inside & np.isfinite(self.value)
        return np.where(inside, self.value, np.nan)


def save_picture(
    robot: Robot, charts: Sequence[Chart], path: str | Path, *, title: str, overwrite: bool = False
) -> None:
    """Draw the charts, one below the other, into a PNG. Raises OutputError; UsageError for a grid that is a line."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    heights = [_height(robot, chart) for chart in charts]
    across = max(len(_views(chart)) for chart in charts)
    figure = Figure(figsize=(max(7.0, 1.4 + PANEL * across), 0.8 + sum(heights)), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subfigures(len(charts), 1, squeeze=False, height_ratios=heights)[:, 0]
    for row, chart in zip(rows, charts, strict=True):
        _draw(row, robot, chart)
    figure.suptitle(title, fontsize="medium")
    with atomic(path, overwrite) as file:
        figure.savefig(file, format="png", dpi=120)


def _draw(figure: Any, robot: Robot, chart: Chart) -> None:
    from matplotlib.colors import Normalize

    values, cut, limits = chart.shown, _cut(chart), _limits(robot, chart.grid)
    name, unit, colours = LABELS[chart.key]
    known = values[np.isfinite(values)]
    norm = Normalize(known.min(), known.max()) if len(known) else Normalize(0, 1)     # one for all panels and the bar
    views = _views(chart)
    panels = figure.subplots(1, len(views), squeeze=False)[0]
    for axes, (across, up, where) in zip(panels, views, strict=True):
        off = 3 - across - up
        image = _slice(axes, chart, values, across, up, cut[off], {"cmap": colours, "norm": norm})
        _machine(axes, robot, chart.cylinder, across, up)
        axes.axvline(cut[across], **CUT)
        axes.axhline(cut[up], **CUT)
        axes.set(xlabel=f"{'xyz'[across]}, mm", ylabel=f"{'xyz'[up]}, mm", xlim=limits[across], ylim=limits[up])
        axes.set_title(f"{where}, cut at {'xyz'[off]} = {cut[off]:.0f} mm", fontsize="small")
        axes.set_aspect("equal")
        axes.locator_params(nbins=5)
    figure.colorbar(image, ax=panels, label=f"{name}, {unit}", shrink=0.9)
    figure.suptitle(chart.title or f"{name}, by place of the platform", fontsize="medium", x=0.01, ha="left")


def _views(chart: Chart) -> list[tuple[int, int, str]]:
    """Those along which the map has more than a line of nodes: one for a robot in a plane."""
    found = [view for view in VIEWS if min(chart.value.shape[view[0]], chart.value.shape[view[1]]) > 1]
    if not found:
        raise UsageError("A picture needs a grid that is more than a line of nodes: a smaller step, or a wider box.")
    return found


def _height(robot: Robot, chart: Chart) -> float:
    """Inches a row of panels takes with its titles and labels."""
    sides = np.ptp(_limits(robot, chart.grid), axis=1)
    return 1.1 + (PANEL - 0.8) * min(2.0, max(sides[up] / sides[across] for across, up, _ in _views(chart)))


def _slice(
    axes: Any, chart: Chart, values: Array, across: int, up: int, cut: float, scale: dict[str, Any]
) -> Any:
    """The plane through `cut` of the third axis: values, and the outline of what is inside."""
    nodes, off = (chart.grid.x, chart.grid.y, chart.grid.z), 3 - across - up
    index = int(np.abs(nodes[off] - cut).argmin())
    axes.set_facecolor(OUTSIDE)
    image = axes.pcolormesh(nodes[across], nodes[up], values.take(index, axis=off).T, shading="nearest",
                            rasterized=True, **scale)
    inside = np.isfinite(values).take(index, axis=off)
    if inside.any():
        drawn = np.pad(inside, 1).repeat(2, axis=0).repeat(2, axis=1).T.astype(float)
        axes.contour(_edges(nodes[across]), _edges(nodes[up]), drawn, [0.5], colors="black", linewidths=0.8)
    return image


def _limits(robot: Robot, grid: Grid) -> Array:
    """What the panels show of each axis (3, 2) mm: anchors, bed and cells."""
    bed = np.empty((0, 3)) if robot.bed_origin is None else robot.bed_origin[None]
    seen = [np.concatenate((robot.anchors[:, i], bed[:, i], nodes)) for i, nodes in enumerate((grid.x, grid.y, grid.z))]
    low, high = np.array([(axis.min(), axis.max()) for axis in seen]).T
    return np.stack((low, high), axis=1) + 0.03 * (high - low).max() * np.array([-1, 1])


def _edges(nodes: Array) -> Array:
    """Both edges of every cell, drawn in by next to nothing, and of one more cell at each end."""
    step = np.diff(nodes).mean()
    more = np.concatenate(([nodes[0] - step], nodes, [nodes[-1] + step]))
    return (more[:, None] + step * np.array([-0.499, 0.499])).ravel()


def _machine(
    axes: Any, robot: Robot, cylinder: tuple[float, float, float, float, float] | None, across: int, up: int
) -> None:
    """Anchors, bed and cylinder."""
    from matplotlib.patches import Circle, Rectangle

    axes.plot(robot.anchors[:, across], robot.anchors[:, up], "s", color="black", markersize=4, clip_on=False)
    if robot.bed_origin is not None:
        side = (robot.bed_size if robot.bed_size is not None else np.zeros(2))[across] / 2
        if up == 2:
            ends = robot.bed_origin[across] - side, robot.bed_origin[across] + side
            axes.plot(ends, robot.bed_origin[[2, 2]], color=MARK, linewidth=3, solid_capstyle="butt")
    if cylinder is not None:
        foot, radius, height = np.array(cylinder[:3]), cylinder[3], cylinder[4]
        side, top = Rectangle((foot[across] - radius, foot[2]), 2 * radius, height), Circle((foot[0], foot[1]), radius)
        form = side if up == 2 else top
        form.set(fill=False, edgecolor=MARK, linewidth=1.5)
        axes.add_patch(form)


def _cut(chart: Chart) -> tuple[float, float, float]:
    """Nodes nearest to where the chart is to be cut."""
    nodes = chart.grid.x, chart.grid.y, chart.grid.z
    if chart.through is not None:
        wanted: Sequence[float] = chart.through
    else:
        places = np.nonzero(np.isfinite(chart.shown))
        wanted = [axis[place].mean() if len(place) else axis.mean() for axis, place in zip(nodes, places, strict=True)]
    x, y, z = (float(axis[np.abs(axis - at).argmin()]) for axis, at in zip(nodes, wanted, strict=True))
    return x, y, z
