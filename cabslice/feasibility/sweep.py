"""Cables against what stands on the bed: a search through two bounding trees, exact where bounds do not decide.

Legend
    grow     cable radius + clearance, mm: what a cable's centre line must stay farther than from every bead
    drift    how far the exit point of a cable can be from the one at the middle of a move, mm (exits.exit_drift)
    spread   the same of its attachment seen from the nozzle, where the platform turns; the larger of the two counts
    margin   distance - grow, mm; the least one is found by branch and bound: pairs of nodes that are proven to be
             farther apart than grow plus the least margin met so far are discarded
    hit      a move during which a cable comes within grow of something laid before or in the same stage
    climb    height gained in a move, mm

A stretch of a move is judged by the triangle its cable sweeps from one exit point, grown by the drift; where that does
not decide, it is halved until drift and climb are below RESOLUTION, and then counts as a hit: no pose is sampled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.distance import PRECISION, sweep_gap
from cabslice.feasibility.exits import Ends, Exits, ends_of, offsets
from cabslice.feasibility.obstacles import Moves, Obstacles
from cabslice.feasibility.trees import Bounds, Tree, bounds_of_beads, bounds_of_moves, cable_gap, members
from cabslice.robot.model import Robot

FAR = 3.0            # mm: margins are not looked for beyond this, where nothing else is asked for
AIR = 30.0           # mm: the same where it is told place by place
NEIGHBOURS = 4       # 2^4 leaves of moves are told one clearance
RESOLUTION = 0.01    # mm
BLOCK_LEVEL = 10     # moves are searched in blocks of 2^10 leaves
PAIRS = 1 << 12      # pairs of nodes in one sweep
MEETINGS = 1 << 8    # pairs of leaves in one sweep
ROUNDING = 1e-9      # mm

_Halves = tuple[Array, Array, Array, Ends]     # pair, start, end, ends of the cable


@dataclass(frozen=True)
class Contacts:
    """Hits as columns, one row a move and cable, in the order of printing; and what the search has covered."""

    move: Array          # (H,) row of Tree.items of the moves
    bead: Array          # (H,) row of Tree.items of the beads
    cable: Array         # (H,) from 0
    gap: Array           # (H,) mm, centre line of the cable to bead; 0: it cuts the bead
    margin: float        # mm, proven for all pairs; `far` where it is at least that; 0 where there are hits
    last_stage: int      # moves up to this stage were searched
    complete: bool       # that is all of them
    exact: int           # pairs of move and bead that were computed one by one
    far: float = FAR     # mm, what the margin was looked for up to


def contacts(
    moves: Tree, beads: Tree, robot: Robot, grow: Array,
    *, stop: int = 10, far: float = FAR, progress: Callable[[int, int], None] | None = None,
) -> Contacts:
    """Every hit of a cable on a bead, up to the block of moves in which `stop` stages have failed.

    moves, beads: trees.tree_of_moves, tree_of_beads; grow (m,) mm; margins are looked for up to `far` mm.
    """
    search = _Search(moves, beads, robot, grow, far)
    size = min(BLOCK_LEVEL, len(moves.levels) - 1)
    blocks = len(moves.levels[size].low)
    done = 0
    while done < blocks and search.failed_stages() < stop:
        search.block(size, done)
        done += 1
        if progress:
            progress(done, blocks)
    return search.result(int(moves.levels[size].last[done - 1]), done == blocks)


def clearances(moves: Tree, beads: Tree, robot: Robot, grow: Array, *, far: float = AIR) -> Array:
    """(M,) mm for each stretch of moves.items: what the cables of it and its neighbours have left to every bead laid
    by then, proven; `far` where it is at least that, 0 for hits. Neighbours: a node of NEIGHBOURS levels."""
    search = _Search(moves, beads, robot, grow, far)
    size = min(NEIGHBOURS, len(moves.levels) - 1)
    found = np.empty(len(search.paths))
    for node in range(len(moves.levels[size].low)):
        search.margin = far
        search.block(size, node)
        first, last = node << size, min((node + 1) << size, moves.leaves)
        found[moves.starts[first]:moves.starts[last]] = search.margin
    return found


class _Search:
    """What a search knows so far."""

    def __init__(self, moves: Tree, beads: Tree, robot: Robot, grow: Array, far: float) -> None:
        self.moves, self.beads, self.robot, self.grow, self.far = moves, beads, robot, grow, far
        self.paths: Moves = moves.items          # type: ignore[assignment]
        self.laid: Obstacles = beads.items       # type: ignore[assignment]
        self.offsets = offsets(robot)
        self.margin, self.exact = far, 0
        self.hit = np.zeros((len(self.paths), robot.cables), bool)
        self.hits: list[tuple[Array, Array, Array, Array]] = []

    def reach(self, cable: Array) -> Array:
        return self.grow[cable] + self.margin

    def failed_stages(self) -> int:
        return len(np.unique(np.concatenate([self.paths.stage[hit[0]] for hit in self.hits]))) if self.hits else 0

    def block(self, level: int, node: int) -> None:
        """All moves below one node against all beads, depth first so that few pairs are held at a time."""
        leaves = self.moves.starts[node << level:((node + 1) << level) + 1]
        self.exits = Exits(self.robot, self.paths, int(leaves[0]), int(leaves[-1]))
        cables = np.arange(self.robot.cables)
        stack = [(level, len(self.beads.levels) - 1, np.full_like(cables, node), np.zeros_like(cables), cables)]
        while stack:
            move_level, bead_level, move, bead, cable = stack.pop()
            if len(move) > PAIRS:
                stack.append((move_level, bead_level, move[PAIRS:], bead[PAIRS:], cable[PAIRS:]))
                move, bead, cable = move[:PAIRS], bead[:PAIRS], cable[:PAIRS]
            move, bead, cable, gap = self.near(move_level, bead_level, move, bead, cable)
            if move_level == bead_level == 0:
                self.meet(move, bead, cable, gap)
            elif len(move):
                stack.append(self.split(move_level, bead_level, move, bead, cable))

    def near(self, move_level: int, bead_level: int, move: Array, bead: Array, cable: Array) -> tuple[Array, ...]:
        """The pairs of nodes that are not proven to be clear of each other, nearest first, with their gaps."""
        bounds, others = self.moves.levels[move_level], self.beads.levels[bead_level]
        rows = np.flatnonzero(others.first[bead] <= bounds.last[move])
        move, bead, cable = move[rows], bead[rows], cable[rows]
        low, high = self.moves.exits[move_level]
        reach = self.reach(cable)
        hung, spread = self.hung(move_level, move, cable)
        gap = cable_gap(
            bounds.take(move), low[move, cable], high[move, cable], hung, others.take(bead), reach, spread
        )
        rows = np.flatnonzero(gap <= reach + ROUNDING)
        rows = rows[np.argsort(gap[rows], kind="stable")]
        return move[rows], bead[rows], cable[rows], gap[rows]

    def hung(self, level: int, node: Array, cable: Array) -> tuple[Array, Array | None]:
        """Attachments seen from the nozzle (K, 3), and by how much (K, 3) they differ in nodes of the moves."""
        if not self.moves.hung:
            return self.offsets[cable], None
        low, high = (corner[node, cable] for corner in self.moves.hung[level])
        return (low + high) / 2, (high - low) / 2

    def split(
        self, move_level: int, bead_level: int, move: Array, bead: Array, cable: Array
    ) -> tuple[int, int, Array, Array, Array]:
        """Children of pairs: of the higher of the two nodes, or of both."""
        down, under = move_level >= bead_level, bead_level >= move_level
        if down:
            move_level -= 1
            move, (bead, cable) = _children(move, len(self.moves.levels[move_level].low), bead, cable)
        if under:
            bead_level -= 1
            bead, (move, cable) = _children(bead, len(self.beads.levels[bead_level].low), move, cable)
        return move_level, bead_level, move, bead, cable

    def meet(self, home: Array, leaf: Array, cable: Array, gap: Array) -> None:
        """Pairs of leaves: each stretch against the leaf of beads, then against each of its beads."""
        for i in range(0, len(home), MEETINGS):
            rows = np.flatnonzero(gap[i:i + MEETINGS] <= self.reach(cable[i:i + MEETINGS]) + ROUNDING) + i
            move, (others, lines) = members(self.moves.starts, home[rows], leaf[rows], cable[rows])
            rows = self.apart(move, lines, self.beads.levels[0].take(others))
            for j in range(0, len(rows), MEETINGS):
                part = rows[j:j + MEETINGS]
                self.confront(move[part], others[part], lines[part])

    def confront(self, move: Array, leaf: Array, cable: Array) -> None:
        """Stretches against each bead of a leaf."""
        bead, (move, cable) = members(self.beads.starts, leaf, move, cable)
        rows = self.apart(move, cable, bounds_of_beads(self.laid.take(bead)))
        self.settle(move[rows], bead[rows], cable[rows])

    def apart(self, move: Array, cable: Array, bounds: Bounds) -> Array:
        """Rows of stretches that are not proven to be clear of what has these bounds, less those known as hits."""
        reach = self.reach(cable)
        ends = self.exits.of(move, cable)
        low, high = ends.exits - ends.drift[:, None], ends.exits + ends.drift[:, None]
        spread = None if ends.spread is None else np.broadcast_to(ends.spread[:, None], low.shape)
        gap = cable_gap(bounds_of_moves(self.paths.take(move)), low, high, ends.hung, bounds, reach, spread)
        return np.flatnonzero((gap <= reach + ROUNDING) & ~self.hit[move, cable])

    def settle(self, move: Array, bead: Array, cable: Array) -> None:
        """Decide pairs one by one."""
        rows = np.flatnonzero(~self.hit[move, cable])
        move, bead, cable = move[rows], bead[rows], cable[rows]
        self.exact += len(rows)
        hit, gap = self.decide(move, bead, cable)
        self.margin = min(self.margin, float((gap - self.grow[cable])[~hit].min(initial=self.far)))
        if hit.any():
            self.margin = 0.0
            self.record(move[hit], bead[hit], cable[hit], gap[hit])

    def decide(self, move: Array, bead: Array, cable: Array) -> tuple[Array, Array]:
        """Hit or not, and a proven distance (K,) mm, of pairs; what is undecided is halved."""
        hit, gap = np.zeros(len(move), bool), np.full(len(move), np.inf)
        stack = [(np.arange(len(move)), self.paths.start[move], self.paths.end[move], self.exits.of(move, cable))]
        while stack:
            owner, start, end, ends = stack.pop()
            sure, open_, apart = self.judge(start, end, bead[owner], cable[owner], ends)
            hit[owner[sure]] = True
            np.minimum.at(gap, owner[~open_], apart[~open_])
            rows = np.flatnonzero(open_ & ~hit[owner])
            for i in range(0, len(rows), PAIRS):
                stack.append(self.halves(owner, start, end, cable, rows[i:i + PAIRS]))
        return hit, gap

    def judge(self, start: Array, end: Array, bead: Array, cable: Array, ends: Ends) -> tuple[Array, Array, Array]:
        """Straight lines (K, 3) against beads: surely hit; undecided; proven distance (K,) mm."""
        grow, off = self.grow[cable], ends.loose
        tips = start + ends.hung, end + ends.hung
        gap, _ = sweep_gap(ends.exits, *tips, self.laid.take(bead), grow + self.margin + off)
        loose = off + np.abs(end[:, 2] - start[:, 2])
        sure = gap + loose + PRECISION <= grow
        gap = np.maximum(gap - off, 0.0)
        near = (gap <= grow) & ~sure
        sure |= near & (loose <= RESOLUTION)
        return sure, near & ~sure, gap

    def halves(self, owner: Array, start: Array, end: Array, cable: Array, rows: Array) -> _Halves:
        """Both halves of some lines, with the ends of their cables."""
        middle = (start[rows] + end[rows]) / 2
        owner, start, end = np.tile(owner[rows], 2), np.vstack((start[rows], middle)), np.vstack((middle, end[rows]))
        return owner, start, end, ends_of(self.robot, start, end, cable[owner])

    def record(self, move: Array, bead: Array, cable: Array, gap: Array) -> None:
        """Keep the nearest bead of each move and cable."""
        order = np.lexsort((bead, gap, cable, move))
        move, bead, cable, gap = move[order], bead[order], cable[order], gap[order]
        fresh = np.append(True, (np.diff(move) != 0) | (np.diff(cable) != 0))
        self.hit[move, cable] = True
        self.hits.append((move[fresh], bead[fresh], cable[fresh], gap[fresh]))

    def result(self, last_stage: int, complete: bool) -> Contacts:
        empty = np.zeros(0, int), np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        move, bead, cable, gap = (np.concatenate(column) for column in zip(*(self.hits or [empty]), strict=True))
        order = np.lexsort((cable, self.paths.move[move]))
        return Contacts(
            move[order], bead[order], cable[order], gap[order], self.margin, last_stage, complete, self.exact,
            self.far,
        )


def _children(nodes: Array, count: int, *columns: Array) -> tuple[Array, list[Array]]:
    """The two children of each node, the other columns repeated; `count` nodes exist on that level."""
    children = np.concatenate((2 * nodes, 2 * nodes + 1))
    rows = np.flatnonzero(children < count)
    return children[rows], [np.concatenate((column, column))[rows] for column in columns]
