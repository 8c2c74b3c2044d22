"""What a robot is at the places a nozzle can go: columns on nodes over the bed, slab by slab."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.exits import lines_at, offsets
from cabslice.feasibility.judges import ends_over_bed, judged_pairs, pair_limits, pulleys
from cabslice.robot.clearance import closest, share_an_end
from cabslice.robot.model import Robot, nozzle_poses

NODES = 17           # along x, y and z
NEVER = -1e6
MEASURES = ("tension_n", "air_mm", "first_mode_hz")


@dataclass(frozen=True)
class Field:
    """Nodes low + step (i, j), i < C, j < R, with the nozzle at the top of slab k < L; bed coordinates, mm."""

    robot: Robot
    grow: Array          # (m,) mm, what centre lines of cables must keep from anything
    dz: float
    low: Array           # (2,)
    step: Array          # (2,)
    exits: Array         # (L, R, C, m, 3) mm
    offsets: Array       # (m, 3) mm
    values: Array        # (F, L, R, C): MEASURES, the last one only where it was asked for
    slopes: Array        # (F,) the most a value was seen to change per mm of shift


def field_of(robot: Robot, grow: Array, slabs: int, dz: float, *, modes: bool = False) -> Field:
    """tension_n: margin of the weight's tensions; air_mm: beside cables, pulleys and bed; first_mode_hz, if `modes`."""
    assert robot.bed_size is not None
    half = robot.bed_size / 2
    axes = [np.linspace(-side, side, NODES) for side in half]
    tops = dz * np.arange(1, slabs + 1)
    heights = np.linspace(tops[0], tops[-1], min(NODES, slabs))
    z, y, x = (column.ravel() for column in np.meshgrid(heights, axes[1], axes[0], indexing="ij"))
    places = np.stack((x, y, z), axis=1)
    exits = lines_at(robot, places).exit - robot.bed_origin
    exits = np.where(np.isfinite(exits), exits, robot.anchors - robot.bed_origin)
    values = np.stack([_finite(column) for column in _measured(robot, grow, places, modes)])
    shape = len(heights), NODES, NODES
    values = _between(values.reshape(len(values), *shape), heights, tops, 1)
    step = 2 * half / (NODES - 1)
    slopes = np.max([np.abs(np.diff(values, axis=axis)).reshape(len(values), -1).max(axis=1) / step[3 - axis]
                     for axis in (2, 3)], axis=0)
    exits = _between(exits.reshape(*shape, robot.cables, 3), heights, tops, 0)
    return Field(robot, grow, dz, -half, step, np.ascontiguousarray(exits), offsets(robot),
                 np.ascontiguousarray(values), slopes)


def _finite(column: Array) -> Array:
    return np.clip(np.nan_to_num(column, nan=NEVER, posinf=-NEVER, neginf=NEVER), NEVER, -NEVER)


def _measured(robot: Robot, grow: Array, places: Array, modes: bool) -> list[Array]:
    from cabslice.robot.held import first_mode
    from cabslice.robot.workspace import feasible_margin

    poses, still = nozzle_poses(robot, places), np.zeros(len(places))
    air = [ends_over_bed(robot, grow)(places, still)[0], pulleys(robot)(places, still)[0]]
    if len(judged_pairs(robot)):
        lines = lines_at(robot, places)
        air.append(closest(robot, poses, lines=lines).distance[:, ~share_an_end(robot)] - pair_limits(robot))
    found = [feasible_margin(robot, poses), np.concatenate(air, axis=1).min(axis=1)]
    return [*found, first_mode()(robot, poses)] if modes else found


def _between(values: Array, heights: Array, tops: Array, axis: int) -> Array:
    """Linear between the heights that were worked out."""
    if len(heights) == len(tops):
        return values
    place = np.clip(np.searchsorted(heights, tops) - 1, 0, len(heights) - 2)
    share = (tops - heights[place]) / np.diff(heights)[place]
    share = share.reshape([-1 if i == axis else 1 for i in range(values.ndim)])
    return np.asarray((1 - share) * values.take(place, axis) + share * values.take(place + 1, axis))
