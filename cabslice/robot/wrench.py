"""Forces and moments on the platform: what tensions supply and what a motion asks for.

Legend (Gueners 2021, 3.2.3; Pott 2018, 3.5)
    W    wrench matrix, columns [u_i ; (R c_i) x u_i]; wrench = W @ tension       N/N and N mm/N
    g    gravity, mm/s^2 (robot.gravity)                 s    R times the centre of mass: lever of the weight, mm
    M    mass matrix about the platform origin           I    inertia about the centre of mass, machine axes
    rates (v, omega), accels (a, alpha) of the platform origin, machine frame

Moments are about the platform origin. Equilibrium of the moving platform: W t + gravity_wrench = inertial_wrench.
``masked=True`` keeps the rows of robot.freedoms only: f of them (point platforms, planar robots).
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.kinematics import cables, jacobian
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.pulley import CableLines
from cabslice.robot.rotation import cross, matrix, skew


def wrench_matrix(robot: Robot, poses: Array, *, masked: bool = False, lines: CableLines | None = None) -> Array:
    """Platform wrench per newton of cable tension, (K, 6, m) or masked (K, f, m).

    Rows 0-2 are force (N/N), rows 3-5 moment about the platform origin (N mm/N). A tension pulls the platform
    towards its pulley.  Raises PoseError as `cables` does.  Source: Pott 2018, eq. 3.5.
    """
    lines = lines or cables(robot, poses)
    matrices = np.swapaxes(-jacobian(robot, poses, lines=lines), 1, 2)
    return matrices[:, robot.freedoms] if masked else matrices


def gravity_wrench(robot: Robot, poses: Array, *, masked: bool = False) -> Array:
    """Wrench of the weight and of what pulls steadily (tube, hose) at the platform origin, (K, 6) or masked (K, f): N
    and N mm."""
    force = np.broadcast_to(NEWTON * robot.mass * robot.gravity, (len(poses), 3))
    wrench = np.concatenate((force, cross(_weight_lever(robot, poses), force)), axis=1) + robot.pull
    return wrench[:, robot.freedoms] if masked else wrench


def mass_matrix(robot: Robot, poses: Array, *, masked: bool = False) -> Array:
    """M (K, 6, 6) or masked (K, f, f) about the platform origin: kg, kg mm, kg mm^2.

    NEWTON * M @ accels is the part of the inertial wrench without velocities, in N and N mm.
    """
    lever = skew(_weight_lever(robot, poses))
    blocks = np.zeros((len(lever), 6, 6))
    blocks[:, :3, :3] = robot.mass * np.eye(3)
    blocks[:, :3, 3:], blocks[:, 3:, :3] = -robot.mass * lever, robot.mass * lever
    blocks[:, 3:, 3:] = _turned_inertia(robot, poses) - robot.mass * lever @ lever
    return blocks[:, robot.freedoms][:, :, robot.freedoms] if masked else blocks


def inertial_wrench(robot: Robot, poses: Array, rates: Array, accels: Array, *, masked: bool = False) -> Array:
    """Rate of change of momentum at the platform origin, (K, 6) or masked (K, f): N and N mm (Newton-Euler).

    M @ accels plus what turning alone needs: centripetal force and gyroscopic moment.
    """
    rates, accels = np.asarray(rates, float), np.asarray(accels, float)
    lever, inertia = _weight_lever(robot, poses), _turned_inertia(robot, poses)
    turn, spin = rates[:, 3:], accels[:, 3:]
    force = robot.mass * (accels[:, :3] + cross(spin, lever) + cross(turn, cross(turn, lever)))
    moment = _times(inertia, spin) + cross(turn, _times(inertia, turn)) + cross(lever, force)
    wrench = NEWTON * np.concatenate((force, moment), axis=1)
    return wrench[:, robot.freedoms] if masked else wrench


def required_wrench(
    robot: Robot, poses: Array, rates: Array | None = None, accels: Array | None = None, *, masked: bool = False
) -> Array:
    """What W @ t must equal, (K, 6) or masked (K, f): inertial minus gravity wrench; absent ones are zero."""
    needed = -gravity_wrench(robot, poses, masked=masked)
    if rates is None and accels is None:
        return needed
    still = np.zeros((len(poses), 6))
    rates, accels = still if rates is None else rates, still if accels is None else accels
    return needed + inertial_wrench(robot, poses, rates, accels, masked=masked)


def _weight_lever(robot: Robot, poses: Array) -> Array:
    return matrix(np.asarray(poses, float)[:, 3:]) @ robot.centre_of_mass


def _turned_inertia(robot: Robot, poses: Array) -> Array:
    turn = matrix(np.asarray(poses, float)[:, 3:])
    return turn @ robot.inertia @ turn.swapaxes(1, 2)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.einsum("kij,kj->ki", matrices, vectors)
