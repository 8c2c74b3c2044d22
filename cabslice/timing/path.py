"""The toolpath made smooth: a C2 curve whose parameter is the length along the polyline.

Legend
    k        move of the toolpath: the segment from vertex k-1 to vertex k; L_k its length, d_k its direction
    h_k      half-length of the blend at vertex k, 0 where the nozzle stops there
    s        path parameter, mm along the polyline of a piece; sigma = s within move k
    q, q', q''   nozzle position and its derivatives by s

At a vertex P with directions d0, d1 the curve leaves the polyline h before P and returns h after it:

    q'(t) = d0 + (d1 - d0) (3 t^2 - 2 t^3),    t = (sigma + h) / 2h,   sigma measured from P

which integrates to a quartic (the Bezier curve with control points P - h d0, P - h/2 d0, P, P + h/2 d1, P + h d1),
so that q'' is zero at both ends and |q'| <= 1. It is farthest from P in its middle: 3/16 h |d1 - d0|.
As s runs along the polyline, filament is a piecewise linear function of s and no bead loses any.
An extrude-only move has its filament as length and the zero vector as direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.toolpath.path import Toolpath

DEVIATION = 3.0 / 16.0   # of h |d1 - d0|
TINY = 1e-3              # mm; vertices nearer than this are one
STILL = 1e-9             # mm; what is shorter does not move the nozzle, and moves of filament take at least so much s
SHARP = 0.3              # |d1 - d0| above which a vertex is a corner


@dataclass(frozen=True)
class Path:
    """Columns over the moves of a toolpath, row 0 unused. A vertex nearer than TINY to the one before is left out: its
    move has no length, and the next one that is not left out (in its piece; else the last) carries its filament."""

    vertex: Array       # (N, 3) mm, bed coordinates
    direction: Array    # (N, 3) unit, or 0 for extrude-only moves
    length: Array       # (N,) mm; filament length for extrude-only moves
    start: Array        # (N,) mm, s at the start of the move within its piece
    half: Array         # (N,) mm, h at the vertex that ends the move
    feed: Array         # (N,) mm filament per mm of s
    filament: Array     # (N,) mm fed before the move starts, from the start of the toolpath
    before: Array       # (N,) int64, the vertex the move starts from
    after: Array        # (N,) int64, the move that starts from the vertex it ends at (at the end of the path: itself)

    def __post_init__(self) -> None:
        shape = Shapes("Path")
        names = ("length", "start", "half", "feed", "filament")
        columns = {name: shape.column(name, getattr(self, name), "N") for name in names}
        columns |= {name: shape.column(name, getattr(self, name), "N 3") for name in ("vertex", "direction")}
        columns |= {name: shape.column(name, getattr(self, name), "N", np.int64) for name in ("before", "after")}
        set_columns(self, **columns)

    @property
    def carrier(self) -> Array:
        """(N,) the move that each row is made in: itself, or where its vertex is left out the one that carries it."""
        return np.where(self.length > 0, np.arange(len(self.length)), self.after[self.before])

    @property
    def turn(self) -> Array:
        """(N,) |d1 - d0| at the vertex that ends each move."""
        return self.turn_at(np.arange(len(self.length)))

    def turn_at(self, move: Array) -> Array:
        """(K,) |d1 - d0| at the vertices that end moves (K,)."""
        return np.asarray(np.linalg.norm(self.direction[self.after[move]] - self.direction[move], axis=1))


def smooth(toolpath: Toolpath, corner_mm: float) -> Path:
    """Round every corner inside a piece so that the curve stays within corner_mm of the polyline and of each vertex."""
    rows = np.flatnonzero(_apart(toolpath))
    xyz, starts = toolpath.xyz[rows], np.searchsorted(rows, toolpath.starts)
    upto, ends = rows.copy(), toolpath.starts[1:] - 1                    # the last row that each move carries
    xyz[starts[1:] - 1], upto[starts[1:] - 1] = toolpath.xyz[ends], ends
    step = np.diff(xyz, axis=0, prepend=xyz[:1])
    lengths = np.linalg.norm(step, axis=1)
    lengths[lengths < STILL] = 0.0
    moves, total = lengths > 0, np.cumsum(toolpath.filament)[upto]
    filament = np.diff(total, prepend=0.0)
    span = np.where(moves, lengths, np.maximum(np.abs(filament), STILL))
    direction = np.where(moves[:, None], step / np.where(moves, lengths, 1.0)[:, None], 0.0)
    number = np.arange(len(toolpath.xyz))
    which = np.searchsorted(upto, number)                                # the move that carries each row
    left_out = rows[which] != number
    columns = span, _half_lengths(direction, lengths, starts, corner_mm), filament / span
    length, half, feed = (np.where(left_out, 0.0, column[which]) for column in columns)
    return Path(
        vertex=xyz[which], direction=direction[which], length=length, start=_within_piece(span, starts)[which],
        half=half, feed=feed, filament=(total - filament)[which], before=rows[np.maximum(which - 1, 0)],
        after=rows[np.minimum(which + 1, len(rows) - 1)],
    )


def _apart(toolpath: Toolpath) -> Array:
    """(N,) bool: vertices at least TINY from the last one before them, and at least one in each piece."""
    keep, starts, tiny = np.ones(len(toolpath.xyz), np.bool_), toolpath.starts, toolpath.lengths < TINY
    tiny[0] = False
    tiny[starts[:-1][np.diff(starts) == 1]] = False
    for piece in np.unique(np.searchsorted(starts, np.flatnonzero(tiny), side="right") - 1).tolist():
        first, end = int(starts[piece]), int(starts[piece + 1]) - 1
        keep[first:end + 1] = _thinned(toolpath.xyz[first - 1:end + 1].tolist())
    return keep


def _thinned(points: list[list[float]]) -> list[bool]:
    """Which of points[1:] to keep: TINY apart; where none is, the last."""
    keep, last = [False] * len(points), 0
    for k in range(1, len(points)):
        if math.dist(points[k], points[last]) >= TINY:
            keep[k], last = True, k
    keep[-1] |= last == 0
    return keep[1:]


def _within_piece(span: Array, starts: Array) -> Array:
    """s at the start of each move: the running length, set back to 0 where a piece starts."""
    before = np.cumsum(span) - span
    before[starts[0]:] -= np.repeat(before[starts[:-1]], np.diff(starts))
    return before


def _half_lengths(direction: Array, lengths: Array, starts: Array, corner_mm: float) -> Array:
    turn = np.linalg.norm(direction[1:] - direction[:-1], axis=1)        # |d1 - d0| at vertices 0..N-2
    room = np.minimum(lengths[1:], lengths[:-1]) / 2
    half = np.zeros(len(lengths))
    half[:-1] = np.minimum(room, corner_mm / (DEVIATION * np.maximum(turn, 1e-12)))
    half[:-1][turn < 1e-9] = 0.0
    half[starts - 1] = 0.0                                              # the nozzle stops at the ends of a piece
    return half


@dataclass(frozen=True)
class Motion:
    """Curve and derivatives by s at K places: q, d1 = q', d2 = q'' (K, 3); filament (K,) mm fed since the start."""

    q: Array
    d1: Array
    d2: Array
    filament: Array


