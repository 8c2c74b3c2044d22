"""What is wrong with a robot at one pose, in sentences: what no drawing of it would show.

A cable without length or with its attachment inside the pulley, a cable that runs through the platform, a pose at which
the cables leave the platform loose, bounds within which no tensions carry it.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.body import GRAZING, outward
from cabslice.robot.held import why_not
from cabslice.robot.model import Robot


def faults(robot: Robot, pose: Array) -> list[PoseError]:
    """Everything that keeps the robot from being at a pose (6,): mm, rotation vector rad. Empty: nothing does.

    Each names the cable (from 1) in its details where it is about one.
    """
    pose = np.asarray(pose, dtype=float)
    try:
        sines = outward(robot, pose[None])[0]
    except PoseError as error:
        return [error]
    found = [_through(cable, float(sine)) for cable, sine in enumerate(sines, start=1) if sine < -GRAZING]
    reason = why_not(robot, pose)
    return [*found, *([reason] if reason else [])]


def require_sound(robot: Robot, pose: Array) -> None:
    """Raises PoseError with all sentences of `faults`, where there are any; the details are those of the first."""
    found = faults(robot, pose)
    if found:
        raise PoseError("; ".join(one.sentence for one in found), **found[0].details)


def _through(cable: int, sine: float) -> PoseError:
    return PoseError(
        f"cable {cable} runs through the platform: it dips {np.degrees(np.arcsin(-sine)):.1f} deg into the hull of the "
        f"attachments, expected a cable that leaves it", cable=cable, sine=sine)
