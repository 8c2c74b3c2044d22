"""Travels led around what stands: for those that would bring a cable, the nozzle or the platform to the part.

Legend
    run      travel moves in a row, of one piece and layer, without an event in them
    F        nozzle positions, in plan, that are forbidden at one height: the affine images of the beads laid so far for
             each cable (obstacles.forbidden_region), and the beads grown by each body that hangs lower than they reach
    lift     height over the run at which the way is looked for, mm; level heights follow the slope of the bed

The shortest way around F runs over its corners (visibility graph; Lozano-Perez and Wesley 1979). F is drawn for exit
points that stand still and grown by what they can move; a way is taken only where the search that proves a print
(sweep, shapes) finds it free. What has no way stays as it was, and a finding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.bodies import Body, swept_bodies
from cabslice.feasibility.exits import exits_of, hung
from cabslice.feasibility.obstacles import (
    LENGTH,
    Moves,
    Obstacles,
    beads_of,
    cut_lines,
    forbidden_region,
    moves_of,
    moving,
    printing_stages,
)
from cabslice.feasibility.shapes import TIP, Widths, all_met, reached
from cabslice.feasibility.sweep import contacts
from cabslice.feasibility.trees import AXES, Tree, bounds_of_beads, tree_of_beads, tree_of_moves
from cabslice.robot.model import Robot
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Events, Toolpath

LIFTS = (0.0, 1.0, 3.0, 10.0, 30.0, 60.0)   # mm
SPARE = 0.2                           # mm, between a way and F
DRAWN = (0.0, False), (0.3, False), (1.0, True)   # F: grown by this share of what exit points move; with all stages
LOOSE = (0.1, 0.5, 2.0)               # mm, by which the corners of F are thinned out
CORNERS = 150                         # more than that are thinned out more
WINDOWS = (20.0, 0.5), (60.0, 2.0)    # around a run, mm and share of its length
SAME = 1e-6                           # mm
ENDLESS = 10**9                       # stages that may fail
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer", "object")


@dataclass(frozen=True)
class Rerouted:
    toolpath: Toolpath
    count: int           # runs led another way
    lifted: int          # of them above the height they had
    longer_mm: float
    left: int            # blocked runs for which no way was found

    @property
    def sentence(self) -> str:
        words = [f"{self.count} travel{'s' if self.count != 1 else ''} rerouted around what stands"]
        words += [f"{self.lifted} of them lifted"] if self.lifted else []
        words += [f"{self.longer_mm:.1f} mm longer in all"]
        words += [f"{self.left} more found no way"] if self.left else []
        return ", ".join(words) + "."


@dataclass(frozen=True)
class Run:
    first: int           # rows of the toolpath, first to last
    last: int
    stage: int
    points: Array        # (n, 3) mm, where it starts included; over a level bed

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def reroute(toolpath: Toolpath, robot: Robot, grow: Array) -> Rerouted | None:
    """The toolpath with its blocked travels led around; None where none is blocked, or none can be.

    grow (m,) mm: what the centre line of each cable stays away from everything by (check.grown).
    """
    stages = printing_stages(toolpath)
    judge = _Judge(toolpath, robot, grow, stages)
    runs = _runs(toolpath, stages, robot.bed_slope)
    blocked = judge.blocked([run.points for run in runs], [run.stage for run in runs])
    ways: dict[int, Array] = {}
    lifted = 0
    for lift, drawing in itertools.product(LIFTS, DRAWN):
        todo = [i for i in np.flatnonzero(blocked).tolist() if i not in ways]
        drawn = {i: way for i in todo for way in [_way(runs[i], judge, lift, *drawing)] if way is not None}
        bad = judge.blocked(list(drawn.values()), [runs[i].stage for i in drawn])
        found = {i: way for (i, way), blocks in zip(drawn.items(), bad.tolist(), strict=True) if not blocks}
        lifted += len(found) * (lift > 0)
        ways |= found
    if not ways:
        return None
    longer = sum(_long(way) - runs[i].length for i, way in ways.items())
    path = _replaced(toolpath, {runs[i].first: (runs[i], _sloping(way, robot.bed_slope)) for i, way in ways.items()})
    return Rerouted(path, len(ways), lifted, float(longer), int(blocked.sum()) - len(ways))


def _long(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _sloping(points: Array, slope: Array) -> Array:
    return points + np.column_stack((np.zeros((len(points), 2)), points[:, :2] @ slope))


def _runs(toolpath: Toolpath, stages: Array, slope: Array) -> list[Run]:
    travel = moving(toolpath) & (toolpath.role == Role.TRAVEL) & (toolpath.filament == 0)
    fresh = np.diff(toolpath.layer, prepend=toolpath.layer[:1]) != 0
    fresh[toolpath.starts[:-1]] = True
    fresh[toolpath.events.index] = True
    begin = travel & (fresh | ~np.concatenate(([False], travel[:-1])))
    first = np.flatnonzero(begin)
    last = np.append(first[1:], len(travel)) - 1
    ends = np.flatnonzero(travel & ~np.append(travel[1:], False))
    last = np.minimum(last, ends[np.searchsorted(ends, first)]) if len(first) else last
    level = _sloping(toolpath.xyz, -slope)
    return [Run(a, b, int(stages[b]), level[a - 1:b + 1]) for a, b in zip(first.tolist(), last.tolist(), strict=True)]


class _Judge:
    """What stands, and whether ways are free of it: the search of the check itself."""

    def __init__(self, toolpath: Toolpath, robot: Robot, grow: Array, stages: Array) -> None:
        self.robot, self.grow = robot, grow
        self.beads = tree_of_beads(beads_of(toolpath, stages))
        self.level = self.beads
        if robot.bed_slope.any():
            flat = replace(toolpath, xyz=_sloping(toolpath.xyz, -robot.bed_slope))
            self.level = tree_of_beads(beads_of(flat, stages))
        tip = Body(TIP, np.zeros((1, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
        self.bodies = [Widths(body) for body in (tip, *swept_bodies(robot, *reached(moves_of(toolpath, stages))))]

    def blocked(self, ways: Sequence[Array], stages: Sequence[int]) -> Array:
        """(K,) bool of ways (n, 3) mm, over a level bed, taken in these stages."""
        found = np.zeros(len(ways), bool)
        if not ways:
            return found
        flat = _moves(ways, stages)
        slope = self.robot.bed_slope
        moves = tree_of_moves(_moves([_sloping(way, slope) for way in ways], stages), self.robot)
        level = tree_of_moves(flat, self.robot) if slope.any() else moves
        met = contacts(moves, self.beads, self.robot, self.grow, stop=ENDLESS, far=0.0)
        found[moves.items.move[met.move]] = True
        for i, body in enumerate(self.bodies):
            ours, laid = (level, self.level) if i == 0 else (moves, self.beads)
            found[ours.items.move[all_met(ours, laid, body)]] = True
        return found

    def forbidden(self, stage: int, height: float, window: tuple[Array, Array], share: float, every: bool) -> Any:
        """F (shapely) in a box (corners (2,) in plan), the nozzle at height mm; grown by a share of the drift.

        Not `every`: of as few stages as their images, grown up and down, need to overlap in upright walls.
        """
        import shapely

        beads = self._until(self.beads, stage)
        if not every and len(beads):
            skipped = max(int(2 * self.grow.min() / max(float((beads.top - beads.low)[-1]), SAME)), 1)
            beads = beads.take(np.flatnonzero((stage - beads.stage) % skipped == 0))
        corners = np.column_stack((np.stack(window), [height, height]))
        exits, drift = exits_of(self.robot, corners[:1], corners[1:])
        regions = [
            forbidden_region(beads, exits[0, i], offset, height, float(self.grow[i] + share * drift[0, i]), window)
            for i, offset in enumerate(hung(self.robot, corners.mean(axis=0)[None])[0])
        ]
        earlier = self._until(self.beads, stage - 1)
        regions += [_under(earlier, body, height, window) for body in self.bodies]
        return shapely.union_all(regions)

    @staticmethod
    def _until(tree: Tree, stage: int) -> Obstacles:
        laid = tree.items
        assert isinstance(laid, Obstacles)
        return laid.take(slice(0, int(np.searchsorted(laid.stage, stage, side="right"))))


def _moves(ways: Sequence[Array], stages: Sequence[int]) -> Moves:
    count = np.array([len(way) - 1 for way in ways])
    start, end = np.vstack([way[:-1] for way in ways]), np.vstack([way[1:] for way in ways])
    which = np.repeat(np.arange(len(ways)), count)
    part, start, end = cut_lines(start, end, LENGTH)
    return Moves(start, end, np.asarray(stages, np.int32)[which[part]], which[part])


def _under(beads: Obstacles, body: Widths, height: float, window: tuple[Array, Array]) -> Any:
    """Boxes around the beads that reach higher than the body with the nozzle at this height."""
    import shapely

    beads = beads.take(np.flatnonzero(beads.top - height > body.low))
    if not len(beads):
        return shapely.Polygon()
    bounds, reach = bounds_of_beads(beads), body.below(beads.top - height)
    x, y = 0, AXES // 2
    low = np.stack((bounds.lo[:, x] - reach[:, x], bounds.lo[:, y] - reach[:, y]), axis=1)
    high = np.stack((bounds.hi[:, x] + reach[:, AXES + x], bounds.hi[:, y] + reach[:, AXES + y]), axis=1)
    near = np.flatnonzero(((low < window[1]) & (high > window[0])).all(axis=1))
    return shapely.union_all(shapely.box(*low[near].T, *high[near].T))


# ---- the way around

def _way(run: Run, judge: _Judge, lift: float, drift: float, every: bool) -> Array | None:
    """Points (n, 3) from the start of a run to its end, around F at `lift` over it."""
    start, end = run.points[0], run.points[-1]
    height = float(run.points[:, 2].max()) + lift
    length = float(np.linalg.norm(end[:2] - start[:2]))
    if length < SAME:
        return None
    for wide, share in WINDOWS:
        margin = wide + share * length
        low, high = np.minimum(start, end)[:2] - margin, np.maximum(start, end)[:2] + margin
        half = judge.robot.bed_size / 2 if judge.robot.bed_size is not None else np.full(2, np.inf)
        region = judge.forbidden(run.stage, height, (low, high), drift, every)
        plan = _around(region, start[:2], end[:2], np.maximum(low, -half), np.minimum(high, half))
        if plan is not None:
            level = np.column_stack((plan, np.full(len(plan), height)))
            points = np.vstack((start, level, end))
            moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME
            return points[np.concatenate(([True], moved))]
    return None


def _around(region: Any, start: Array, end: Array, low: Array, high: Array) -> Array | None:
    """Shortest polyline (n, 2) from start to end that keeps out of a region and within a box; None: there is none."""
    import shapely
    from scipy.sparse.csgraph import dijkstra

    shapely.prepare(region)
    if shapely.intersects(region, shapely.points(np.stack((start, end)))).any():
        return None
    corners = _corners(region)
    corners = corners[((corners >= low) & (corners <= high)).all(axis=1)]
    places = np.vstack((start, end, corners))
    one, other = np.triu_indices(len(places), 1)
    lines = shapely.linestrings(np.stack((places[one], places[other]), axis=1))
    free = ~shapely.intersects(region, lines)
    graph = np.zeros((len(places), len(places)))
    graph[one[free], other[free]] = np.linalg.norm(places[other[free]] - places[one[free]], axis=1)
    _, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
    if before[1] < 0:
        return None
    row = [1]
    while row[-1] != 0:
        row.append(int(before[row[-1]]))
    return places[row[::-1]]


def _corners(region: Any) -> Array:
    """(n, 2) corners of a region drawn SPARE around it, thinned out without coming nearer."""
    import shapely

    for loose in LOOSE:
        drawn = shapely.simplify(shapely.buffer(region, SPARE + loose, join_style="mitre"), loose)
        corners = shapely.get_coordinates(drawn)
        if len(corners) <= CORNERS:
            break
    return np.unique(np.asarray(corners), axis=0)


# ---- rows

def _replaced(toolpath: Toolpath, ways: dict[int, tuple[Run, Array]]) -> Toolpath:
    """The toolpath with runs, by their first row, replaced by ways (n, 3); their rows are like the run's last one."""
    count = np.ones(len(toolpath.xyz), int)
    for first, (run, way) in ways.items():
        count[first:run.last + 1] = 0
        count[run.last] = len(way) - 1
    row = np.repeat(np.arange(len(count)), count)
    columns: dict[str, Any] = {name: getattr(toolpath, name)[row] for name in COLUMNS}
    offset = np.cumsum(count) - count
    for run, way in ways.values():
        columns["xyz"][offset[run.last]:offset[run.last] + len(way) - 1] = way[1:]
    events = toolpath.events
    moved = Events(offset[events.index], events.kind, events.value)
    starts = np.append(offset, len(row))[toolpath.starts]
    return replace(toolpath, **columns, starts=starts, events=moved)


def only_travels(findings: Sequence[Any]) -> bool:
    """Whether what was found against a path is of travels that may be led another way, and nothing else."""
    mine = [finding for finding in findings if finding.code in ("cable-part", "head-part")]
    return bool(mine) and len(mine) == len(findings) and all(finding.travel for finding in mine)


