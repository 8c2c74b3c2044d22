"""Parallel lines that fill a region, linked along its edge.

Rows are numbered from below across the lines' direction; a row cuts the region into segments, each from a left to
a right end (even-odd rule). Segments of neighbouring rows are linked by the piece of the edge between their ends where
that is short: at left ends from even rows up, at right ends from odd rows up. So every end is linked at most once,
every chain climbs, and no chain closes. Odd rows run left to right, even rows right to left.

C crossings, S segments, N points of rings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.region import Region, following, pieces, to_rings

NUDGE = 1e-4  # of a spacing: rows that would lie on the region's lowest or highest edge are moved inwards


@dataclass(frozen=True)
class Lines:
    """Lines, all open or all closed: points (N, 2) mm, starts (B+1,), and the row spacing (B,) mm each was laid for."""

    points: Array
    starts: Array
    spacing: Array
    closed: bool = False

    @property
    def lengths(self) -> Array:
        """(B,) mm."""
        back = self.points[self.starts[1:] - 1] - self.points[self.starts[:-1]]
        return line_lengths(self.points, self.starts) + (np.linalg.norm(back, axis=1) if self.closed else 0.0)


def line_lengths(points: Array, starts: Array) -> Array:
    """(B,) mm of open lines points[starts[b]:starts[b+1]]."""
    step = np.concatenate(([0.0], np.linalg.norm(np.diff(points, axis=0), axis=1)))
    total = np.concatenate((np.cumsum(step), [0.0]))
    return total[starts[1:] - 1] - total[starts[:-1]]


def even_lines(region: Region, spacing: float, angle: float, margin: float, link: float) -> Lines:
    """Lines at about `spacing` (mm) and at `angle` (rad) to x, their rows evenly spread over each connected part.

    The outermost rows lie `margin` (mm) inside the part's extent. Neighbours are linked along edges up to `link` mm.
    """
    parts = [to_rings(part) for part in pieces(region)]
    if not parts:
        return no_lines()
    points = turn(np.concatenate([part[0] for part in parts]), -angle)
    sizes = np.concatenate([np.diff(part[1]) for part in parts])
    starts = np.concatenate(([0], np.cumsum(sizes)))
    ends = np.cumsum([len(part[0]) for part in parts])
    begins = np.concatenate(([0], ends[:-1]))
    low, high = np.minimum.reduceat(points[:, 1], begins), np.maximum.reduceat(points[:, 1], begins)
    span = np.maximum(high - low - 2 * margin, 0.0)
    rows = np.ceil(span / spacing - 0.1).astype(np.int64) + 1
    pitch = np.where(rows > 1, span / np.maximum(rows - 1, 1), spacing)
    first = np.where(rows > 1, low + np.minimum(margin, (high - low) / 2), (low + high) / 2) + NUDGE * pitch
    pitch = np.where(rows > 1, pitch * (1 - 2 * NUDGE / np.maximum(rows - 1, 1)), pitch)
    base = np.concatenate(([0], np.cumsum(rows + 2)[:-1]))
    base += base % 2                             # each part's first row is even
    part = np.repeat(np.arange(len(parts)), ends - begins)
    return _lines(points, starts, angle, (first - base * pitch)[part], pitch[part], base[part], rows[part], link)


def fixed_lines(region: Region, spacing: float, angle: float, link: float, shift: float = 0.0) -> Lines:
    """Lines at `spacing` (mm) and `angle` (rad), the same in every layer, so that they stack.

    One of them passes `shift` mm to the left of the origin.
    """
    points, starts = to_rings(region)
    if not len(points):
        return no_lines()
    points = turn(points, -angle)
    ones, level = np.ones(len(points)), (points[:, 1] - shift) / spacing
    base = np.full(len(points), np.floor(level.min()).astype(np.int64))
    rows = np.full(len(points), int(np.ceil(level.max())) - base[0] + 1)
    return _lines(points, starts, angle, shift * ones, spacing * ones, base, rows, link)


def no_lines() -> Lines:
    return Lines(np.zeros((0, 2)), np.zeros(1, dtype=np.int64), np.zeros(0))


def turn(points: Array, angle: float) -> Array:
    """Points (N, 2) turned about the origin by an angle (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def _lines(
    points: Array, starts: Array, angle: float, origin: Array, pitch: Array, base: Array, rows: Array, link: float
) -> Lines:
    """Rows y = origin + pitch * row, base <= row < base + rows; these four per point of the rings."""
    cross = crossings(points, starts, *meetings(starts, (points[:, 1] - origin) / pitch, base, rows))
    if not len(cross.row):
        return no_lines()
    chains = linked(points, starts, cross, link)
    first = cross.edge[cross.by_row[0::2][chains.first]]
    return Lines(turn(chains.points, angle), chains.starts, pitch[first])


@dataclass(frozen=True)
class Crossings:
    """In order along the rings: row (C,), x (C,), y (C,), edge (C,), and by_row (C,), their order by row, then x."""

    row: Array
    x: Array
    y: Array
    edge: Array
    by_row: Array


def meetings(starts: Array, level: Array, base: Array, rows: Array) -> tuple[Array, Array, Array]:
    """Where edges cross rows, in order along the rings: edge (C,), row (C,), share (C,) of the edge.

    level (N,) is y in rows at each point: a point on a row counts as above it; rows base <= row < base + rows (N,).
    """
    ahead = following(starts)
    low, high = np.minimum(level, level[ahead]), np.maximum(level, level[ahead])
    first = np.maximum(np.floor(low).astype(np.int64) + 1, base)
    last = np.minimum(np.floor(high).astype(np.int64), base + rows - 1)
    count = np.maximum(last - first + 1, 0)
    edge = np.repeat(np.arange(len(level)), count)
    k = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    rising = level[ahead] > level
    row = np.where(rising[edge], first[edge] + k, last[edge] - k)
    return edge, row, (row - level[edge]) / (level[ahead] - level)[edge]


def crossings(points: Array, starts: Array, edge: Array, row: Array, share: Array) -> Crossings:
    """Places on edges (C,), in order along the rings of points (N, 2)."""
    at = points[edge] + share[:, None] * (points[following(starts)] - points)[edge]
    return Crossings(row, at[:, 0], at[:, 1], edge, np.lexsort((at[:, 0], row)))


@dataclass(frozen=True)
class Chains:
    """Linked segments: points (M, 2), starts (B+1,), first (B,) segment of each; leave (S,) row in points where each
    segment ends (it begins one row before)."""

    points: Array
    starts: Array
    first: Array
    leave: Array


def linked(points: Array, starts: Array, cross: Crossings, link: float) -> Chains:
    """Segments between the crossings of each row, chained along the edge up to `link` mm (see the module)."""
    left, right = cross.by_row[0::2], cross.by_row[1::2]
    segment = np.empty(len(cross.row), dtype=np.int64)
    segment[left] = segment[right] = np.arange(len(left))
    lower, upper, along = _links(points, starts, cross, link)
    follow = np.full(len(left), -1)
    back = np.full(len(left), -1)                # which link leads here
    follow[segment[lower]] = segment[upper]
    back[segment[upper]] = np.arange(len(lower))
    odd = cross.row[left] % 2 == 1
    enter, leave = np.where(odd, left, right), np.where(odd, right, left)
    order, opens = _chains(follow, back, segment[lower], cross.row[left])
    laid, ends = _assemble(points, starts, cross, enter[order], leave[order], back[order], lower, along)
    begins = np.concatenate(([0], ends[:-1] + 1))
    return Chains(laid, np.append(begins[opens], len(laid)), order[opens], ends)


def _links(points: Array, starts: Array, cross: Crossings, link: float) -> tuple[Array, Array, Array]:
    """Crossings (lower, upper) to be linked, and whether the ring runs from lower to upper."""
    ring_of_edge = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    opens = np.searchsorted(ring_of_edge[cross.edge], np.arange(len(starts)))
    here, there = np.arange(len(cross.row)), following(opens)
    length = np.concatenate(([0.0], np.cumsum(np.linalg.norm(points[following(starts)] - points, axis=1))))
    at = length[cross.edge] + np.hypot(cross.x - points[cross.edge, 0], cross.y - points[cross.edge, 1])
    ring = ring_of_edge[cross.edge]
    gap = at[there] - at
    gap = np.where(there <= here, gap + (length[starts[1:]] - length[starts[:-1]])[ring], gap)
    step = cross.row[there] - cross.row
    even = np.minimum(cross.row, cross.row[there]) % 2 == 0
    used = (gap <= link) & (((step == 1) & ~even) | ((step == -1) & even))
    rising = step[used] == 1
    return np.where(rising, here[used], there[used]), np.where(rising, there[used], here[used]), rising


def _chains(follow: Array, back: Array, lower_segment: Array, row: Array) -> tuple[Array, Array]:
    """Segments in printing order (S,), and where each chain starts in it."""
    root = np.where(back >= 0, lower_segment[back] if len(lower_segment) else 0, np.arange(len(follow)))
    while True:
        further = root[root]
        if np.array_equal(further, root):
            break
        root = further
    order = np.lexsort((row, root))
    opens = np.flatnonzero(np.concatenate(([True], root[order][1:] != root[order][:-1])))
    return order, opens


def _assemble(
    points: Array, starts: Array, cross: Crossings, enter: Array, leave: Array, back: Array, lower: Array,
    along: Array,
) -> tuple[Array, Array]:
    """Points, per segment the ring's since the last one, then its two ends; and where (S,) its second end is."""
    linked = back >= 0
    a = np.where(linked, lower[back] if len(lower) else 0, 0)
    b = enter                                     # the upper crossing of the link
    forward = np.where(linked, along[back] if len(along) else False, False)
    from_edge = np.where(forward, cross.edge[a], cross.edge[b])
    to_edge = np.where(forward, cross.edge[b], cross.edge[a])
    ring_begin = starts[np.searchsorted(starts, from_edge, side="right") - 1]
    ring_size = starts[np.searchsorted(starts, from_edge, side="right")] - ring_begin
    between = np.where(linked, (to_edge - from_edge) % ring_size, 0)
    # two crossings on one edge have no point between them, unless the link goes all around
    count = between + 2
    offset = np.cumsum(count) - count
    out = np.empty((int(count.sum()), 2))
    which = np.repeat(np.arange(len(enter)), between)
    k = np.arange(len(which)) - np.repeat(np.cumsum(between) - between, between)
    k_ring = np.where(forward[which], k, between[which] - 1 - k)
    vertex = ring_begin[which] + (from_edge[which] - ring_begin[which] + 1 + k_ring) % ring_size[which]
    out[offset[which] + k] = points[vertex]
    out[offset + between] = np.stack((cross.x[enter], cross.y[enter]), axis=1)
    out[offset + between + 1] = np.stack((cross.x[leave], cross.y[leave]), axis=1)
    return out, offset + between + 1
