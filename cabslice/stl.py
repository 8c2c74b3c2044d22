"""STL, the format nearly every part comes in: read without trimesh, whose import costs more than the reading."""

from __future__ import annotations

import re

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 84
_TOKEN = re.compile(rb"end\s*facet|end\s*loop|facet|vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.IGNORECASE)


def read_stl(data: bytes, name: str) -> tuple[Array, list[str]]:
    """Triangles (F, 3, 3) of a binary or ascii STL, and sentences about what had to be guessed.

    Raises ModelError when it is neither, or ends early.
    """
    count = int.from_bytes(data[80:_HEAD], "little") if len(data) >= _HEAD else -1
    if count >= 0 and len(data) == _HEAD + count * _RECORD.itemsize:
        return _binary(data, count), []
    if data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:1000].lower():
        return _ascii(data, name)
    if count > 0 and len(data) > _HEAD + count * _RECORD.itemsize:
        extra = len(data) - _HEAD - count * _RECORD.itemsize
        return _binary(data, count), [f"{extra} bytes after the last triangle were ignored."]
    if count > 0 and len(data) > _HEAD and b"\0" in data:
        held = (len(data) - _HEAD) // _RECORD.itemsize
        raise ModelError(f"{name}: ends early: its head promises {count} triangles, it holds {held}.", file=name)
    raise ModelError(f"{name}: not an STL file: neither 'solid ... facet' text nor a binary triangle list.", file=name)


def _binary(data: bytes, count: int) -> Array:
    return np.frombuffer(data, dtype=_RECORD, count=count, offset=_HEAD)["corners"].astype(np.float64)


def _ascii(data: bytes, name: str) -> tuple[Array, list[str]]:
    """Facets of more than three corners are cut into fans; those of fewer are left out."""
    corners: list[tuple[bytes, ...]] = []
    ends: list[int] = [0]
    for match in _TOKEN.finditer(data):
        if match[1] is not None:
            corners.append(match.groups())
        elif ends[-1] != len(corners):
            ends.append(len(corners))
    if ends[-1] != len(corners):
        ends.append(len(corners))
    points = _numbers(corners, name)
    starts, sizes = np.array(ends[:-1], dtype=np.int64), np.diff(ends)
    fans = [
        np.stack((starts[sizes >= k + 3], starts[sizes >= k + 3] + k + 1, starts[sizes >= k + 3] + k + 2), axis=1)
        for k in range(max(sizes, default=2) - 2)
    ]
    triangles = points[np.concatenate(fans)] if fans else np.zeros((0, 3, 3))
    notes = []
    if (odd := int((sizes > 3).sum())) > 0:
        notes.append(f"{odd} facets with more than three corners were cut into triangles.")
    if (short := int((sizes < 3).sum())) > 0:
        notes.append(f"{short} facets with fewer than three corners were left out.")
    return triangles, notes


def _numbers(corners: list[tuple[bytes, ...]], name: str) -> Array:
    try:
        return np.array(corners, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        for k, corner in enumerate(corners):
            try:
                np.array(corner, dtype=np.float64)
            except ValueError:
                text = b" ".join(corner).decode("latin1")
                raise ModelError(f"{name}: corner {k + 1} is '{text}', expected three numbers.", file=name) from None
        raise


def write_stl(vertices: Array, faces: Array) -> bytes:
    """A binary STL of triangles: vertices (V, 3) mm, faces (F, 3)."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)[:, None]
    records = np.zeros(len(faces), _RECORD)
    records["corners"], records["normal"] = corners, normals / np.where(size > 0, size, 1.0)
    return b"cabslice".ljust(80, b" ") + len(faces).to_bytes(4, "little") + records.tobytes()
