"""The finished motion: where along the path at which time, and from it everything else at any time.

Legend
    node     grid point of the retiming; s its path parameter (mm within its piece), x = (ds/dt)^2, t its time
    u        d2s/dt2, constant between two nodes, so x is linear in s and s is quadratic in t there
    pose rate and acceleration: q' ds/dt and q' u + q'' (ds/dt)^2   (Bobrow 1985; Pham & Pham 2018)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.timing.path import Path, evaluate


@dataclass(frozen=True)
class Samples:
    """The motion at K times; poses are level, so rotations, their rates and accelerations are zero."""

    poses: Array      # (K, 6) platform pose, machine frame
    rates: Array      # (K, 6) mm/s, rad/s
    accels: Array     # (K, 6) mm/s^2, rad/s^2
    filament: Array   # (K,) mm fed since the start
    feed: Array       # (K,) mm/s of filament
    move: Array       # (K,) int64, row of the toolpath


@dataclass(frozen=True)
class Trajectory:
    """Nodes of all pieces in time order. Interval i runs from node i to node i+1; a node that ends a piece
    starts no motion: the next row is the first node of the next piece, at the same time or after a dwell."""

    path: Path
    time: Array       # (G,) s
    s: Array          # (G,) mm within the piece
    x: Array          # (G,) mm^2/s^2
    move: Array       # (G,) int64: move that the interval starting here lies in (at the end of a piece: its last move)
    pieces: Array     # (P+1,) int64: piece p has nodes pieces[p]:pieces[p+1]
    to_pose: Array    # (3,) mm: platform origin in the machine frame minus nozzle in bed coordinates

    def __post_init__(self) -> None:
        shape = Shapes("Trajectory")
        columns = {name: shape.column(name, getattr(self, name), "G") for name in ("time", "s", "x")}
        columns["move"] = shape.column("move", self.move, "G", np.int64)
        columns["pieces"] = shape.column("pieces", self.pieces, "P+1", np.int64)
        columns["to_pose"] = shape.column("to_pose", self.to_pose, "3")
        set_columns(self, **columns)

    @property
    def duration(self) -> float:
        """s"""
        return float(self.time[-1])


def sample(trajectory: Trajectory, times: Array) -> Samples:
    """The motion at times (K,) s; before the start and after the end the machine rests."""
    times = np.clip(times, 0.0, trajectory.duration)
    node = np.clip(np.searchsorted(trajectory.time, times, side="right") - 1, 0, len(trajectory.time) - 2)
    span, u = intervals(trajectory, node)
    rate0 = np.sqrt(trajectory.x[node])
    passed = times - trajectory.time[node]
    s = np.minimum(trajectory.s[node] + passed * (rate0 + u * passed / 2), trajectory.s[node] + span)
    rate = np.maximum(rate0 + u * passed, 0.0)
    resting = span <= 0                                        # between two pieces, or at the very end
    return _samples(trajectory, trajectory.move[node], s, np.where(resting, 0.0, rate), np.where(resting, 0.0, u))


def intervals(trajectory: Trajectory, node: Array) -> tuple[Array, Array]:
    """Length (K,) mm and u (K,) mm/s^2 of the intervals that start at the nodes (K,); 0 where a piece ends there."""
    same = trajectory.s[node + 1] > trajectory.s[node]
    span = np.where(same, trajectory.s[node + 1] - trajectory.s[node], 0.0)
    u = (trajectory.x[node + 1] - trajectory.x[node]) / (2 * np.where(same, span, 1.0))
    return span, np.where(same, u, 0.0)


def _samples(trajectory: Trajectory, move: Array, s: Array, rate: Array, u: Array) -> Samples:
    path = trajectory.path
    sigma = np.clip(s - path.start[move], 0.0, path.length[move])
    motion = evaluate(path, move, sigma)
    poses, rates, accels = np.zeros((3, len(move), 6))
    poses[:, :3] = motion.q + trajectory.to_pose
    rates[:, :3] = motion.d1 * rate[:, None]
    accels[:, :3] = motion.d1 * u[:, None] + motion.d2 * (rate**2)[:, None]
    return Samples(poses, rates, accels, motion.filament, path.feed[move] * rate, move)


def times_of(s: Array, x: Array) -> Array:
    """Time (G-1,) s spent between neighbouring nodes: 2 ds / (sqrt x0 + sqrt x1)."""
    rate = np.sqrt(x)
    return 2 * np.diff(s) / (rate[:-1] + rate[1:])
