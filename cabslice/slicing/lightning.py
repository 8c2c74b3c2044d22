"""Infill that holds only what is above it: trees that grow on the walls and branch out under top skins.

From the top down: under what is hollow no more in the next layer up (skins, walls), places further than `reach` from a
wall or a branch get a branch, to the nearest of either. Every layer further down each branch ends a layer height
earlier (45 deg), so that it rests on the branch below; near the walls nothing is left of it.

N nodes, E edges of a region, G places.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabslice.arrays import Array
from cabslice.profile.process import Process
from cabslice.slicing.fill import sparse_pitch
from cabslice.slicing.flow import bead_spacing
from cabslice.slicing.heights import Heights
from cabslice.slicing.infill import fixed_lines
from cabslice.slicing.region import Region, contains, difference, following, from_rings, intersection, offset, to_rings
from cabslice.slicing.sections import Solid, cut
from cabslice.slicing.unsupported import segments_meeting

COARSE = 0.1     # of the bead: detail of outlines that trees do not see
MOVES = 0.5      # of the reach: a wall nearer than this to the foot of a tree draws it along, else the foot grows

Lines = tuple[Array, Array]


class Forest:
    """Nodes with a place and a parent; a node without a parent is a foot, on a wall."""

    def __init__(self) -> None:
        self.place = np.zeros((0, 2))
        self.parent = np.zeros(0, np.int64)

    def add(self, places: Array, parent: int) -> None:
        """A branch from `parent` (-1: a foot) through `places` (K, 2)."""
        first = len(self.place)
        self.place = np.vstack((self.place, places))
        self.parent = np.concatenate((self.parent, [parent], first + np.arange(len(places) - 1)))

    def keep(self, kept: Array) -> None:
        """Without the other nodes; kept (N,) holds the parent of all it holds."""
        number = np.append(np.cumsum(kept) - 1, -1)
        self.parent = number[self.parent[kept]]
        self.place = self.place[kept]


def plan_lightning(part: Solid, heights: Heights, process: Process) -> list[Lines]:
    """Per layer the lines (points (N, 2) mm, starts (B+1,)) that hold the top skins above it."""
    outlines = [from_rings(points, starts, simplify_mm=COARSE * process.bead_mm)
                for points, starts in cut(part.vertices, part.faces, heights.plane)]
    depth = process.walls * float(bead_spacing(process.bead_mm, process.layer_mm))
    reach = sparse_pitch(process, 0.0, 1.0) / 2
    forest, made, above = Forest(), [], Region()
    for index in reversed(range(len(outlines))):
        inside = offset(outlines[index], -depth)
        hollow = _hollow(outlines, index, inside, process.top_layers)
        rings = to_rings(inside)
        if inside.is_empty():
            forest = Forest()
        else:
            shorten(forest, float(heights.height[min(index + 1, len(outlines) - 1)]))
            _follow_walls(forest, rings, MOVES * reach)
            _grow(forest, difference(hollow, above), rings, reach)
        above = hollow
        made.append(paths(forest))
    return made[::-1]


def _hollow(outlines: Sequence[Region], index: int, inside: Region, top_layers: int) -> Region:
    """What of a layer's inside is no top skin."""
    above = index + top_layers
    return intersection(inside, outlines[above]) if above < len(outlines) else Region()


def _grow(forest: Forest, roof: Region, rings: Lines, reach: float) -> None:
    """Branches to all places of the roof further than `reach` from walls and branches, the nearest first."""
    from cabslice.slicing.branches import grow

    places = _places(roof, reach)
    feet, away = nearest_on_walls(places, rings)
    order = np.argsort(away, kind="stable")[np.searchsorted(np.sort(away), reach):]
    if not len(order):
        return
    cell, low = 2 * reach, np.vstack((rings[0], forest.place)).min(0)
    columns = ((np.vstack((rings[0], forest.place)).max(0) - low) / cell).astype(np.int64) + 1
    count, room = len(forest.place), len(forest.place) + 4 * len(order) + 1000
    while True:
        node, parent = np.zeros((room, 2)), np.full(room, -1)
        node[:count], parent[:count] = forest.place, forest.parent
        first, after = np.full(columns, -1), np.full(room, -1)
        filled = grow(node, parent, count, places[order], feet[order], away[order], reach, cell, low, first, after)
        if filled >= 0:
            break
        room *= 2
    forest.place, forest.parent = node[:filled].copy(), parent[:filled].copy()


