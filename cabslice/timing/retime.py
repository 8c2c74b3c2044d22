"""The plan: every piece of the toolpath as fast as the limits allow, then checked between the nodes and derated.

The pieces are independent (the nozzle rests between them), so they are planned in blocks, on as many threads as
asked, with the same result for any number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, PoseError
from cabslice.robot.delta import Machine
from cabslice.robot.model import level_shift, turned
from cabslice.robot.turning import platform_motion
from cabslice.timing.grid import Grid, lay_grid
from cabslice.timing.layers import dwells, paced
from cabslice.timing.limits import RESERVE, Limits, Nodes, highest_x, limits_of, speed_limit, take_up_cap
from cabslice.timing.path import DEVIATION, Path, evaluate, smooth, to_corners
from cabslice.timing.recursion import widened
from cabslice.timing.refusal import cannot_rest, cannot_run, cannot_time
from cabslice.timing.rules import Rules, rules_for
from cabslice.timing.trajectory import Trajectory, nozzle_at, times_between
from cabslice.toolpath.path import Toolpath

BLOCK_NODES = 20_000       # nodes planned together
ROUNDS = 6                 # of tightening where the motion between the nodes breaks a limit
SLACK = RESERVE / 2        # of the reserve that motion between nodes may use
OVERSHOOT = 1e-9           # of the asked speed: rounding
PART_OF_CORNER = 0.98      # of the corner tolerance that is used; the audit measures with finite steps
LEAST_BLEND = 0.5          # of that part is left to blends, however long the window
GENTLE = 0.02              # |d1 - d0| of a vertex that averaging cuts by nothing worth looking at
NEAR, CAUTION = 0.5, 0.95   # mm around a corner (and as far as half a window reaches) with this share of what it stands
PLACES = 200               # of the path, at which the cables' take-up is looked at
LOOKS = 9                  # in each interval, for the place at which a cable cannot run
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Task:
    """What planning a block of pieces needs, the same for all blocks."""

    robot: Machine
    limits: Limits
    toolpath: Toolpath
    path: Path
    grid: Grid
    speed: Array        # (N,) mm/s
    corner_mm: float    # how far the motion may leave the toolpath
    bend: float         # mm/s^2, largest acceleration in corners: what averaging may cut off them
    behind: Array       # (N,) mm from the start of each move back to the last sharp corner of its piece
    ahead: Array        # (N,) mm from the end of each move on to the next one
    tops: tuple[Array, Array]   # (I,) mm^2/s^2 at the start and the end of every interval
    rules: Rules
    calm: Array | None = None   # (N,) share of the acceleration that each move may have; all of it


@dataclass(frozen=True)
class Block:
    """Some pieces: `which` are their intervals in the grid; start (I,) is the node each begins at."""

    pieces: Array       # (B,)
    which: Array        # (I,)
    offsets: Array      # (B+1,) of the nodes
    start: Array        # (I,)
    step: Array         # (G,) mm to the next node; 0 at the end of a piece
    move: Array         # (G,)
    sigma: Array        # (G,) mm into the move


def plan(
    toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any,
    *, engine: str = "compiled", jobs: int = 1, progress: Progress | None = None,
) -> Trajectory:
    """The fastest motion along the toolpath within the limits of the profiles.

    engine is "compiled" or "toppra" (the reference; slower). progress(done, total) counts pieces.
    Raises ImpossibleError where the platform cannot even rest on the path. Source: Pham & Pham 2018.
    """
    task = task_for(toolpath, robot, printer, material, process, engine)
    return timed(task, speeds_of(task, np.arange(len(toolpath.starts) - 1), jobs=jobs, progress=progress))


def speeds_of(task: Task, pieces: Array, *, jobs: int = 1, progress: Progress | None = None) -> Array:
    """x (G,) mm^2/s^2 at the nodes of pieces (B,), in their order. Arguments and errors as `plan`."""
    blocks, speeds = list(blocks_of(task.grid, pieces)), [np.zeros(0)]
    with ThreadPoolExecutor(jobs) as pool:
        for block, x in zip(blocks, pool.map(lambda block: _plan_block(task, block), blocks), strict=True):
            speeds.append(x)
            if progress:
                progress(int(block.pieces[-1]) + 1, len(task.toolpath.starts) - 1)
    return np.concatenate(speeds)


def timed(task: Task, x: Array) -> Trajectory:
    """The motion with x (G,) at the nodes of all pieces; layers are as long as asked."""
    everything = block_of(task.grid, np.arange(len(task.toolpath.starts) - 1))
    return paced(_trajectory(task, everything, x), task.toolpath)


def task_for(toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any, engine: str) -> Task:
    limits = limits_of(printer, material)
    places = np.arange(0, len(toolpath.xyz), len(toolpath.xyz) // PLACES + 1)
    try:
        cap = take_up_cap(robot, limits, toolpath.xyz[places])
    except PoseError:
        raise cannot_run(robot, toolpath, toolpath.xyz[places], places) from None
    limits = replace(limits, acceleration=min(limits.acceleration, cap))
    corner_mm = PART_OF_CORNER * process.corner_mm
    blend_mm, bend = shared_corner(limits, corner_mm)
    path = smooth(toolpath, blend_mm)
    grid, speed = lay_grid(path, toolpath.starts), speed_limit(toolpath, path, limits)
    return Task(robot, limits, toolpath, path, grid, speed, corner_mm, bend, *to_corners(path, toolpath.starts),
                highest_x(grid, path, limits, speed), rules_for(robot, limits, engine))


def shared_corner(limits: Limits, corner_mm: float) -> tuple[float, float]:
    """How much of corner_mm the blends may use, and the acceleration (mm/s^2) across the path that averaging over the
    window turns into the rest: |acceleration| w^2 / 24."""
    if limits.window <= 0:
        return corner_mm, np.inf
    cut = limits.window**2 / 24
    blend_mm = max(corner_mm - cut * np.sqrt(2) * limits.acceleration, LEAST_BLEND * corner_mm)
    return blend_mm, (corner_mm - blend_mm) / cut


def blocks_of(grid: Grid, pieces: Array) -> Iterator[Block]:
    """Runs of pieces (B,) of about BLOCK_NODES nodes."""
    first, upto = 0, np.concatenate(([0], np.cumsum(np.diff(grid.intervals)[pieces])))
    while first < len(pieces):
        last = int(np.searchsorted(upto, upto[first] + BLOCK_NODES, side="right")) - 1
        last = max(last, first + 1)
        yield block_of(grid, pieces[first:last])
        first = last


def block_of(grid: Grid, pieces: Array) -> Block:
    """The intervals and nodes of pieces (B,), in the order given."""
    counts = grid.intervals[pieces + 1] - grid.intervals[pieces]
    offsets = np.concatenate(([0], np.cumsum(counts + 1)))
    ends = offsets[1:] - 1
    start = np.delete(np.arange(offsets[-1]), ends)
    which = start + np.repeat(grid.intervals[pieces] - offsets[:-1], counts)
    move, sigma, step = np.empty(offsets[-1], np.int64), np.empty(offsets[-1]), np.zeros(offsets[-1])
    move[start], sigma[start], step[start] = grid.move[which], grid.low[which], (grid.high - grid.low)[which]
    final = grid.intervals[pieces + 1] - 1
    move[ends], sigma[ends] = grid.move[final], grid.high[final]
    return Block(pieces, which, offsets, start, step, move, sigma)


def _plan_block(task: Task, block: Block) -> Array:
    """x (nodes of the block,) mm^2/s^2: planned, checked as it will be moved, tightened where a limit is broken."""
    try:
        return _tightened(task, block)
    except PoseError:
        sigma = (block.sigma[:, None] + block.step[:, None] * np.linspace(0, 1, LOOKS)).ravel()
        move = np.repeat(block.move, LOOKS)
        raise cannot_run(task.robot, task.toolpath, evaluate(task.path, move, sigma).q, move) from None


def _tightened(task: Task, block: Block) -> Array:
    x, tight = np.empty(len(block.step)), np.ones(len(block.step))
    part, at = block, np.arange(len(x))                    # the pieces still to plan, and their nodes in the block
    for _ in range(ROUNDS):
        x[at] = _solved(task, part, tight[at])
        broken = _broken(task, part, x[at])
        if not (broken > 1).any():
            return x
        tight[at] *= broken
        part, at = _still_broken(task.grid, part, at, broken)
    while ((broken := _broken(task, part, x[at])) > 1).any():
        worst = np.maximum.reduceat(broken, part.offsets[:-1])
        x[at] /= np.repeat(np.where(worst > 1, 1.05 * worst, 1.0), np.diff(part.offsets))
    return x


def _solved(task: Task, block: Block, tight: Array) -> Array:
    places = nodes_at(task, block.move, block.sigma)
    top = widened(_tops(task, block) / tight, block.step, block.offsets, task.limits.window)
    top = np.minimum(top, task.bend / np.maximum(np.linalg.norm(places.d2, axis=1), 1e-9))
    x, margin = task.rules.solve(places, tight, top, block.step, block.offsets)
    if not (margin > 0).all():
        worst = int(np.argmin(np.nan_to_num(margin, nan=-np.inf)))
        raise cannot_rest(task.robot, task.toolpath, task.path, int(block.move[worst]), float(block.sigma[worst]),
                          float(margin[worst]))
    return x


def _still_broken(grid: Grid, block: Block, at: Array, broken: Array) -> tuple[Block, Array]:
    worst = np.maximum.reduceat(broken, block.offsets[:-1]) > 1
    return block_of(grid, block.pieces[worst]), at[np.repeat(worst, np.diff(block.offsets))]


def nodes_at(task: Task, move: Array, sigma: Array) -> Nodes:
    """What the limits need to know of places sigma (K,) mm into moves (K,)."""
    motion = evaluate(task.path, move, sigma)
    away = np.minimum(sigma + task.behind[move], task.path.length[move] - sigma + task.ahead[move])
    near = away < NEAR + task.speed[move] * task.limits.window / 2
    most = np.where(near, min(task.limits.acceleration, CAUTION * task.bend), task.limits.acceleration)
    if task.calm is not None:
        most = most * task.calm[move]
    robot, nozzle = task.robot, (motion.q, motion.d1, motion.d2)
    platform = platform_motion(robot.turning, robot.nozzle, level_shift(robot), *nozzle)
    feed = task.path.feed[move]
    if task.limits.advance:
        feed = feed * np.where(task.path.direction[move].any(axis=1), task.limits.gain, 1.0)
    return Nodes(*platform, feed, most, nozzle[1:] if robot.turning is not None else None)


def _tops(task: Task, block: Block) -> Array:
    top = np.full(len(block.step), np.inf)
    top[block.start] = task.tops[0][block.which]
    top[block.start + 1] = np.minimum(top[block.start + 1], task.tops[1][block.which])
    top[block.offsets[:-1]] = top[block.offsets[1:] - 1] = 0.0
    return top


def _broken(task: Task, block: Block, x: Array) -> Array:
    """Factors (G,) by which to tighten the nodes around places that break a limit: 1 where there is none.

    Looked at half-way in time between the nodes. What the plan keeps, its average keeps: the limits are convex.
    """
    start, step = block.start, block.step[block.start]
    first, last = np.sqrt(x[start]), np.sqrt(x[start + 1])
    rate, u = (first + last) / 2, (x[start + 1] - x[start]) / (2 * step)
    if not (rate > 0).all():
        raise _cannot_time(task, block, int(start[np.argmin(rate > 0)]))
    sigma = block.sigma[start] + step * (first + rate) / (2 * (first + last))
    share = task.rules.used(nodes_at(task, block.move[start], sigma), u, rate**2) / (1 + SLACK)
    if not np.isfinite(share).all():
        raise _cannot_time(task, block, int(start[np.argmin(np.isfinite(share))]))
    factor, bad = np.ones(len(x)), share > 1
    wanted = 1.02 * np.minimum(share[bad], 4.0)
    np.maximum.at(factor, start[bad], wanted)
    np.maximum.at(factor, start[bad] + 1, wanted)
    if task.limits.window > 0:
        _pull_in(task, block, x, factor)
    return factor


def _cannot_time(task: Task, block: Block, node: int) -> ImpossibleError:
    return cannot_time(task.toolpath, task.path, int(block.move[node]), float(block.sigma[node]))


def _pull_in(task: Task, block: Block, x: Array, factor: Array) -> None:
    """Raise factor (G,) around every vertex that the averaged motion would pass too far away."""
    trajectory, path = _trajectory(task, block, x), task.path
    vertex = block.start[block.sigma[block.start] == 0]
    vertex = np.setdiff1d(vertex, block.offsets[:-1])
    before = path.before[block.move[vertex]]
    turn = np.linalg.norm(path.direction[path.after[before]] - path.direction[before], axis=1)
    vertex, before = vertex[turn > GENTLE], before[turn > GENTLE]
    off = np.linalg.norm(nozzle_at(trajectory, trajectory.time[vertex]) - path.vertex[before], axis=1)
    blend = DEVIATION * path.half[before] * turn[turn > GENTLE]
    share = np.maximum(off - blend, 0) / np.maximum(task.corner_mm - blend, 1e-9)
    far = np.flatnonzero(share > 1 + SLACK)
    times, half = trajectory.time[vertex[far]], task.limits.window / 2
    low = np.searchsorted(trajectory.time, times - half)
    high = np.searchsorted(trajectory.time, times + half, side="right")
    for first, last, value in zip(low, high, np.minimum(share[far], 4.0), strict=True):
        np.maximum(factor[first:last], 1.02 * value, out=factor[first:last])


def _trajectory(task: Task, block: Block, x: Array) -> Trajectory:
    """The motion of the pieces of a block with x (G,) at its nodes; the clock starts at 0."""
    s = task.path.start[block.move] + block.sigma
    time = _clock(task.toolpath, block, s, x, task.limits.window)
    return Trajectory(task.path, time, s, x, block.move, block.offsets, level_shift(task.robot), task.limits.window,
                      *turned(task.robot), task.limits.advance)


def _clock(toolpath: Toolpath, block: Block, s: Array, x: Array, window: float) -> Array:
    """Absolute time of every node, a window of rest between pieces and dwells before them."""
    spent = np.zeros(len(s))
    with np.errstate(divide="ignore", invalid="ignore"):
        spent[block.start + 1] = times_between(s, x)[block.start]
    spent[block.offsets[:-1]] = window
    spent[0] = window / 2
    spent[block.offsets[:-1]] += dwells(toolpath)[block.pieces]
    return np.cumsum(spent)
