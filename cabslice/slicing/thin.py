"""Beads for regions too thin for a pair of lines: one line along the middle, as wide as the region is there.

d  diameter of the widest disc at a point of the medial line, mm
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.medial import MedialLines, medial_lines
from cabslice.slicing.region import Region, contains, following, ring_areas, to_rings

JOIN = 1.0       # of d: ends nearer than this continue each other, where branches meet
DOT = 0.3        # of d: a shorter line is none
BROAD = 0.42     # of the widest line: a bead and less
SPOT = 0.6       # of the largest disc of a strip: smaller discs are its corners
FULL = 0.6       # of a strip's area: where lines cover less, dots are added
DETAIL = 0.06    # of d: what place and width may be off where points are left out
STEP = 0.2       # of d: how much wider one segment may be than the last
MOST_STEPS = 12


@dataclass(frozen=True)
class ThinLines:
    """points (M, 2) mm, diameter (M,) mm, starts (B+1,), closed (B,) bool, group (B,): index of the region it is in."""

    points: Array
    diameter: Array
    starts: Array
    closed: Array
    group: Array

    def of_group(self, group: int) -> tuple[Array, Array, Array, Array]:
        """points, starts, diameter, closed of the lines in one region."""
        mine = np.flatnonzero(self.group == group)
        sizes = np.diff(self.starts)[mine]
        rows = np.repeat(self.starts[mine] - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())
        return self.points[rows], np.concatenate(([0], np.cumsum(sizes))), self.diameter[rows], self.closed[mine]


def strip_area(points: Array, starts: Array, diameter: Array, closed: Array) -> float:
    """mm^2 that lines as wide as their diameter cover, without their round ends."""
    ahead = following(starts)
    segment = np.ones(len(points), dtype=bool)
    segment[starts[1:][~closed] - 1] = False
    length = np.linalg.norm(points[ahead] - points, axis=1)
    return float((length * (diameter + diameter[ahead]) / 2)[segment].sum())


@dataclass(frozen=True)
class Strips:
    """Thin regions of one kind.

    reach: how far lines run on at free ends, of the radius there; the disc at an end leaves the strip's corners empty.
    least_mm2: a line that would cover less is left out.
    """

    region: Region
    reach: float
    least_mm2: float


def thin_lines(strips: Sequence[Strips], *, narrowest_mm: float, widest_mm: float, step_mm: float) -> ThinLines:
    """One line along each thin strip, narrowest_mm to widest_mm wide; the groups do not see each other.

    Branches that meet are joined, a spot too round for a line becomes a dot. step_mm is the distance at which the edge
    is looked at.
    """
    rings = [to_rings(strip.region) for strip in strips]
    sizes = [np.diff(starts) for _, starts in rings]
    group = np.repeat(np.arange(len(rings)), [len(size) for size in sizes])
    if not len(group):
        return _columns([], group, 0.0)
    starts = np.concatenate(([0], np.cumsum(np.concatenate(sizes))))
    points = np.concatenate([ring for ring, _ in rings])
    apart = np.ptp(points[:, 0]) + 4 * widest_mm
    shift = np.repeat(group * apart, np.diff(starts))   # groups side by side, so that one pass does them all
    points = points + np.stack((shift, 0 * shift), 1)
    found = medial_lines(points, starts, narrowest_mm=narrowest_mm, widest_mm=widest_mm, step_mm=step_mm)
    lines = _joined(found, np.array([strip.reach for strip in strips])[group])
    lines += _spots(found, lines, points, starts, group, widest_mm)
    least = np.array([strip.least_mm2 for strip in strips])[group]
    return _columns([line for line in lines if line.area >= least[line.ring]], group, apart)


@dataclass
class _Line:
    points: Array
    diameter: Array
    closed: bool
    ring: int

    @property
    def area(self) -> float:
        """mm^2, without the round ends."""
        length = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return float((length * (self.diameter[1:] + self.diameter[:-1]) / 2).sum())


def _joined(found: MedialLines, reach: Array) -> list[_Line]:
    """Runs chained where their ends meet, then lengthened at free ends."""
    runs = [slice(a, b) for a, b in zip(found.starts[:-1], found.starts[1:], strict=True)]
    first, last = found.starts[:-1], found.starts[1:] - 1
    mates = _mates(found.points, found.diameter, first, last)
    lines: list[_Line] = []
    used = [False] * len(runs)
    for head in _chain_heads(mates, len(runs)):
        run, end = head
        if used[run]:
            continue
        pieces: list[Array] = []
        width: list[Array] = []
        closed = False
        while True:                              # enter run at `end`, leave at its other end
            used[run] = True
            rows = runs[run]
            pieces.append(found.points[rows][:: 1 if end == 0 else -1])
            width.append(found.diameter[rows][:: 1 if end == 0 else -1])
            mate = mates.get((run, 1 - end))
            if mate is None or used[mate[0]]:
                closed = mate is not None and mate == head
                break
            run, end = mate
        points, diameter, ring = np.concatenate(pieces), np.concatenate(width), int(found.ring[head[0]])
        if np.linalg.norm(np.diff(points, axis=0), axis=1).sum() >= DOT * diameter.max():
            if not closed:
                points, diameter = _lengthen(points, diameter, float(reach[ring]))
            lines.append(_Line(points, diameter, closed, ring))
    return lines


def _chain_heads(mates: dict[tuple[int, int], tuple[int, int]], count: int) -> list[tuple[int, int]]:
    """Free ends first, then any end, for chains that close."""
    free = [(run, end) for run in range(count) for end in (0, 1) if (run, end) not in mates]
    return free + [(run, 0) for run in range(count)]


def _mates(points: Array, diameter: Array, first: Array, last: Array) -> dict[tuple[int, int], tuple[int, int]]:
    """Ends (run, 0 or 1) that continue each other: nearest pairs first, each end once."""
    ends = np.stack((first, last), axis=1).ravel()
    place, reach = points[ends], JOIN * diameter[ends]
    if len(ends) < 2:
        return {}
    order = np.argsort(place[:, 0], kind="stable")
    upto = np.searchsorted(place[order, 0], place[order, 0] + reach.max(), side="right")
    count = upto - np.arange(len(ends)) - 1
    i = np.repeat(np.arange(len(ends)), count)
    j = i + 1 + np.arange(len(i)) - np.repeat(np.cumsum(count) - count, count)
    i, j = order[i], order[j]
    gap = np.linalg.norm(place[i] - place[j], axis=1)
    # the two ends of one run continue each other only if it goes around: is much longer than the gap
    long = (last - first)[i // 2] >= 8
    near = np.flatnonzero((gap <= np.minimum(reach[i], reach[j])) & ((i // 2 != j // 2) | long))
    found: dict[tuple[int, int], tuple[int, int]] = {}
    for k in near[np.argsort(gap[near], kind="stable")]:
        a, b = divmod(int(i[k]), 2), divmod(int(j[k]), 2)
        if a not in found and b not in found:
            found[a], found[b] = b, a
    return found


def _lengthen(points: Array, diameter: Array, reach: float) -> tuple[Array, Array]:
    """Both ends run on straight, by `reach` of their radius."""
    for _ in (0, 1):
        back = np.linalg.norm(points - points[0], axis=1)
        ahead = int(np.argmax(back > diameter[0] / 2)) or len(points) - 1
        step = (points[0] - points[ahead]) / max(back[ahead], 1e-12)
        points = np.concatenate(([points[0] + reach * diameter[0] / 2 * step], points))[::-1]
        diameter = np.concatenate((diameter[:1], diameter))[::-1]
    return points, diameter


def thin_out(points: Array, starts: Array, tolerance: Array) -> Array:
    """(M,) bool: points of open lines (M, k) to keep, the others lie within tolerance (B,) of the line that is left.

    Every second point is left out where that keeps the bound, until nothing changes. slack (M,) is how far points left
    out are at most from the segment into each point.
    """
    keep = np.arange(len(points))
    line = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    slack = np.zeros(len(points))
    place = keep - starts[line]
    while True:
        inner = (place[1:-1] % 2 == 1) & (line[:-2] == line[2:])
        here = np.flatnonzero(inner) + 1
        off = _distance(points[keep[here]], points[keep[here - 1]], points[keep[here + 1]])
        bound = np.maximum(slack[here], slack[here + 1]) + off
        drop = bound <= tolerance[line[here]]
        if not drop.any():
            break
        slack[here[drop] + 1] = bound[drop]
        left = np.ones(len(keep), dtype=bool)
        left[here[drop]] = False
        keep, line, slack = keep[left], line[left], slack[left]
        place = np.arange(len(keep)) - np.searchsorted(line, line)
    kept = np.zeros(len(points), dtype=bool)
    kept[keep] = True
    return kept


def _distance(p: Array, a: Array, b: Array) -> Array:
    """(N,) distance of points (N, k) from segments."""
    along = b - a
    share = ((p - a) * along).sum(1) / np.maximum((along * along).sum(1), 1e-300)
    return np.linalg.norm(p - a - np.clip(share, 0, 1)[:, None] * along, axis=1)


def _spots(
    found: MedialLines, lines: list[_Line], points: Array, starts: Array, group: Array, widest: float
) -> list[_Line]:
    """Dots where lines leave much of a strip empty: at the largest discs whose middle nothing has reached yet.

    A dot is a line half as long as it is wide.
    """
    area = ring_areas(points, starts)
    owner = _owners(points, starts, area, group)
    whole = np.bincount(owner, area, len(area))
    held = np.bincount(owner[[line.ring for line in lines]], [line.area for line in lines], len(area))
    spots = []
    of_disc = owner[found.discs.ring]
    lacking = (area > 0) & (held < FULL * whole)
    fits = found.discs.diameter <= widest
    broad = fits & (found.discs.diameter >= BROAD * widest)     # wide enough for a bead: nowhere left empty
    broad[broad] = _far(found.discs.centre[broad], lines)
    looked_at = np.union1d(np.flatnonzero(lacking), of_disc[broad])
    for ring in looked_at:
        mine = (of_disc == ring) & (fits if lacking[ring] else broad)
        centre, diameter = found.discs.centre[mine], found.discs.diameter[mine]
        free = np.ones(len(centre), dtype=bool)
        for line in lines:
            if owner[line.ring] == ring:
                free &= ~_within(centre, line.points, line.diameter, line.closed)
        while free.any():
            best = int(np.argmax(np.where(free, diameter, -1.0)))
            if diameter[best] < SPOT * diameter.max():
                break
            ends = centre[best] + diameter[best] / 4 * np.array([[-1.0, 0.0], [1.0, 0.0]])
            spots.append(_Line(ends, np.full(2, diameter[best]), False, int(ring)))
            free &= np.linalg.norm(centre - centre[best], axis=1) > (diameter + diameter[best]) / 2
    return spots


def _far(query: Array, lines: list[_Line]) -> Array:
    """(Q,) bool: query points (Q, 2) outside the discs at all points of the lines."""
    if not lines or not len(query):
        return np.ones(len(query), dtype=bool)
    place = np.concatenate([line.points for line in lines])
    radius = np.concatenate([line.diameter for line in lines]) / 2
    order = np.argsort(place[:, 0], kind="stable")
    place, radius = place[order], radius[order]
    first = np.searchsorted(place[:, 0], query[:, 0] - radius.max())
    count = np.searchsorted(place[:, 0], query[:, 0] + radius.max(), side="right") - first
    asked = np.repeat(np.arange(len(query)), count)
    near = np.arange(len(asked)) + np.repeat(first - np.cumsum(count) + count, count)
    inside = ((query[asked] - place[near]) ** 2).sum(1) <= radius[near] ** 2
    return np.bincount(asked[inside], minlength=len(query)) == 0


def _owners(points: Array, starts: Array, area: Array, group: Array) -> Array:
    """(R,) the outline each ring belongs to: itself, or for a hole the smallest outline of its group around it."""
    owner = np.arange(len(area))
    for hole in np.flatnonzero(area < 0):
        around = np.flatnonzero((group == group[hole]) & (area > -area[hole]))
        for ring in around[np.argsort(area[around], kind="stable")]:
            loop = points[starts[ring] : starts[ring + 1]]
            if contains(loop, np.array([0, len(loop)]), points[starts[hole], None])[0]:
                owner[hole] = ring
                break
    return owner


def _within(query: Array, places: Array, wide: Array, closed: bool) -> Array:
    """(Q,) bool: query points (Q, 2) inside a disc at one of the places (P, 2), or between two of them."""
    if closed:
        places, wide = np.concatenate((places, places[:1])), np.concatenate((wide, wide[:1]))
    if len(places) > 1:
        cuts = np.maximum(2, np.ceil(np.linalg.norm(np.diff(places, axis=0), axis=1) / (wide.min() / 2)).astype(int))
        share = np.concatenate([k + np.arange(n) / n for k, n in enumerate(cuts)] + [[len(places) - 1]])
        every = np.arange(len(places))
        places = np.stack([np.interp(share, every, places[:, axis]) for axis in (0, 1)], axis=1)
        wide = np.interp(share, every, wide)
    return (np.linalg.norm(query[:, None] - places, axis=2) <= wide / 2).any(1)


def _columns(lines: list[_Line], group: Array, apart: float) -> ThinLines:
    if not lines:
        none = np.zeros(0)
        return ThinLines(np.zeros((0, 2)), none, np.zeros(1, np.int64), none.astype(bool), none.astype(np.int64))
    sizes = [len(line.points) for line in lines]
    of_line = group[[line.ring for line in lines]]
    points = np.concatenate([line.points for line in lines])
    points[:, 0] -= np.repeat(of_line, sizes) * apart
    diameter = np.concatenate([line.diameter for line in lines])
    starts = np.cumsum([0, *sizes])
    kept = thin_out(np.column_stack((points, diameter)), starts, DETAIL * np.minimum.reduceat(diameter, starts[:-1]))
    starts = np.concatenate(([0], np.cumsum(np.add.reduceat(kept, starts[:-1], dtype=np.int64))))
    points, diameter, starts = _even_steps(points[kept], diameter[kept], starts)
    return ThinLines(points, diameter, starts, np.array([line.closed for line in lines]), of_line)


def _even_steps(points: Array, diameter: Array, starts: Array) -> tuple[Array, Array, Array]:
    """Segments cut so that along none the diameter changes by more than STEP of itself: a segment has one width."""
    change = np.abs(np.diff(diameter, prepend=diameter[0])) / diameter
    pieces = np.clip(np.ceil(change / STEP), 1, MOST_STEPS).astype(np.int64)
    pieces[starts[:-1]] = 1
    point = np.repeat(np.arange(len(points)), pieces)
    share = (np.arange(len(point)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1) / pieces[point]
    before = np.maximum(point - 1, 0)
    cut = points[before] + share[:, None] * (points[point] - points[before])
    wide = diameter[before] + share * (diameter[point] - diameter[before])
    first = pieces[point] == 1
    cut[first], wide[first] = points[point[first]], diameter[point[first]]
    return cut, wide, np.concatenate(([0], np.cumsum(np.add.reduceat(pieces, starts[:-1]))))


def segment_widths(diameter: Array, starts: Array, closed: Array) -> Array:
    """(M,) mean diameter of the segment into each point; the first point of an open line has its own."""
    before = np.concatenate((diameter[:1], diameter[:-1]))
    before[starts[:-1]] = np.where(closed, diameter[starts[1:] - 1], diameter[starts[:-1]])
    return (before + diameter) / 2
