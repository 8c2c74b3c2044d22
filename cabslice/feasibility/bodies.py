"""Convex bodies: the platform and the print head, what stands around, and how near cables and prints come to them.

Legend
    body     corners (V, 3) mm of a convex body; of the platform seen from the nozzle tip, of what stands in bed
             coordinates; its faces are n . x <= d, n unit vectors outwards
    g(x)     max over the faces of n . x - d: never more than the distance of x to the body, equal to it over a face,
             and never changing by more than x moves; convex, so that its least value along a cable is found by sections
    axis     unit vector; two bodies are apart by at least their gap along any axis. Faces of both and crossed edges
             decide whether they are apart at all (separating axes; Gottschalk, Lin and Manocha 1996). The platform only
             shifts, so that a gap is linear in the place of the nozzle
    R, drift as in judges
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.exits import exit_drift, lines_at, tip_shift, turned_by
from cabslice.feasibility.survey import Judge
from cabslice.robot.model import Robot

SECTIONS = 48        # of the golden section along a cable: to 1e-9 of its length
GOLDEN = (np.sqrt(5) - 1) / 2
ALIKE = 1e-9
TURNS = 9            # ways a platform is turned along each axis, of which hulls are made


@dataclass(frozen=True)
class Body:
    name: str
    corners: Array       # (V, 3) mm
    normals: Array       # (F, 3)
    offsets: Array       # (F,) mm
    edges: Array         # (E, 3) unit vectors, each direction once
    pad: float = 0.0     # mm by which the body is larger on all sides


def body_of(name: str, corners: Array) -> Body:
    """The convex hull of at least four corners that are not in one plane. Raises ValueError where they are."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(corners)
    except (QhullError, ValueError) as error:
        raise ValueError(f"{name}: expected at least four corners that are not in one plane") from error
    planes = np.unique(np.round(hull.equations, 9), axis=0)
    ends = corners[np.vstack([hull.simplices[:, [i, (i + 1) % 3]] for i in range(3)])]
    edges = ends[:, 1] - ends[:, 0]
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    edges *= np.where(edges[:, [0]] < 0, -1.0, 1.0)
    return Body(name, corners[hull.vertices], planes[:, :3], -planes[:, 3], np.unique(np.round(edges, 9), axis=0))


def moving_bodies(robot: Robot) -> list[Body]:
    """What hangs on the cables, seen from the nozzle tip of a level platform."""
    return [body_of(name, corners - robot.nozzle) for name, corners in robot.bodies]


def swept_bodies(robot: Robot, low: Array, high: Array) -> list[Body]:
    """What hangs on the cables, seen from the nozzle tip, in every way the platform is turned with the nozzle in a box
    (corners (3,)): hulls of it turned in many of them, padded by what it can move between two of these."""
    bodies = moving_bodies(robot)
    if robot.turning is None or not bodies:
        return bodies
    knots = [np.unique(np.clip(np.linspace(a, b, TURNS if len(row) > 1 else 1), a, b)) for a, b, row in zip(
        low, high, (robot.turning.x, robot.turning.y, robot.turning.z), strict=True)]
    places = np.stack([column.ravel() for column in np.meshgrid(*knots, indexing="ij")], axis=1)
    half = np.array([np.diff(row).max(initial=0.0) / 2 if len(row) > 1 else 0.0 for row in knots])
    between = robot.turning.change(places - half, places, places + half).max()
    turns = np.unique(np.round(robot.turning.matrices(places), 12), axis=0)
    found = []
    for body in bodies:
        corners = np.einsum("kij,vj->kvi", turns, body.corners).reshape(-1, 3)
        reach = float(np.linalg.norm(body.corners, axis=1).max())
        found.append(replace(body_of(body.name, corners), pad=float(between) * reach + ALIKE))
    return found


def standing_bodies(robot: Robot) -> list[Body]:
    """What stands around, in bed coordinates."""
    return [body_of(name, corners - robot.bed_origin) for name, corners in robot.obstacles]


def cables_and(robot: Robot, bodies: list[Body], grow: Array, *, moving: bool) -> Judge:
    """Columns (m times the bodies): g along each cable less grow, mm.

    The first robot.body_free mm of a cable from the body it is fastened to are left out: from the attachment where the
    bodies move with the nozzle, from the pulley where they stand.
    """

    turning = robot.turning

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        lines = lines_at(robot, places)
        shift = places[:, None] if moving else np.zeros((1, 1, 3))
        near, far = (lines.tip, lines.exit) if moving else (lines.exit, lines.tip)
        near, far = near - robot.bed_origin - shift, far - robot.bed_origin - shift
        moved = tip_shift(robot, places, radii) + exit_drift(robot, places, radii)
        if moving and turning is not None:
            back = turning.matrices(places)                    # R: times a row, its transposed
            near, far = near @ back, far @ back
            seen = np.linalg.norm(far, axis=2) + radii[:, None]
            moved = moved + turned_by(robot, places, radii[:, None])[:, None] * seen
        way = far - near
        length = np.linalg.norm(way, axis=2)
        start = near + np.minimum(robot.body_free / np.maximum(length, 1e-9), 1.0)[..., None] * way
        gaps = [least_along(start, far, body) - grow for body in bodies]
        excess = np.concatenate(gaps, axis=1)
        return excess, excess - np.tile(moved, len(bodies))

    return judge


def least_along(start: Array, end: Array, body: Body) -> Array:
    """Least g (K, m) mm on segments (K, m, 3): golden section, g being convex; short of it by nothing that matters."""
    first, last = (np.einsum("kmi,fi->kmf", ends, body.normals) - body.offsets for ends in (start, end))

    def value(t: Array) -> Array:
        return np.asarray((first + t[..., None] * (last - first)).max(axis=2))

    low, high = np.zeros(first.shape[:2]), np.ones(first.shape[:2])
    for _ in range(SECTIONS):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        lower = value(left) < value(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return np.asarray(np.minimum.reduce((value((low + high) / 2), value(np.zeros_like(low)), value(np.ones_like(low)))))


def shifted_apart(moving: list[Body], standing: list[Body]) -> Judge:
    """Columns (moving times standing): the largest gap along an axis, mm; negative: they overlap."""
    tables = [_axes(one, other) for one in moving for other in standing]
    pads = np.array([one.pad + other.pad for one in moving for other in standing])

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        excess = np.stack([(places @ axes.T + gaps).max(axis=1) for axes, gaps in tables], axis=1) - pads
        return excess, excess - radii[:, None]

    return judge


def _axes(one: Body, other: Body) -> tuple[Array, Array]:
    """Axes (U, 3) and gaps (U,) mm with the nozzle at the origin: the moving body's least less the other's greatest."""
    crossed = np.cross(one.edges[:, None], other.edges).reshape(-1, 3)
    size = np.linalg.norm(crossed, axis=1)
    crossed = crossed[size > ALIKE] / size[size > ALIKE, None]
    axes = np.vstack((one.normals, other.normals, crossed))
    axes = np.vstack((axes, -axes))
    return axes, (one.corners @ axes.T).min(axis=0) - (other.corners @ axes.T).max(axis=0)


def plate(size: Array, thick: float, slope: Array | None = None) -> Body:
    """The bed plate, from `thick` mm below up to its surface, z = slope . (x, y)."""
    x, y = size / 2
    corners = np.array([[i * x, j * y, k] for i in (-1, 1) for j in (-1, 1) for k in (-thick, 0.0)])
    corners[:, 2] += corners[:, :2] @ (np.zeros(2) if slope is None else slope)
    return body_of("bed plate", corners)
