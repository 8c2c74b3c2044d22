"""What a workspace says in numbers: the same in --json and in tables. Every key names its unit.

Fractions are of the frame: the box of the anchors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import Robot
from cabslice.robot.workspace import Grid, PrintSpace


def of_maps(grid: Grid, inside: Array, maps: Mapping[str, Array]) -> dict[str, Any]:
    """Share of the nodes (X, Y, Z) that are inside, and mean and extremes there of each map."""
    found: dict[str, Any] = {
        "workspace_fraction": float(inside.mean()), "nodes": list(grid.shape), "nodes_inside": int(inside.sum())}
    for key, value in maps.items():
        held = value[inside & np.isfinite(value)]
        if len(held):
            values = {"mean": held.mean(), "min": held.min(), "max": held.max()}
            found |= {f"{kind}_{key}": float(value) for kind, value in values.items()}
    return found


def of_print_space(robot: Robot, space: PrintSpace) -> dict[str, Any]:
    """The union of all poses free of collision, and the largest single cylinder: radius and height."""
    frame = float(np.prod(np.ptp(robot.anchors, axis=0)))
    return {
        "print_space_fraction": space.volume / frame, "print_space_mm3": space.volume,
        "largest_cylinder_mm": [space.cylinder_radius, space.cylinder_height],
        "largest_cylinder_fraction": space.cylinder_volume / frame, "largest_cylinder_mm3": space.cylinder_volume,
    }
