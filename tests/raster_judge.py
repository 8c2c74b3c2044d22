"""A judge of sliced layers that shares nothing with the slicer: it paints pixels.

It knows the section of the mesh as directed edges, cut here from the triangles alone (what winds positively is solid),
and the beads as capsules of their own width. On a grid of 0.05 mm it measures what of the section is further than a
tolerance from every bead, and what of the beads lies outside the section.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

PIXEL = 0.05
TOLERANCE = 0.05      # mm from a bead that still counts as filled


@dataclass(frozen=True)
class Judgement:
    """Areas in mm^2: of the section, of what is not filled, of material outside, of material far outside."""

    section: float
    unfilled: float
    outside: float
    far_outside: float

    @property
    def underfill(self) -> float:
        return self.unfilled / self.section

    @property
    def spill(self) -> float:
        return self.far_outside / self.section

    def __add__(self, other):
        return Judgement(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))


NOTHING = Judgement(0.0, 0.0, 0.0, 0.0)


class Canvas:
    """A grid of pixels from 1 mm below `low` to 1 mm above `high` (2,) mm."""

    def __init__(self, low, high):
        self.low = np.floor((np.asarray(low) - 1.0) / PIXEL) * PIXEL
        size = np.ceil((np.asarray(high) + 1.0 - self.low) / PIXEL).astype(int)
        self.x = self.low[0] + PIXEL * (np.arange(size[0]) + 0.5)
        self.y = self.low[1] + PIXEL * (np.arange(size[1]) + 0.5)

    def blank(self):
        return np.zeros((len(self.y), len(self.x)), dtype=bool)

    def _rows(self, low, high):
        """(thing, row) pairs: the rows from low to high (N,) mm of each thing."""
        first, last = np.searchsorted(self.y, low), np.searchsorted(self.y, high)
        count = np.maximum(last - first, 0)
        thing = np.repeat(np.arange(len(first)), count)
        return thing, first[thing] + np.arange(len(thing)) - np.repeat(np.cumsum(count) - count, count)

    def _sum(self, row, column, change):
        """Counts that change by `change` from a column on."""
        total = np.zeros((len(self.y), len(self.x) + 1), dtype=np.int32)
        np.add.at(total, (row, column), change)
        return np.cumsum(total, axis=1)[:, :-1]

    def wound(self, p, q):
        """Pixels whose middle the directed edges p -> q (N, 2) wind around a positive number of times."""
        edge, row = self._rows(np.minimum(p[:, 1], q[:, 1]), np.maximum(p[:, 1], q[:, 1]))
        a, b = p[edge], q[edge]
        at = a[:, 0] + (self.y[row] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        return self._sum(row, np.searchsorted(self.x, at), np.where(b[:, 1] > a[:, 1], -1, 1)) > 0

    def rings(self, points, starts):
        """Pixels inside closed rings."""
        return self.wound(*edges_of(points, starts))

    def capsules(self, p, q, radius):
        """Pixels whose middle is within radius (N,) of one of the segments p q (N, 2)."""
        which, row = self._rows(np.minimum(p[:, 1], q[:, 1]) - radius, np.maximum(p[:, 1], q[:, 1]) + radius)
        a, b, r, y = p[which], q[which], radius[which], self.y[row]
        step = b - a
        length = np.maximum(np.hypot(*step.T), 1e-12)
        reach = [], []
        for end in (a, b):                       # the disc at each end
            half = np.sqrt(np.maximum(r**2 - (y - end[:, 1]) ** 2, 0.0))
            near = np.abs(y - end[:, 1]) <= r
            for side, sign in zip(reach, (-1, 1), strict=True):
                side.append(np.where(near, end[:, 0] + sign * half, -sign * np.inf))
        for sign in (-1, 1):                     # and the two long edges
            shift = sign * r[:, None] * np.stack((step[:, 1], -step[:, 0]), 1) / length[:, None]
            rise = np.where(step[:, 1] == 0, 1.0, step[:, 1])
            share = (y - a[:, 1] - shift[:, 1]) / rise
            meets = (share >= 0) & (share <= 1) & (step[:, 1] != 0)
            x = a[:, 0] + shift[:, 0] + share * step[:, 0]
            reach[0].append(np.where(meets, x, np.inf))
            reach[1].append(np.where(meets, x, -np.inf))
        left, right = np.min(reach[0], axis=0), np.max(reach[1], axis=0)
        flat = (step[:, 1] == 0) & (np.abs(y - a[:, 1]) <= r)      # discs alone bound a level segment
        assert np.isfinite(left[flat]).all()
        lies = left <= right
        row, begin, end = row[lies], np.searchsorted(self.x, left[lies]), np.searchsorted(self.x, right[lies], "right")
        ones = np.ones(len(row), np.int32)
        return self._sum(np.tile(row, 2), np.concatenate((begin, end)), np.concatenate((ones, -ones))) > 0

    def beads(self, lines, more=0.0):
        """Pixels within half a bead (+ more) of lines (p, q, width)."""
        if not len(lines):
            return self.blank()
        p, q, width = columns(lines)
        return self.capsules(p, q, width / 2 + more)


def columns(lines):
    p, q, width = zip(*lines, strict=True)
    return np.array(p), np.array(q), np.array(width)


def edges_of(points, starts):
    """Directed edges (p, q) of closed rings."""
    ahead = np.concatenate([np.roll(points[a:b], -1, axis=0) for a, b in pairwise(starts)]) if len(points) else points
    return points, ahead


def section(vertices, faces, z):
    """Directed edges (p, q), material on their left, where a mesh is cut just under the plane z."""
    corner = vertices[faces]
    above = corner[:, :, 2] >= z
    up = above.sum(1)
    cut = (up == 1) | (up == 2)
    corner, above, up = corner[cut], above[cut], up[cut]
    alone = np.argmax(above == (up == 1)[:, None], axis=1)
    rows = np.arange(len(corner))
    apex, after, before = (corner[rows, (alone + k) % 3] for k in range(3))

    def meet(a, b):
        return a[:, :2] + ((z - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None] * (b - a)[:, :2]

    one, other = meet(apex, after), meet(apex, before)
    rising = (up == 1)[:, None]
    return np.where(rising, one, other), np.where(rising, other, one)


def segments(layer, roles=None):
    """(p, q, width) of every extruded segment of a layer, what stands beside the part left out."""
    beads = layer.beads
    found = []
    for b in range(len(beads.role)):
        if beads.island[b] < 0 or (roles is not None and beads.role[b] not in roles):
            continue
        rows = np.arange(beads.starts[b], beads.starts[b + 1])
        ahead = np.roll(rows, -1) if beads.closed[b] else rows[1:]
        found += [(beads.points[i], beads.points[j], beads.width[j]) for i, j in zip(rows, ahead, strict=False)]
    return found


def judge_lines(lines, edges, *, tolerance=TOLERANCE, half_bead=0.225):
    """Judge beads (p, q, width) against the directed edges (p, q) of a section."""
    p, q = edges
    ends = np.concatenate([p, q, *([np.array([line[:2] for line in lines]).reshape(-1, 2)] if lines else [])])
    canvas = Canvas(ends.min(0), ends.max(0))
    solid, covered, near = canvas.wound(p, q), canvas.beads(lines), canvas.beads(lines, tolerance)
    far = covered & ~solid & ~canvas.capsules(p, q, np.full(len(p), half_bead))
    areas = solid, solid & ~near, covered & ~solid, far
    return Judgement(*(float(mask.sum()) * PIXEL**2 for mask in areas))

