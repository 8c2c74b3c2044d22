"""Where the platform can be: maps over a grid of poses, reach along rays, and the print space of the thesis.

Legend (Gueners 2021, 3.3)
    grid   nodes x, y, z of the platform origin, one orientation: values are (X, Y, Z) arrays
    r, h   nozzle: distance from the vertical axis through the middle of the bed, height in the machine frame      mm
    rho    free radius of a pose: the widest cylinder about that axis, from the bed to h, that no cable crosses     mm

A *measure* is a function (robot, poses (K, 6)) -> (K,) that is nan or -inf where there is no answer; a pose belongs to
the workspace where the measure is at least a threshold. Poses that no cable can be led to count as outside, silently:
a grid asks everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.robot import clearance
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot
from cabslice.robot.nullspace import balance, blocks, elementary_vectors
from cabslice.robot.reach import margins
from cabslice.robot.stiffness import first_modes, gravity_stiffness, point_compliance, stiffness
from cabslice.robot.tension import nearest
from cabslice.robot.wrench import required_wrench, wrench_matrix

Measure = Callable[[Robot, Array], Array]

SWEEP = 8192         # poses asked at once: bounds the memory of a map of any size
ROUNDING = 1e-9      # share of the tension range that a margin may miss 0 by


@dataclass(frozen=True)
class Grid:
    """Nodes of a box, one orientation (rotation vector, rad); K = X Y Z of them in C order."""

    x: Array             # (X,) mm
    y: Array             # (Y,)
    z: Array             # (Z,)
    turn: Array          # (3,) rad

    def __post_init__(self) -> None:
        shape = Shapes("Grid")
        set_columns(self, x=shape.column("x", self.x, "X"), y=shape.column("y", self.y, "Y"),
                    z=shape.column("z", self.z, "Z"), turn=shape.column("turn", self.turn, "3"))

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self.x), len(self.y), len(self.z)

    def poses(self, part: slice = slice(None)) -> Array:
        """Poses (K, 6) of the nodes in C order, or of a slice of them."""
        numbers = np.arange(np.prod(self.shape))[part]
        i, j, k = np.unravel_index(numbers, self.shape)
        return np.column_stack((self.x[i], self.y[j], self.z[k], np.broadcast_to(self.turn, (len(numbers), 3))))


@dataclass(frozen=True)
class Workspace:
    """A measure on a grid, and the nodes where it is at least the threshold."""

    grid: Grid
    value: Array         # (X, Y, Z), unit of the measure
    inside: Array        # (X, Y, Z) bool
    threshold: float

    @property
    def fraction(self) -> float:
        """Share of the nodes that are inside."""
        return float(self.inside.mean())


@dataclass(frozen=True)
class PrintSpace:
    """Where the nozzle may be over an idealised part, and the biggest part. Nozzle in the machine frame."""

    grid: Grid               # of the nozzle
    free_radius: Array       # (X, Y, Z) mm, rho; 0 where the pose is not feasible
    inside: Array            # (X, Y, Z) bool: rho >= r, the union over R of all poses free of collision
    volume: float            # mm^3 of the union: nodes inside, each with its cell
    cylinder_radius: float   # mm, of the largest single cylinder
    cylinder_height: float   # mm, from the bed

    @property
    def cylinder_volume(self) -> float:
        return float(np.pi * self.cylinder_radius**2 * self.cylinder_height)


def frame_grid(robot: Robot, *, count: int | None = None, step: float | None = None, turn: Array | None = None) -> Grid:
    """Nodes over the box of the anchors, faces included: `count` a side, or about `step` mm apart.

    Raises ValueError unless exactly one of count and step is given.
    """
    if (count is None) == (step is None):
        raise ValueError("expected either count or step")
    low, high = robot.anchors.min(axis=0), robot.anchors.max(axis=0)

    def axis(start: float, end: float) -> Array:
        nodes = count if count is not None else round((end - start) / (step or 1.0)) + 1
        return np.linspace(start, end, nodes if end > start else 1)

    x, y, z = (axis(*ends) for ends in zip(low, high, strict=True))
    return Grid(x, y, z, turn=np.zeros(3) if turn is None else turn)


def survey(robot: Robot, grid: Grid, measure: Measure, *, threshold: float = 0.0) -> Workspace:
    """The measure at every node of the grid."""
    value = np.empty(int(np.prod(grid.shape)))
    for part in blocks(len(value), SWEEP):
        value[part] = measure(robot, grid.poses(part))
    value = value.reshape(grid.shape)
    return Workspace(grid, value, value >= threshold, threshold)


def feasible_margin(robot: Robot, poses: Array) -> Array:
    """Wrench-feasible workspace: margin (K,) N of the tensions that carry the platform's own weight; see reach.margins.

    Rounding counts as feasible: poses that need a tension exactly at its bound are inside.
    """
    wrench = wrench_matrix(robot, poses, masked=True, lines=cables(robot, poses, refuse=False))
    needed = required_wrench(robot, poses, masked=True)
    margin = margins(wrench, needed, robot.tension_min, robot.tension_max)
    return np.where(np.abs(margin) < ROUNDING * np.max(robot.tension_max - robot.tension_min), 0.0, margin)


def closure(robot: Robot, poses: Array) -> Array:
    """Wrench-closure workspace: > 0 (K,) where tensions without upper bound supply every wrench, 0 on its border.

    By Stiemke's theorem some t > 0 has W t = 0 if and only if no row combination mu of W is >= 0 but not 0; elementary
    vectors suffice. The measure is the smaller sign's share of the most one-sided mu: between 0 and 1/2.
    """
    wrench = wrench_matrix(robot, poses, masked=True, lines=cables(robot, poses, refuse=False))
    out = np.empty(len(poses))
    for part in blocks(len(poses)):
        state = balance(wrench[part])
        weights = np.array(elementary_vectors(state.null)[1])
        whole = np.abs(weights).sum(axis=0)
        lesser = np.minimum(np.maximum(weights, 0).sum(axis=0), np.maximum(-weights, 0).sum(axis=0))
        share = np.where(whole > ROUNDING, lesser / np.where(whole > ROUNDING, whole, 1.0), np.inf)
        out[part] = np.where(state.regular, share.min(axis=0, initial=0.5), -np.inf)
    return np.where(np.abs(out) < ROUNDING, 0.0, out)


def first_mode(robot: Robot, poses: Array) -> Array:
    """First natural frequency (K,) Hz under the nearest feasible tensions that carry the weight; nan where none are."""
    return _with_tension(robot, poses, first_modes)


def nozzle_stiffness(robot: Robot, poses: Array) -> Array:
    """Static stiffness (K,) N/mm of the nozzle (else the origin) in its softest direction; nan where infeasible."""
    def softest(robot: Robot, poses: Array, tension: Array) -> Array:
        whole = stiffness(robot, poses, tension).total + gravity_stiffness(robot, poses)
        return 1 / np.linalg.eigvalsh(point_compliance(robot, poses, whole))[:, -1]

    return _with_tension(robot, poses, softest)


def least_gap(robot: Robot, poses: Array) -> Array:
    """Interference: air (K,) mm between the two nearest cables; inf where none can meet. See clearance.cable_gaps."""
    lines = cables(robot, poses, refuse=False)
    return clearance.cable_gaps(robot, poses, lines=lines).min(axis=1, initial=np.inf)


MEASURES: dict[str, Measure] = {
    "wrench-feasible": feasible_margin, "wrench-closure": closure, "first-mode": first_mode,
    "stiffness": nozzle_stiffness, "cable-gap": least_gap,
}


def along_rays(
    robot: Robot, start: Array, directions: Array, measure: Measure, *, threshold: float = 0.0, far: float,
    step: float = 20.0, accuracy: float = 0.01
) -> Array:
    """How far (K,) mm the platform can go from `start` (6,) along unit directions (K, 3) and stay inside.

    Marches by `step` mm to the first node outside, then halves down to `accuracy` mm; `far` where none is outside. A
    hole thinner than a step may be missed. 0 where start itself is outside.
    """
    directions = np.asarray(directions, dtype=float)

    def inside(distance: Array) -> Array:
        poses = np.tile(np.asarray(start, dtype=float), (len(directions), 1))
        poses[:, :3] += distance[:, None] * directions
        return measure(robot, poses) >= threshold

    low, high = np.zeros(len(directions)), np.full(len(directions), np.inf)
    for distance in np.append(np.arange(0.0, far, step), far):
        out = np.isinf(high) & ~inside(np.full(len(directions), distance))
        high[out] = distance
        low[np.isinf(high)] = distance
    bounded = np.isfinite(high)
    high = np.where(bounded, high, low)
    while (high - low).max(initial=0.0) > accuracy:
        middle = (low + high) / 2
        here = inside(middle)
        low, high = np.where(here, middle, low), np.where(here, high, middle)
    return low


def free_radius(robot: Robot, poses: Array) -> Array:
    """rho (K,) mm: how far the cables keep from the bed's vertical axis between the bed and the nozzle; inf where none
    passes there. Raises ValueError for a robot without bed or nozzle. Source: Gueners 2021, 3.3.
    """
    bed, nozzle = _tools(robot)
    lines = cables(robot, poses, refuse=False)
    top = poses[:, 2, None] + nozzle[2]
    start, way = lines.exit - bed, lines.tip - lines.exit
    rise = np.where(np.abs(way[..., 2]) < 1e-9, 1e-9, way[..., 2])
    ends = -start[..., 2] / rise, (top - bed[2] - start[..., 2]) / rise
    first, last = np.maximum(np.minimum(*ends), 0.0), np.minimum(np.maximum(*ends), 1.0)
    flat = way[..., :2]
    square = np.maximum(np.einsum("kmi,kmi->km", flat, flat), np.finfo(float).tiny)
    foot = -np.einsum("kmi,kmi->km", start[..., :2], flat) / square
    share = np.minimum(np.maximum(foot, first), last)
    passing = start[..., :2] + share[..., None] * flat
    distance = np.where(first <= last, np.hypot(passing[..., 0], passing[..., 1]), np.inf)
    return distance.min(axis=1)


def print_space(
    robot: Robot, *, step: float = 20.0, mask: Measure = feasible_margin, threshold: float = 0.0
) -> PrintSpace:
    """The thesis' print space: nozzle positions at which no cable touches an idealised part, a cylinder.

    Nozzle nodes `step` mm apart over the box of the anchors, from the bed up. A pose with the nozzle at radius r is
    free if rho >= r (the part need only be as wide as r) and the mask measure is at least the threshold: their union
    is `inside`. A cylinder (R, H) is free if every pose with r <= R and h <= H has rho >= R: the largest is reported
    too. Both are exact at the nodes only. Source: Gueners 2021, 3.3, table 5.5.
    """
    bed, nozzle = _tools(robot)
    frame = frame_grid(robot, step=step)
    grid = Grid(frame.x, frame.y, np.arange(bed[2], frame.z[-1] + step / 2, step), turn=np.zeros(3))

    def rho(robot: Robot, poses: Array) -> Array:
        poses = poses - np.append(nozzle, np.zeros(3))
        return np.where(mask(robot, poses) >= threshold, free_radius(robot, poses), 0.0)

    free = survey(robot, grid, rho).value
    apart = np.hypot(grid.x[:, None] - bed[0], grid.y - bed[1])
    inside = (free >= apart[..., None]) & (free > 0)
    cell = [np.diff(axis).mean() for axis in (grid.x, grid.y, grid.z)]
    radius, height = _largest_cylinder(apart, free, grid.z - bed[2])
    return PrintSpace(grid, free, inside, float(inside.sum() * np.prod(cell)), radius, height)


def _largest_cylinder(apart: Array, free: Array, heights: Array) -> tuple[float, float]:
    """Radius and height of the largest cylinder free at all nodes: apart (X, Y), free (X, Y, Z), heights (Z,)."""
    radii, ring = np.unique(apart, return_inverse=True)
    least = np.full((len(radii), len(heights)), np.inf)
    np.minimum.at(least, ring.ravel(), free.reshape(-1, len(heights)))
    least = np.minimum.accumulate(least, axis=0)
    widest = np.where(least >= radii[:, None], radii[:, None], 0.0).max(axis=0)
    widest = np.minimum.accumulate(widest)
    best = int(np.argmax(widest**2 * heights))
    return float(widest[best]), float(heights[best])


def _with_tension(robot: Robot, poses: Array, measure: Callable[[Robot, Array, Array], Array]) -> Array:
    """A measure that needs tensions, at the poses that have them; nan elsewhere."""
    out = np.full(len(poses), np.nan)
    wrench = wrench_matrix(robot, poses, masked=True, lines=cables(robot, poses, refuse=False))
    held = nearest(wrench, required_wrench(robot, poses, masked=True),
                   robot.tension_min, robot.tension_max, robot.tension_reference)
    if held.feasible.any():
        out[held.feasible] = measure(robot, poses[held.feasible], held.tension[held.feasible])
    return out


def _tools(robot: Robot) -> tuple[Array, Array]:
    if robot.bed_origin is None or robot.nozzle is None:
        raise ValueError("the print space needs a robot with a nozzle and a bed")
    return robot.bed_origin, robot.nozzle
