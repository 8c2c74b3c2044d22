"""Where the cables hold the platform at rest, or under a steady load.

Legend
    rest, line   rest lengths and lines to the pulleys, mm       w    wrench that acts besides the cables, N and N mm
    r            W t + w, what is left to balance                 K    stiffness there (robot.stiffness)
Newton: step = K^-1 r, poses turned by left perturbations.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot
from cabslice.robot.rotation import turned
from cabslice.robot.stiffness import elastic_tensions, gravity_stiffness, stiffness
from cabslice.robot.wrench import gravity_wrench, wrench_matrix

MOST, NEAR = 30, 1e-9       # steps; mm, and rad times 100 mm, at which a pose is accepted
LONGEST = 5.0               # mm and rad times 100 mm, of a step


def equilibrium(
    robot: Robot, rest: Array, line: Array, start: Array, *, wrench: Array | float = 0.0
) -> tuple[Array, Array]:
    """Poses (K, 6) at which cables of rest lengths and lines (K, m) mm balance weight and wrench, and tensions (K, m).

    start (K, 6) near them; wrench (K, 6) N, N mm at the platform origin besides the weight. Cables may be slack.
    Raises PoseError where no equilibrium is found near start.
    """
    count = np.ones(robot.cables) if robot.winders is None else robot.winders.advantage
    poses, free = np.array(start, dtype=float), np.flatnonzero(robot.freedoms)
    for _ in range(MOST):
        lines = cables(robot, poses)
        tension = elastic_tensions(robot, lines.length + line / count, rest / count)
        matrix = wrench_matrix(robot, poses, lines=lines)
        left = np.einsum("kij,kj->ki", matrix, tension) + gravity_wrench(robot, poses) + wrench
        whole = stiffness(robot, poses, tension, line=line / count, lines=lines).total + gravity_stiffness(robot, poses)
        step = np.zeros_like(poses)
        step[:, free] = np.linalg.solve(whole[:, free[:, None], free], left[:, free, None])[..., 0]
        size = np.abs(step * [1, 1, 1, 100, 100, 100]).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, LONGEST / np.maximum(size, 1e-12))
        poses = np.hstack((poses[:, :3] + step[:, :3], turned(poses[:, 3:], step[:, 3:])))
        if not size.max() > NEAR:
            return poses, tension
    raise PoseError(f"pose {int(size.argmax())}: no equilibrium of the cables was found near it",
                    pose=int(size.argmax()))
