"""How a motion makes the platform ring on a robot that is not as its profile says, without playing it: modes alone.

Rest lengths are commanded for the tensions of the dynamic motion. If modulus or mass is wrong by a share epsilon the
cables pull with epsilon of what inertia needs too little. So the error of the platform is what the wrong robot shows at
rest, motors standing, and beside it d of a spring-mass system shaken by the motion's own acceleration:

    M d'' + C d' + (1 - epsilon) K d = -epsilon M a      modulus epsilon lower; a mass epsilon higher is the same to
                                                         epsilon^2: K / (1 + epsilon)
Legend
    a        acceleration of the motion, mm/s^2                K, M, C   stiffness, mass, damping (robot.stiffness)
    Phi      modes of unit mass, d = Phi q                     w, z      their angular frequencies, damping ratios
    q'' + 2 z w q' + w^2 q = Phi^T f, f linear between two times: solved exactly (Nigam & Jennings 1969)
K is taken constant in cells of the bed, of a level platform; at their borders d and d' are handed over. What it shows
at rest is a quadratic through PLACES. simulation.plant knows better and has the last word; this costs a hundredth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import Robot
from cabslice.robot.rotation import matrix
from cabslice.robot.stiffness import gravity_stiffness, modes, stiffness
from cabslice.robot.tension import nearest_tension
from cabslice.robot.winder import loaded_length
from cabslice.robot.wrench import mass_matrix, required_wrench
from cabslice.simulation.damping import of_ratio
from cabslice.simulation.ringing_kernel import ring
from cabslice.simulation.sensitivity import shift, standing
from cabslice.timing.trajectory import Trajectory, sample

CELL = 20.0              # mm
STEP_S = 2e-3            # of the times looked at
SETTLE_S = 3.0           # played before, so that what rang then is there
PLACES = 120
MOVING = 1e-3            # mm/s


@dataclass(frozen=True)
class Shaken:
    """What a stretch of a motion does, every STEP_S: K rows."""

    error: Array         # (K, 3) mm of the nozzle
    laying: Array        # (K,) bool
    move: Array          # (K,) int64


@dataclass(frozen=True)
class _Cells:
    """The modes in C cells of the bed, F modes each."""

    low: Array           # (3,) mm, the platform in the corner of the first cell
    counts: Array        # (3,) cells along each axis
    step: Array          # (C, F, 8): q, q' after a step from q, q', and the modal force at its start and its end
    drive: Array         # (C, F, 3) modal force of an acceleration
    nozzle: Array        # (C, 3, F)
    shapes: Array        # (C, 6, F)
    dual: Array          # (C, F, 6): what finds the modes in a displacement

    def at(self, places: Array) -> Array:
        """(K,) cells of platform places (K, 3) mm."""
        cell = np.clip(((places - self.low) / CELL).astype(np.int64), 0, self.counts - 1)
        return np.ravel_multi_index(tuple(cell.T), tuple(self.counts))


class Ringing:
    """A robot whose modulus is wrong by a share (> 0: lower), with damping ratio `ratio` of its first mode, on its way
    along a motion: places and what it shows at rest are taken from that, and good for any other timing of the path."""

    def __init__(self, robot: Robot, share: float, ratio: float, trajectory: Trajectory) -> None:
        self.robot, self.share = robot, share
        self.wrong = replace(robot, axial_stiffness=robot.axial_stiffness * (1 - share))
        vertices = trajectory.path.vertex + trajectory.to_pose
        self.cells = _cells(robot, self.wrong, vertices, ratio)
        self._rest_by(sample(trajectory, np.linspace(0.0, trajectory.duration, PLACES)).poses)

    def _rest_by(self, poses: Array) -> None:
        places = poses[:, :3]
        self.centre, self.reach = places.mean(axis=0), np.maximum(np.ptp(places, axis=0), 1.0)
        off = shift(standing(self.robot, poses), self.wrong)
        self.weights = np.linalg.lstsq(_quadratic((places - self.centre) / self.reach), off, rcond=1e-9)[0]

    def at_rest(self, places: Array) -> Array:
        """What the nozzle is off (K, 3) mm with the platform at rest at places (K, 3) mm."""
        return np.asarray(_quadratic((places - self.centre) / self.reach) @ self.weights)

    def play(self, trajectory: Trajectory, start_s: float, end_s: float) -> Shaken:
        """From start_s to end_s; the platform rests SETTLE_S before."""
        since = max(start_s - SETTLE_S, 0.0)
        found = sample(trajectory, np.arange(since, end_s, STEP_S))
        cells, error = self.cells, np.empty((len(found.move), 3))
        ring(cells.at(found.poses[:, :3]), -self.share * found.accels[:, :3], cells.step, cells.drive, cells.nozzle,
             cells.shapes, cells.dual, np.zeros(2 * cells.drive.shape[1]), error)
        error += self.at_rest(found.poses[:, :3])
        moving = np.abs(found.rates[:, :3]).max(axis=1) > MOVING
        new = slice(round((start_s - since) / STEP_S), None)
        return Shaken(error[new], ((found.feed > 0) & moving)[new], found.move[new])


def _quadratic(x: Array) -> Array:
    """(K, 10) of x (K, 3)."""
    i, j = np.triu_indices(3)
    return np.hstack((np.ones((len(x), 1)), x, x[:, i] * x[:, j]))


def _cells(robot: Robot, real: Robot, vertices: Array, ratio: float) -> _Cells:
    low = vertices.min(axis=0)
    counts = (np.ptp(vertices, axis=0) / CELL).astype(np.int64) + 1
    index = np.stack(np.unravel_index(np.arange(counts.prod()), tuple(counts)), axis=1)
    poses = np.zeros((len(index), 6))
    poses[:, :3] = np.minimum(low + (index + 0.5) * CELL, vertices.max(axis=0))
    tension = nearest_tension(robot, poses, required_wrench(robot, poses)).tension
    tension = np.where(np.isfinite(tension), tension, robot.tension_reference)
    line = np.zeros(robot.cables)
    if robot.winders is not None:
        length = lengths(robot, robot.home[None])
        line = (loaded_length(robot, length, robot.winders.home_angle[None]) - length)[0]
    parts = stiffness(real, poses, tension, line=line)
    hertz, phi = modes(real, poses, parts.total + gravity_stiffness(real, poses))
    mass, lever = mass_matrix(real, poses), _lever(robot, poses)
    hertz = np.maximum(hertz, 0.1)
    viscous = of_ratio(real, (float(hertz[0, 0]), phi[0, :, 0], parts.cable[0]), ratio)
    damped = np.einsum("kif,kij,kjf->kf", phi, parts.cable, phi) * (viscous / real.axial_stiffness).mean() * 1e3
    omega = 2 * np.pi * hertz
    dual = phi.swapaxes(1, 2) @ mass
    return _Cells(
        low, counts, _one_step(omega, np.minimum(damped / (2 * omega), 0.9), STEP_S), np.ascontiguousarray(
            dual[..., :3]), phi[:, :3] + np.cross(phi[:, 3:], lever[:, :, None], axis=1), phi, dual)


def _lever(robot: Robot, poses: Array) -> Array:
    return matrix(poses[:, 3:]) @ (np.zeros(3) if robot.nozzle is None else robot.nozzle)


def _one_step(omega: Array, zeta: Array, h: float) -> Array:
    """(C, F, 8): q and q' after h as weights of q, q', f at its start and f at its end."""
    damped, decay, square = omega * np.sqrt(1 - zeta**2), np.exp(-zeta * omega * h), omega**2
    sine, cosine = np.sin(damped * h) / damped, np.cos(damped * h)

    def after(q: Array, rate: Array) -> tuple[Array, Array]:
        q1 = decay * (q * cosine + (rate + zeta * omega * q) * sine)
        return q1, decay * (rate * cosine - (zeta * omega * rate + square * q) * sine)

    one, none = np.ones_like(omega), np.zeros_like(omega)
    columns = [after(one, none), after(none, one)]
    for f0, f1 in ((1.0, 0.0), (0.0, 1.0)):
        slope = (f1 - f0) / h / square
        lag = 2 * zeta / omega * slope
        q, rate = after(lag - f0 / square, -slope)
        columns.append((q + f1 / square - lag, rate + slope))
    return np.stack([column[part] for part in (0, 1) for column in columns], axis=-1)
