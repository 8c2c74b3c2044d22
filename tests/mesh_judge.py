"""Cables against a mesh by brute force: no beads, no bounds, no code of cabslice.feasibility.

Legend
    M(z)     the solid of the mesh up to the height z
    samples  points on the mesh's surface and on the cut at z: none of M(z)'s outside is farther than `slack` from one
    signed   distance from a point to M(z), mm, negative inside; outside it is that to the nearest sample, too large by
             `slack` at most; inside or not is told by the facets over the point, counted with their turn

A cable is walked in steps after which it cannot be nearer than it was, or than LOOK, but never shorter than STEP: what
is told of distances below LOOK is right to slack and half a STEP.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.spatial import cKDTree

STEP = 0.25          # mm
LOOK = 2.5           # mm
DEEP = 0.5           # mm inside, where a walk ends
BANDS = 16           # heights at which the solid is cut
SHIFT = np.array([1.7e-5, 3.1e-5])      # so that no point stands over an edge of a facet


def surface_points(triangles, spacing):
    """(P, 3): middles of triangles (K, 3, 3), halved at their longest side until no side is longer than spacing."""
    found = []
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        small = sides.max(axis=1) <= spacing
        found.append(triangles[small].mean(axis=1))
        triangles, longest = triangles[~small], sides[~small].argmax(axis=1)
        a, b, c = (np.take_along_axis(triangles, ((longest + k) % 3)[:, None, None], 1)[:, 0] for k in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate((np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)))
    return np.concatenate(found)


@numba.njit(cache=True)
def winding(points, triangles, starts, rows, low, pitch, columns):
    """(K,): facets over each point, +1 for one that faces up, -1 for one that faces down; 0 outside of the solid."""
    found = np.zeros(len(points), np.int64)
    for k in range(len(points)):
        x, y, z = points[k]
        i, j = int((x - low[0]) // pitch), int((y - low[1]) // pitch)
        if i < 0 or j < 0 or i >= columns or i * columns + j + 1 >= len(starts) or j >= columns:
            continue
        for n in range(starts[i * columns + j], starts[i * columns + j + 1]):
            t = triangles[rows[n]]
            one = (t[1, 0] - t[0, 0]) * (y - t[0, 1]) - (t[1, 1] - t[0, 1]) * (x - t[0, 0])
            two = (t[2, 0] - t[1, 0]) * (y - t[1, 1]) - (t[2, 1] - t[1, 1]) * (x - t[1, 0])
            three = (t[0, 0] - t[2, 0]) * (y - t[2, 1]) - (t[0, 1] - t[2, 1]) * (x - t[2, 0])
            if (one > 0 and two > 0 and three > 0) or (one < 0 and two < 0 and three < 0):
                area = one + two + three
                if (two * t[0, 2] + three * t[1, 2] + one * t[2, 2]) / area > z:
                    found[k] += 1 if area > 0 else -1
    return found


class Judge:
    """M(z) for heights in bands: tests of a height use the cut at the band's lower end, which holds less."""

    def __init__(self, vertices, faces, *, spacing=1.2):
        self.triangles = np.ascontiguousarray(vertices[faces])
        self.low, self.high = vertices.min(axis=0), vertices.max(axis=0)
        self.slack, self.spacing = 0.6 * spacing, spacing
        self.surface = surface_points(self.triangles, spacing)
        self._columns()

    def _columns(self):
        self.pitch = max(float((self.high - self.low)[:2].max()) / 200, 0.05)
        self.columns = 202
        plan = self.triangles[:, :, :2] + SHIFT
        first = np.floor((plan.min(axis=1) - self.low[:2]) / self.pitch).astype(int)
        last = np.floor((plan.max(axis=1) - self.low[:2] + 1e-3) / self.pitch).astype(int)
        count = np.prod(last - first + 1, axis=1)
        rows = np.repeat(np.arange(len(count)), count)
        within = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
        wide = (last - first)[rows, 1] + 1
        cell = (first[rows, 0] + within // wide) * self.columns + first[rows, 1] + within % wide
        order = np.argsort(cell, kind="stable")
        self.rows = rows[order]
        self.starts = np.searchsorted(cell[order], np.arange(self.columns**2 + 1))

    def inside(self, points):
        """(K,) bool: in the solid of the whole mesh."""
        moved = np.ascontiguousarray(points + np.append(SHIFT, 0.0))
        return winding(moved, self.triangles, self.starts, self.rows, self.low[:2], self.pitch, self.columns) > 0

    def until(self, z):
        """Nearest-sample tree of M(z)."""
        grid = np.stack(np.meshgrid(*(
            np.arange(a, b + self.spacing, 0.8 * self.spacing) for a, b in zip(self.low[:2], self.high[:2], strict=True)
        )), axis=-1).reshape(-1, 2)
        cut = np.column_stack((grid, np.full(len(grid), z)))
        below = self.surface[self.surface[:, 2] <= z]
        return cKDTree(np.concatenate((below, cut[self.inside(cut)])), balanced_tree=False)

    def signed(self, tree, z, points):
        """(K,) mm: distance to M(z), too large by `slack` at most, where the tree is that of `until(z)`."""
        away = tree.query(points, workers=1)[0]
        within = points[:, 2] < z
        within[within] = self.inside(points[within])
        return np.where(within, -away, away)

    def least(self, exits, tips, tops):
        """Least signed distance (K,) mm that cables have to M(tops), not below -DEEP; and the points looked at.

        exits, tips (K, 3) mm, tops (K,) mm: cut downwards to the lower end of their band.
        """
        edges = np.linspace(self.low[2], self.high[2], BANDS + 1)
        band = np.clip(np.searchsorted(edges, tops, side="right") - 1, 0, BANDS)
        found, looked = np.full(len(tops), np.inf), 0
        for number in np.unique(band[band > 0]):
            rows = np.flatnonzero(band == number)
            tree = self.until(edges[number])
            found[rows], points = self._walked(tree, edges[number], exits[rows], tips[rows])
            looked += points
        return found, looked

    def _walked(self, tree, z, exits, tips, far=6.0):
        way = tips - exits
        length = np.linalg.norm(way, axis=1)
        way /= length[:, None]
        low, high = np.append(self.low[:2], self.low[2]) - far, np.append(self.high[:2], z) + far
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack(((low - exits) / way, (high - exits) / way))
        at = np.maximum(np.nanmax(ends.min(axis=0), axis=1), 0.0)
        until = np.minimum(np.nanmin(ends.max(axis=0), axis=1), length)
        least, looked = np.full(len(exits), far), 0
        alive = np.flatnonzero(at <= until)
        while len(alive):
            value = self.signed(tree, z, exits[alive] + at[alive, None] * way[alive])
            looked += len(alive)
            least[alive] = np.minimum(least[alive], value)
            at[alive] += np.maximum(value - self.slack - np.minimum(least[alive], LOOK), STEP)
            alive = alive[(at[alive] <= until[alive]) & (least[alive] > -DEEP)]
        return np.maximum(least, -DEEP), looked
