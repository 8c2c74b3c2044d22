"""Every place the nozzle visits, judged in cells: a bound on the change inside a cell proves all of its places at once.

Legend
    piece    a straight stretch of a move, no longer than the cells are wide
    cell     the pieces whose middle lies in one cube of a grid; its box is that of the pieces
    place    the middle of the piece nearest to the middle of the box: on the path, and the one place that is worked out
    radius   of the ball around the place that holds the box, mm
    excess   value - limit, one column for each thing judged; < 0 fails
    proven   what excess is at least, anywhere in the ball

Cells whose proof does not suffice are cut into finer ones, down to the last width; what is still open there is judged
at its places alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.obstacles import LENGTH, Moves, cut_lines

WIDTHS = (LENGTH, 10.0, 5.0, 2.5, 1.25, 0.6, 0.3)   # mm
SHARE = 0.8          # a proven margin is at least this share of the one met, up to the cap
BLOCK = 4096         # places judged in one sweep
PIECES = 1 << 19     # pieces refined in one sweep

Judge = Callable[[Array, Array], tuple[Array, Array]]      # places (K, 3), radii (K,) -> excess, proven (K, q)


@dataclass(frozen=True)
class Pieces:
    start: Array         # (P, 3) mm
    end: Array           # (P, 3) mm
    move: Array          # (P,) row of the moves they are of

    def take(self, rows: Array) -> Pieces:
        return Pieces(self.start[rows], self.end[rows], self.move[rows])


@dataclass(frozen=True)
class Cells:
    """Pieces in the order of their cells; cell c holds pieces starts[c]:starts[c+1]."""

    pieces: Pieces
    starts: Array        # (C+1,)
    place: Array         # (C, 3) mm
    radius: Array        # (C,) mm
    move: Array          # (C,) row of the move the place is on


@dataclass(frozen=True)
class Survey:
    """What a judge said of every place."""

    worst: Array         # (q,) least excess met
    where: Array         # (q, 3) mm, the place
    move: Array          # (q,) row of the move
    proven: float        # excess is nowhere less; only where nothing fails and nothing is open
    failing: Pieces      # of the cells whose place fails
    visits: int          # places worked out
    open: int            # cells judged by their place alone


def cells_of(pieces: Pieces, width: float) -> Cells:
    """Cut the pieces to the width of a grid and sort them into its cells."""
    pieces = _cut(pieces, width)
    key = _keys((pieces.start + pieces.end) / 2, width)
    order = np.argsort(key, kind="stable")
    pieces, key = pieces.take(order), key[order]
    starts = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
    low = np.minimum.reduceat(np.minimum(pieces.start, pieces.end), starts)
    high = np.maximum.reduceat(np.maximum(pieces.start, pieces.end), starts)
    middle = (pieces.start + pieces.end) / 2
    cell = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(key)))
    away = ((middle - ((low + high) / 2)[cell]) ** 2).sum(axis=1)
    nearest = np.flatnonzero(away == np.minimum.reduceat(away, starts)[cell])
    nearest = nearest[np.diff(cell[nearest], prepend=-1) != 0]
    place = middle[nearest]
    radius = np.linalg.norm(np.maximum(high - place, place - low), axis=1)
    return Cells(pieces, np.append(starts, len(key)), place, radius, pieces.move[nearest])


def first_cells(moves: Moves) -> Cells:
    """The coarsest cells of a path: shared by all checks."""
    return cells_of(Pieces(moves.start, moves.end, np.arange(len(moves))), WIDTHS[0])


def explore(cells: Cells, judge: Judge, *, cap: float = 0.0) -> Survey:
    """Judge every place of a path.

    Cells are refined until they fail or are proven to be right, with a margin that is at least SHARE of the least one
    met or of `cap`, whichever is less; in the finest cells it is enough that they are right.
    """
    found = _Explorer(judge, cap)
    found.visit(cells, 1)
    assert found.state is not None
    together = Pieces(*(
        np.concatenate([getattr(part, name) for part in found.failing]) for name in Pieces.__dataclass_fields__
    ))
    return replace(found.state, failing=together.take(np.argsort(together.move, kind="stable")))


class _Explorer:
    """What a survey knows so far."""

    def __init__(self, judge: Judge, cap: float) -> None:
        self.judge, self.cap = judge, cap
        self.state: Survey | None = None
        self.failing: list[Pieces] = []

    def visit(self, cells: Cells, level: int) -> None:
        """Judge cells, and in blocks the finer ones, WIDTHS[level] wide, of those that are not settled."""
        excess, proven = _judged(cells, self.judge)
        self.state = state = _worse(self.state, cells, excess)
        last = level == len(WIDTHS)
        wanted = SHARE * min(self.cap, max(float(state.worst.min()), 0.0))
        bad = np.any(excess < 0, axis=1)
        loose = ~bad & np.any(proven < (0.0 if last else wanted), axis=1)
        least = float(proven[~bad & ~loose].min(initial=np.inf))
        if last and loose.any():
            least = 0.0
        self.state = replace(state, proven=min(state.proven, least), open=state.open + last * int(loose.sum()))
        self.failing.append(cells.pieces.take(_rows(cells, bad)))
        rows = _rows(cells, loose & (not last))
        for i in range(0, len(rows), PIECES):
            self.visit(cells_of(cells.pieces.take(rows[i:i + PIECES]), WIDTHS[level]), level + 1)


def first_failure(failing: Pieces, judge: Judge) -> tuple[int, Array]:
    """The first move that fails in the middle of one of its stretches of 1 mm, and the excess (q,) there."""
    for i in range(0, len(failing.move), BLOCK):
        part = _cut(failing.take(np.arange(i, min(i + BLOCK, len(failing.move)))), 1.0)
        excess, _ = judge((part.start + part.end) / 2, np.zeros(len(part.move)))
        bad = np.flatnonzero((excess < 0).any(axis=1))
        if len(bad):
            first = bad[part.move[bad].argmin()]
            return int(part.move[first]), excess[first]
    raise ValueError("nothing fails")


def _judged(cells: Cells, judge: Judge) -> tuple[Array, Array]:
    parts = [judge(cells.place[i:i + BLOCK], cells.radius[i:i + BLOCK]) for i in range(0, len(cells.radius), BLOCK)]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _worse(state: Survey | None, cells: Cells, excess: Array) -> Survey:
    """The survey so far, with the least of what was met in these cells."""
    least, columns = excess.argmin(axis=0), np.arange(excess.shape[1])
    worst, where, move = excess[least, columns], cells.place[least], cells.move[least]
    if state is None:
        none = cells.pieces.take(np.zeros(0, int))
        return Survey(worst, where, move, np.inf, none, len(excess), 0)
    lower = worst < state.worst
    return replace(
        state, worst=np.where(lower, worst, state.worst), where=np.where(lower[:, None], where, state.where),
        move=np.where(lower, move, state.move), visits=state.visits + len(excess),
    )


def _rows(cells: Cells, chosen: Array) -> Array:
    """Pieces of the chosen cells."""
    return np.flatnonzero(np.repeat(chosen, np.diff(cells.starts)))


def _cut(pieces: Pieces, width: float) -> Pieces:
    """The same stretches in equal pieces no longer than width."""
    row, start, end = cut_lines(pieces.start, pieces.end, width)
    return Pieces(start, end, pieces.move[row])


def _keys(points: Array, width: float) -> Array:
    """One number for each cell of a grid."""
    cell = np.floor(points / width).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    return (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
