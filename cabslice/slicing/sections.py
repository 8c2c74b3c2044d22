"""Plane cuts of all layers, streamed: rings of every layer from the triangles that cross its plane.

A vertex on the plane counts as above it, so a section is the one just under its plane and faces lying in
the plane need no special case. Each crossing triangle gives one segment from edge to edge with the material on
its left; segments are linked where they share an edge of the mesh, never by distance.

L planes, F triangles, S segments of a block of planes, V vertices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from cabslice.arrays import Array

BLOCK = 150_000  # segments cut at once: bounds memory, not the result


class Solid(Protocol):
    """What is cut: a closed mesh standing on z = 0 (mesh.part.Part is one)."""

    @property
    def vertices(self) -> Array: ...
    @property
    def faces(self) -> Array: ...
    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class Modifiers:
    """Meshes beside the part, in its coordinates: where there must be no support, and where there must be."""

    blockers: Sequence[Solid] = ()
    enforcers: Sequence[Solid] = ()


NO_MODIFIERS = Modifiers()


def cut(vertices: Array, faces: Array, planes: Array) -> Iterator[tuple[Array, Array]]:
    """Rings (points (N, 2) mm, starts (R+1,)) of each plane z (L,) mm, ascending, in order.

    The mesh must be closed (mesh.mend); rings may cross each other and themselves: their positive winding is the
    solid. Raises ValueError where it is not closed.
    """
    z = vertices[:, 2][faces]
    first = np.searchsorted(planes, z.min(1), side="right")
    last = np.searchsorted(planes, z.max(1), side="right")
    crossing = np.flatnonzero(last > first)
    crossing = crossing[np.argsort(first[crossing], kind="stable")]
    first, last = first[crossing], last[crossing]
    active = np.zeros(0, dtype=np.int64)  # rows of `crossing` that reach into the block
    taken = 0
    for begin, end in _blocks(first, last, len(planes)):
        upto = int(np.searchsorted(first, end))
        active = np.concatenate((active[last[active] > begin], np.arange(taken, upto)))
        taken = upto
        low, high = np.maximum(first[active], begin), np.minimum(last[active], end)
        row = np.repeat(active, high - low)
        layer = np.arange(len(row)) - np.repeat(np.cumsum(high - low) - high, high - low)
        yield from _cut_block(vertices, faces[crossing[row]], planes, layer, begin, end)


def _blocks(first: Array, last: Array, count: int) -> list[tuple[int, int]]:
    """Runs of planes with about BLOCK segments each."""
    change = np.bincount(first, minlength=count + 1) - np.bincount(last, minlength=count + 1)
    total = np.cumsum(np.cumsum(change)[:count])
    edges = [0]
    while edges[-1] < count:
        done = total[edges[-1] - 1] if edges[-1] else 0
        edges.append(max(edges[-1] + 1, int(np.searchsorted(total, done + BLOCK, side="right"))))
    return list(pairwise(edges))


def _cut_block(
    vertices: Array, faces: Array, planes: Array, layer: Array, begin: int, end: int
) -> Iterator[tuple[Array, Array]]:
    """Rings of planes begin..end from the (triangle, plane) pairs that cross: faces (S, 3), layer (S,)."""
    above = vertices[:, 2][faces] >= planes[layer][:, None]
    up = above.sum(1) == 1                       # one corner above: it is alone, else the one below is
    alone = np.argmax(above == up[:, None], axis=1)
    rows = np.arange(len(faces))
    apex, after, before = faces[rows, alone], faces[rows, (alone + 1) % 3], faces[rows, (alone + 2) % 3]
    tail, head = np.where(up, after, before), np.where(up, before, after)
    size = len(vertices)
    base = (layer - begin) * size
    start_key = (base + np.minimum(apex, tail)) * size + np.maximum(apex, tail)
    end_key = (base + np.minimum(apex, head)) * size + np.maximum(apex, head)
    order = np.argsort(start_key, kind="stable")
    by_end = np.argsort(end_key, kind="stable")
    start_key = start_key[order]
    if not np.array_equal(start_key, end_key[by_end]):
        raise ValueError("cut: the mesh is not closed")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = rows
    follow = np.empty(len(order), dtype=np.int64)
    follow[rank[by_end]] = rows
    layer = layer[order]
    points = _crossings(vertices, start_key % size, start_key // size % size, planes[layer])
    walk, opens = _cycles(follow)
    first_of = np.searchsorted(layer[walk], np.arange(begin, end + 1))
    ring_of = np.searchsorted(opens, first_of)
    for k in range(end - begin):
        a, b = first_of[k], first_of[k + 1]
        yield points[walk[a:b]], np.append(opens[ring_of[k] : ring_of[k + 1]], b) - a


def _crossings(vertices: Array, high: Array, low: Array, z: Array) -> Array:
    """(S, 2) where edges low-high meet their planes; the same bits from whichever side the edge is asked."""
    p, q = vertices[low], vertices[high]
    share = (z - p[:, 2]) / (q[:, 2] - p[:, 2])
    return p[:, :2] + share[:, None] * (q[:, :2] - p[:, :2])


def _cycles(follow: Array) -> tuple[Array, Array]:
    """Cycles of a permutation (S,), each from its lowest member, in order of that: visiting order (S,), starts (R,)."""
    ahead = follow.tolist()
    walk: list[int] = []
    opens: list[int] = []
    seen = bytearray(len(ahead))
    for first in range(len(ahead)):
        if not seen[first]:
            opens.append(len(walk))
            here = first
            while not seen[here]:
                seen[here] = 1
                walk.append(here)
                here = ahead[here]
    return np.array(walk, dtype=np.int64), np.array(opens, dtype=np.int64)
