"""A judge of sliced layers that shares nothing with the slicer: it paints pixels.

It knows the section as rings (what winds positively is solid) and the beads as capsules of their own width, and it
measures, on a grid of 0.05 mm: what of the section is further than a tolerance from every bead, and what of the
beads lies outside the section.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

PIXEL = 0.05


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


class Canvas:
    def __init__(self, low, high):
        self.low = np.floor((np.asarray(low) - 1.0) / PIXEL) * PIXEL
        size = np.ceil((np.asarray(high) + 1.0 - self.low) / PIXEL).astype(int)
        self.x = self.low[0] + PIXEL * (np.arange(size[0]) + 0.5)
        self.y = self.low[1] + PIXEL * (np.arange(size[1]) + 0.5)

    def blank(self):
        return np.zeros((len(self.y), len(self.x)), dtype=bool)

    def rings(self, points, starts):
        """Pixels whose middle is wound a positive number of times."""
        change = np.zeros((len(self.y), len(self.x) + 1), dtype=np.int32)
        for a, b in pairwise(starts):
            ring = points[a:b]
            for p, q in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                up = q[1] > p[1]
                rows = np.flatnonzero((self.y >= min(p[1], q[1])) & (self.y < max(p[1], q[1])))
                if len(rows):
                    at = p[0] + (self.y[rows] - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
                    columns = np.searchsorted(self.x, at)       # everything left of the edge
                    np.add.at(change, (rows, 0), 1 if up else -1)
                    np.add.at(change, (rows, columns), -1 if up else 1)
        return np.cumsum(change, axis=1)[:, :-1] > 0

    def capsule(self, mask, p, q, radius):
        """Set the pixels whose middle is within radius of the segment."""
        low, high = np.minimum(p, q) - radius, np.maximum(p, q) + radius
        i0, i1 = np.searchsorted(self.y, [low[1], high[1]])
        j0, j1 = np.searchsorted(self.x, [low[0], high[0]])
        x, y = self.x[j0:j1] - p[0], (self.y[i0:i1] - p[1])[:, None]
        d = q - p
        share = np.clip((x * d[0] + y * d[1]) / max(d @ d, 1e-18), 0, 1)
        mask[i0:i1, j0:j1] |= (x - share * d[0]) ** 2 + (y - share * d[1]) ** 2 <= radius**2

    def beads(self, segments, more=0.0):
        mask = self.blank()
        for p, q, width in segments:
            self.capsule(mask, p, q, width / 2 + more)
        return mask


def segments(layer, roles=None):
    """(p, q, width) of every extruded segment of a layer, skirt left out."""
    beads = layer.beads
    found = []
    for b in range(len(beads.role)):
        if beads.island[b] < 0 or (roles is not None and beads.role[b] not in roles):
            continue
        rows = np.arange(beads.starts[b], beads.starts[b + 1])
        ahead = np.roll(rows, -1) if beads.closed[b] else rows[1:]
        found += [(beads.points[i], beads.points[j], beads.width[j]) for i, j in zip(rows, ahead, strict=False)]
    return found


def judge(layer, *, tolerance=0.05, half_bead=0.225, rings=None):
    """Judge one layer against rings (points, starts), by default its own outline."""
    points, starts = (layer.outline.points, layer.outline.starts) if rings is None else rings
    canvas = Canvas(points.min(0), points.max(0))
    section = canvas.rings(points, starts)
    lines = segments(layer)
    covered = canvas.beads(lines)
    near = canvas.beads(lines, tolerance)
    edge = [
        (p, q, 0.0) for a, b in pairwise(starts)
        for p, q in zip(points[a:b], np.roll(points[a:b], -1, axis=0), strict=True)
    ]
    far = covered & ~section & ~canvas.beads(edge, half_bead)
    pixel = PIXEL**2
    return Judgement(
        section.sum() * pixel, (section & ~near).sum() * pixel, (covered & ~section).sum() * pixel, far.sum() * pixel
    )
