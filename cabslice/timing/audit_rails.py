"""The audit of a linear Delta: carriages and motors by finite differences, forces by the arms.

Nothing of the planner is used: forces are those of three rods on the platform (Newton), not of virtual work.

Legend
    n_k      unit vector along arm k, from carriage to platform;   t_k its push:   sum n_k t_k = m (a - g)
    F_k      force of motor k along its rail, m_c (q'' - g_z) + t_k n_kz
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.delta import Delta, arm_angles, belt_radius, carriages
from cabslice.robot.model import NEWTON
from cabslice.timing.worst import Worst


def see(delta: Delta, worst: Worst, now: Array, at: Array, poses: Array, step: float) -> None:
    """Every limit of every rail at the inner ones of poses (K + 2, 6), `step` s apart; times, moves (K,)."""
    q, radius, winders = carriages(delta, poses), belt_radius(delta), delta.winders
    accel = (poses[2:, :3] - 2 * poses[1:-1, :3] + poses[:-2, :3]) / step**2
    speed, lift = (q[2:] - q[:-2]) / (2 * step), (q[2:] - 2 * q[1:-1] + q[:-2]) / step**2
    torque = radius * _forces(delta, poses[1:-1], q[1:-1], accel, lift) + winders.inertia * lift / radius * NEWTON
    torque = (torque + winders.friction * np.sign(speed)) * 1e-3
    angle, one = np.degrees(arm_angles(delta, poses[1:-1])), np.ones(3)
    worst.see_cables("stroke", np.abs(q[1:-1] - delta.travel.mean()), one * np.ptp(delta.travel) / 2, now, at)
    worst.see_cables("arm-angle", angle, one * np.degrees(delta.arm_angle_max), now, at)
    worst.see_cables("motor-speed", np.abs(speed) / radius, winders.max_speed, now, at)
    worst.see_cables("motor-torque", np.abs(torque), winders.peak_torque * 1e-3, now, at)
    if np.isfinite(delta.acceleration_max):
        worst.see_cables("carriage-acceleration", np.abs(lift), one * delta.acceleration_max, now, at)
    worst.squares, worst.rows = worst.squares + np.einsum("km,km->m", torque, torque), worst.rows + len(torque)


def _forces(delta: Delta, poses: Array, q: Array, accel: Array, lift: Array) -> Array:
    """(K, 3) N"""
    joints = np.empty((len(q), 3, 3))
    joints[:, :, :2], joints[:, :, 2] = delta.radius * delta.rails, q
    arm = poses[:, None, :3] - joints
    arm /= np.linalg.norm(arm, axis=2, keepdims=True)
    push = np.linalg.solve(np.swapaxes(arm, 1, 2), (delta.mass * (accel - delta.gravity))[..., None])[..., 0]
    return np.asarray((delta.carriage_mass * (lift - delta.gravity[2]) + push * arm[:, :, 2]) * NEWTON)
