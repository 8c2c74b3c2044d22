"""Where the cables run: platform poses in; lengths, directions and their rates out.

Legend
    p, R   platform origin (mm) and orientation of a pose     c_i    attachment, platform frame
    b_i    attachment in the machine frame, p + R c_i         L_i    length from entry point to b_i (see pulley)
    u_i    unit vector from b_i towards the pulley            H_i    second derivative of L_i with b_i
    rates  (v, omega): mm/s and rad/s in the machine frame    accels (a, alpha): mm/s^2 and rad/s^2

Rotations are left perturbations, R <- exp([dphi]x) R, so dphi/dt = omega whatever the orientation is.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import Robot
from cabslice.robot.pulley import CableLines, bend, lead
from cabslice.robot.pulley_kernel import fill_jacobian, place_attachments
from cabslice.robot.rotation import cross


def cables(robot: Robot, poses: Array, *, refuse: bool = True) -> CableLines:
    """Lines of all cables at `poses` (K, 6): exit points, directions, free and wrapped lengths (see CableLines).

    Raises PoseError where an attachment lies inside its pulley or on its anchor; ``refuse=False`` gives nan there.
    """
    poses = np.ascontiguousarray(poses, float).view()
    poses.flags.writeable = False      # one compiled version, whether the caller's poses may be written or not
    lever, tip = np.empty((2, len(poses), robot.cables, 3))
    place_attachments(poses, robot.attachments, lever, tip)
    return lead(robot, tip, lever, refuse=refuse)


def lengths(robot: Robot, poses: Array) -> Array:
    """Cable lengths from pulley entry to platform (K, m) mm, wrap included. Raises PoseError as `cables` does."""
    return cables(robot, poses).length


def jacobian(robot: Robot, poses: Array, *, lines: CableLines | None = None) -> Array:
    """dL/d(translation, left rotation vector) (K, m, 6), mm/mm and mm/rad: rows -[u_i ; (R c_i) x u_i].

    By virtual work this is minus the transposed wrench matrix (Pott 2018, 3.2).  `lines`: what `cables` gave.
    """
    lines = lines or cables(robot, poses)
    rows = np.empty((*lines.free.shape, 6))
    fill_jacobian(lines.unit, lines.lever, rows)
    return rows


def length_rates(robot: Robot, poses: Array, rates: Array, *, lines: CableLines | None = None) -> Array:
    """dL/dt (K, m) mm/s for platform rates (K, 6)."""
    lines = lines or cables(robot, poses)
    return -np.einsum("kmi,kmi->km", lines.unit, tip_velocities(lines, rates))


def length_accelerations(
    robot: Robot, poses: Array, rates: Array, accels: Array, *, lines: CableLines | None = None
) -> Array:
    """d2L/dt2 (K, m) mm/s^2 for platform rates and accels (K, 6): -u . b'' + b'^T H b'.

    The second term is the turning of the cable, on the pulley and about the swivel axis (see pulley.hessian).
    """
    lines = lines or cables(robot, poses)
    accels, turn = np.asarray(accels, float), np.asarray(rates, float)[:, None, 3:]
    tip = accels[:, None, :3] + cross(accels[:, None, 3:], lines.lever) + cross(turn, cross(turn, lines.lever))
    return bend(lines, tip_velocities(lines, rates)) - np.einsum("kmi,kmi->km", lines.unit, tip)


def tip_velocities(lines: CableLines, rates: Array) -> Array:
    """Velocities of the attachments (K, m, 3) mm/s for platform rates (K, 6)."""
    rates = np.asarray(rates, float)
    return rates[:, None, :3] + cross(rates[:, None, 3:], lines.lever)
