"""Support as branches: from tips under the overhangs they lean towards each other on their way down, and merge.

S_k  outline of layer k    r  radius of a branch    g  xy gap    m_k = h_k tan(branch angle), a branch's way per layer
A_k  where no branch may be that shall reach the bed: (S_k grown by g + tip radius) + (A_(k-1) shrunk by m_k)
So whatever is outside A_k can be outside A_(k-1) one layer further down, and at last on the bed. What begins inside
A_k goes down to the part. All positions are in mm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.profile.stand import Support
from cabslice.slicing.heights import Heights
from cabslice.slicing.overhang import COARSE
from cabslice.slicing.region import (
    Region,
    contains,
    following,
    intersection,
    offset,
    opening,
    pieces,
    to_rings,
    union,
)
from cabslice.slicing.sections import Solid
from cabslice.slicing.standing import Nearby, Standing, clearances, from_above, outlines_of, room_for

CHORD = 0.03       # mm: how far the sides of a branch, a polygon, are from its circle
EDGE = 1e-3        # mm: how far outside of what it avoids a branch is put
NEAREST = 0.7      # of the tip distance: tips are never closer
FINER = 3          # places tried for tips in a tip distance
ROUGH = 0.05       # mm: detail of outlines that branches need not know
CHUNK = 256        # positions whose distance to all edges is found at once


@dataclass(frozen=True)
class Branches:
    """at (N, 2); length (N,) mm from the tip down; bed (N,) bool: it can reach the bed."""

    at: Array
    length: Array
    bed: Array

    def only(self, chosen: Array) -> Branches:
        return Branches(self.at[chosen], self.length[chosen], self.bed[chosen])

    def radius(self, asked: Support, bead: float) -> Array:
        """(N,) mm, where nothing is in the way."""
        tip = tip_radius(asked, bead)
        grown = tip + self.length * np.tan(np.radians(asked.tree.taper_deg))
        return np.minimum(grown, max(asked.tree.thickest_mm / 2, tip))


def tip_radius(asked: Support, bead: float) -> float:
    return max(asked.tree.tip_mm, 1.1 * bead) / 2


@dataclass(frozen=True)
class _Stage:
    """The branches of one layer: at (N, 2), radius (N,), and which branch of the layer below bears each, or -1."""

    at: Array
    radius: Array
    below: Array


def trees(part: Solid, heights: Heights, asked: Support, bead: float, hanging: list[Region]) -> list[Standing]:
    """One per layer; see support.plan_support."""
    clear, count = clearances(heights, asked), len(hanging)
    move = heights.height * np.tan(np.radians(asked.tree.branch_angle_deg))
    stages = _slimmed(_grown(part, heights, asked, bead, hanging, move), move, tip_radius(asked, bead))
    near = Nearby(from_above(part, heights.plane), count, int(clear.above.max()), int(clear.below.max()))
    bodies, roofs = [Region()] * count, [Region()] * count
    for k in reversed(range(count)):
        near.move(k)
        roofs[k] = union(hanging[slice(*np.searchsorted(clear.contact, (k, k + asked.interface_layers)))])
        bodies[k] = room_for(_discs(stages[k]), near, k, clear, asked, bead)
        roofs[k] = room_for(roofs[k], near, k, clear, asked, bead)
    return _borne(bodies, roofs, asked.tree.tip_distance_mm, bead)


def _borne(bodies: list[Region], roofs: list[Region], apart: float, bead: float) -> list[Standing]:
    """Branches, and of their roofs what is held by them, no further than tips are apart, or by the roof below."""
    found: list[Standing] = []
    below = Region()
    for body, roof in zip(bodies, roofs, strict=True):
        under = union([below, body])
        roof = intersection(roof, union([offset(body, apart), offset(below, 2 * bead)]))
        roof = opening(roof, bead / 2)
        kept = union([piece for piece in pieces(roof) if not intersection(piece, under).is_empty()])
        below = union([body, kept])
        found.append(Standing(below, kept))
    return found


def _grown(
    part: Solid, heights: Heights, asked: Support, bead: float, hanging: list[Region], move: Array
) -> list[_Stage]:
    """The branches of each layer, found from the top down."""
    contact = clearances(heights, asked).contact
    avoid = _avoided(outlines_of([part], heights.plane), move, asked.xy_gap_mm + tip_radius(asked, bead))
    branches, tips = Branches(np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool)), np.zeros((0, 3))
    stages: list[_Stage] = []
    outlines = from_above(part, heights.plane)
    for k in reversed(range(len(hanging))):
        outline, z = next(outlines).simplify(ROUGH), float(heights.top[k])
        branches, below = _lowered(branches, outline, avoid[k], z, float(move[k]), asked, bead)
        if stages:
            stages[-1] = replace(stages[-1], below=below)
        branches = replace(branches, length=branches.length + heights.height[k])
        for region in hanging[slice(*np.searchsorted(contact, (k, k + 1)))]:
            fresh, tips = _tips(region, outline, avoid[k], z, tips, asked, bead)
            branches = _both(branches, fresh)
        radius = _fitting(branches, outline, asked, bead)
        stages.append(_Stage(branches.at, radius, np.full(len(radius), -1)))
    return stages[::-1]


def _slimmed(stages: list[_Stage], move: Array, tip: float) -> list[_Stage]:
    """No branch is more than a way per layer thicker than what bears it."""
    found: list[_Stage] = []
    for k, stage in enumerate(stages):
        radius = stage.radius
        if found and len(radius):
            borne = stage.below >= 0
            most = np.full(len(radius), np.inf)
            most[borne] = found[-1].radius[stage.below[borne]] + move[k]
            radius = np.clip(radius, tip, np.maximum(most, tip))
        found.append(replace(stage, radius=radius))
    return found


def _avoided(outlines: Iterator[Region], move: Array, gap: float) -> list[Region]:
    """A_k of each layer, from the bed up."""
    found: list[Region] = []
    for outline, step in zip(outlines, move, strict=True):
        near = offset(outline.simplify(ROUGH), gap + ROUGH, round_corners=True)
        before = offset(found[-1], -float(step)) if found else Region()
        found.append(union([near, before]).simplify(COARSE))
    return found


def _tips(
    hanging: Region, outline: Region, avoid: Region, z: float, earlier: Array, asked: Support, bead: float
) -> tuple[Branches, Array]:
    """New branches under an overhang, at the places tips have not been put yet; `earlier` (T, 3) grows by them.

    No place of the overhang, but for the gap beside the part, is further than the tip distance from a tip.
    """
    apart = asked.tree.tip_distance_mm
    places = _places(hanging, apart / FINER)
    if len(places):
        away, _ = signed_distance(outline, places)
        places = places[away >= asked.xy_gap_mm + tip_radius(asked, bead)]
    bed = ~contains(*to_rings(avoid), places)
    if asked.where == "bed":
        places, bed = places[bed], bed[bed]
    near = earlier[earlier[:, 2] <= z + apart]
    chosen: list[int] = []
    left = np.arange(len(places))
    for x, y, _ in near:
        left = left[np.hypot(*(places[left] - (x, y)).T) >= NEAREST * apart]
    while len(left):
        chosen.append(int(left[0]))
        left = left[np.hypot(*(places[left] - places[left[0]]).T) >= NEAREST * apart]
    at = places[chosen]
    tips = np.concatenate((near, np.column_stack((at, np.full(len(at), z)))))
    return Branches(at, np.zeros(len(at)), bed[chosen]), tips


def _places(region: Region, step: float) -> Array:
    """(P, 2) on a grid in the region, the coarser grid first, then along its edge."""
    points, starts = to_rings(region)
    if not len(points):
        return points
    low, high = np.floor(points.min(0) / step).astype(int), np.ceil(points.max(0) / step).astype(int)
    i, j = (axis.ravel() for axis in np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))))
    coarse = (i % FINER == 0) & (j % FINER == 0)
    order = np.argsort(~coarse, kind="stable")
    grid = step * np.column_stack((i, j))[order]
    along = points[following(starts)] - points
    count = np.ceil(np.linalg.norm(along, axis=1) / step).astype(int)
    share = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)) / np.repeat(count, count)
    edge = np.repeat(points, count, axis=0) + share[:, None] * np.repeat(along, count, axis=0)
    return np.concatenate((grid[contains(points, starts, grid)], edge))


def _lowered(
    branches: Branches, outline: Region, avoid: Region, z: float, move: float, asked: Support, bead: float
) -> tuple[Branches, Array]:
    """The branches of the layer above, moved by at most `move`, and which of them each has become (N,).

    -1 stands for those that have come down on the part.
    """
    if not len(branches.at):
        return branches, np.zeros(0, np.int64)
    gap, at = asked.xy_gap_mm, branches.at
    room, foot = signed_distance(outline, at)
    away = np.sign(room)[:, None] * (at - foot) / np.maximum(np.abs(room), 1e-9)[:, None]
    step = _together(branches, z, move, asked)
    short = branches.radius(asked, bead) + gap - room
    crowded = short > 0
    towards = np.minimum((step * away).sum(1), 0.0)
    step = np.where(crowded[:, None], step - towards[:, None] * away, step)
    step += np.clip(short, 0.0, move)[:, None] * away
    step *= np.minimum(1.0, move / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]
    moved, bed = _kept_out(at, at + step, branches.bed, avoid, move)
    down, _ = signed_distance(outline, moved)
    stuck = ~bed & (down < gap) & (down < room)
    moved = np.where(stuck[:, None], at, moved)
    left = np.where(stuck, room, down) >= 0
    found, into = _merged(Branches(moved, branches.length, bed).only(left), move, asked, bead)
    below = np.full(len(at), -1)
    below[left] = into
    return found, below


def _together(branches: Branches, z: float, move: float, asked: Support) -> Array:
    """(N, 2) steps towards the nearest branch of the same kind that can be met above the bed, at most half way."""
    from scipy.spatial import cKDTree

    step = np.zeros_like(branches.at)
    reach = 2 * z * np.tan(np.radians(asked.tree.branch_angle_deg))
    for kind in (False, True):
        mine = np.flatnonzero(branches.bed == kind)
        if len(mine) < 2:
            continue
        gap, other = cKDTree(branches.at[mine]).query(branches.at[mine], k=2)
        gap, other = gap[:, 1], mine[other[:, 1]]
        meets = (gap > 0) & (gap <= reach)
        share = np.where(meets, np.minimum(move, gap / 2) / np.maximum(gap, 1e-12), 0.0)
        step[mine] = share[:, None] * (branches.at[other] - branches.at[mine])
    return step


def _kept_out(at: Array, wanted: Array, bed: Array, avoid: Region, move: float) -> tuple[Array, Array]:
    """Where branches go: as wanted where that is outside `avoid`, else where they are, else to its edge.

    Those that would have to go much further than `move` do not reach the bed any more. Others go as wanted.
    """
    moved, bed = wanted.copy(), bed.copy()
    rings = to_rings(avoid)
    blocked = np.flatnonzero(bed)
    blocked = blocked[contains(*rings, wanted[blocked])]
    moved[blocked] = at[blocked]
    inside = blocked[contains(*rings, at[blocked])]
    if len(inside):
        depth, foot = signed_distance(avoid, at[inside])
        out = (foot - at[inside]) / np.maximum(np.abs(depth), 1e-9)[:, None]
        moved[inside] = foot + EDGE * out
        bed[inside] = np.abs(depth) <= 1.5 * move + COARSE
        moved[inside[~bed[inside]]] = at[inside[~bed[inside]]]
    return moved, bed


def _merged(branches: Branches, move: float, asked: Support, bead: float) -> tuple[Branches, Array]:
    """Branches of a kind that are nearly one become one: the thicker takes the other in. And into which (N,)."""
    from scipy.spatial import cKDTree

    into = np.arange(len(branches.at))
    if len(into) < 2:
        return branches, into
    radius = branches.radius(asked, bead)
    pairs = cKDTree(branches.at).query_pairs(max(move, radius.max()) / 2, output_type="ndarray")
    gap = np.linalg.norm(branches.at[pairs[:, 0]] - branches.at[pairs[:, 1]], axis=1)
    pairs = pairs[gap <= np.maximum(move, radius[pairs].max(1)) / 2]
    gap = np.linalg.norm(branches.at[pairs[:, 0]] - branches.at[pairs[:, 1]], axis=1)
    length, met = branches.length.copy(), np.zeros(len(into), bool)
    for a, b in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], gap))]:
        if not met[a] and not met[b] and branches.bed[a] == branches.bed[b]:
            kept, other = (a, b) if radius[a] >= radius[b] else (b, a)
            length[kept], into[other] = max(length[a], length[b]), kept
            met[a] = met[b] = True
    left = into == np.arange(len(into))
    return Branches(branches.at, length, branches.bed).only(left), (np.cumsum(left) - 1)[into]


def _both(one: Branches, other: Branches) -> Branches:
    pairs = ((one.at, other.at), (one.length, other.length), (one.bed, other.bed))
    return Branches(*(np.concatenate(pair) for pair in pairs))


def _fitting(branches: Branches, outline: Region, asked: Support, bead: float) -> Array:
    """(N,) mm: as thick as branches may be beside the part, never thinner than their tips."""
    room, _ = signed_distance(outline, branches.at)
    tip, wanted = tip_radius(asked, bead), branches.radius(asked, bead)
    return np.clip(room - asked.xy_gap_mm, tip, wanted)


def _discs(stage: _Stage) -> Region:
    """Each branch as a polygon with the area of its circle."""
    return union([Region([at + _polygon(float(radius))]) for at, radius in zip(stage.at, stage.radius, strict=True)])


def _polygon(radius: float) -> Array:
    sides = max(6, int(np.ceil(np.pi / np.arccos(max(1 - CHORD / radius, 0.0)))))
    turn = 2 * np.pi * np.arange(sides) / sides
    wide = radius * np.sqrt(turn[1] / np.sin(turn[1]))
    return wide * np.column_stack((np.cos(turn), np.sin(turn)))


def signed_distance(region: Region, query: Array) -> tuple[Array, Array]:
    """(Q,) mm from the edge of a region, negative inside, and the nearest places (Q, 2) on it; inf without an edge."""
    points, starts = to_rings(region)
    distance, foot = np.full(len(query), np.inf), np.array(query)
    if not len(points):
        return distance, foot
    along = points[following(starts)] - points
    square = np.maximum((along**2).sum(1), 1e-18)
    for begin in range(0, len(query), CHUNK):
        here = query[begin:begin + CHUNK, None]
        share = np.clip(((here - points) * along).sum(2) / square, 0.0, 1.0)
        gap = points + share[:, :, None] * along - here
        best = np.argmin((gap**2).sum(2), axis=1)
        nearest = gap[np.arange(len(best)), best]
        distance[begin:begin + CHUNK] = np.linalg.norm(nearest, axis=1)
        foot[begin:begin + CHUNK] += nearest
    return np.where(contains(points, starts, query), -distance, distance), foot