def _places(roof: Region, reach: float) -> Array:
    """(G, 2) a grid of places `reach` mm apart inside the roof."""
    ends = fixed_lines(roof, reach, 0.0, 0.0).points.reshape(-1, 2, 2)
    begin, end = np.ceil(ends[:, :, 0].min(1) / reach), np.floor(ends[:, :, 0].max(1) / reach)
    count = np.maximum(end - begin + 1, 0).astype(np.int64)
    row = np.repeat(np.arange(len(ends)), count)
    k = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return np.stack(((begin[row] + k) * reach, ends[row, 0, 1]), axis=1)


def shorten(forest: Forest, step: float) -> None:
    """Every branch ends `step` mm earlier; what is shorter goes."""
    children = np.bincount(forest.parent[forest.parent >= 0], minlength=len(forest.place))
    kept = np.ones(len(forest.place), np.bool_)
    for tip in np.flatnonzero(children == 0).tolist():
        left, node = step, tip
        while left > 0:
            below = int(forest.parent[node])
            along = forest.place[below] - forest.place[node] if below >= 0 else np.zeros(2)
            long = float(np.hypot(*along))
            if below >= 0 and long > left:
                forest.place[node] = forest.place[node] + left / long * along
                break
            kept[node] = False
            if below < 0:
                break
            children[below] -= 1
            left, node = (left - long, below) if not children[below] else (0.0, node)
    forest.keep(kept)


def _follow_walls(forest: Forest, rings: Lines, near: float) -> None:
    """Feet go where the wall is now: small steps and ways out of the wall at once, long ways as a branch."""
    feet = np.flatnonzero(forest.parent < 0)
    if not len(feet):
        return
    places, away = nearest_on_walls(forest.place[feet], rings)
    inside = contains(*rings, forest.place[feet])
    moved = (away <= near) | ~inside
    forest.place[feet[moved]] = places[moved]
    for foot, place in zip(feet[~moved].tolist(), places[~moved], strict=True):
        forest.add(place[None], -1)
        forest.parent[foot] = len(forest.place) - 1


def nearest_on_walls(query: Array, rings: Lines) -> tuple[Array, Array]:
    """The nearest places (G, 2) on the rings, and how far (G,) they are."""
    from cabslice.slicing.branches import nearest_on_edges

    points, starts = rings
    return nearest_on_edges(np.ascontiguousarray(query), points, points[following(starts)])


def paths(forest: Forest) -> Lines:
    """The branches as lines, each from its tip to its foot or to where another has passed."""
    tips = np.setdiff1d(np.arange(len(forest.place)), forest.parent)
    passed = np.zeros(len(forest.place), np.bool_)
    lines = []
    for tip in tips.tolist():
        line, node = [tip], tip
        while not passed[node] and forest.parent[node] >= 0:
            passed[node] = True
            node = int(forest.parent[node])
            line.append(node)
        passed[node] = True
        if len(line) > 1:
            lines.append(line)
    if not lines:
        return np.zeros((0, 2)), np.zeros(1, np.int64)
    return forest.place[np.concatenate(lines)], np.cumsum([0, *map(len, lines)])


def clipped(lines: Lines, region: Region, least: float = 0.0) -> Lines:
    """What of the lines is inside a region, pieces up to `least` mm left out."""
    points, starts = lines
    rings, edge = to_rings(region)
    if not len(points) or not len(rings):
        return np.zeros((0, 2)), np.zeros(1, np.int64)
    ends = np.setdiff1d(np.arange(1, len(points)), starts)
    which, share = segments_meeting(rings, rings[following(edge)], points[ends - 1], points[ends])
    source = np.concatenate((ends[which], np.arange(len(points))))
    at = np.concatenate((share, np.ones(len(points))))
    order = np.lexsort((at, source))
    source, at = source[order], at[order]
    before = np.maximum(source - 1, 0)
    place = points[before] + at[:, None] * (points[source] - points[before])
    jump = np.isin(source[1:], starts)
    crossed = (at[:-1] < 1) | jump                        # segments from here on may be on the other side
    run = np.cumsum(np.append(True, crossed[1:] | jump[:-1])) - 1
    first, last = np.searchsorted(run, np.arange(run[-1] + 1)), np.searchsorted(run, np.arange(run[-1] + 1), "right")
    middle = (first + last - 1) // 2
    held = contains(rings, edge, (place[middle] + place[middle + 1]) / 2)
    inside = held[run] & ~jump
    runs = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(np.int8))).reshape(-1, 2)
    pieces = [place[a:b + 1] for a, b in runs]
    pieces = [piece for piece in pieces if np.linalg.norm(np.diff(piece, axis=0), axis=1).sum() > least]
    if not pieces:
        return np.zeros((0, 2)), np.zeros(1, np.int64)
    return np.concatenate(pieces), np.cumsum([0, *map(len, pieces)])
