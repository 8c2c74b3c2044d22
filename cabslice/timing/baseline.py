"""What printer firmware does, to compare with: trapezoids at one acceleration that is safe everywhere over the bed.

Legend
    a0      the largest acceleration, in any level direction, that no cable and no motor forbids anywhere in the
            printable volume; it steps, so motors take up what the cables stretch between -a0 and a0 within T
    d       junction deviation: v^2 = a0 d sin / (1 - sin) of half the inner angle (Jeon 2011)
    T       what the audit takes central differences over: two of its steps, s

Three of them. Two turn their corners by junction deviation whatever step of velocity that is: d the corner tolerance,
and what Klipper takes as it is shipped, v = 5 mm/s in a right angle (square_corner_velocity). The last halves a0
between ramps and corners (a step of velocity is an acceleration within T / 2): the sum of both is safe everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ProfileError
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.kinematics import jacobian
from cabslice.robot.model import Robot, level_shift, nozzle_poses, turned
from cabslice.robot.usable import stretch
from cabslice.timing.audit import STEP_S, audit
from cabslice.timing.layers import dwells, paced
from cabslice.timing.limits import RESERVE, Limits, Nodes, limits_of, speed_limit, tension, winding_caps
from cabslice.timing.path import Path, smooth
from cabslice.timing.trajectory import Trajectory, times_between
from cabslice.toolpath.path import Toolpath

HALF = 0.5 * (1 - 1e-6)
ACROSS, UP = 13, 6      # places across the bed, and heights up to the bed's smaller side
DIRECTIONS = 24         # level, over half a turn
KLIPPER = 5.0           # mm/s in right angles
BASELINES: dict[str, dict[str, Any]] = {
    "one safe acceleration, corners by junction deviation": {},
    "one safe acceleration, corners as Klipper is shipped": {"right_angle_mm_s": KLIPPER},
    "one safe acceleration and corner step": {"safe": True},
}


@dataclass(frozen=True)
class Baseline:
    acceleration: float      # mm/s^2
    step: float              # mm/s, largest step of velocity in a corner
    trajectory: Trajectory   # of the polyline itself, corners turned at speed


def safe_acceleration(robot: Robot, limits: Limits) -> float:
    """a0, mm/s^2: over the bed up to as high as the bed is wide, in any level direction, the planner's reserve kept."""
    if robot.bed_size is None:
        raise ValueError("the robot has no bed")
    (x, y), height = robot.bed_size / 2, float(min(robot.bed_size))
    sides = np.linspace(-x, x, ACROSS), np.linspace(-y, y, ACROSS), np.linspace(0, height, UP)
    xyz = np.stack([column.ravel() for column in np.meshgrid(*sides, indexing="ij")], axis=1)
    poses, still, one = nozzle_poses(robot, xyz), np.zeros((len(xyz), 6)), np.zeros((2, len(xyz), 6))
    one[0, :, 0] = one[1, :, 1] = 1.0
    free = np.full(len(xyz), np.inf)
    blocks = [tension(robot, Nodes(poses, along, still, np.zeros(len(xyz)), free)) for along in one]
    slope = np.hypot(blocks[0][0], blocks[1][0])
    room = np.maximum(np.minimum(blocks[0][3], -blocks[0][2]), 0.0) * (1 - RESERVE)
    most = (room / np.maximum(slope, 1e-300)).min()
    return float(min(most, _steps_taken_up(robot, limits, poses), limits.acceleration))


def _steps_taken_up(robot: Robot, limits: Limits, poses: Array) -> float:
    """mm/s^2: a step from as much forwards to as much backwards, at the machine's speed, is taken up within T."""
    turns = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    along = np.stack((np.cos(turns), np.sin(turns)))
    fastest = winding_caps(robot)[1][:, None]
    running = np.abs(jacobian(robot, poses)[:, :, :2] @ along) * limits.speed
    return float((np.maximum(fastest - running, 0.0) / np.abs(stretch(robot, poses) @ along)).min() * STEP_S)


def firmware(
    toolpath: Toolpath, robot: Robot, printer: Any, material: Any, process: Any, *, safe: bool = False,
    right_angle_mm_s: float | None = None,
) -> Baseline:
    """The print at one acceleration that is safe everywhere; `safe`: its corners too, not its ramps alone. Corners by
    the corner tolerance, or so that right angles are turned at right_angle_mm_s."""
    limits = limits_of(printer, material)
    accel, path = safe_acceleration(robot, limits) * (HALF if safe else 1.0), smooth(toolpath, 1e-9)
    path = replace(path, half=np.zeros(len(path.half)))
    top, still = speed_limit(toolpath, path, limits), ~path.direction.any(axis=1)
    each = np.where(still, limits.feed_acceleration, accel)
    deviation = right_angle_mm_s**2 * (np.sqrt(2) - 1) / accel if right_angle_mm_s else process.corner_mm
    corner = _corners(path, toolpath, accel, deviation, top)
    if safe:
        corner = np.minimum(corner, accel * STEP_S / np.maximum(path.turn, 1e-12))
    corner[toolpath.starts - 1] = 0.0
    rows = np.flatnonzero(path.length[1:] > 0) + 1
    entry, leave = look_ahead(path.length[rows], corner[path.before[rows]], corner[rows], each[rows])
    trajectory = _trajectory(robot, toolpath, path, rows, entry, leave, top[rows], each[rows])
    return Baseline(accel, float((path.turn[rows] * leave).max(initial=0.0)), paced(trajectory, toolpath))


