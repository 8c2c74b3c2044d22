"""Plane regions: the doorway to manifold3d's CrossSection, with its traps guarded.

A `Region` is any number of outlines with holes, without self-intersections, mm. Guarded here: round corners are made of
as many segments as a tolerance asks for (the default is 4 to 12), mitres may overshoot (`opening` clips them), an empty
region has infinite bounds, thin parts vanish under an inward offset (`thin_parts` finds them).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, ceil, pi

import numpy as np
from manifold3d import CrossSection as Region
from manifold3d import FillRule, JoinType, OpType

from cabslice.arrays import Array
from cabslice.slicing.layer import Polygons

ARC = 0.02       # of the radius: how far the chords of a rounded corner may leave its arc
ARC_SEGMENTS = 4 * ceil(pi / acos(1 - ARC) / 4)
BOUND = 0.6      # manifold3d's simplify leaves outlines by up to 1.6 times what it is asked


def from_rings(points: Array, starts: Array, *, simplify_mm: float = 0.0) -> Region:
    """The region where rings (points (N, 2), starts (R+1,)) wind in total counter-clockwise, simplified."""
    rings = [ring for ring in np.split(points, starts[1:-1]) if len(ring) > 2]
    if not rings:
        return Region()
    region = Region(rings, FillRule.Positive)
    return region.simplify(BOUND * simplify_mm) if simplify_mm else region


def to_rings(region: Region) -> tuple[Array, Array]:
    """points (N, 2), starts (R+1,): outlines counter-clockwise, holes clockwise."""
    rings = region.to_polygons()
    if not rings:
        return np.zeros((0, 2)), np.zeros(1, dtype=np.int64)
    return np.concatenate(rings), np.cumsum([0, *map(len, rings)])


def to_polygons(region: Region) -> Polygons:
    return Polygons(*to_rings(region))


def offset(region: Region, distance: float, *, round_corners: bool = False) -> Region:
    """Grown by a distance (mm), or shrunk if negative; corners stay sharp up to a mitre of twice the distance."""
    if distance == 0 or region.is_empty():
        return region
    if not round_corners:
        return region.offset(distance, JoinType.Miter, 2.0)
    return region.offset(distance, JoinType.Round, 2.0, ARC_SEGMENTS).simplify(ARC / 2 * abs(distance))


def union(regions: Sequence[Region]) -> Region:
    filled = [region for region in regions if not region.is_empty()]
    if len(filled) < 2:
        return filled[0] if filled else Region()
    return Region.batch_boolean(filled, OpType.Add)


def difference(region: Region, *others: Region) -> Region:
    filled = [other for other in others if not other.is_empty()]
    if region.is_empty() or not filled:
        return region
    return Region.batch_boolean([region, *filled], OpType.Subtract)


def intersection(region: Region, other: Region) -> Region:
    if region.is_empty() or other.is_empty():
        return Region()
    return region ^ other


def opening(region: Region, radius: float) -> Region:
    """What of the region is wider than 2 radius (mm); sharp corners stay."""
    if _largest_outline(region) < pi * radius**2:
        return Region()
    core = offset(region, -radius, round_corners=True)  # a mitre would take away what is wide enough
    if core.is_empty():
        return core
    return intersection(offset(core, radius), region)


def _largest_outline(region: Region) -> float:
    """mm^2, without its holes: no disc in the region is larger."""
    points, starts = to_rings(region)
    return float(ring_areas(points, starts).max(initial=0.0))


def ring_areas(points: Array, starts: Array) -> Array:
    """(R,) mm^2 of rings without empty ones; holes are negative."""
    if len(starts) < 2:
        return np.zeros(0)
    ahead = points[following(starts)]
    return np.add.reduceat(points[:, 0] * ahead[:, 1] - ahead[:, 0] * points[:, 1], starts[:-1]) / 2


def edge_length(region: Region) -> float:
    """mm, of outlines and holes."""
    points, starts = to_rings(region)
    return float(np.linalg.norm(points[following(starts)] - points, axis=1).sum())


def pieces(region: Region) -> list[Region]:
    """Connected parts, each one outline with its holes."""
    if region.num_contour() < 2:
        return [] if region.is_empty() else [region]
    return region.decompose()


def contains(points: Array, starts: Array, query: Array) -> Array:
    """(Q,) bool: query points (Q, 2) inside rings, by the even-odd rule."""
    if len(query) == 0 or len(points) == 0:
        return np.zeros(len(query), dtype=bool)
    ahead = points[following(starts)]
    inside = np.zeros(len(query), dtype=bool)
    for chunk in range(0, len(query), 512):
        x, y = query[chunk : chunk + 512, 0, None], query[chunk : chunk + 512, 1, None]
        crosses = (points[:, 1] <= y) != (ahead[:, 1] <= y)
        rise = np.where(ahead[:, 1] == points[:, 1], 1.0, ahead[:, 1] - points[:, 1])
        at = points[:, 0] + (y - points[:, 1]) / rise * (ahead[:, 0] - points[:, 0])
        inside[chunk : chunk + 512] = (crosses & (at > x)).sum(1) % 2 == 1
    return inside


def following(starts: Array) -> Array:
    """(N,) index of the next point of its ring."""
    ahead = np.arange(1, starts[-1] + 1)
    filled = starts[1:] > starts[:-1]
    ahead[starts[1:][filled] - 1] = starts[:-1][filled]
    return ahead
