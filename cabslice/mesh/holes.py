"""Closing holes. The open edges of any heap of triangles form closed loops; each loop gets a cone of triangles.

The tip of the cone is where the planes around the hole meet, if they do (a missing corner comes back exactly),
else the middle of the loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.mesh.topology import edge_balance

MEET = 0.02      # of the loop's radius: planes that pass a point within this meet there
REACH = 1.5      # of the loop's radius: how far from its middle a corner may be rebuilt
ROUNDING = 1e-4  # weight that draws the tip to the middle where the planes leave it free


@dataclass(frozen=True)
class Hole:
    edges: int
    across_mm: float
    corner: bool       # closed with a corner, not with a lid
    added_mm3: float   # volume of that corner beyond a lid


def fill_holes(vertices: Array, faces: Array) -> tuple[Array, Array, list[Hole]]:
    """Vertices (V', 3) and faces (F', 3) of the closed mesh, new ones last, and what was closed."""
    loops = _loops(*edge_balance(faces, len(vertices)))
    if not loops:
        return vertices, faces, []
    normals = _edge_normals(vertices, faces)
    tips: list[Array] = []
    lids: list[Array] = []
    holes: list[Hole] = []
    for loop in loops:
        points = vertices[loop]
        middle = points.mean(0)
        if len(loop) == 3:
            lids.append(loop[None])
            tip = middle
        else:
            tip = _tip(points, [normals.get((int(b), int(a))) for a, b in zip(loop, np.roll(loop, -1), strict=True)])
            lids.append(np.stack((loop, np.roll(loop, -1), np.full(len(loop), len(vertices) + len(tips))), axis=1))
            tips.append(tip)
        holes.append(_describe(points, middle, tip))
    return np.concatenate((vertices, np.array(tips).reshape(-1, 3))), np.concatenate((faces, *lids)), holes


def _loops(low: Array, high: Array, surplus: Array) -> list[Array]:
    """Simple loops of vertices that run every edge against its surplus."""
    follow: dict[int, list[int]] = {}
    for a, b, n in zip(low.tolist(), high.tolist(), surplus.tolist(), strict=True):
        start, end = (b, a) if n > 0 else (a, b)
        follow.setdefault(start, []).extend([end] * abs(n))
    loops = []
    for first in sorted(follow):
        while follow[first]:
            path, seen = [first], {first: 0}
            while True:
                step = follow[path[-1]].pop(0)
                if step in seen:  # what was walked since then is a loop of its own
                    cut = seen[step]
                    loops.append(np.array(path[cut:]))
                    for vertex in path[cut + 1 :]:
                        del seen[vertex]
                    del path[cut + 1 :]
                    if step == first and cut == 0:
                        break
                else:
                    seen[step] = len(path)
                    path.append(step)
    return loops


def _edge_normals(vertices: Array, faces: Array) -> dict[tuple[int, int], Array]:
    """Unit normal of the face that runs each edge (a, b); only edges on the rim are asked for, all are cheap enough."""
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    low, high, _ = edge_balance(faces, len(vertices))
    rim = set(zip(low.tolist(), high.tolist(), strict=True))
    rim |= {(b, a) for a, b in rim}
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    on_rim = np.zeros(len(vertices), dtype=bool)
    on_rim[low], on_rim[high] = True, True
    found: dict[tuple[int, int], Array] = {}
    for half in np.flatnonzero(on_rim[start] & on_rim[end]):
        edge = (int(start[half]), int(end[half]))
        if edge in rim:
            found[edge] = normal[half // 3]
    return found


def _tip(points: Array, normals: list[Array | None]) -> Array:
    """Least squares over the planes of the faces around the hole, drawn to the middle where they leave it free."""
    middle = points.mean(0)
    known = [(n, p) for n, p in zip(normals, points, strict=True) if n is not None]
    if not known:
        return middle
    normal, through = np.array([n for n, _ in known]), np.array([p for _, p in known])
    offset = np.einsum("ei,ei->e", normal, through - middle)
    shift = np.linalg.solve(normal.T @ normal + ROUNDING * len(normal) * np.eye(3), normal.T @ offset)
    radius = np.sqrt(((points - middle) ** 2).sum(1).mean())
    if np.abs(normal @ shift - offset).max() > MEET * radius or np.linalg.norm(shift) > REACH * radius:
        return middle
    exact = np.linalg.lstsq(normal, offset, rcond=0.05)[0]
    return middle + (exact if np.linalg.norm(exact - shift) < MEET * radius else shift)


def _describe(points: Array, middle: Array, tip: Array) -> Hole:
    """Lid and corner compared: the cone over the loop from its middle to the tip."""
    around = np.roll(points, -1, axis=0)
    vector = np.cross(points - middle, around - middle).sum(0) / 2  # of area, as seen along each axis
    added = float(vector @ (tip - middle) / 3)
    across = float(np.linalg.norm(np.ptp(points, axis=0)))
    corner = bool(np.linalg.norm(tip - middle) > 0.05 * across)
    return Hole(len(points), across, corner, added if corner else 0.0)
