"""Compiled inner loops of the kinematics: one cable at a time, in plain scalars (legend in pulley and kinematics).

numpy takes 2 us a pose for this with 8 cables, most of it in temporaries whose last axis is 3; compiled it is 0.7 us,
and small batches no longer cost more.
"""

from __future__ import annotations

from math import atan2, cos, nan, pi, sin, sqrt

from cabslice.compiled import compiled


@compiled
def _put(rows, k, i, x, y, z):
    rows[k, i, 0], rows[k, i, 1], rows[k, i, 2] = x, y, z


@compiled
def place_attachments(poses, attachments, lever, tip):
    """Fill lever = R c_i and tip = p + R c_i (K, m, 3) for poses (K, 6); R by Rodrigues' formula."""
    for k in range(len(poses)):
        x, y, z = poses[k, 3], poses[k, 4], poses[k, 5]
        square = x * x + y * y + z * z
        angle = sqrt(square)
        a, b = (sin(angle) / angle, (1 - cos(angle)) / square) if angle > 1e-4 else (1 - square / 6, 0.5 - square / 24)
        for i in range(len(attachments)):
            c, d, e = attachments[i, 0], attachments[i, 1], attachments[i, 2]
            u, v, w = y * e - z * d, z * c - x * e, x * d - y * c
            lever[k, i, 0] = c + a * u + b * (y * w - z * v)
            lever[k, i, 1] = d + a * v + b * (z * u - x * w)
            lever[k, i, 2] = e + a * w + b * (x * v - y * u)
            for j in range(3):
                tip[k, i, j] = poses[k, j] + lever[k, i, j]


@compiled
def lead_cables(tip, anchors, axes, radii, vectors, numbers):
    """Fill vectors (3, K, m, 3): exit, unit, side; numbers (4, K, m): free, wrap, length, lateral; nan if inside."""
    exit, unit, side = vectors
    for k in range(len(tip)):
        for i in range(len(radii)):
            r = radii[i]
            ax, ay, az = axes[i]
            bx, by, bz = anchors[i]
            x, y, z = tip[k, i, 0] - bx, tip[k, i, 1] - by, tip[k, i, 2] - bz
            height = x * ax + y * ay + z * az
            x, y, z = x - height * ax, y - height * ay, z - height * az
            rho = sqrt(x * x + y * y + z * z)
            square = (rho - r) * (rho - r) + height * height
            if not square > r * r or (rho <= r and r > 0):
                square = nan
            if rho > 0:
                x, y, z = x / rho, y / rho, z / rho
            free = sqrt(square - r * r)
            sine, cosine = ((rho - r) * free + height * r) / square, (height * free - (rho - r) * r) / square
            wrap = atan2(sine, cosine)
            if wrap < 0:
                wrap += 2 * pi
            out, up = r * (1 - cosine), r * sine
            _put(exit, k, i, bx + out * x + up * ax, by + out * y + up * ay, bz + out * z + up * az)
            _put(unit, k, i, -sine * x - cosine * ax, -sine * y - cosine * ay, -sine * z - cosine * az)
            _put(side, k, i, ay * z - az * y, az * x - ax * z, ax * y - ay * x)
            numbers[0, k, i], numbers[1, k, i], numbers[2, k, i] = free, wrap, r * wrap + free
            numbers[3, k, i] = sine / rho if r > 0 else 1 / free


@compiled
def fill_jacobian(unit, lever, rows):
    """Fill rows (K, m, 6) with -[u ; lever x u]."""
    for k in range(unit.shape[0]):
        for i in range(unit.shape[1]):
            x, y, z = unit[k, i]
            a, b, c = lever[k, i]
            _put(rows, k, i, -x, -y, -z)
            rows[k, i, 3], rows[k, i, 4], rows[k, i, 5] = c * y - b * z, a * z - c * x, b * x - a * y
