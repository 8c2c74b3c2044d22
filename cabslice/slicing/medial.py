"""The line through the middle of a thin region, and how wide the region is along it.

At samples p of the boundary, with inward normal n, the largest disc inside the region that touches the boundary at p:
centre c = p + r n, r = min over other samples q of |q-p|^2 / (2 n.(q-p)) (the shrinking ball of Ma, Bae and Choi,
Visual Computer 28, 2012, with all q at once). The centres lie on the medial axis, and going along the boundary they
come in order; q is where the disc touches the other side. Each line is met from both its sides: the side that comes
first is kept. Centres whose two touching points lie less than TURN apart, seen from the centre, belong to corners and
are left out.

N samples, P pairs of samples, M points of lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.region import following

TURN = np.radians(110.0)  # corners of rectangles (90 deg) end a line
FAN = np.radians(25.0)    # normals at a re-entrant corner are this far apart
SPECK = 0.02              # of a step: shorter edges have no direction to speak of
CHUNK = 5_000             # samples looked at together: bounds memory, not the result


@dataclass(frozen=True)
class Discs:
    """The largest disc at each sample of the boundary: centre (N, 2) mm, diameter (N,) mm, ring (N,) of the sample."""

    centre: Array
    diameter: Array
    ring: Array


@dataclass(frozen=True)
class MedialLines:
    """points (M, 2) mm, diameter (M,) mm of the largest disc there, starts (B+1,), ring (B,) a line was met on."""

    points: Array
    diameter: Array
    starts: Array
    ring: Array
    discs: Discs


def medial_lines(
    points: Array, starts: Array, *, narrowest_mm: float, widest_mm: float, step_mm: float
) -> MedialLines:
    """Medial lines of the region inside rings (points (N, 2), starts (R+1,)), narrowest_mm to widest_mm wide.

    step_mm is the distance of samples; detail below it is lost. The lines stop a radius short of the region's ends.
    """
    place, normal, ring, order = _samples(points, starts, step_mm)
    if not len(place):
        none, index = np.zeros(0), np.zeros(0, dtype=np.int64)
        nothing = Discs(place, none, index)
        return MedialLines(place, none, np.zeros(1, dtype=np.int64), index, nothing)
    radius, partner = _largest_discs(place, normal, widest_mm)
    radius = _against_edge(place, normal, radius, partner)
    centre = place + radius[:, None] * normal
    chord = np.linalg.norm(place[partner] - place, axis=1)
    apart = (chord >= 2 * np.sin(TURN / 2) * radius) & ((normal * normal[partner]).sum(1) <= np.cos(TURN))
    good = (2 * radius <= widest_mm) & (2 * radius >= narrowest_mm) & apart & (np.arange(len(place)) < partner)
    return _lines(Discs(centre, 2 * radius, ring), order, good, step_mm)


def _samples(points: Array, starts: Array, step: float) -> tuple[Array, Array, Array, Array]:
    """Samples in order along the rings: place (N, 2), inward unit normal (N, 2), ring (N,), next sample (N,)."""
    ahead = points[following(starts)]
    along = ahead - points
    length = np.linalg.norm(along, axis=1)
    direction = np.divide(along, length[:, None], out=np.zeros_like(along), where=length[:, None] > 0)
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    turn = (angle[following(starts)] - angle + np.pi) % (2 * np.pi) - np.pi   # at the end of each edge
    fan = np.where(turn < -FAN / 2, np.ceil(-turn / FAN).astype(np.int64) + 1, 0)
    inner = np.where(length > SPECK * step, np.ceil(length / step), 0).astype(np.int64)
    each = inner + fan
    edge = np.repeat(np.arange(len(points)), each)
    k = np.arange(len(edge)) - np.repeat(np.cumsum(each) - each, each)
    on_edge = k < inner[edge]
    share = np.where(on_edge, (k + 0.5) / np.maximum(inner[edge], 1), 1.0)
    place = points[edge] + share[:, None] * along[edge]
    swing = np.where(on_edge, 0.0, (k - inner[edge]) / np.maximum(fan[edge] - 1, 1))
    heading = angle[edge] + swing * turn[edge]
    normal = np.stack((-np.sin(heading), np.cos(heading)), axis=1)
    ring = np.repeat(np.arange(len(starts) - 1), np.diff(starts))[edge]
    opens = np.searchsorted(ring, np.arange(len(starts)))
    return place, normal, ring, following(opens)


def _largest_discs(place: Array, normal: Array, widest: float) -> tuple[Array, Array]:
    """Radius (N,) of the largest empty disc at each sample, and the sample (N,) it touches; exact up to `widest`.

    Samples are sorted into square cells of side `widest`: what such a disc can touch lies in the 3 x 3 cells around.
    """
    low = place.min(0)
    cell = ((place - low) / widest).astype(np.int64) + 1
    rows = int(cell[:, 1].max()) + 2
    key = cell[:, 0] * rows + cell[:, 1]
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    radius, partner = np.full(len(place), np.inf), np.arange(len(place))
    for begin in range(0, len(place), CHUNK):
        mine = order[begin : begin + CHUNK]
        column = (key[mine][:, None] + np.array([-rows, 0, rows])).ravel()
        first = np.searchsorted(sorted_key, column - 1, side="left")
        count = np.searchsorted(sorted_key, column + 1, side="right") - first
        other = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(count.sum())
        per_sample = count.reshape(-1, 3).sum(1)
        q = order[other]
        dx = place[:, 0][q] - np.repeat(place[mine, 0], per_sample)
        dy = place[:, 1][q] - np.repeat(place[mine, 1], per_sample)
        depth = dx * np.repeat(2 * normal[mine, 0], per_sample) + dy * np.repeat(2 * normal[mine, 1], per_sample)
        square = dx * dx + dy * dy
        ahead = (depth > 1e-9) & (square > 1e-18)
        r = np.divide(square, depth, out=np.full(len(q), np.inf), where=ahead)
        opens = np.cumsum(per_sample) - per_sample
        best = np.minimum.reduceat(r, opens)
        hit = np.flatnonzero(r == np.repeat(best, per_sample))
        radius[mine] = best
        partner[mine] = q[hit[np.searchsorted(hit, opens)]]
    radius[~np.isfinite(radius)] = widest
    return radius, partner


def _against_edge(place: Array, normal: Array, radius: Array, partner: Array) -> Array:
    """Radii (N,) of discs that touch the edge through the other sample rather than the sample itself.

    For edges that face each other, with m the normal there: the distance of c = p + r n from that edge is r, so
    r = (p - q).m / (1 - n.m).
    """
    other = normal[partner]
    facing = 1 - (normal * other).sum(1)
    depth = ((place - place[partner]) * other).sum(1)
    exact = np.divide(depth, facing, out=radius.copy(), where=facing > 1.5)
    return np.where((exact > 0.8 * radius) & (exact < radius), exact, radius)


def _lines(discs: Discs, ahead: Array, good: Array, step: float) -> MedialLines:
    """Runs of good samples along each ring; a run ends where the centre jumps."""
    centre, diameter = discs.centre, discs.diameter
    jump = np.linalg.norm(centre[ahead] - centre, axis=1) > np.maximum(4 * step, diameter)
    linked = good & good[ahead] & ~jump & (ahead > np.arange(len(good)))
    keep = np.flatnonzero(good)
    opens = np.flatnonzero(np.concatenate(([True], ~linked[keep[:-1]] | (np.diff(keep) != 1)))[: len(keep)])
    return MedialLines(centre[keep], diameter[keep], np.append(opens, len(keep)), discs.ring[keep[opens]], discs)
