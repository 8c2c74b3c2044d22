"""What can be said of a part before it is sliced: its box against the bed plate and the frame."""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.distance import PRECISION
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.model import Robot


def fits(bounds: Array, robot: Machine) -> Verdict:
    """Whether a part with bounds (2, 3) mm, bed coordinates, can be on the bed and below the pulleys at all.

    Necessary, never sufficient; the robot needs a nozzle and a bed.
    """
    high = [] if isinstance(robot, Delta) else _height(bounds, robot)
    found = tuple(_sides(bounds, robot) + high)
    highest = "" if isinstance(robot, Delta) else " and the height of the highest pulley"
    sentence = f"The part's box against the bed plate{highest}"
    return Verdict((f"{sentence}; nothing else, as it is too large." if found else f"{sentence}.",), found)


def _sides(bounds: Array, robot: Machine) -> list[Finding]:
    assert robot.bed_size is not None
    found = []
    for axis, name in enumerate("xy"):
        half, reach = float(robot.bed_size[axis]) / 2, np.abs(bounds[:, axis])
        if reach.max() > half + PRECISION:
            value, size = float(bounds[reach.argmax(), axis]), float(np.ptp(bounds[:, axis]))
            fits_when = f"Shift the part along {name}." if size <= 2 * half else (
                f"At most {100 * 2 * half / size:.3g} % of this size fits as it is turned; or turn it, or cut it up."
            )
            place = (value, 0.0) if axis == 0 else (0.0, value)
            found.append(Finding(
                "bed", 0, (*place, float(bounds[0, 2])), 0, abs(value), half, "mm",
                f"The part is {size:.4g} mm long along {name} and reaches {name} {value:.2f} mm, beyond the edge of "
                f"the bed plate at {np.copysign(half, value):.2f} mm.", fits_when,
            ))
    return found


def _height(bounds: Array, robot: Robot) -> list[Finding]:
    """With every attachment above every pulley no cable carries weight."""
    assert robot.nozzle is not None
    assert robot.bed_origin is not None
    top = float((robot.anchors[:, 2] + 2 * robot.pulley_radii).max() - robot.bed_origin[2])
    limit = top - float((robot.attachments[:, 2] - robot.nozzle[2]).min())
    height = float(bounds[1, 2])
    if height <= limit or not robot.gravity[2] < 0 or not robot.freedoms[2]:
        return []
    return [Finding(
        "tension", 0, (0.0, 0.0, height), 0, height, limit, "mm",
        f"The part is {height:.4g} mm high: with the nozzle above {limit:.4g} mm the platform is higher than every "
        "pulley and no cable carries it.", f"At most {100 * limit / height:.3g} % of this size; or split it in height.",
    )]
