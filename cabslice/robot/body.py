"""The platform as a body: the convex hull of its attachments, and cables that would run through it.

Legend
    c_i    attachment, platform frame                  u_i    direction in which its cable leaves, platform frame
    n, d   facet of the hull: n . x <= d for its points, n outwards, of length 1

A line that starts on the surface of a convex body and leaves it never comes back, so cable i runs through the body if
and only if n . u_i < 0 for every facet that holds c_i. Attachments inside the hull (a frame with ears, a hollow
platform) are not judged, nor are platforms whose attachments lie on a line or in one point. Attachments in one plane
make a plate: only a cable in that plane can run through it.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot
from cabslice.robot.rotation import matrix

FLAT = 1e-6          # share of the platform's size below which it counts as flat, and a point as on a facet
GRAZING = 1e-6       # sine of the angle at which a cable may dip in: it lies on the surface


def outward(robot: Robot, poses: Array) -> Array:
    """Sine (K, m) of the angle at which each cable leaves the platform's hull; negative: it runs through the platform.

    nan for attachments that are not judged (see above).  Raises PoseError as kinematics.cables.
    """
    lines = cables(robot, poses)
    directions = np.einsum("kij,kmi->kmj", matrix(np.asarray(poses, float)[:, 3:]), lines.unit)
    span, across = _span(robot.attachments)
    sines = np.full(lines.free.shape, np.nan)
    if len(span) < 2:
        return sines
    normals, holds = _facets(robot.attachments @ span.T)
    for cable, facets in enumerate(holds.T):
        if facets.any():
            along = directions[:, cable] @ span.T
            aside = np.abs(directions[:, cable] @ across.T).max(axis=1, initial=0.0)
            sines[:, cable] = np.where(aside > GRAZING, aside, (along @ normals[facets].T).max(axis=1))
    return sines


def through(robot: Robot, poses: Array) -> Array:
    """Whether each cable runs through the platform, (K, m) bool. Raises PoseError as kinematics.cables."""
    return outward(robot, poses) < -GRAZING


def _span(points: Array) -> tuple[Array, Array]:
    """Orthonormal rows that span the differences of points (m, 3), and rows that span the rest."""
    _, size, rows = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)
    kept = np.zeros(3, bool)
    kept[:len(size)] = size > FLAT * max(float(size[0]), 1e-12)
    return rows[kept], rows[~kept]


def _facets(points: Array) -> tuple[Array, Array]:
    """Outward normals (F, n) of the hull of points (m, n), and which points lie on each facet, (F, m) bool."""
    from scipy.spatial import ConvexHull

    equations = ConvexHull(points).equations
    gap = equations[:, :-1] @ points.T + equations[:, -1:]
    return equations[:, :-1], np.abs(gap) < FLAT * np.ptp(points, axis=0).max()
