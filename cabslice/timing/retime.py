"""The plan: every piece of the toolpath as fast as the limits allow, then checked between the nodes and derated.

The pieces are independent (the nozzle rests between them), so they are planned in blocks, on as many threads as
asked, with the same result for any number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, UsageError
from cabslice.feasibility.findings import Finding
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.timing.grid import Grid, lay_grid
from cabslice.timing.limits import (
    RESERVE,
    Limits,
    Nodes,
    highest_x,
    limits_of,
    rows,
    speed_limit,
    winder_speed_x,
)
from cabslice.timing.path import Path, evaluate, smooth
from cabslice.timing.trajectory import Trajectory, times_of
from cabslice.toolpath.path import EventKind, Toolpath

BLOCK_NODES = 12_000       # nodes planned together; their rows take about 2 kB each
ROUNDS = 4                 # of tightening rows where the motion between two nodes breaks them
SLACK = RESERVE / 2        # of the reserve that motion between nodes may use
Progress = Callable[[int, int], None]
Engine = Callable[[Array, Array, Array, Array, Array], Array]


@dataclass(frozen=True)
class Task:
    """What planning a block of pieces needs, the same for all blocks."""

    robot: Robot
    limits: Limits
    toolpath: Toolpath
    path: Path
    grid: Grid
    speed: Array        # (N,) mm/s
    engine: Engine


def plan(
    toolpath: Toolpath, robot: Robot, printer: Any, material: Any, process: Any,
    *, engine: str = "compiled", jobs: int = 1, progress: Progress | None = None,
) -> Trajectory:
    """The fastest motion along the toolpath within the limits of the profiles.

    engine is "compiled" or "toppra" (the reference; slower). progress(done, total) counts pieces.
    Raises ImpossibleError where the platform cannot even rest on the path. Source: Pham & Pham 2018.
    """
    path = smooth(toolpath, process.corner_mm)
    limits = limits_of(printer, material)
    task = Task(robot, limits, toolpath, path, lay_grid(path, toolpath.starts),
                speed_limit(toolpath, path, limits), _engine(engine))
    blocks = list(_blocks(task.grid.intervals))
    speeds: list[Array] = []
    with ThreadPoolExecutor(jobs) as pool:
        for block, x in zip(blocks, pool.map(lambda block: _plan_block(task, *block), blocks), strict=True):
            speeds.append(x)
            if progress:
                progress(block[1], len(toolpath.starts) - 1)
    return _assemble(task, np.concatenate(speeds))


def _engine(name: str) -> Engine:
    if name == "compiled":
        from cabslice.timing.recursion import retime
        return retime
    if name == "toppra":
        from cabslice.timing.stock import retime as stock
        return stock
    raise UsageError(f"unknown engine '{name}': expected compiled or toppra")


def _blocks(intervals: Array) -> Iterator[tuple[int, int]]:
    """Runs of pieces [first, last) of about BLOCK_NODES nodes."""
    first = 0
    while first < len(intervals) - 1:
        last = int(np.searchsorted(intervals, intervals[first] + BLOCK_NODES, side="right")) - 1
        last = max(last, first + 1)
        yield first, last
        first = last


def _plan_block(task: Task, first: int, last: int) -> Array:
    """x (nodes of pieces first..last-1,) mm^2/s^2."""
    grid, spans = task.grid, task.grid.intervals[first:last + 1]
    nodes = spans - spans[0] + np.arange(len(spans))
    which = slice(spans[0], spans[-1])
    start = np.delete(np.arange(nodes[-1]), nodes[1:] - 1)           # node at which each interval starts
    move, sigma = _node_places(grid, which, nodes, start)
    places = _nodes(task, move, sigma)
    a, b = rows(task.robot, task.limits, places, lambda margin: _cannot_rest(task, move, places, margin))
    top = _tops(task, which, nodes, start, places)
    step = np.zeros(nodes[-1])
    step[start] = grid.high[which] - grid.low[which]
    x = task.engine(a, b, top, step, nodes)
    return _mend(task, which, nodes, start, a, b, top, step, x)


def _node_places(grid: Grid, which: slice, nodes: Array, start: Array) -> tuple[Array, Array]:
    """Move and distance into it of every node."""
    move, sigma = np.empty(nodes[-1], np.int64), np.empty(nodes[-1])
    move[start], sigma[start] = grid.move[which], grid.low[which]
    ends = nodes[1:] - 1
    final = grid.intervals[0] + np.searchsorted(start, ends) - 1 + which.start - grid.intervals[0]
    move[ends], sigma[ends] = grid.move[final], grid.high[final]
    return move, sigma


def _nodes(task: Task, move: Array, sigma: Array) -> Nodes:
    motion = evaluate(task.path, move, sigma)
    still = np.zeros((len(move), 3))
    return Nodes(nozzle_poses(task.robot, motion.q), np.hstack((motion.d1, still)), np.hstack((motion.d2, still)),
                 task.path.feed[move])


def _tops(task: Task, which: slice, nodes: Array, start: Array, places: Nodes) -> Array:
    at_start, at_end = highest_x(task.grid, task.path, task.limits, task.speed)
    top = winder_speed_x(task.robot, places)
    top[start] = np.minimum(top[start], at_start[which])
    top[start + 1] = np.minimum(top[start + 1], at_end[which])
    top[nodes[:-1]] = top[nodes[1:] - 1] = 0.0
    return top


def _mend(
    task: Task, which: slice, nodes: Array, start: Array, a: Array, b: Array, top: Array, step: Array, x: Array
) -> Array:
    """Tighten the rows of intervals whose middle breaks them and plan again; at last stretch the time of the piece."""
    grid = task.grid
    bent = np.flatnonzero(_in_blend(task.path, grid.move[which], grid.low[which], grid.high[which]))
    middle = (grid.low[which] + grid.high[which])[bent] / 2
    inside = _nodes(task, grid.move[which][bent], middle)
    rows_a, rows_b = rows(task.robot, task.limits, inside, lambda margin: None)
    left = start[bent]
    for _ in range(ROUNDS):
        used = _used(rows_a, rows_b, x, left, step)
        worst = np.flatnonzero(used > 1 + SLACK)
        if not len(worst):
            return x
        for node in (left[worst], left[worst] + 1):
            factor = np.ones(len(a))
            np.maximum.at(factor, node, used[worst])
            a, b = a * factor[:, None], b * factor[:, None]
        x = task.engine(a, b, top, step, nodes)
    used = _used(rows_a, rows_b, x, left, step)
    stretch = np.ones(len(nodes) - 1)
    np.maximum.at(stretch, np.searchsorted(nodes, left, side="right") - 1, used / (1 + SLACK))
    return x / np.repeat(stretch, np.diff(nodes))


def _in_blend(path: Path, move: Array, low: Array, high: Array) -> Array:
    middle = (low + high) / 2
    return (middle < path.half[move - 1]) | (middle > path.length[move] - path.half[move])


def _used(a: Array, b: Array, x: Array, left: Array, step: Array) -> Array:
    """Largest share of any row used in the middle of the intervals that start at nodes `left`."""
    u = (x[left + 1] - x[left]) / (2 * step[left])
    between = (x[left + 1] + x[left]) / 2
    return (a * u[:, None] + b * between[:, None]).max(axis=1, initial=0.0)


def _cannot_rest(task: Task, move: Array, places: Nodes, margin: Array) -> None:
    worst = int(np.argmin(margin))
    row = move[worst]
    x, y, z = (float(value) for value in task.toolpath.xyz[row])
    layer = int(task.toolpath.layer[row])
    sentence = (f"layer {layer}: no cable tensions within bounds hold the platform with the nozzle near "
                f"x {x:.1f} y {y:.1f} z {z:.1f} mm")
    finding = Finding("tension", layer, (x, y, z), 0, float(margin[worst]), 0.0, "N", sentence,
                      "move the part towards the middle of the bed or lower its height")
    raise ImpossibleError(sentence, [finding])


def _assemble(task: Task, x: Array) -> Trajectory:
    grid, toolpath, path = task.grid, task.toolpath, task.path
    pieces = grid.intervals + np.arange(len(grid.intervals))
    start = np.delete(np.arange(pieces[-1]), pieces[1:] - 1)
    move, s = np.empty(pieces[-1], np.int64), np.empty(pieces[-1])
    move[start], s[start] = grid.move, path.start[grid.move] + grid.low
    move[pieces[1:] - 1] = grid.move[grid.intervals[1:] - 1]
    s[pieces[1:] - 1] = (path.start[grid.move] + grid.high)[grid.intervals[1:] - 1]
    return Trajectory(path, _times(toolpath, s, x, start, pieces), s, x, move, pieces,
                      nozzle_poses(task.robot, np.zeros((1, 3)))[0, :3])


def _times(toolpath: Toolpath, s: Array, x: Array, start: Array, pieces: Array) -> Array:
    """Absolute time of every node; dwells before a piece are waited for there."""
    spent = np.zeros(len(s))
    with np.errstate(divide="ignore", invalid="ignore"):
        spent[start + 1] = times_of(s, x)[start]
    events = toolpath.events
    dwells = events.kind == EventKind.DWELL
    piece = np.clip(np.searchsorted(toolpath.starts, events.index[dwells], side="left"), 0, len(pieces) - 2)
    np.add.at(spent, pieces[piece], events.value[dwells])
    return np.cumsum(spent)
