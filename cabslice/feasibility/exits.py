"""Where cables leave their pulleys, in bed coordinates, and how far that point can move when the nozzle does.

Legend (see robot.pulley)
    q    nozzle, bed coordinates                        d_i   attachment minus nozzle: constant on a level platform,
                                                              else turned with it (robot.turning)
    A_i  exit point on the pulley                       b_i   attachment, q + d_i
    rho, d, l, r_p, beta   as in robot.pulley           R     radius of a ball of nozzle positions around q, mm

When b moves, A turns about the swivel axis by at most |db|/rho at a distance r_p (1 - cos beta) <= 2 r_p from it, and
along the groove by at most r_p |db|/l; the two movements of b are at right angles, and so are those of A. Hence
|dA| <= r_p max(2/rho, 1/l) |db|, with rho and l at their smallest in the ball.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.obstacles import Moves
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.pulley import CableLines


def offsets(robot: Robot) -> Array:
    """d (m, 3) mm: attachments seen from the nozzle tip of a level platform."""
    return robot.attachments - robot.nozzle


def hung(robot: Robot, xyz: Array) -> Array:
    """d (K, m, 3) mm: attachments seen from the nozzle tip at xyz (K, 3)."""
    if robot.turning is None:
        return np.broadcast_to(offsets(robot), (len(xyz), robot.cables, 3))
    return np.einsum("kij,mj->kmi", robot.turning.matrices(xyz), offsets(robot))


def turned_by(robot: Robot, middle: Array, half: Array) -> Array:
    """(K,) rad: at most so far the platform turns from middle (K, 3), within half (K, 3) or (K, 1) mm of it."""
    if robot.turning is None:
        return np.zeros(len(middle))
    return robot.turning.change(middle - half, middle, middle + half)


def hung_within(robot: Robot, middle: Array, half: Array) -> tuple[Array, Array]:
    """d (K, m, 3) at middle (K, 3), and by how much (K, m) mm it differs at most within half (K, 3) of it."""
    lever = np.linalg.norm(offsets(robot), axis=1)
    return hung(robot, middle), turned_by(robot, middle, half)[:, None] * lever


def tip_shift(robot: Robot, xyz: Array, radius: Array) -> Array:
    """(K, m) mm: how far attachments can get while the nozzle stays within radius (K,) of xyz (K, 3)."""
    lever = np.linalg.norm(offsets(robot), axis=1)
    return radius[:, None] + turned_by(robot, xyz, radius[:, None])[:, None] * lever


def lines_at(robot: Robot, xyz: Array) -> CableLines:
    """Cables with the nozzle at xyz (K, 3), bed coordinates; columns in the machine frame, nan if impossible."""
    return cables(robot, nozzle_poses(robot, xyz), refuse=False)


def exit_points(robot: Robot, xyz: Array) -> Array:
    """A (K, m, 3) mm in bed coordinates."""
    return lines_at(robot, xyz).exit - robot.bed_origin


def pulley_distances(robot: Robot, xyz: Array) -> tuple[Array, Array]:
    """rho and d (K, m) mm: attachment to the swivel axis, and to the centre of the pulley."""
    arm = (xyz + robot.bed_origin)[:, None] + hung(robot, xyz) - robot.anchors
    height = np.einsum("kmi,mi->km", arm, robot.pulley_axes)
    rho = np.sqrt(np.maximum(np.einsum("kmi,kmi->km", arm, arm) - height**2, 0.0))
    return rho, np.hypot(rho - robot.pulley_radii, height)


def exit_drift(robot: Robot, xyz: Array, radius: Array) -> Array:
    """How far (K, m) mm each exit point can get while the nozzle stays within radius (K,) of xyz (K, 3)."""
    r, moved = robot.pulley_radii, tip_shift(robot, xyz, radius)
    rho, d = pulley_distances(robot, xyz)
    nearest = np.maximum(np.stack((rho, d)) - moved, 1e-9)
    free = np.sqrt(np.maximum(nearest[1] ** 2 - r * r, 1e-18))
    return np.minimum(r * np.maximum(2 / nearest[0], 1 / free) * moved, 4 * r)


def exit_boxes(robot: Robot, low: Array, high: Array) -> tuple[Array, Array]:
    """Boxes (K, m, 3), lowest and highest corner, of all exit points for nozzle positions in boxes (K, 3)."""
    centre = (low + high) / 2
    exits = exit_points(robot, centre)
    drift = exit_drift(robot, centre, np.linalg.norm(high - low, axis=1) / 2)[..., None]
    unknown = ~np.isfinite(exits)
    exits = np.where(unknown, robot.anchors - robot.bed_origin, exits)
    drift = np.where(unknown, 3 * robot.pulley_radii[:, None], drift)
    return exits - drift, exits + drift


def hung_boxes(robot: Robot, low: Array, high: Array) -> tuple[Array, Array]:
    """Boxes (K, m, 3) of d for nozzle positions in boxes (K, 3)."""
    middle, spread = hung_within(robot, (low + high) / 2, (high - low) / 2)
    return middle - spread[..., None], middle + spread[..., None]


def exits_of(robot: Robot, start: Array, end: Array) -> tuple[Array, Array]:
    """Exit points (K, m, 3) at the middle of straight lines (K, 3), and their drift (K, m) to either end, mm."""
    middle = (start + end) / 2
    return exit_points(robot, middle), exit_drift(robot, middle, np.linalg.norm(end - start, axis=1) / 2)


@dataclass(frozen=True)
class Ends:
    """Both ends of cables with the nozzle on straight lines: at their middle, and how far they differ to either end."""

    exits: Array             # A (K, 3) mm
    drift: Array             # (K,) mm
    hung: Array              # d (K, 3) mm
    spread: Array | None     # (K,) mm; None: nothing

    @property
    def loose(self) -> Array:
        """(K,) mm: by how much the cable may be elsewhere than between A and the line shifted by d."""
        return self.drift if self.spread is None else np.maximum(self.drift, self.spread)


def ends_of(robot: Robot, start: Array, end: Array, cable: Array) -> Ends:
    """Of cables (K,), the nozzle on straight lines (K, 3)."""
    every, (exits, drift) = np.arange(len(start)), exits_of(robot, start, end)
    if robot.turning is None:
        return Ends(exits[every, cable], drift[every, cable], offsets(robot)[cable], None)
    hung, spread = hung_along(robot, start, end)
    return Ends(exits[every, cable], drift[every, cable], hung[every, cable], spread[every, cable])


def hung_along(robot: Robot, start: Array, end: Array) -> tuple[Array, Array]:
    """d (K, m, 3) at the middle of straight lines (K, 3), and how far (K, m) mm it differs at most to either end."""
    return hung_within(robot, (start + end) / 2, np.abs(end - start) / 2)


class Exits:
    """Exit points and attachments of stretches begin..end-1, worked out when first asked for."""

    def __init__(self, robot: Robot, moves: Moves, begin: int, end: int) -> None:
        self.robot, self.moves, self.begin = robot, moves, begin
        self.known = np.zeros(end - begin, bool)
        self.points, self.drift = np.empty((end - begin, robot.cables, 3)), np.empty((end - begin, robot.cables))
        self.level = robot.turning is None
        self.hung, self.spread = offsets(robot)[None], np.zeros((1, robot.cables))
        if not self.level:
            self.hung, self.spread = np.empty_like(self.points), np.empty_like(self.drift)

    def of(self, move: Array, cable: Array) -> Ends:
        """Of cables (K,) on stretches (K,)."""
        rows = move - self.begin
        asked = np.zeros(len(self.known), bool)
        asked[rows] = True
        fresh = np.flatnonzero(asked & ~self.known)
        if len(fresh):
            part = self.moves.take(fresh + self.begin)
            self.points[fresh], self.drift[fresh] = exits_of(self.robot, part.start, part.end)
            if not self.level:
                self.hung[fresh], self.spread[fresh] = hung_along(self.robot, part.start, part.end)
            self.known[fresh] = True
        if self.level:
            return Ends(self.points[rows, cable], self.drift[rows, cable], self.hung[0, cable], None)
        return Ends(self.points[rows, cable], self.drift[rows, cable], self.hung[rows, cable], self.spread[rows, cable])
