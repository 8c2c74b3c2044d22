"""Bodies that a printer file gives as the name of an STL file: read, and replaced by the corners of its convex hull.

From then on the profile holds the corners, so that what is shown, exported or carried in a product stands alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cabslice.errors import ModelError, ProfileError
from cabslice.profile.toml import Place, line_of

TABLES = ("platform", "nozzle")
MOST = 400           # corners of a hull: cables are judged against each of its faces
DIGITS = 6


def with_hulls(values: dict[str, Any], folder: Path, label: str, text: str = "") -> dict[str, Any]:
    """The same values with corners (V, 3) mm for file names, seen from `folder`.

    Raises ProfileError with every file that is not there, is no STL, is flat or has more than MOST corners.
    """
    faults = []
    for place, holder, key in list(_named(values)):
        try:
            holder[key] = hull_of(folder / holder[key])
        except (ModelError, OSError, ValueError) as error:
            words = f"cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error)
            name, line = ".".join(str(part) for part in place), line_of(text, place)
            start = f"line {line}: {name}" if line else name
            faults.append(f'{start} = "{holder[key]}": {words} (expected an STL file in mm, relative to this file)')
    if faults:
        raise ProfileError(label, faults)
    return values


def _named(values: dict[str, Any]) -> Iterator[tuple[Place, Any, Any]]:
    """Where a body is a text: its place, and the table or list it stands in with its key."""
    for name in TABLES:
        table = values.get(name)
        if isinstance(table, dict) and isinstance(table.get("hull_mm"), str):
            yield (name, "hull_mm"), table, "hull_mm"
    bodies = values.get("obstacles_mm")
    for index, body in enumerate(bodies if isinstance(bodies, list) else []):
        if isinstance(body, str):
            yield ("obstacles_mm", index), bodies, index


def hull_of(path: Path) -> list[list[float]]:
    """Corners of the convex hull of an STL file, mm. Raises OSError, ModelError, or ValueError with what is wrong."""
    import numpy as np
    from scipy.spatial import ConvexHull, QhullError

    from cabslice.stl import read_stl

    triangles, _ = read_stl(path.read_bytes(), path.name)
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    if not np.isfinite(points).all():
        raise ValueError("a corner is not a finite number")
    try:
        corners = points[np.sort(ConvexHull(points).vertices)]
    except (QhullError, ValueError) as error:
        raise ValueError("its corners are all in one plane, it has no volume") from error
    if len(corners) > MOST:
        raise ValueError(f"its convex hull has {len(corners)} corners, at most {MOST} are taken: make it coarser")
    return [[float(value) for value in corner] for corner in np.round(corners, DIGITS) + 0.0]
