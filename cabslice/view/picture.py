"""One picture of a path, a plan or a motor file: where the nozzle goes, how fast, and what the cables bear.

A curve is sampled at a few ten thousand points at most, evenly in length (a path) or in time (a motion).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.files import atomic
from cabslice.motors.stream import Block, MotorStream
from cabslice.robot.forward import forward
from cabslice.robot.model import Robot, nozzle_places
from cabslice.robot.winder import pulley_lengths_of
from cabslice.timing.trajectory import Trajectory, sample
from cabslice.toolpath.path import Toolpath
from cabslice.view.motion import planned

COLOURS = "#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7"   # Okabe & Ito 2008
POINTS = 40_000          # of a curve
FORWARD_POINTS = 4_000   # where each needs forward kinematics


@dataclass(frozen=True)
class Curve:
    """Points of a nozzle's way. `along` is time in s, or length in m where there is no time yet."""

    title: str
    along: Array                    # (K,)
    xyz: Array                      # (K, 3) mm, bed coordinates
    speed: Array                    # (K,) mm/s
    tension: Array | None = None    # (K, m) N
    bounds: Array | None = None     # (2,) N, lowest and highest bound of the tensions
    timed: bool = True

    def __post_init__(self) -> None:
        shape = Shapes("Curve")
        columns = {name: shape.column(name, getattr(self, name), "K") for name in ("along", "speed")}
        columns["xyz"] = shape.column("xyz", self.xyz, "K 3")
        if self.tension is not None:
            columns["tension"] = shape.column("tension", self.tension, "K m")
        set_columns(self, **columns)


def curve_of_path(path: Toolpath, title: str) -> Curve:
    """The path with the speed asked for; no time and no tension yet."""
    ends = np.cumsum(path.lengths)
    along = np.linspace(0.0, ends[-1], min(POINTS, 20 * len(ends)))
    move = np.clip(np.searchsorted(ends, along), 1, len(ends) - 1)
    share = (along - ends[move - 1]) / np.maximum(path.lengths[move], 1e-12)
    xyz = path.xyz[move - 1] + share[:, None] * (path.xyz[move] - path.xyz[move - 1])
    return Curve(title, along / 1e3, xyz, path.speed[move], timed=False)


def curve_of_motion(trajectory: Trajectory, robot: Robot, title: str) -> Curve:
    """The planned motion with the tensions it needs."""
    times = np.linspace(0.0, trajectory.duration, POINTS)
    found = sample(trajectory, times)
    speed = np.linalg.norm(found.rates[:, :3], axis=1)
    return Curve(title, times, _nozzle(robot, found.poses), speed, planned(robot, found)[1], _bounds(robot))


def curve_of_stream(stream: MotorStream, robot: Robot, title: str) -> Curve:
    """A motor file played back: angles and tensions to cable lengths to poses, at a few thousand pairs of rows.

    Two neighbouring rows give a speed.
    """
    step = max(1, stream.rows // FORWARD_POINTS)
    angle, tension, row = _rows(stream, step)
    poses = forward(robot, pulley_lengths_of(robot, angle, tension), np.array(stream.header["start_pose"])).poses
    xyz = _nozzle(robot, poses)
    first, second = xyz[0::2], xyz[1::2]
    speed = np.linalg.norm(second - first, axis=1) / stream.period_s
    return Curve(title, row[0::2] * stream.period_s, first, speed, tension[0::2], _bounds(robot))


def _rows(stream: MotorStream, step: int) -> tuple[Array, Array, Array]:
    """Angles, tensions and numbers of rows 0, 1, step, step + 1, ..."""
    kept: list[tuple[Array, Array, Array]] = []
    for block in stream:
        kept.append(_pairs(block, step, stream.rows))
    angle, tension, row = (np.concatenate(column) for column in zip(*kept, strict=True))
    whole = len(row) // 2 * 2
    return angle[:whole], tension[:whole], row[:whole]


def _pairs(block: Block, step: int, rows: int) -> tuple[Array, Array, Array]:
    row = np.arange(block.row, block.row + len(block))
    phase = row % max(step, 2)
    kept = (phase < 2) & (row - phase + 1 < rows)
    return block.angle[kept], block.tension[kept], row[kept]


def _nozzle(robot: Robot, poses: Array) -> Array:
    """Nozzle (K, 3) in bed coordinates."""
    return nozzle_places(robot, poses)


def _bounds(robot: Robot) -> Array:
    return np.array([robot.tension_min.min(), robot.tension_max.max()])


# ---- drawing

def save_picture(curve: Curve, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a PNG. Raises OutputError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8), layout="constrained")
    FigureCanvasAgg(figure)
    heights = [2, 1] if curve.tension is None else [2, 1, 1]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    dots = _view(figure.add_subplot(grid[0, 0]), curve, 0, 1, "from above")
    _view(figure.add_subplot(grid[0, 1]), curve, 0, 2, "from the side")
    figure.colorbar(dots, ax=figure.axes, label="nozzle speed, mm/s", shrink=0.6)
    _speed(figure.add_subplot(grid[1, :]), curve)
    if curve.tension is not None:
        _tension(figure.add_subplot(grid[2, :], sharex=figure.axes[-1]), curve)
    figure.suptitle(curve.title)
    with atomic(path, overwrite) as file:
        figure.savefig(file, format="png", dpi=120)


def _view(axes: Any, curve: Curve, across: int, up: int, name: str) -> Any:
    dots = axes.scatter(
        curve.xyz[:, across], curve.xyz[:, up], c=curve.speed, s=0.4, cmap="viridis", linewidths=0, rasterized=True
    )
    axes.set(title=name, xlabel=f"{'xyz'[across]}, mm", ylabel=f"{'xyz'[up]}, mm")
    axes.set_aspect("equal")
    return dots


def _speed(axes: Any, curve: Curve) -> None:
    axes.plot(curve.along, curve.speed, linewidth=0.4, color="#0072b2")
    speed, along = ("nozzle speed, mm/s", "time, s") if curve.timed else ("speed asked, mm/s", "path, m")
    axes.set(ylabel=speed, xlabel=along)
    axes.set_ylim(bottom=0)


def _tension(axes: Any, curve: Curve) -> None:
    assert curve.tension is not None
    for cable, tension in enumerate(curve.tension.T):
        axes.plot(curve.along, tension, linewidth=0.5, color=COLOURS[cable % len(COLOURS)], label=f"{cable + 1}")
    for bound in () if curve.bounds is None else curve.bounds:
        axes.axhline(bound, color="black", linewidth=0.8, linestyle="--")
    axes.set(ylabel="tension, N", xlabel="time, s")
    legend = axes.legend(title="cable", loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    for line in legend.get_lines():
        line.set_linewidth(2)
