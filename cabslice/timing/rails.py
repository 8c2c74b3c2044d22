"""What limits a linear Delta, in the form of timing.limits: a machine that needs no cables to be retimed.

Legend
    q_k', q_k''  derivatives of the carriages' heights by s: J q' and, of the second, J q'' + q' H q'
    tau_k        torque of motor k, rho F_k + I q_k'' / rho, rho the belt radius; friction is taken off its bound
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot import delta as machine
from cabslice.robot.delta import Delta, belt_radius
from cabslice.robot.model import NEWTON
from cabslice.timing.limits import NO_SPEED_LIMIT, RESERVE, Block, Limits, Nodes, axes, feeding, scaled


def rows(delta: Delta, limits: Limits, nodes: Nodes) -> tuple[Array, Array, Array]:
    """As timing.limits.rows: a, b (K, R) and the margin (K,) at rest, N mm."""
    turning = torque(delta, nodes)
    margin = np.minimum(turning[3], -turning[2]).min(axis=0)
    return *scaled([turning, carriages(delta, nodes), axes(nodes), feeding(limits, nodes)]), margin


def torque(delta: Delta, nodes: Nodes) -> Block:
    """Within what the motors give for ever, so that none overheats however long the print is."""
    still, winders = np.zeros_like(nodes.d1), delta.winders
    base = _torque(delta, nodes.poses, still, still)
    high = (winders.continuous_torque - winders.friction)[:, None]
    first, second = _torque(delta, nodes.poses, still, nodes.d1), _torque(delta, nodes.poses, nodes.d1, nodes.d2)
    return first - base, second - base, -high - base, high - base


def _torque(delta: Delta, poses: Array, rates: Array, accels: Array) -> Array:
    """(3, K) N mm without friction."""
    lifting = belt_radius(delta) * machine.forces(delta, poses, rates, accels)
    spin = machine.carriage_accelerations(delta, poses, rates, accels) / belt_radius(delta)
    return np.asarray((lifting + delta.winders.inertia * spin * NEWTON).T)


def carriages(delta: Delta, nodes: Nodes) -> Block:
    still = np.zeros_like(nodes.d1)
    first = machine.carriage_accelerations(delta, nodes.poses, still, nodes.d1).T
    second = machine.carriage_accelerations(delta, nodes.poses, nodes.d1, nodes.d2).T
    high = np.full(first.shape, delta.acceleration_max)
    return first, second, -high, high


def speed_x(delta: Delta, nodes: Nodes) -> Array:
    """(K,) mm^2/s^2, largest x that keeps every motor within its speed."""
    per_s = np.abs(np.einsum("kmi,ki->km", machine.jacobian(delta, nodes.poses), nodes.d1[:, :3]))
    fastest = (per_s / (delta.winders.max_speed * belt_radius(delta) * (1 - RESERVE))).max(axis=1)
    return 1 / np.maximum(fastest, NO_SPEED_LIMIT**-0.5) ** 2
