"""How near cables come to each other.

Legend
    A_i, B_i   ends of the free cable: exit point on the pulley, attachment on the platform        mm
    s, t       place of the nearest point of a cable, share of the way from A (0) to B (1)
    pair       two cables (i, j), i < j, in lexicographic order: P = m (m - 1)/2 of them

The free cables are taken as straight segments; what is wrapped on a pulley is not looked at. Cables that share an end
(the same anchor or the same attachment) touch there by design and, being straight, nowhere else: their distance is inf.

How fast a distance can change, when the platform shifts by d without turning: a point of the cable moves by
E d + (1 - s)(r_p/l) u (w . d), E symmetric between 0 and the identity, since A moves with the swivel and the wrap. Two
such E differ by at most 1, so no distance changes by more than (1 + r_i/l_i + r_j/l_j) |d|: by |d| for point anchors.
Source of the segment distance: Lumelsky 1985; Ericson 2004, Real-Time Collision Detection, 5.1.9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot
from cabslice.robot.nullspace import blocks, subsets
from cabslice.robot.pulley import CableLines

SHARED = 1e-6        # mm: ends nearer than this are one end
PARALLEL = 1e-12     # sine squared of the angle between two cables below which they count as parallel


@dataclass(frozen=True)
class Approach:
    """Where the P pairs of cables are nearest, at K poses."""

    pairs: Array         # (P, 2) int, cables counted from 0
    distance: Array      # (K, P) mm between centre lines; inf for pairs that share an end
    first: Array         # (K, P) s on the first cable of the pair
    second: Array        # (K, P) t on the second


def closest(robot: Robot, poses: Array, *, lines: CableLines | None = None) -> Approach:
    """Nearest points of all pairs of cables at poses (K, 6). Raises PoseError as kinematics.cables.

    `lines`: what cables gave, if at hand. Takes 3 K P doubles.
    """
    lines = lines or cables(robot, poses)
    pairs = subsets(robot.cables, 2)
    out = np.empty((3, len(lines.tip), len(pairs)))
    for part in blocks(len(lines.tip)):
        start, end = (np.ascontiguousarray(np.transpose(ends[part])) for ends in (lines.exit, lines.tip))
        for column, values in zip(out, _between(start, end, pairs), strict=True):
            column[part] = values.T
    out[0][:, share_an_end(robot)] = np.inf
    return Approach(pairs, *out)


def cable_gaps(robot: Robot, poses: Array, *, lines: CableLines | None = None) -> Array:
    """Air between the skins of all pairs of cables (K, P) mm, negative where they overlap; inf for shared ends."""
    found = closest(robot, poses, lines=lines)
    return found.distance - robot.cable_radii[found.pairs].sum(axis=1)


def share_an_end(robot: Robot) -> Array:
    """(P,) bool: pairs of cables with the same anchor or the same attachment."""
    one, other = subsets(robot.cables, 2).T
    apart = [np.linalg.norm(ends[one] - ends[other], axis=1) for ends in (robot.anchors, robot.attachments)]
    return np.minimum(*apart) < SHARED


def distance_rates(robot: Robot, lines: CableLines) -> Array:
    """(K, P) mm/mm: the most a distance can change per mm the platform shifts, 1 + r_i/l_i + r_j/l_j."""
    lever = robot.pulley_radii / lines.free
    one, other = subsets(robot.cables, 2).T
    return 1.0 + lever[:, one] + lever[:, other]


def segment_distance(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """Distance (...,) mm between segments given by their ends (..., 3) mm, broadcast."""
    given = np.broadcast_arrays(*(np.asarray(end, dtype=float) for end in (start, end, other_start, other_end)))
    ends = [np.moveaxis(end, -1, 0) for end in given]
    return _nearest(ends[0], ends[1] - ends[0], ends[2], ends[3] - ends[2])[0]


def _between(start: Array, end: Array, pairs: Array) -> tuple[Array, Array, Array]:
    """Distance, s, t (P, K) of pairs of segments with ends (3, m, K)."""
    way, (one, other) = end - start, pairs.T
    return _nearest(start[:, one], way[:, one], start[:, other], way[:, other])


def _nearest(start: Array, way: Array, other: Array, other_way: Array) -> tuple[Array, Array, Array]:
    """Distance, s, t of segments start + s way and other + t other_way, coordinates first."""
    gap = start - other
    length, other_length, mixed = _dot(way, way), _dot(other_way, other_way), _dot(way, other_way)
    along, other_along = _dot(way, gap), _dot(other_way, gap)
    tiny = np.finfo(float).tiny
    cross = length * other_length - mixed * mixed
    skew = cross > PARALLEL * length * other_length
    s = np.where(skew, (mixed * other_along - along * other_length) / np.where(skew, cross, 1.0), 0.0)
    s = np.minimum(np.maximum(s, 0.0), 1.0)
    t = np.minimum(np.maximum((mixed * s + other_along) / np.maximum(other_length, tiny), 0.0), 1.0)
    s = np.minimum(np.maximum((mixed * t - along) / np.maximum(length, tiny), 0.0), 1.0)
    apart = gap + s * way - t * other_way
    return np.sqrt(_dot(apart, apart)), s, t


def _dot(a: Array, b: Array) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
