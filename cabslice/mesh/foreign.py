"""OBJ, PLY, OFF, 3MF and STEP: the doorway to trimesh.

trimesh tells a 3MF's unit but does not apply it, and leaves faces of mirrored objects inside out: both are done here.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4, "ft": 304.8}
METRES = 1000.0      # mm: STEP comes by way of glTF, which is in metres
FACETS: dict[str, dict[str, Any]] = {"step": {"tol_linear": 0.01, "tol_angular": 0.2}}   # mm, rad off the true surface
_UNITS_3MF = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}


def read_foreign(data: bytes, name: str, file_type: str) -> tuple[Array, list[str], float | None]:
    """Triangles (F, 3, 3) in the file's unit, sentences, and mm per unit if the file says (3MF, STEP), else
    None.

    Raises ModelError when trimesh cannot read it, or has no package for it (STEP).
    """
    import importlib.util
    import logging

    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    if file_type == "step" and importlib.util.find_spec("cascadio") is None:
        raise ModelError(
            f"{name}: STEP needs the optional package cascadio (pip install 'cabslice[step]'); "
            "or save it as STL or 3MF in the CAD program.", file=name,
        )
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, process=False, **FACETS.get(file_type, {}))
        pieces = _pieces(scene)
    except (MemoryError, KeyboardInterrupt):
        raise
    except Exception as fault:  # parsers of damaged files raise anything
        raise ModelError(f"{name}: not a readable {file_type.upper()} file: {_first_line(fault)}", file=name) from fault
    if not pieces:
        raise ModelError(f"{name}: no triangles in it: expected a solid model.", file=name)
    notes = [f"Merged {len(pieces)} objects into one part."] if len(pieces) > 1 else []
    if (mirrored := sum(piece.mirrored for piece in pieces)) > 0:
        notes.append(f"Turned the faces of {mirrored} mirrored objects.")
    factor = _unit_3mf(scene, name) if file_type == "3mf" else METRES if file_type == "step" else None
    return np.concatenate([piece.triangles for piece in pieces]), notes, factor


class _Piece:
    def __init__(self, mesh: Any, matrix: Array) -> None:
        corners = np.asarray(mesh.vertices, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        self.mirrored = bool(np.linalg.det(matrix[:3, :3]) < 0)
        faces = np.asarray(mesh.faces)[:, ::-1] if self.mirrored else np.asarray(mesh.faces)
        self.triangles = corners[faces]


def _pieces(scene: Any) -> list[_Piece]:
    """One per placed object, in order of name."""
    found = []
    for node in sorted(scene.graph.nodes_geometry):
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if len(getattr(mesh, "faces", ())):
            found.append(_Piece(mesh, np.asarray(matrix, dtype=np.float64)))
    return found


def _unit_3mf(scene: Any, name: str) -> float:
    said = {mesh.metadata.get("units", "millimeter") for mesh in scene.geometry.values()}
    unit = said.pop().removesuffix("s") if said else "millimeter"
    unit = {"feet": "foot", "inche": "inch"}.get(unit, unit)
    if unit not in _UNITS_3MF:
        raise ModelError(f"{name}: unit '{unit}', expected one of {', '.join(_UNITS_3MF)}.", file=name)
    return _UNITS_3MF[unit]


def _first_line(fault: Exception) -> str:
    text = str(fault).strip().splitlines()
    return text[0][:200] if text else type(fault).__name__
