"""The robot as a page draws it: frame, pulleys, cables, platform, nozzle, bed; in bed coordinates, mm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.model import Robot

PLACES = 4     # decimals, mm


def machine(robot: Robot) -> dict[str, Any]:
    """JSON values. `nozzle` counts from the platform origin: origin = nozzle place - nozzle."""
    shift, nozzle = bed_of(robot), np.zeros(3) if robot.nozzle is None else robot.nozzle
    return {
        "name": robot.name, "anchors": _plain(robot.anchors - shift), "axes": _plain(robot.pulley_axes),
        "pulleys": _plain(robot.pulley_radii), "attachments": _plain(robot.attachments),
        "cables": _plain(robot.cable_radii), "nozzle": _plain(nozzle), "tip": robot.nozzle is not None,
        "home": _plain(robot.home[:3] - shift + nozzle), "frame": _plain(_frame(robot) - shift),
        "bed": None if robot.bed_size is None or robot.bed_origin is None else _plain(robot.bed_size),
        "hull": hull(np.vstack((robot.attachments, np.zeros((1, 3))))), "winders": _winders(robot, shift),
    }


def bed_of(robot: Robot) -> Array:
    """The middle of the bed (3,) mm in the machine frame; of a robot without bed, the machine's origin."""
    return np.zeros(3) if robot.bed_origin is None else robot.bed_origin


def hull(points: Array) -> Mapping[str, Any]:
    """Corners (n, 3) and triangles (f, 3) of the convex hull; no triangles where the points lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except QhullError:
        return {"points": _plain(points), "faces": []}
    ahead = np.einsum("fi,fi->f", _normals(points, found.simplices), found.equations[:, :3]) > 0
    faces = np.where(ahead[:, None], found.simplices, found.simplices[:, ::-1])
    return {"points": _plain(points), "faces": faces.tolist()}


def _normals(points: Array, faces: Array) -> Array:
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def _frame(robot: Robot) -> Array:
    """Two corners (2, 3) of the box of anchors, home and bed."""
    seen = [robot.anchors, robot.home[None, :3]] + ([] if robot.bed_origin is None else [robot.bed_origin[None]])
    every = np.vstack(seen)
    return np.array([every.min(axis=0), every.max(axis=0)])


def _winders(robot: Robot, shift: Array) -> list[dict[str, Any]]:
    """Discs whose centre is known: centre, radius, normal, and the line from disc to pulley."""
    from cabslice.robot import winder
    from cabslice.robot.winder_line import touch_points

    if robot.winders is None:
        return []
    radii = winder.radius(robot.winders, robot.winders.home_angle[None])
    try:
        disc, pulley = (place[0] - shift for place in touch_points(robot, radii))
    except PoseError:
        return []
    centre = robot.winders.centre - shift
    return [
        {"centre": _plain(centre[i]), "radius": float(radii[0, i]), "from": _plain(disc[i]), "to": _plain(pulley[i])}
        for i in range(robot.cables) if np.isfinite(centre[i]).all() and np.isfinite(disc[i]).all()
    ]


def _plain(values: Array) -> Any:
    return np.round(np.asarray(values, float), PLACES).tolist()
