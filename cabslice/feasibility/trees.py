"""Bounding trees over moves and beads in the order of printing, and the gap between what a cable sweeps and beads.

Legend
    axes     AXES directions in plan over half a turn; lo, hi: least and greatest x . axis, 2 AXES half-planes in all
             (k-DOP; Klosowski et al. 1998)
    leaf     up to LEAF neighbouring moves (or beads) of one stage; level l of a tree joins 2^l leaves in a row
    X        where a cable crosses a range of heights: (1 - s) A + s b, s from first to last; linear in s, A and b, so
             that its extent along an axis is that of the ends

A gap on one axis proves that everything in the two nodes is apart: a node is discarded only on such a proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.distance import height_range
from cabslice.feasibility.exits import exit_boxes, hung_boxes
from cabslice.feasibility.obstacles import Moves, Obstacles
from cabslice.robot.model import Robot

AXES = 8
LEAF = 16
BLOCK = 1 << 13      # items in one sweep: they stay in the cache
TURNS = np.pi / AXES * np.arange(AXES)
DIRECTIONS = np.stack((np.cos(TURNS), np.sin(TURNS)))       # (2, AXES)


@dataclass(frozen=True)
class Bounds:
    """Bounds of nodes as columns."""

    lo: Array            # (n, AXES) mm
    hi: Array            # (n, AXES) mm
    low: Array           # (n,) mm, least z
    top: Array           # (n,) mm, greatest z
    first: Array         # (n,) least stage
    last: Array          # (n,) greatest stage

    def take(self, rows: Array) -> Bounds:
        return Bounds(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Tree:
    """Items sorted into leaves: leaf i holds items starts[i]:starts[i+1]; levels[l] bounds 2^l leaves each."""

    items: Moves | Obstacles
    starts: Array
    levels: tuple[Bounds, ...]
    exits: tuple[tuple[Array, Array], ...] = ()     # per level, boxes (n, m, 3) of exit points; moves only
    hung: tuple[tuple[Array, Array], ...] = ()      # per level, boxes (n, m, 3) of attachment minus nozzle; if turned

    @property
    def leaves(self) -> int:
        return len(self.starts) - 1


def tree_of_moves(moves: Moves, robot: Robot) -> Tree:
    order, starts = _leaves(moves.start[:, :2], moves.end[:, :2], moves.stage)
    moves = moves.take(order)
    leaf = _bounds(starts, lambda part: bounds_of_moves(moves.take(part)))
    low = np.stack((leaf.lo[:, 0], leaf.lo[:, AXES // 2], leaf.low), axis=1)
    high = np.stack((leaf.hi[:, 0], leaf.hi[:, AXES // 2], leaf.top), axis=1)
    levels = _levels(leaf)
    exits = _risen(_boxes(exit_boxes, robot, low, high), len(levels))
    hung = _risen(_boxes(hung_boxes, robot, low, high), len(levels)) if robot.turning is not None else ()
    return Tree(moves, starts, levels, exits, hung)


def tree_of_beads(beads: Obstacles) -> Tree:
    order, starts = _leaves(beads.first, beads.last, beads.stage)
    beads = beads.take(order)
    return Tree(beads, starts, _levels(_bounds(starts, lambda part: bounds_of_beads(beads.take(part)))))


def bounds_of_moves(moves: Moves) -> Bounds:
    start, end = moves.start[:, :2] @ DIRECTIONS, moves.end[:, :2] @ DIRECTIONS
    low, top = np.minimum(moves.start[:, 2], moves.end[:, 2]), np.maximum(moves.start[:, 2], moves.end[:, 2])
    return Bounds(np.minimum(start, end), np.maximum(start, end), low, top, moves.stage, moves.stage)


def bounds_of_beads(beads: Obstacles) -> Bounds:
    first, last, half = beads.first @ DIRECTIONS, beads.last @ DIRECTIONS, beads.half[:, None]
    lo, hi = np.minimum(first, last) - half, np.maximum(first, last) + half
    return Bounds(lo, hi, beads.low, beads.top, beads.stage, beads.stage)


def cable_gap(
    moves: Bounds, exit_low: Array, exit_high: Array, offsets: Array, beads: Bounds, reach: Array,
    spread: Array | None = None,
) -> Array:
    """Proven distance (n,) mm between the cable in all its places and all the beads, pair by pair; negative: no proof.

    exit_low, exit_high (n, 3): box of exit points; offsets (n, 3): attachment minus nozzle; reach (n,) mm: where the
    heights are farther apart than this the gap is inf; spread (n, 3): by how much offsets may differ.
    """
    low, top, wide = moves.low + offsets[:, 2], moves.top + offsets[:, 2], 0.0
    if spread is not None:
        low, top, wide = low - spread[:, 2], top + spread[:, 2], spread[:, :2] @ abs(DIRECTIONS)
    first, last = height_range(exit_low[:, 2], exit_high[:, 2], low, top, beads.low - reach, beads.top + reach)
    middle, around = (exit_low + exit_high)[:, :2] / 2 @ DIRECTIONS, (exit_high - exit_low)[:, :2] / 2 @ abs(DIRECTIONS)
    shift = offsets[:, :2] @ DIRECTIONS
    inner, outer = np.clip(first, 0.0, 1.0)[:, None], np.clip(last, 0.0, 1.0)[:, None]
    start, end = middle + around, moves.hi + shift + wide
    end -= start
    highest = start + np.maximum(inner * end, outer * end)
    start, end = middle - around, moves.lo + shift - wide
    end -= start
    lowest = start + np.minimum(inner * end, outer * end)
    gap = np.maximum(beads.lo - highest, lowest - beads.hi).max(axis=1)
    return np.where(first > last, np.inf, gap)


def _risen(leaf: tuple[Array, Array], levels: int) -> tuple[tuple[Array, Array], ...]:
    """Boxes of the leaves and of all levels over them."""
    boxes = [leaf]
    for _ in range(levels - 1):
        lower, upper = boxes[-1]
        boxes.append((_pairs(np.minimum, lower), _pairs(np.maximum, upper)))
    return tuple(boxes)


def _boxes(
    of: Callable[[Robot, Array, Array], tuple[Array, Array]], robot: Robot, low: Array, high: Array
) -> tuple[Array, Array]:
    step = BLOCK // 8
    parts = [of(robot, low[i:i + step], high[i:i + step]) for i in range(0, len(low), step)]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _leaves(start: Array, end: Array, stage: Array) -> tuple[Array, Array]:
    """Order of the items, neighbours of a stage together, and where the leaves start."""
    key = _morton((start + end) / 2)
    key |= (stage - stage.min()).astype(np.uint64) << np.uint64(32)
    order = np.argsort(key, kind="stable")
    fresh = np.diff(stage[order], prepend=stage.min() - 1) != 0
    begin = np.flatnonzero(fresh)
    rank = np.arange(len(order)) - begin[np.cumsum(fresh) - 1]
    return order, np.append(np.flatnonzero(rank % LEAF == 0), len(order))


def _morton(points: Array) -> Array:
    """Place (K,), 32 bits, of plan points along a Z-shaped curve that keeps neighbours together."""
    low = points.min(axis=0)
    cells = ((points - low) / max(float((points.max(axis=0) - low).max()), 1e-9) * 65535).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    return cells[:, 0] | cells[:, 1] << np.uint64(1)


def _bounds(starts: Array, bounds_of: Callable[[slice], Bounds]) -> Bounds:
    """Bounds of the leaves, a block of them at a time."""
    step = BLOCK // LEAF
    parts = []
    for i in range(0, len(starts) - 1, step):
        cut = starts[i:i + step + 1]
        parts.append(_joined(bounds_of(slice(cut[0], cut[-1])), cut[:-1] - cut[0]))
    return Bounds(*(np.concatenate([getattr(part, name) for part in parts]) for name in Bounds.__dataclass_fields__))


def _joined(bounds: Bounds, starts: Array) -> Bounds:
    return Bounds(
        np.minimum.reduceat(bounds.lo, starts), np.maximum.reduceat(bounds.hi, starts),
        np.minimum.reduceat(bounds.low, starts), np.maximum.reduceat(bounds.top, starts),
        np.minimum.reduceat(bounds.first, starts), np.maximum.reduceat(bounds.last, starts),
    )


def _levels(leaf: Bounds) -> tuple[Bounds, ...]:
    levels = [leaf]
    while len(levels[-1].low) > 1:
        levels.append(_joined(levels[-1], np.arange(0, len(levels[-1].low), 2)))
    return tuple(levels)


def _pairs(ufunc: np.ufunc, column: Array) -> Array:
    return ufunc.reduceat(column, np.arange(0, len(column), 2))


def members(starts: Array, groups: Array, *columns: Array) -> tuple[Array, list[Array]]:
    """The members starts[g]..starts[g+1]-1 of each group, the other columns repeated."""
    count = starts[groups + 1] - starts[groups]
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return np.repeat(starts[groups], count) + within, [np.repeat(column, count) for column in columns]
