"""Reading a part: any supported file in, one closed `Part` in mm out, or a sentence that says why not."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError, UsageError
from cabslice.mesh.foreign import UNITS, read_foreign
from cabslice.mesh.mend import mend
from cabslice.mesh.part import Part
from cabslice.stl import read_stl

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".step", ".stp")
SMALL_MM, LARGE_MM = 1.0, 3000.0  # outside of this a unit is probably wrong


def load_mesh(path: str | Path, *, unit: str = "mm", scale: float = 1.0) -> Part:
    """The part in a model file, mended, in mm and where the file has it (see `place`).

    `Part.repairs` says what was changed, `Part.warnings` what looks odd. unit is what one unit of the file means (mm,
    cm, m, inch, ft); a 3MF or STEP file says so itself. Raises ModelError naming the file if it cannot be read or
    is no solid.
    """
    if unit not in UNITS:
        raise UsageError(f"unit '{unit}', expected one of {', '.join(UNITS)}.")
    if not (np.isfinite(scale) and scale > 0):
        raise UsageError(f"scale {scale}, expected a number above 0.")
    path = Path(path)
    data = _read(path)
    triangles, notes, own_unit = _triangles(data, path)
    factor = (UNITS[unit] if own_unit is None else own_unit) * scale
    if own_unit is not None and unit != "mm":
        notes.append(f"The file says its own unit ({own_unit:g} mm): --unit {unit} was not used.")
    vertices, faces, repairs = mend(triangles * factor if factor != 1 else triangles, path.name)
    return Part(
        vertices, faces, path.name, hashlib.sha256(data).hexdigest(),
        repairs=(*notes, *repairs), warnings=_warnings(vertices, path.name),
    )


def _read(path: Path) -> bytes:
    if path.suffix.lower() not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise ModelError(f"{path.name}: '{path.suffix}' is not a model format: expected {known}.", file=path.name)
    try:
        data = path.read_bytes()
    except OSError as fault:
        raise ModelError(f"{path}: cannot be read: {fault.strerror or fault}.", file=str(path)) from fault
    if not data:
        raise ModelError(f"{path.name}: the file is empty.", file=path.name)
    return data


def _triangles(data: bytes, path: Path) -> tuple[Array, list[str], float | None]:
    kind = path.suffix.lower().removeprefix(".")
    if kind == "stl":
        return *read_stl(data, path.name), None
    return read_foreign(data, path.name, "step" if kind == "stp" else kind)


def _warnings(vertices: Array, name: str) -> tuple[str, ...]:
    extent = np.ptp(vertices, axis=0)
    size = " x ".join(f"{length:.4g}" for length in extent)
    if extent.max() < SMALL_MM or extent.max() > LARGE_MM:
        return (f"{name} is {size} mm: is the unit right? See --unit.",)
    return ()
