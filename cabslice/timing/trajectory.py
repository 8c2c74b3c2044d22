"""The finished motion: where along the path at which time, and from it everything else at any time.

Legend
    node     grid point of the retiming; s its path parameter (mm within its piece), x = (ds/dt)^2, t its time
    u        d2s/dt2, constant between two nodes, so x is linear in s and s is quadratic in t there
    w        window: the planned position is averaged over [t - w/2, t + w/2], so that acceleration ramps over w instead
             of stepping and the jerk is bounded; corners are cut by a little more (timing.averaging)
    pose rate and acceleration: q' ds/dt and q' u + q'' (ds/dt)^2   (Bobrow 1985; Pham & Pham 2018)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.robot.turning import Turning, platform_motion
from cabslice.timing.path import Path


@dataclass(frozen=True)
class Samples:
    """The motion at K times; where poses are level rotations, their rates and accelerations are zero."""

    poses: Array      # (K, 6) platform pose, machine frame
    rates: Array      # (K, 6) mm/s, rad/s
    accels: Array     # (K, 6) mm/s^2, rad/s^2
    filament: Array   # (K,) mm fed since the start: the position of the extruder, pressure advance included
    feed: Array       # (K,) mm/s of filament laid
    move: Array       # (K,) int64, row of the toolpath
    laid: Array       # (K,) mm of filament the beads take: what is fed, without pressure advance


@dataclass(frozen=True)
class Trajectory:
    """Nodes of all pieces in time order. Interval i runs from node i to node i+1; a node that ends a piece starts no
    motion: the next row is the first node of the next piece, a window (and perhaps a dwell) later."""

    path: Path
    time: Array       # (G,) s, of the plan before averaging
    s: Array          # (G,) mm within the piece
    x: Array          # (G,) mm^2/s^2
    move: Array       # (G,) int64: move that the interval starting here lies in (at the end of a piece: its last move)
    pieces: Array     # (P+1,) int64: piece p has nodes pieces[p]:pieces[p+1]
    to_pose: Array    # (3,) mm: platform origin in the machine frame minus nozzle in bed coordinates
    window: float     # s
    turning: Turning | None = None    # how the platform is turned; None: level
    nozzle: Array | None = None       # (3,) mm, platform frame; only where it is turned
    advance: float = 0.0              # s: while the nozzle moves, filament is fed ahead by this times its speed

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
        return float(self.time[-1]) + self.window / 2


def sample(trajectory: Trajectory, times: Array) -> Samples:
    """The motion at times (K,) s; before the start and after the end the machine rests."""
    from cabslice.timing.averaging import moved

    piece = piece_at(trajectory, times)
    first, last = trajectory.pieces[piece], trajectory.pieces[piece + 1] - 1
    plan = trajectory.time, trajectory.s, trajectory.x, trajectory.move
    motion, s, filament, feed = moved(trajectory.path, plan, first, last, times, trajectory.window)
    platform = platform_motion(
        trajectory.turning, trajectory.nozzle, trajectory.to_pose, motion[:, :3], motion[:, 3:6], motion[:, 6:])
    move, fed = move_at(trajectory, piece, s), filament
    if trajectory.advance:
        fed = filament + trajectory.advance * feed * trajectory.path.direction[move].any(axis=1)
    return Samples(*platform, fed, feed, move, filament)


def nozzle_at(trajectory: Trajectory, times: Array) -> Array:
    """(K, 3) mm, bed coordinates, at times (K,) s, as planned."""
    from cabslice.timing.averaging import moved

    piece = piece_at(trajectory, times)
    first, last = trajectory.pieces[piece], trajectory.pieces[piece + 1] - 1
    plan = trajectory.time, trajectory.s, trajectory.x, trajectory.move
    return moved(trajectory.path, plan, first, last, times, trajectory.window)[0][:, :3]


def move_at(trajectory: Trajectory, piece: Array, s: Array) -> Array:
    """(K,) the move of the toolpath that s (K,) mm into pieces (K,) lies in.

    Pieces are told apart by adding their number times more than the longest piece to s.
    """
    path, pieces = trajectory.path, trajectory.pieces
    if not len(piece):
        return np.zeros(0, np.int64)
    low = int(piece.min())
    near = np.arange(low, int(piece.max()) + 1)
    first, last = trajectory.move[pieces[near]], trajectory.move[pieces[near + 1] - 1]
    longest = 1.0 + float(trajectory.s[pieces[near + 1] - 1].max())
    counts = last - first + 1
    moves = np.arange(counts.sum()) + np.repeat(first - np.cumsum(counts) + counts, counts)
    key = path.start[moves] + longest * np.repeat(near - low, counts)
    which = piece - low
    found = moves[np.maximum(np.searchsorted(key, s + longest * which, side="right") - 1, 0)]
    return np.clip(found, first[which], last[which])


def slowed(trajectory: Trajectory, factor: Array) -> Trajectory:
    """The same path with the plan of piece p stretched in time by factor[p] >= 1: accelerations fall by its square."""
    pieces = trajectory.pieces
    each = np.repeat(factor, np.diff(pieces))
    spent = np.diff(trajectory.time, prepend=0.0)
    inside = np.ones(len(each), np.bool_)
    inside[pieces[:-1]] = False
    return replace(trajectory, time=np.cumsum(np.where(inside, spent * each, spent)), x=trajectory.x / each**2)


def eased(trajectory: Trajectory, factor: Array) -> Trajectory:
    """The same path, stretched in time by factor (G,) >= 1 around each node: where it changes, gently, acceleration
    changes by what that takes."""
    x, inside = trajectory.x / factor**2, np.ones(len(factor), np.bool_)
    inside[trajectory.pieces[:-1]] = False
    spent, rows = np.diff(trajectory.time, prepend=0.0), np.flatnonzero(inside)
    rate, before = np.sqrt(x), np.sqrt(trajectory.x)
    spent[rows] *= (before[rows - 1] + before[rows]) / (rate[rows - 1] + rate[rows])
    return replace(trajectory, time=np.cumsum(spent), x=x)


def at_share(trajectory: Trajectory, share: float) -> Trajectory:
    """The whole motion, rests and window too, at `share` of its speed: accelerations change by its square."""
    return replace(
        trajectory, time=trajectory.time / share, x=trajectory.x * share**2, window=trajectory.window / share
    )


def piece_at(trajectory: Trajectory, times: Array) -> Array:
    """(K,) the piece whose run, rest before it included, holds the times (K,) s."""
    starts = trajectory.time[trajectory.pieces[:-1]] - trajectory.window / 2
    return np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)


def times_between(s: Array, x: Array) -> Array:
    """Time (G-1,) s between neighbouring nodes, 2 ds / (sqrt x0 + sqrt x1)."""
    rate = np.sqrt(x)
    return 2 * np.diff(s) / (rate[:-1] + rate[1:])
