"""Where along the path the limits are imposed: a grid fine in corners and near their ends, coarse on straights.

Each move is cut into up to five sections: the second half of the blend it starts in, a straight part that is graded
from both its ends with an even middle, and the first half of the blend it ends in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.timing.path import SHARP, Path

FINEST, GROWTH = 0.3, 0.5     # mm; interval length FINEST + ~GROWTH x distance from the end of the straight part
REACH, COARSEST = 10.0, 5.0   # mm; graded this far from each end, then even intervals of at most COARSEST
SECTIONS = 5


@dataclass(frozen=True)
class Grid:
    """Intervals of all pieces in order; interval i lies in move[i], from low[i] to high[i] mm into it.

    Piece p has intervals intervals[p]:intervals[p+1], so one node more than intervals.
    """

    move: Array         # (I,) int64
    low: Array          # (I,) mm
    high: Array         # (I,) mm
    intervals: Array    # (P+1,) int64

    def __post_init__(self) -> None:
        shape = Shapes("Grid")
        set_columns(
            self,
            move=shape.column("move", self.move, "I", np.int64),
            low=shape.column("low", self.low, "I"),
            high=shape.column("high", self.high, "I"),
            intervals=shape.column("intervals", self.intervals, "P+1", np.int64),
        )


def lay_grid(path: Path, starts: Array) -> Grid:
    """The grid over the pieces starts (P+1,) of the toolpath."""
    moves = np.arange(starts[0], starts[-1])
    length, count, graded = _sections(path, moves)
    keep = length > 0
    section_move = np.repeat(moves, SECTIONS).reshape(keep.shape)[keep]
    offset = (np.cumsum(length, axis=1) - length)[keep]
    length, count, graded = length[keep], count[keep], graded[keep]
    low, high = _divide(length, count, graded)
    move = np.repeat(section_move, count)
    base = np.repeat(offset, count)
    high = base + high
    last = np.concatenate((move[1:] != move[:-1], [True]))
    high[last] = path.length[move[last]]                                # no rounding gap at the vertex
    low = base + low
    low[1:][~last[:-1]] = high[:-1][~last[:-1]]
    return Grid(move, low, high, np.searchsorted(move, starts))


def _sections(path: Path, moves: Array) -> tuple[Array, Array, Array]:
    """Length (M, 5), number of intervals (M, 5), grading (M, 5): +1 fine at its start, -1 fine at its end, 0 even."""
    h_in, h_out = path.half[path.before[moves]], path.half[moves]
    straight = np.maximum(path.length[moves] - h_in - h_out, 0.0)
    straight[straight < 1e-9 * path.length[moves]] = 0.0
    end = np.minimum(straight / 2, REACH)
    middle = np.maximum(straight - 2 * REACH, 0.0)
    length = np.stack((h_in, end, middle, end, h_out), axis=1)
    length[path.length[moves] == 0] = 0.0
    count = np.ones(length.shape, np.int64)
    sharp = [path.turn_at(corner) > SHARP for corner in (path.before[moves], moves)]
    count[:, 0], count[:, 4] = np.where(sharp, 3, 2)                         # intervals in half a blend
    count[:, 1] = count[:, 3] = np.maximum(1, np.ceil(np.arcsinh(GROWTH * end / FINEST) / GROWTH))
    count[:, 2] = np.maximum(1, np.ceil(middle / COARSEST))
    graded = np.zeros(length.shape, np.int64)
    graded[:, 1], graded[:, 3] = 1, -1
    return length, count, graded


def _divide(length: Array, count: Array, graded: Array) -> tuple[Array, Array]:
    """Low and high end of each interval from the start of its section."""
    first = np.cumsum(count) - count
    index = np.arange(count.sum()) - np.repeat(first, count)
    n, span, kind = np.repeat(count, count), np.repeat(length, count), np.repeat(graded, count)
    return _place(index, n, span, kind), _place(index + 1, n, span, kind)


def _place(index: Array, count: Array, length: Array, graded: Array) -> Array:
    """Distance of node `index` of `count` intervals from the start of a section."""
    share = index / count
    scale = np.arcsinh(GROWTH * length / FINEST)
    fine_start = np.sinh(scale * share) / np.sinh(scale)
    fine_end = 1.0 - np.sinh(scale * (1.0 - share)) / np.sinh(scale)
    return length * np.where(graded > 0, fine_start, np.where(graded < 0, fine_end, share))
