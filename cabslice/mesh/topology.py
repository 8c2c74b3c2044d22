"""What a triangle mesh hangs together by: vertices, edges, bodies. Pure numpy.

V vertices, F faces, H = 3 F half-edges: half-edge 3 f + k runs from corner k of face f to the next corner.
A mesh is closed when every edge is run as often one way as the other; then every plane cuts it in closed
curves, also where more than two faces share an edge.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array

_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))


def weld(points: Array) -> tuple[Array, Array]:
    """Merge points that are equal bit by bit (-0 is 0): vertices (V, 3) and, per point (N,), its vertex."""
    points = np.ascontiguousarray(points, dtype=np.float64) + 0.0
    bits = points.view(np.uint64)
    key = np.zeros(len(points), dtype=np.uint64)
    for axis, factor in enumerate(_MIX):
        key = (key ^ bits[:, axis]) * factor
        key ^= key >> np.uint64(29)
    first, of_point = _groups(key)
    if not np.array_equal(points[first][of_point], points):  # two points share a key: the slow way is always right
        vertices, of_point = np.unique(points, axis=0, return_inverse=True)
        return vertices, of_point.reshape(-1)
    return points[first], of_point


def _groups(key: Array) -> tuple[Array, Array]:
    """Index of the first of each group of equal keys, and (N,) the group of each; groups in order of first."""
    order = np.argsort(key, kind="stable")
    opens = np.concatenate(([True], key[order][1:] != key[order][:-1]))[: len(key)]
    first = order[opens]
    rank = np.empty(len(first), dtype=np.int64)
    by_first = np.argsort(first, kind="stable")
    rank[by_first] = np.arange(len(first))
    group = np.empty(len(key), dtype=np.int64)
    group[order] = rank[np.cumsum(opens) - 1]
    return first[by_first], group


def proper_faces(faces: Array) -> Array:
    """(F,) bool: the three corners are three vertices."""
    return (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])


def edge_balance(faces: Array, vertex_count: int) -> tuple[Array, Array, Array]:
    """Edges that are run more often one way than the other.

    Returns low (E,), high (E,), its two vertices, and surplus (E,) int: runs low -> high minus runs high -> low.
    All empty for a closed mesh.
    """
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = (low * vertex_count + high) * 2 + (start > end)
    key.sort()
    edge = key >> 1
    opens = np.flatnonzero(np.concatenate(([True], edge[1:] != edge[:-1]))) if len(edge) else np.zeros(0, np.int64)
    surplus = np.add.reduceat(1 - 2 * (key & 1), opens) if len(edge) else opens
    bad = np.flatnonzero(surplus)
    edge = edge[opens[bad]]
    return edge // vertex_count, edge % vertex_count, surplus[bad]


def bodies(faces: Array, vertex_count: int) -> tuple[Array, int]:
    """Connected bodies (sharing vertices): label (F,) 0..count-1 in order of first face, and their count."""
    label = _joined(np.concatenate((faces[:, [0, 1]], faces[:, [1, 2]])), vertex_count)
    first, of_face = _groups(label[faces[:, 0]])
    return of_face, len(first)


def patches(faces: Array, vertex_count: int) -> tuple[Array, Array]:
    """Faces connected over edges of exactly two faces: label (F,) 0..count-1; and (F,) whether at an edge of more."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    opens = np.flatnonzero(np.concatenate(([True], key[order][1:] != key[order][:-1])))
    count = np.diff(np.append(opens, len(key)))
    pairs = opens[count == 2]
    label = _joined(np.stack((order[pairs] // 3, order[pairs + 1] // 3), axis=1), len(faces))
    crowded = np.zeros(len(faces), dtype=bool)
    crowded[order[np.repeat(count > 2, count)] // 3] = True
    return _groups(label)[1], crowded


def _joined(links: Array, size: int) -> Array:
    """(size,) label of what each index hangs together with over the links (P, 2): the lowest index of its group."""
    label = np.arange(size)
    while True:
        low = np.minimum(label[links[:, 0]], label[links[:, 1]])
        before = label.copy()
        for side in (0, 1):
            np.minimum.at(label, label[links[:, side]], low)
        while not np.array_equal(label, label[label]):
            label = label[label]
        if np.array_equal(label, before):
            return label


def signed_volumes(vertices: Array, faces: Array) -> Array:
    """(F,) mm^3, tetrahedron from the middle of the bounds to each face; the sum of a closed body is its volume."""
    corner = (vertices - (vertices.min(0) + vertices.max(0)) / 2)[faces]
    return np.einsum("fi,fi->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6


def areas(vertices: Array, faces: Array) -> Array:
    """(F,) mm^2."""
    corner = vertices[faces]
    return np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2


def winding_number(vertices: Array, faces: Array, point: Array) -> int:
    """How often closed faces wrap a point (3,): signed crossings of the ray from the point straight up.

    Half-open rules as in a plane cut, so that a ray through an edge or a vertex counts once.
    """
    flat = vertices[:, :2] - point[:2]
    near = ((flat[faces].min(1) <= 0) & (flat[faces].max(1) >= 0)).all(1)
    corner = (vertices - point)[faces[near]]
    total = 0
    for triangle in corner:
        x, y, z = triangle.T
        twice = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if twice == 0:
            continue
        inside = 0
        for i, j in ((0, 1), (1, 2), (2, 0)):
            if (y[i] >= 0) != (y[j] >= 0) and (x[i] * y[j] - x[j] * y[i]) * np.sign(y[j] - y[i]) > 0:
                inside += int(np.sign(y[j] - y[i]))
        if inside:
            height = np.linalg.det(np.array([x, y, z])) / twice
            total += inside * (height > 0)
    return total
