"""Rotation vectors, matrices and angles, batched.

Legend
    r      rotation vector, rad: axis times angle                   (K, 3)
    R      rotation matrix, platform to machine frame               (K, 3, 3)
    q      unit quaternion (w, x, y, z)                             (K, 4)
    left   a step d turns the platform about machine axes: R <- exp([d]x) R
    psi, theta, phi   Tait-Bryan angles of the papers, R = Rx(psi) Ry(theta) Rz(phi)
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array


def cross(a: Array, b: Array) -> Array:
    """Vector product over the last axis, broadcast; several times faster than numpy's."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


def skew(a: Array) -> Array:
    """[a]x with [a]x b = a x b: (..., 3) -> (..., 3, 3)."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    o = np.zeros_like(x)
    return np.stack((o, -z, y, z, o, -x, -y, x, o), axis=-1).reshape(*a.shape, 3)


def matrix(vector: Array) -> Array:
    """Rotation matrices (K, 3, 3) of rotation vectors (K, 3) rad (Rodrigues 1840)."""
    angle = np.sqrt(np.einsum("...i,...i", vector, vector))
    a, b = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    turn = skew(vector)
    return np.eye(3) + a[..., None, None] * turn + b[..., None, None] * (turn @ turn)


def vector(turn: Array) -> Array:
    """Rotation vectors (K, 3) rad, angle in 0..pi, of rotation matrices (K, 3, 3)."""
    return vector_of(_quaternion_of(turn))


def turned(start: Array, step: Array) -> Array:
    """Rotation vector of exp([step]x) exp([start]x), (K, 3) rad: the left perturbation of an orientation."""
    p, q = quaternion(step), quaternion(start)
    w = p[..., 0] * q[..., 0] - np.einsum("...i,...i", p[..., 1:], q[..., 1:])
    v = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + cross(p[..., 1:], q[..., 1:])
    return vector_of(np.concatenate((w[..., None], v), axis=-1))


def from_angles(angles: Array) -> Array:
    """Rotation vectors (K, 3) of the papers' angles psi, theta, phi (K, 3), all in rad."""
    angles = np.asarray(angles, float)
    zero = np.zeros_like(angles[..., 0])
    about = [np.stack([angle if axis == i else zero for i in range(3)], axis=-1)
             for axis, angle in enumerate(np.moveaxis(angles, -1, 0))]
    return turned(turned(about[2], about[1]), about[0])


def to_angles(vectors: Array) -> Array:
    """Angles psi, theta, phi (K, 3) rad of rotation vectors; psi = 0 where theta = +-pi/2 leaves it open."""
    turn = matrix(np.asarray(vectors, float))
    theta = np.arctan2(turn[..., 0, 2], np.hypot(turn[..., 0, 0], turn[..., 0, 1]))
    locked = np.hypot(turn[..., 0, 0], turn[..., 0, 1]) < 1e-12
    psi = np.where(locked, 0.0, np.arctan2(-turn[..., 1, 2], turn[..., 2, 2]))
    phi = np.where(locked, np.arctan2(turn[..., 1, 0], turn[..., 1, 1]), np.arctan2(-turn[..., 0, 1], turn[..., 0, 0]))
    return np.stack((psi, theta, phi), axis=-1)


def angle_rates(vectors: Array) -> Array:
    """T (K, 3, 3) with angular velocity = T @ d(psi, theta, phi)/dt: columns e_x, Rx e_y, Rx Ry e_z."""
    psi, theta, _ = np.moveaxis(to_angles(vectors), -1, 0)
    one, zero = np.ones_like(psi), np.zeros_like(psi)
    columns = ((one, zero, zero), (zero, np.cos(psi), np.sin(psi)),
               (np.sin(theta), -np.sin(psi) * np.cos(theta), np.cos(psi) * np.cos(theta)))
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def quaternion(vector: Array) -> Array:
    """Unit quaternions (K, 4), w first, of rotation vectors (K, 3) rad."""
    angle = np.sqrt(np.einsum("...i,...i", vector, vector))
    half = 0.5 * np.sinc(angle / (2 * np.pi))
    return np.concatenate((np.cos(angle / 2)[..., None], half[..., None] * vector), axis=-1)


def vector_of(q: Array) -> Array:
    """Rotation vectors (K, 3) rad of unit quaternions (K, 4), w first."""
    q = np.where(q[..., :1] < 0, -q, q)
    size = np.sqrt(np.einsum("...i,...i", q[..., 1:], q[..., 1:]))
    tiny = size < 1e-12
    scale = np.where(tiny, 2.0, 2 * np.arctan2(size, q[..., 0]) / np.where(tiny, 1.0, size))
    return scale[..., None] * q[..., 1:]


def _quaternion_of(turn: Array) -> Array:
    """Largest of the four components first (Shepperd 1978), so that no angle loses digits."""
    t = turn
    trace = np.einsum("...ii", t)
    diagonal = np.einsum("...ii->...i", t)
    squares = np.concatenate(((1 + trace)[..., None], 1 + 2 * diagonal - trace[..., None]), axis=-1)   # 4 q_i^2
    w = np.stack((t[..., 2, 1] - t[..., 1, 2], t[..., 0, 2] - t[..., 2, 0], t[..., 1, 0] - t[..., 0, 1]), axis=-1)
    p = t + np.swapaxes(t, -1, -2)
    rows = [np.concatenate((squares[..., :1], w), axis=-1)]
    for i in range(3):
        row = np.concatenate((w[..., i: i + 1], p[..., i, :]), axis=-1)
        row[..., i + 1] = squares[..., i + 1]
        rows.append(row)
    best = np.argmax(squares, axis=-1)
    table = np.stack(rows, axis=-2)                                                                 # 4 q_best q_j
    q = np.take_along_axis(table, best[..., None, None], axis=-2)[..., 0, :]
    return q / np.sqrt(np.einsum("...i,...i", q, q))[..., None]
