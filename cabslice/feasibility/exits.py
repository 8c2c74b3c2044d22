"""Where cables leave their pulleys, in bed coordinates, and how far that point can move when the nozzle does.

Legend (see robot.pulley)
    q    nozzle, bed coordinates                        d_i   attachment minus nozzle: constant, the platform is level
    A_i  exit point on the pulley                       b_i   attachment, q + d_i
    rho, d, l, r_p, beta   as in robot.pulley           R     radius of a ball of nozzle positions around q, mm

When b moves, A turns about the swivel axis by at most |db|/rho at a distance r_p (1 - cos beta) <= 2 r_p from it, and
along the groove by at most r_p |db|/l; the two movements of b are at right angles, and so are those of A. Hence
|dA| <= r_p max(2/rho, 1/l) |db|, with rho and l at their smallest in the ball.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.obstacles import Moves
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.pulley import CableLines


def offsets(robot: Robot) -> Array:
    """d (m, 3) mm: attachments seen from the nozzle tip."""
    return robot.attachments - robot.nozzle


def lines_at(robot: Robot, xyz: Array) -> CableLines:
    """Cables with the nozzle at xyz (K, 3), bed coordinates; columns in the machine frame, nan if impossible."""
    return cables(robot, nozzle_poses(robot, xyz), refuse=False)


def exit_points(robot: Robot, xyz: Array) -> Array:
    """A (K, m, 3) mm in bed coordinates."""
    return lines_at(robot, xyz).exit - robot.bed_origin


def pulley_distances(robot: Robot, xyz: Array) -> tuple[Array, Array]:
    """rho and d (K, m) mm: attachment to the swivel axis, and to the centre of the pulley."""
    arm = nozzle_poses(robot, xyz)[:, None, :3] + robot.attachments - robot.anchors
    height = np.einsum("kmi,mi->km", arm, robot.pulley_axes)
    rho = np.sqrt(np.maximum(np.einsum("kmi,kmi->km", arm, arm) - height**2, 0.0))
    return rho, np.hypot(rho - robot.pulley_radii, height)


def exit_drift(robot: Robot, xyz: Array, radius: Array) -> Array:
    """How far (K, m) mm each exit point can get while the nozzle stays within radius (K,) of xyz (K, 3)."""
    r = robot.pulley_radii
    rho, d = pulley_distances(robot, xyz)
    nearest = np.maximum(np.stack((rho, d)) - radius[:, None], 1e-9)
    free = np.sqrt(np.maximum(nearest[1] ** 2 - r * r, 1e-18))
    return np.minimum(r * np.maximum(2 / nearest[0], 1 / free) * radius[:, None], 4 * r)


def exit_boxes(robot: Robot, low: Array, high: Array) -> tuple[Array, Array]:
    """Boxes (K, m, 3), lowest and highest corner, of all exit points for nozzle positions in boxes (K, 3)."""
    centre = (low + high) / 2
    exits = exit_points(robot, centre)
    drift = exit_drift(robot, centre, np.linalg.norm(high - low, axis=1) / 2)[..., None]
    unknown = ~np.isfinite(exits)
    exits = np.where(unknown, robot.anchors - robot.bed_origin, exits)
    drift = np.where(unknown, 3 * robot.pulley_radii[:, None], drift)
    return exits - drift, exits + drift


def exits_of(robot: Robot, start: Array, end: Array) -> tuple[Array, Array]:
    """Exit points (K, m, 3) at the middle of straight lines (K, 3), and their drift (K, m) to either end, mm."""
    middle = (start + end) / 2
    return exit_points(robot, middle), exit_drift(robot, middle, np.linalg.norm(end - start, axis=1) / 2)


class Exits:
    """Exit points of stretches begin..end-1, worked out when first asked for."""

    def __init__(self, robot: Robot, moves: Moves, begin: int, end: int) -> None:
        self.robot, self.moves, self.begin = robot, moves, begin
        self.known = np.zeros(end - begin, bool)
        self.points, self.drift = np.empty((end - begin, robot.cables, 3)), np.empty((end - begin, robot.cables))

    def of(self, move: Array, cable: Array) -> tuple[Array, Array]:
        """A (K, 3) at the middle of stretches and drift (K,) to either end, mm."""
        rows = move - self.begin
        asked = np.zeros(len(self.known), bool)
        asked[rows] = True
        fresh = np.flatnonzero(asked & ~self.known)
        if len(fresh):
            part = self.moves.take(fresh + self.begin)
            self.points[fresh], self.drift[fresh] = exits_of(self.robot, part.start, part.end)
            self.known[fresh] = True
        return self.points[rows, cable], self.drift[rows, cable]
