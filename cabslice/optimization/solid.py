"""A part as a stack of slabs, each with the signed distance to its section: fast to ask, good for ranking only.

Legend
    slab k     from k dz to (k + 1) dz above the bed; its section is cut in the middle
    field      distance from the middle of a slab to its section and to the slabs below, mm; < 0 inside, in plan
    frame      of the part: origin on the bed under the middle of its bounds; a pose (c, s, x, y) turns and shifts it

Source of the filling: winding numbers summed along rows of pixels; of the distance: Felzenszwalb, Huttenlocher 2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.sections import cut

SLABS = 64           # at most
THINNEST = 1.0       # mm
PIXELS = 192         # along the longer side of the part
LOOKED_DOWN = 25.0   # mm: how far below a slab others are looked at
EMPTY = 1e6          # mm: distance to a section that is not there


@dataclass(frozen=True)
class Solid:
    points: Array        # (N, 2) mm, outlines of the slabs, `spacing` mm apart or nearer
    starts: Array        # (L+1,) int64: slab k has points[starts[k]:starts[k+1]]
    field: Array         # (L, R, C) float32 mm
    low: Array           # (2,) mm, centre of pixel (0, 0)
    pixel: float         # mm
    dz: float            # mm
    radius: float        # mm, of the part around its own origin
    bounds: Array        # (2, 3) mm, in the frame of the part

    @property
    def order(self) -> Array:
        """(L,) int64: all slabs, from the top in long strides, then in shorter ones."""
        rest = np.arange(self.slabs - 1, -1, -1)
        first = [rest[begin::8] for begin in (0, 4, 2, 6, 1, 3, 5, 7)]
        return np.concatenate(first)

    @property
    def slabs(self) -> int:
        return len(self.starts) - 1


def solid_of(vertices: Array, faces: Array, *, dz: float | None = None, spacing: float | None = None) -> Solid:
    """The slabs of a closed mesh standing on z = 0, in the frame of the part. dz: thickness asked for, mm."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = vertices - np.append((low + high)[:2] / 2, 0.0)
    height, size = float(high[2]), float((high - low)[:2].max())
    dz = dz or max(height / SLABS, min(THINNEST, height))
    planes = dz * (np.arange(max(round(height / dz), 1)) + 0.5)
    pixel = size / PIXELS
    corner = (low - high)[:2] / 2 - 2 * pixel
    shape = np.ceil((high - low)[1::-1] / pixel).astype(int) + 5
    fields, rings = [], []
    for points, starts in cut(vertices, faces, np.minimum(planes, height * (1 - 1e-9))):
        fields.append(_distance(_filled(points, starts, corner, pixel, shape), pixel))
        rings.append(_spaced(points, starts, spacing or max(size / 24, 1.0)))
    counts = np.cumsum([0, *(len(ring) for ring in rings)])
    reach = float(np.linalg.norm(vertices[:, :2], axis=1).max())
    bounds = np.array([vertices.min(axis=0), vertices.max(axis=0)])
    field, starts = _above(np.array(fields), dz), counts.astype(np.int64)
    return Solid(np.vstack(rings), starts, field, corner, pixel, dz, reach, bounds)


def _above(plan: Array, dz: float) -> Array:
    """From distances in plan (L, R, C) to those from the whole stack up to each slab."""
    least = plan.copy()
    for down in range(1, min(len(plan), int(LOOKED_DOWN / dz) + 2)):
        height = (down - 0.5) * dz
        lower = np.hypot(np.maximum(plan[:-down], 0.0), height)
        least[down:] = np.where(plan[down:] > 0, np.minimum(least[down:], lower), plan[down:])
    return least


def _edges(points: Array, starts: Array) -> tuple[Array, Array]:
    """Both ends of all edges of closed rings, (E, 2) each."""
    after = np.arange(1, len(points) + 1)
    ends = starts[1:][starts[1:] > starts[:-1]]
    after[ends - 1] = starts[:-1][starts[1:] > starts[:-1]]
    return points, points[after]


def _filled(points: Array, starts: Array, corner: Array, pixel: float, shape: Array) -> Array:
    """(R, C) bool: pixel centres with a winding number above 0."""
    first, last = _edges((points - corner) / pixel, starts)
    low, high = np.minimum(first[:, 1], last[:, 1]), np.maximum(first[:, 1], last[:, 1])
    begin, end = np.ceil(low).astype(int), np.ceil(high).astype(int)
    edge = np.repeat(np.arange(len(begin)), end - begin)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin) + begin[edge]
    rise = last[edge] - first[edge]
    x = first[edge, 0] + (row - first[edge, 1]) / rise[:, 1] * rise[:, 0]
    winding = np.zeros(tuple(shape), np.int32)
    np.add.at(winding, (row, np.clip(np.ceil(x).astype(int), 0, shape[1] - 1)), np.where(rise[:, 1] < 0, 1, -1))
    return np.asarray(np.cumsum(winding, axis=1) > 0)


def _distance(inside: Array, pixel: float) -> Array:
    from scipy.ndimage import distance_transform_edt

    if not inside.any():
        return np.full(inside.shape, EMPTY, np.float32)
    out, within = distance_transform_edt(~inside), distance_transform_edt(inside)
    return ((out - within - np.where(inside, -0.5, 0.5)) * pixel).astype(np.float32)


def _spaced(points: Array, starts: Array, spacing: float) -> Array:
    """Points along closed rings no farther apart than spacing, corners kept where they are not nearer than that."""
    first, last = _edges(points, starts)
    if not len(points):
        return points
    length = np.linalg.norm(last - first, axis=1)
    along = np.cumsum(length)
    keep = np.diff(np.floor(along / spacing), prepend=-1) != 0
    keep[starts[:-1][starts[1:] > starts[:-1]]] = True
    count = np.maximum(np.ceil(length / spacing), 1).astype(int)
    row = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / count[row]
    dense = first[row] + share[:, None] * (last - first)[row]
    return dense[keep[row] | (share > 0)]
