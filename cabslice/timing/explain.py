"""What holds the motion back: the limit that is used most, at places spread evenly over the print time."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.delta import Delta, Machine
from cabslice.timing import limits as data
from cabslice.timing import rails
from cabslice.timing.limits import RESERVE, Limits, Nodes
from cabslice.timing.path import Path
from cabslice.timing.retime import Task, nodes_at, task_for
from cabslice.timing.trajectory import Trajectory
from cabslice.toolpath.path import Toolpath

PLACES = 20_000
USED = 0.85          # share of a limit from which on it counts as active
RAMP, REST = "between two limits", "rest between pieces"


def time_by_limit(
    trajectory: Trajectory, toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any
) -> dict[str, float]:
    """Limit -> share of the print time in which it is the active one, largest first; the shares add up to 1."""
    task = task_for(toolpath, robot, printer, material, process, "compiled")
    count = min(PLACES, max(int(trajectory.duration / 1e-3), 1))
    times = (np.arange(count) + 0.5) / count * trajectory.duration
    node = np.clip(np.searchsorted(trajectory.time, times, side="right") - 1, 0, len(trajectory.time) - 2)
    moving = (trajectory.move[node] == trajectory.move[node + 1]) | (trajectory.s[node + 1] > trajectory.s[node])
    moving &= ~np.isin(node, trajectory.pieces[1:] - 1) & (times > trajectory.time[0])
    names, shares = _shares(task, robot, trajectory, node[moving], times[moving])
    worst = np.argmax(shares, axis=0)
    active = np.where(shares[worst, np.arange(len(worst))] >= USED, worst, len(names))
    found = np.bincount(active, minlength=len(names) + 1) / count
    told = dict(zip([*names, RAMP], found.tolist(), strict=True)) | {REST: float(1 - moving.mean())}
    return {name: told[name] for name in sorted(told, key=lambda name: -told[name]) if told[name] > 0}


def _shares(task: Task, robot: Machine, trajectory: Trajectory, node: Array, times: Array) -> tuple[list[str], Array]:
    """Names (L) and the shares (L, K) that the plan uses of each limit at times (K,) in the intervals at node (K,)."""
    span, passed = trajectory.s[node + 1] - trajectory.s[node], times - trajectory.time[node]
    first, u = np.sqrt(trajectory.x[node]), (trajectory.x[node + 1] - trajectory.x[node]) / (2 * span)
    rate = np.maximum(first + u * passed, 0.0)
    into = np.clip(passed * (first + u * passed / 2), 0.0, span)
    move = trajectory.move[node]
    places = nodes_at(task, move, trajectory.s[node] + into - task.path.start[move])
    speeds = _speeds(task.toolpath, task.path, task.limits)
    found = {name: (rate / top[move]) ** 2 for name, top in speeds.items()}
    found |= {name: _used(block, u, rate**2) for name, block in _blocks(robot, places).items()}
    found["motor speed"] = rate**2 / _motors_top(robot, places)
    found["corner (corner_mm)"] = np.linalg.norm(places.d2, axis=1) * rate**2 / task.bend
    feeding = np.abs(places.feed * u) / task.limits.feed_acceleration
    found["filament acceleration (extruder.max_acceleration_mm_s2)"] = feeding / (1 - RESERVE)
    return list(found), np.stack(list(found.values()))


def _speeds(toolpath: Toolpath, path: Path, limits: Limits) -> dict[str, Array]:
    """Name -> (N,) mm/s, largest ds/dt."""
    travel, feed = path.direction.any(axis=1), np.maximum(np.abs(path.feed), 1e-12)
    flow = limits.flow / (feed * toolpath.filament_area_mm2)
    return {
        "speed asked for (process.speeds_mm_s)": toolpath.speed,
        "nozzle speed (motion.max_speed_mm_s)": np.where(travel, limits.speed, np.inf),
        "melt flow (max_flow_mm3_s)": np.where(travel, flow, np.inf),
        "filament speed (extruder.max_speed_mm_s)": np.where(travel, limits.laying_speed, limits.feed_speed) / feed,
    }


def _motors_top(robot: Machine, places: Nodes) -> Array:
    if isinstance(robot, Delta):
        return rails.speed_x(robot, places)
    return data.winder_speed_x(robot, places) if robot.winders else np.full(len(places.poses), np.inf)


def _blocks(robot: Machine, places: Nodes) -> dict[str, data.Block]:
    if isinstance(robot, Delta):
        return {
            "acceleration (motion.max_acceleration_mm_s2)": data.axes(places),
            "carriage acceleration (delta.max_acceleration_mm_s2)": rails.carriages(robot, places),
            "motor torque": rails.torque(robot, places),
        }
    return {
        "acceleration (motion.max_acceleration_mm_s2)": data.axes(places),
        "cable tension": data.tension(robot, places),
        "motor torque": data.winding(robot, places),
    }


def _used(block: data.Block, u: Array, x: Array) -> Array:
    a, b, low, high = block
    value = a * u + b * x
    share = np.where(value > 0, value / np.where(high > 0, high, np.inf), value / np.where(low < 0, low, -np.inf))
    return np.asarray(share.max(axis=0) / (1 - RESERVE))