def evaluate(path: Path, move: Array, sigma: Array) -> Motion:
    """The curve at distance sigma (K,) mm into moves (K,), 0 <= sigma <= length."""
    after = sigma - path.length[move]                                    # distance to the vertex at the end, <= 0
    h_in, h_out = path.half[path.before[move]], path.half[move]
    coming, leaving = sigma < h_in, (-after < h_out)
    corner = np.where(coming, path.before[move], move)
    d0, d1 = path.direction[corner], path.direction[path.after[corner]]
    h = np.where(coming, h_in, np.where(leaving, h_out, 0.0))
    along = np.where(coming, sigma, after)                              # signed distance from the vertex of the corner
    blend = h > 0
    t = np.where(blend, (along + h) / np.where(blend, 2 * h, 1.0), 0.0)
    turn = np.where(blend[:, None], d1 - d0, 0.0)
    base = np.where(blend[:, None], d0, path.direction[move])
    q = path.vertex[np.where(blend, corner, move)] + np.where(blend, along, after)[:, None] * base
    q = q + (2 * h * t**3 * (1 - t / 2))[:, None] * turn
    first = base + (t * t * (3 - 2 * t))[:, None] * turn
    second = np.where(blend, 6 * t * (1 - t) / np.where(blend, 2 * h, 1.0), 0.0)[:, None] * turn
    return Motion(q, first, second, path.filament[move] + path.feed[move] * sigma)


def deviation(path: Path) -> Array:
    """(N,) mm, distance between each vertex and the curve: the largest the curve leaves the polyline there."""
    return DEVIATION * path.half * path.turn


def to_corners(path: Path, starts: Array) -> tuple[Array, Array]:
    """(N,) mm from the start of each move back to the last corner sharper than SHARP in its piece, and from its end on
    to the next one; inf where there is none."""
    corner = (path.half > 0) & (path.turn > SHARP)                       # at the end of the move
    run = np.cumsum(path.length)                                         # at the end of each move, all pieces in a row
    piece = np.searchsorted(starts, np.arange(len(run)), side="right")
    last = np.maximum.accumulate(np.where(corner, np.arange(len(run)), 0))
    last = np.concatenate(([0], last[:-1]))                              # before the move
    following = np.minimum.accumulate(np.where(corner, np.arange(len(run)), len(run) - 1)[::-1])[::-1]
    behind = np.where(corner[last] & (piece[last] == piece), run - path.length - run[last], np.inf)
    ahead = np.where(corner[following] & (piece[following] == piece), run[following] - run, np.inf)
    return behind, ahead
