"""The order of islands within a layer: what stands in the way of another one is laid after it.

Legend
    run      beads without a travel between them: an island, or part of one
    way      the rows before a run that lay nothing: retraction, lift, travel, lowering, prime; it keeps its place in
             the layer when runs change theirs, and goes from the end of the run before it to the start of the one after
    A -> B   a cable meets A while B is laid: B comes first. Runs without a say keep their order (Kahn 1962)
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.obstacles import beads_of, island_stages, laying, moves_of, moving, printing_stages
from cabslice.feasibility.sweep import contacts
from cabslice.feasibility.trees import tree_of_beads, tree_of_moves
from cabslice.robot.model import Robot
from cabslice.toolpath.path import Toolpath, piece_starts

ROUNDS = 4
SAME = 1e-6          # mm
ENDLESS = 10**9
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer", "object")


@dataclass(frozen=True)
class Reordered:
    toolpath: Toolpath
    layers: int

    @property
    def sentence(self) -> str:
        return f"In {self.layers} layer{'s' if self.layers != 1 else ''} the islands are laid in another order."


def reordered(toolpath: Toolpath, robot: Robot, grow: Array) -> Reordered | None:
    """The toolpath with the islands of layers in an order in which none is in the way of a later one; None where no
    bead is blocked by what was laid before it in its own layer, or no order helps.

    grow (m,) mm: check.grown. Travels may still be blocked.
    """
    known: dict[int, set[tuple[int, int]]] = {}       # layer: pairs of runs, by their number in the order given
    path = toolpath
    for _ in range(ROUNDS):
        found = _blocks(path, robot, grow)
        if found is None:
            return None
        if not found:
            return Reordered(path, len(known)) if known else None
        if known.keys() & found.keys():
            return None                                # what the first order hid: not followed any further
        known |= found
        for layer, pairs in found.items():
            other = _in_order(path, layer, pairs)
            if other is None:
                return None
            path = other
    return None


def _blocks(toolpath: Toolpath, robot: Robot, grow: Array) -> dict[int, set[tuple[int, int]]] | None:
    """layer: pairs (A, B) of its runs where A, laid before, is in the way of B; None: a bead is blocked otherwise."""
    beads, stages = laying(toolpath), printing_stages(toolpath)
    runs = island_stages(toolpath, stages, 0)
    moves, laid = tree_of_moves(moves_of(toolpath, runs), robot), tree_of_beads(beads_of(toolpath, runs))
    for stop in (1, ENDLESS):                          # most parts that cannot be made show it soon
        met = contacts(moves, laid, robot, grow, stop=stop, far=0.0)
        row, bead = moves.items.move[met.move], laid.items.move[met.bead]
        row, bead = row[beads[row]], bead[beads[row]]
        if (stages[row] != stages[bead]).any() or (runs[row] == runs[bead]).any():
            return None
    found: dict[int, set[tuple[int, int]]] = {}
    for stage, a, b in np.unique(np.stack((stages[row], runs[bead], runs[row]), axis=1), axis=0).tolist():
        first = int(runs[(stages == stage) & beads].min())
        found.setdefault(int(stage), set()).add((a - first, b - first))
    return found


def _in_order(toolpath: Toolpath, stage: int, pairs: set[tuple[int, int]]) -> Toolpath | None:
    """With the runs of one stage in an order that keeps to the pairs; None where there is none, or rows forbid it."""
    beads = laying(toolpath)
    here = printing_stages(toolpath) == stage
    begins = np.flatnonzero(beads & here & ~np.concatenate(([False], beads[:-1])))
    ends = np.flatnonzero(beads & here & ~np.append(beads[1:], False)) + 1
    first = max(int(np.flatnonzero(here)[0]), 1)
    stop = int(np.append(np.flatnonzero(beads[ends[-1]:]) + ends[-1], len(beads))[0])    # the way after the layer too
    wiped = moving(toolpath) & ~beads & (toolpath.filament != 0)
    inside = (toolpath.events.index > first) & (toolpath.events.index < ends[-1])
    order = _topological(len(begins), pairs)
    if order is None or wiped[first:stop].any() or inside.any():
        return None
    ways = [np.arange(a, b) for a, b in zip([first, *ends], [*begins, stop], strict=True)]
    bodies = [np.arange(a, b) for a, b in zip(begins, ends, strict=True)]
    rows, xyz, at = [np.arange(first)], [toolpath.xyz[:first]], toolpath.xyz[first - 1]
    for place, way in enumerate(ways):
        old = toolpath.xyz[way[0] - 1] if len(way) else at
        goal = toolpath.xyz[bodies[place][0] - 1] if place < len(bodies) else None
        to = toolpath.xyz[bodies[order[place]][0] - 1] if place < len(bodies) else None
        kept, points = _led(toolpath, way, old, at, goal, to)
        rows.append(kept)
        xyz.append(points)
        if place < len(bodies):
            rows.append(bodies[order[place]])
            xyz.append(toolpath.xyz[rows[-1]])
            at = xyz[-1][-1]
    rows.append(np.arange(stop, len(beads)))
    xyz.append(toolpath.xyz[stop:])
    return _taken(toolpath, np.concatenate(rows), np.vstack(xyz))


def _led(
    toolpath: Toolpath, way: Array, old: Array, at: Array, goal: Array | None, to: Array | None
) -> tuple[Array, Array]:
    """Rows of a way, and their places (n, 3), where it begins at `at` instead of `old` and ends at `to`, not `goal`."""
    points = toolpath.xyz[way].copy()
    begin = np.linalg.norm(points[:, :2] - old[:2], axis=1) < SAME
    end = np.linalg.norm(points[:, :2] - goal[:2], axis=1) < SAME if goal is not None else ~begin
    points[begin, :2] = at[:2]
    if to is not None:
        points[end & ~begin, :2] = to[:2]
    keep = begin | end if goal is not None and (np.any(old != at) or np.any(goal != to)) else np.ones(len(way), bool)
    return way[keep], points[keep]


def _topological(count: int, pairs: set[tuple[int, int]]) -> list[int] | None:
    """Numbers 0..count-1, of each pair (A, B) the B first; None where pairs go round in a circle."""
    waits = [len({b for one, b in pairs if one == a}) for a in range(count)]
    ready, order = [a for a in range(count) if not waits[a]], list[int]()
    heapq.heapify(ready)
    while ready:
        order.append(heapq.heappop(ready))
        for a in sorted({a for a, b in pairs if b == order[-1]}):
            waits[a] -= 1
            if not waits[a]:
                heapq.heappush(ready, a)
    return order if len(order) == count else None


def _taken(toolpath: Toolpath, rows: Array, xyz: Array) -> Toolpath:
    """Rows of a toolpath at other places, without those that have become moves of nothing."""
    still = np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1) == 0
    keep = ~still | (toolpath.filament[rows] != 0)
    keep[0] = True
    rows, xyz = rows[keep], xyz[keep]
    columns: dict[str, Any] = {name: getattr(toolpath, name)[rows] for name in COLUMNS} | {"xyz": xyz}
    index = _new_index(rows, toolpath.events.index)
    own = np.isin(rows, toolpath.starts[:-1]) & (np.diff(rows, prepend=-1) == 1)
    starts = np.union1d(piece_starts(still[keep]), np.flatnonzero(own))
    return replace(
        toolpath, **columns, starts=starts[starts > 0], events=replace(toolpath.events, index=index))


def _new_index(rows: Array, index: Array) -> Array:
    """Where the first row that came from `index` or later of the old order is now, events being outside what moved."""
    place = np.minimum.accumulate(np.maximum(rows, 0)[::-1])[::-1]
    return np.minimum(np.searchsorted(place, index), len(rows) - 1)


def only_beads(findings: Sequence[Any]) -> bool:
    """Whether cables at the part are all that was found, and not in travels alone."""
    return all(finding.code == "cable-part" for finding in findings) and not all(one.travel for one in findings)