def _corners(path: Path, toolpath: Toolpath, accel: float, deviation_mm: float, top: Array) -> Array:
    """(N,) mm/s at the vertex that ends each move, by junction deviation."""
    cosine = np.clip(-(path.direction * path.direction[path.after]).sum(axis=1), -1, 1)
    half = np.sqrt((1 - cosine) / 2)                                      # sine of half the inner angle
    speed = np.sqrt(accel * deviation_mm * half / np.maximum(1 - half, 1e-12))
    return np.minimum(speed, np.minimum(top, top[path.after]))


def look_ahead(length: Array, before: Array, after: Array, accel: Array) -> tuple[Array, Array]:
    """Speeds (K,) mm/s at which moves are entered and left, at most before and after (K,), at accel (K,) mm/s^2."""
    most, gain = [float(value) for value in (*before, after[-1])], (2 * accel * length).tolist()
    for k in range(len(gain) - 1, -1, -1):
        most[k] = min(most[k], (most[k + 1] ** 2 + gain[k]) ** 0.5)
    for k in range(len(gain)):
        most[k + 1] = min(most[k + 1], (most[k] ** 2 + gain[k]) ** 0.5)
    return np.array(most[:-1]), np.array(most[1:])


def _trajectory(
    robot: Robot, toolpath: Toolpath, path: Path, rows: Array, entry: Array, leave: Array, top: Array, accel: Array
) -> Trajectory:
    length = path.length[rows]
    peak = np.minimum(top**2, accel * length + (entry**2 + leave**2) / 2)
    peak = np.maximum(peak, np.maximum(entry, leave) ** 2)
    rising, falling = (peak - entry**2) / (2 * accel), (peak - leave**2) / (2 * accel)
    ends = np.stack((np.zeros(len(rows)), np.minimum(rising, length), np.maximum(length - falling, 0.0)), axis=1)
    keep = np.diff(ends, axis=1, append=length[:, None]) > 1e-9 * length[:, None]
    squares = np.stack((entry**2, peak, peak), axis=1)
    move = np.repeat(rows, 3).reshape(keep.shape)
    start, square, move = (ends + path.start[rows][:, None])[keep], squares[keep], move[keep]
    first: Array = np.searchsorted(move, toolpath.starts)                 # interval that each piece starts with
    last = move[first[1:] - 1]
    nodes = first[:-1] + np.arange(len(first) - 1)
    s: Array = np.insert(start, first[1:], path.start[last] + path.length[last])
    x, row = np.insert(square, first[1:], 0.0), np.insert(move, first[1:], last)
    pieces = np.append(nodes, len(s))
    spent: Array = np.zeros(len(s))
    with np.errstate(divide="ignore", invalid="ignore"):
        spent[1:] = times_between(s, x)
    spent[nodes] = dwells(toolpath)
    return Trajectory(path, np.cumsum(spent), s, x, row, pieces, level_shift(robot), 0.0, *turned(robot))


def compared(
    duration_s: float, toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any, *, jobs: int = 1
) -> list[dict[str, Any]]:
    """The baselines beside a plan of duration_s: acceleration, largest step in a corner, time, time over that of the
    plan, and what the audit of the plan finds in them: share of the limit by code.

    Raises ProfileError where there are no cables.
    """
    if isinstance(robot, Delta):
        raise ProfileError(robot.name, ["what is compared with is safe for cables: expected a printer that has them"])
    given, rows = (toolpath, robot, printer, material, process), []
    for name, options in BASELINES.items():
        found = firmware(*given, **options)
        verdict = audit(found.trajectory, *given, jobs=jobs)
        rows.append({
            "name": name, "acceleration_mm_s2": found.acceleration, "corner_step_mm_s": found.step,
            "duration_s": found.trajectory.duration, "times_ours": found.trajectory.duration / duration_s,
            "broken": {finding.code: verdict.margins[f"{finding.code.replace('-', '_')}_share"]
                       for finding in verdict.findings},
        })
    return rows


def unhindered(toolpath: Toolpath, robot: Robot, printer: Any, material: Any) -> float:
    """s the print takes at the speeds asked for, melt flow and filament speed kept, were acceleration free: no plan
    is faster on this toolpath."""
    path = smooth(toolpath, 1e-9)
    rows = np.flatnonzero(path.length > 0)
    speed = speed_limit(toolpath, path, limits_of(printer, material))[rows]
    return float((path.length[rows] / speed).sum() + dwells(toolpath).sum())
