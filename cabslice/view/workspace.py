"""What a workspace says in numbers: the same in --json and in tables. Every key names its unit.

Fractions are of the box of the grid, those of the print space of the frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.workspace import Grid, PrintSpace


def of_maps(grid: Grid, inside: Array, maps: Mapping[str, Array]) -> dict[str, Any]:
    """Share of the nodes (X, Y, Z) that are inside, and mean and extremes there of each map."""
    found: dict[str, Any] = {
        "workspace_fraction": float(inside.mean()), "nodes": list(grid.shape),
        "box_mm": [[axis[0], axis[-1]] for axis in (grid.x, grid.y, grid.z)], "nodes_inside": int(inside.sum())}
    for key, value in maps.items():
        held = value[inside & np.isfinite(value)]
        if len(held):
            values = {"mean": held.mean(), "min": held.min(), "max": held.max()}
            found |= {f"{kind}_{key}": float(value) for kind, value in values.items()}
    return found


def of_print_space(frame_mm3: float, space: PrintSpace) -> dict[str, Any]:
    """The union of all poses free of collision, and the largest single cylinder: radius and height."""
    return {
        "print_space_fraction": space.volume / frame_mm3, "print_space_mm3": space.volume,
        "largest_cylinder_mm": [space.cylinder_radius, space.cylinder_height],
        "largest_cylinder_fraction": space.cylinder_volume / frame_mm3, "largest_cylinder_mm3": space.cylinder_volume,
    }
