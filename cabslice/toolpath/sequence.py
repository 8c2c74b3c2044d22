"""In which order the beads of one layer are laid, and where each begins.

Skirt first, then island after island: walls (of each outer wall first the inner ones beside it, innermost first),
infill of every kind, ironing. A stop is what is drawn in one go: an open line, a ring, or an outer wall with the inner
walls along it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Beads, Role
from cabslice.toolpath.seams import Seam, seam_places

STAGE = np.ones(len(Role), np.int64)                       # infill of every kind
STAGE[[Role.OUTER_WALL, Role.INNER_WALL, Role.OVERHANG_WALL]] = 0
STAGE[Role.IRONING] = 2


@dataclass(frozen=True)
class Drawn:
    """In drawing order: points (M, 2) mm, width (M,) mm of the segment into each; starts (L + 1,); role, island (L,);

    height (L,) mm, 0 where it is that of the layer.
    """

    points: Array
    width: Array
    starts: Array
    role: Array
    island: Array
    height: Array


@dataclass(frozen=True)
class _Stops:
    """Per line: where it begins as a ring (first, part), its rank inside its stop, its stop; per stop: begin, end."""

    first: Array
    part: Array
    rank: Array
    stop: Array
    begin: Array
    end: Array


def draw_layer(
    beads: Beads, position: Array, earlier: Array, *, bead_mm: float, tolerance_mm: float,
    seam: Seam = "aligned", outer_first: bool = False, layer: int = 0,
) -> tuple[Drawn, Array]:
    """The beads in drawing order from `position` (2,) mm, and the seams (S, 2) mm of this layer's outer walls.

    `earlier` (S, 2) are the seams of the layer before: outer walls near them keep them. Every bead is drawn once; open
    ones may be reversed, closed ones begin anywhere. Points that lie within `tolerance_mm` of the line without them go.
    """
    from cabslice.toolpath.lines import draw

    outer = np.flatnonzero(beads.closed & (beads.role == Role.OUTER_WALL))
    places = seam_places(beads, outer, seam, position=position, earlier=earlier, bead_mm=bead_mm, layer=layer)
    stops = _find_stops(beads, position, outer, places, bead_mm, outer_first=outer_first)
    entered = _tour(beads, stops, np.asarray(position, np.float64))
    rank, back = np.empty(len(beads.role), np.int64), np.zeros(len(beads.role), np.bool_)
    rank[entered >> 1], back[entered >> 1] = np.arange(len(entered)), entered % 2 == 1
    lines = np.lexsort((stops.rank, rank[stops.stop]))
    points, width, starts = draw(
        beads.points, beads.width, beads.starts, beads.closed,
        lines, stops.first[lines], stops.part[lines], back[lines], tolerance_mm,
    )
    full = np.flatnonzero(np.diff(starts))
    points, width = points[: starts[-1]].copy(), width[: starts[-1]].copy()
    starts = np.append(starts[full], starts[-1])
    some = lines[full]
    drawn = Drawn(points, width, starts, beads.role[some], beads.island[some], beads.height[some])
    return drawn, _places(beads, outer, *places)


def _find_stops(
    beads: Beads, position: Array, outer: Array, places: tuple[Array, Array], bead_mm: float, *, outer_first: bool
) -> _Stops:
    """`outer` (O,) are the closed outer walls, and `places` where they begin."""
    from cabslice.toolpath.rings import starts_beside

    count = len(beads.role)
    first, part, depth, stop = np.zeros(count, np.int64), np.zeros(count), np.zeros(count), np.arange(count)
    first[outer], part[outer] = places
    begin, end = beads.points[beads.starts[:-1]], beads.points[beads.starts[1:] - 1]
    begin[outer] = _places(beads, outer, first[outer], part[outer])
    rings = np.flatnonzero(beads.closed & (beads.role != Role.OUTER_WALL))
    if len(rings):
        host, depth[rings] = _inner_hosts(beads, rings, outer)
        beside = np.where(host[:, None] >= 0, begin[host], position)
        gap, first[rings], part[rings] = starts_beside(beads.points, beads.starts, rings, beside)
        begin[rings] = _places(beads, rings, first[rings], part[rings])
        joined = (host >= 0) & (gap <= 3 * depth[rings] + bead_mm)
        stop[rings[joined]] = host[joined]
    end[beads.closed] = begin[beads.closed]
    inward = depth if outer_first else -depth
    order = np.lexsort((inward, stop))
    cuts = np.unique(stop[order], return_index=True)[1]
    heads, tails = order[cuts], order[np.append(cuts[1:], count) - 1]     # the lines each stop begins and ends with
    at_head, at_tail = begin[heads], end[tails]
    begin[stop[heads]], end[stop[tails]] = at_head, at_tail
    return _Stops(first, part, inward, stop, begin, end)


def _inner_hosts(beads: Beads, rings: Array, outer: Array) -> tuple[Array, Array]:
    """For each ring the outer wall it runs along (its line, or -1) and how deep inside, mm; only walls have one."""
    from cabslice.toolpath.rings import hosts

    host, depth = np.full(len(rings), -1), np.zeros(len(rings))
    walls = np.flatnonzero(STAGE[beads.role[rings]] == 0)
    if len(walls) and len(outer):
        guests = rings[walls]
        found, depth[walls] = hosts(
            beads.points, beads.starts, guests, beads.island[guests], outer, beads.island[outer]
        )
        host[walls] = np.where(found >= 0, outer[found], -1)
    return host, depth


def _places(beads: Beads, lines: Array, first: Array, part: Array) -> Array:
    """(L, 2) mm, where the rings `lines` begin."""
    low, size = beads.starts[lines], np.diff(beads.starts)[lines]
    here, after = beads.points[low + first], beads.points[low + (first + 1) % size]
    return here + part[:, None] * (after - here)


def _tour(beads: Beads, stops: _Stops, position: Array) -> Array:
    """Entered ends of all stops in drawing order: 2 * line, + 1 where it is drawn backwards."""
    heads = np.unique(stops.stop)
    skirt = beads.role[heads] == Role.SKIRT
    tours, rest = [], heads[~skirt]
    if skirt.any():
        tours.append(_stage_tour(heads[skirt], stops, position))
        position = _left_at(tours[-1], stops)
    blocks = _islands(beads, rest)
    for block in _island_order(blocks, beads, stops, position):
        for stage in blocks[block]:
            tours.append(_stage_tour(stage, stops, position))
            position = _left_at(tours[-1], stops)
    return np.concatenate(tours) if tours else np.empty(0, np.int64)


def _islands(beads: Beads, heads: Array) -> list[list[Array]]:
    """The stops of each island, one array per stage."""
    stage = STAGE[beads.role[heads]]
    order = np.lexsort((stage, beads.island[heads]))
    heads, stage, island = heads[order], stage[order], beads.island[heads[order]]
    blocks: list[list[Array]] = []
    new_island = np.diff(island, prepend=island[:1] - 1) != 0
    cuts = np.flatnonzero(new_island | (np.diff(stage, prepend=-1) != 0))
    for low, high in pairwise([*cuts.tolist(), len(heads)]):
        if new_island[low]:
            blocks.append([])
        blocks[-1].append(heads[low:high])
    return blocks


def _island_order(blocks: list[list[Array]], beads: Beads, stops: _Stops, position: Array) -> Array:
    """Which island comes when: a short tour over the middles of where they begin."""
    from cabslice.toolpath.tour import shortest_tour

    if len(blocks) < 2:
        return np.arange(len(blocks))
    middles = np.array([stops.begin[block[0]].mean(0) for block in blocks])
    return shortest_tour(middles, middles, position, True) >> 1


def _stage_tour(heads: Array, stops: _Stops, position: Array) -> Array:
    from cabslice.toolpath.tour import shortest_tour

    if len(heads) == 1:
        there, other = stops.begin[heads[0]] - position, stops.end[heads[0]] - position
        return 2 * heads + int(other @ other < there @ there)
    entered = shortest_tour(stops.begin[heads], stops.end[heads], position, True)
    return 2 * heads[entered >> 1] + entered % 2


def _left_at(entered: Array, stops: _Stops) -> Array:
    last = entered[-1]
    return stops.begin[last >> 1] if last % 2 else stops.end[last >> 1]
