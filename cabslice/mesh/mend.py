"""From a heap of triangles to closed, outward-facing bodies, with a sentence for everything that was changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError
from cabslice.mesh.holes import fill_holes
from cabslice.mesh.topology import (
    areas,
    bodies,
    edge_balance,
    patches,
    proper_faces,
    signed_volumes,
    weld,
    winding_number,
)

WELD_STEPS = (1e-7, 1e-6, 1e-5, 1e-4)  # of the diagonal: how far apart points on open edges may be to be one
NO_VOLUME = 1e-9                       # of area^1.5: a body with less is a sheet, not a body
FLAP = 0.2                             # share of new surface from which a closed patch would be an invention
MOST_FLAPS = 200
FLAPS = 0.35                           # share of the surface that flaps may have
MOST_NEW_SURFACE = 0.5                 # a body of which more than this would be invented is not mended


@dataclass
class _Mesh:
    vertices: Array
    faces: Array
    repairs: list[str]

    def open_edges(self) -> int:
        return int(np.abs(edge_balance(self.faces, len(self.vertices))[2]).sum())


def mend(triangles: Array, name: str) -> tuple[Array, Array, list[str]]:
    """Vertices (V, 3), faces (F, 3) and repair sentences of triangles (F, 3, 3) mm.

    The result is closed: every edge is run as often one way as the other. Bodies may overlap and intersect
    themselves; slicing takes their union. Raises ModelError when no solid can be made of it.
    """
    _refuse_nonsense(triangles, name)
    vertices, of_corner = weld(triangles.reshape(-1, 3))
    _refuse_flat(vertices, name)
    mesh = _Mesh(vertices, of_corner.reshape(-1, 3), [])
    kept = proper_faces(mesh.faces)
    if not kept.all():
        mesh.repairs.append(f"Dropped {count(int((~kept).sum()), 'triangle')} without area.")
        mesh.faces = mesh.faces[kept]
    if not len(mesh.faces):
        raise ModelError(f"{name}: none of its triangles has an area: there is nothing to print.", file=name)
    if mesh.open_edges():
        _close(mesh, name)
    _orient(mesh)
    return *_compact(mesh.vertices, mesh.faces), mesh.repairs


def count(number: int, noun: str) -> str:
    """"1 hole", "2 holes", "3 bodies"."""
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun[:-1] + 'ies' if noun.endswith('y') else noun + 's'}"


def _refuse_nonsense(triangles: Array, name: str) -> None:
    if not len(triangles):
        raise ModelError(f"{name}: no triangles in it: expected a solid model.", file=name)
    if not np.isfinite(triangles).all():
        bad = np.flatnonzero(~np.isfinite(triangles).all((1, 2)))
        raise ModelError(f"{name}: triangle {bad[0] + 1} has a coordinate that is not a finite number.", file=name)


def _refuse_flat(vertices: Array, name: str) -> None:
    low, high = vertices.min(0), vertices.max(0)
    extent, most = high - low, max(-low.min(), high.max())
    if most > 1e9:
        raise ModelError(f"{name}: a coordinate of {most:.3g} mm: is the file damaged?", file=name)
    if extent.max() == 0:
        raise ModelError(f"{name}: all its points are one point: there is nothing to print.", file=name)
    if extent.min() <= 1e-9 * extent.max():
        axis = "xyz"[int(extent.argmin())]
        raise ModelError(f"{name}: it is flat, without extent along {axis}: expected a solid body.", file=name)


def _close(mesh: _Mesh, name: str) -> None:
    """Weld, drop doubles, turn faces, fill holes, drop sheets: in this order, each only where it helps."""
    start = mesh.open_edges()
    _weld_near(mesh)
    _drop_doubles(mesh)
    _wind_alike(mesh)
    _drop_flaps(mesh)
    left = mesh.open_edges()
    if left < start:
        mesh.repairs.append(f"Open edges in the file: {start}, after this: {left}.")
    old_count = len(mesh.faces)
    mesh.vertices, mesh.faces, holes = fill_holes(mesh.vertices, mesh.faces)
    if holes:
        across = max(hole.across_mm for hole in holes)
        total, new = areas(mesh.vertices, mesh.faces).sum(), areas(mesh.vertices, mesh.faces[old_count:]).sum()
        mesh.repairs.append(
            f"Closed {count(len(holes), 'hole')} (the largest {across:.4g} mm across) with "
            f"{count(len(mesh.faces) - old_count, 'triangle')}, {100 * new / total:.2g} % of the surface."
        )
        corners = [hole for hole in holes if hole.corner]
        if corners:
            added = sum(hole.added_mm3 for hole in corners)
            mesh.repairs.append(
                f"Rebuilt {count(len(corners), 'missing corner')} where the planes around a hole meet: "
                f"{added:+.4g} mm3 compared to a lid."
            )
    _drop_sheets(mesh, old_count, name)
    if mesh.repairs:
        held = abs(float(signed_volumes(mesh.vertices, mesh.faces).sum()))
        mesh.repairs.append(f"The closed part holds {held:.6g} mm3.")


def _weld_near(mesh: _Mesh) -> None:
    """Make one of points on open edges that lie within a hair of each other, while that closes edges."""
    from scipy.spatial import cKDTree  # late: most parts are closed and never come here

    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    before, welded, faces = mesh.open_edges(), 0, mesh.faces
    for step in WELD_STEPS:
        low, high, _ = edge_balance(faces, len(mesh.vertices))
        rim = np.unique(np.concatenate((low, high)))
        pairs = cKDTree(mesh.vertices[rim]).query_pairs(step * diagonal, output_type="ndarray")
        if not len(pairs):
            continue
        target = _merge(rim[pairs], len(mesh.vertices))
        trial = target[faces]
        trial = trial[proper_faces(trial)]
        left = int(np.abs(edge_balance(trial, len(mesh.vertices))[2]).sum())
        if left < before:
            welded, faces, before = welded + int((target[rim] != rim).sum()), trial, left
    if welded:
        within = WELD_STEPS[-1] * diagonal
        mesh.repairs.append(f"Welded {count(welded, 'point')} on open edges to a neighbour within {within:.2g} mm.")
        mesh.faces = faces


def _merge(pairs: Array, size: int) -> Array:
    """Target (size,) of each index when the pairs (P, 2) are made one: the lowest of its group."""
    target = np.arange(size)
    while True:
        low = target[pairs].min(1)
        before = target.copy()
        for side in (0, 1):
            np.minimum.at(target, target[pairs[:, side]], low)
        target = target[target]
        if np.array_equal(target, before):
            return target


def _drop_doubles(mesh: _Mesh) -> None:
    """Of equal faces keep one; a face and its reverse cancel. Only if that closes edges."""
    corners = np.sort(mesh.faces, axis=1)
    even = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])
    order = np.argsort(mesh.faces, axis=1)
    sign = np.where((order[:, None, :] == even).all(2).any(1), 1, -1)
    group = np.unique(corners, axis=0, return_inverse=True)[1]
    group = group.reshape(-1)
    total = np.bincount(group, sign).astype(int)
    right_way = np.full(len(total), -1)
    for face in range(len(mesh.faces) - 1, -1, -1):
        if sign[face] == np.sign(total[group[face]]):
            right_way[group[face]] = face
    kept = np.sort(right_way[right_way >= 0])
    if len(kept) == len(mesh.faces):
        return
    trial = _Mesh(mesh.vertices, mesh.faces[kept], [])
    if len(kept) and trial.open_edges() < mesh.open_edges():
        mesh.repairs.append(f"Dropped {count(len(mesh.faces) - len(kept), 'triangle')} that lie on another one.")
        mesh.faces = trial.faces


def _wind_alike(mesh: _Mesh) -> None:
    """Turn faces that run the same way along an edge as their neighbour."""
    if not (np.abs(edge_balance(mesh.faces, len(mesh.vertices))[2]) == 2).any():
        return
    import trimesh

    copy = trimesh.Trimesh(mesh.vertices, mesh.faces.copy(), process=False)
    trimesh.repair.fix_winding(copy)
    trial = _Mesh(mesh.vertices, np.asarray(copy.faces, dtype=np.int64), [])
    if trial.open_edges() < mesh.open_edges():
        turned = int((trial.faces != mesh.faces).any(1).sum())
        mesh.repairs.append(f"Turned {count(turned, 'triangle')} to face the same way as their neighbours.")
        mesh.faces = trial.faces


def _drop_flaps(mesh: _Mesh) -> None:
    """Leave out open surfaces that hang on a body along an edge, if the rest is more closed without them.

    A flap is no body with a hole in it: closing it alone would take a lot of new surface.
    """
    patch, crowded = patches(mesh.faces, len(mesh.vertices))
    area = areas(mesh.vertices, mesh.faces)
    total = np.bincount(patch, area)
    kept = np.ones(len(mesh.faces), dtype=bool)
    low, high, _ = edge_balance(mesh.faces, len(mesh.vertices))
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[low], rim[high] = True, True
    hanging = np.intersect1d(patch[crowded], patch[rim[mesh.faces].sum(1) > 1])
    for p in hanging[np.argsort(total[hanging], kind="stable")][:MOST_FLAPS]:
        mine = patch == p
        if area[~kept].sum() + total[p] > FLAPS * area.sum():
            break
        vertices, faces, holes = fill_holes(mesh.vertices, mesh.faces[mine])
        new = areas(vertices, faces[mine.sum() :]).sum()
        trial, now = (_Mesh(mesh.vertices, mesh.faces[which], []).open_edges() for which in (kept & ~mine, kept))
        if holes and new > FLAP * (new + total[p]) and trial < now:
            kept &= ~mine
    if not kept.all():
        lost = area[~kept].sum()
        mesh.repairs.append(
            f"Left out {count(int((~kept).sum()), 'triangle')} of open surface hanging on a body, {lost:.4g} mm2"
            f" ({100 * lost / area.sum():.2g} % of the surface)."
        )
        mesh.faces = mesh.faces[kept]


def _drop_sheets(mesh: _Mesh, old_count: int, name: str) -> None:
    """Leave out bodies without volume; refuse when what remains is mostly invented."""
    body, number = bodies(mesh.faces, len(mesh.vertices))
    area = areas(mesh.vertices, mesh.faces)
    total = np.bincount(body, area, number)
    new = np.bincount(body[old_count:], area[old_count:], number)
    volume = np.bincount(body, signed_volumes(mesh.vertices, mesh.faces), number)
    sheet = np.abs(volume) <= NO_VOLUME * total**1.5
    guess = ~sheet & (new > MOST_NEW_SURFACE * total)
    lost = (total - new)[sheet | guess].sum()
    whole = (total - new).sum()
    if lost > MOST_NEW_SURFACE * whole or (sheet | guess).all():
        raise ModelError(
            f"{name}: wide open: {100 * lost / whole:.3g} % of its surface bounds no volume "
            f"({count(number, 'loose piece')}). Mend it in the program that made it.", file=name,
        )
    for which, what in ((sheet, "without thickness"), (guess, "more than half open")):
        if which.any():
            mesh.repairs.append(
                f"Left out {count(int(which.sum()), 'surface')} {what}, {(total - new)[which].sum():.4g} mm2"
                f" ({100 * (total - new)[which].sum() / whole:.2g} % of the surface)."
            )
    mesh.faces = mesh.faces[~(sheet | guess)[body]]


def _orient(mesh: _Mesh) -> None:
    """Turn inside-out bodies; a body turned inwards that lies in another one is a cavity and stays."""
    body, number = bodies(mesh.faces, len(mesh.vertices))
    volume = np.bincount(body, signed_volumes(mesh.vertices, mesh.faces), number)
    if (volume >= 0).all():
        return
    if volume.sum() < 0:
        mesh.faces, volume = mesh.faces[:, ::-1], -volume
        mesh.repairs.append(f"Turned the whole part inside out: its volume was {-volume.sum():.4g} mm3.")
    turned = 0.0
    flipped = 0
    solid = mesh.faces[(volume > 0)[body]]
    for b in np.flatnonzero(volume < 0):
        if winding_number(mesh.vertices, solid, mesh.vertices[mesh.faces[body == b][0, 0]]) <= 0:
            mesh.faces = np.where((body == b)[:, None], mesh.faces[:, ::-1], mesh.faces)
            flipped, turned = flipped + 1, turned - volume[b]
    if flipped:
        mesh.repairs.append(f"Turned {count(flipped, 'body')} inside out: {turned:.4g} mm3 that would have been lost.")


def _compact(vertices: Array, faces: Array) -> tuple[Array, Array]:
    """Without vertices that no face uses."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return vertices, faces
    return vertices[used], (np.cumsum(used) - 1)[faces]
