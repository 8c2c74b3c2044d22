"""What the moves of a plan or a motor file do: speed, acceleration, tensions and motor speeds, the worst of each move.

Legend
    samples  times spread evenly over the motion (every row of the motor file, where there are not too many), and the
             end of every move
    t_r      reference tension of a cable; of its tensions during a move the one farthest from it is told
    margin   how far the tensions of a sample stay inside their bounds, least over the cables, N
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, PoseError
from cabslice.motors.stream import MotorStream, make_stream, row_count
from cabslice.robot import kinematics, tension, winder, wrench
from cabslice.robot.forward import forward
from cabslice.robot.model import Robot
from cabslice.robot.rotation import matrix
from cabslice.slicing.layer import Role
from cabslice.timing.trajectory import Samples, Trajectory, sample
from cabslice.toolpath.path import Toolpath
from cabslice.view.scene import FAR, HIGH, LOW, Field, Moves, path_fields

SPREAD = 100_000     # samples besides those of the moves, at most
BLOCK = 1 << 16
PLACES = 120_000     # of a motor file, at most: each needs forward kinematics
SAME_MM = 0.02       # heights nearer than this are one layer
STILL_MM = 1e-3      # what forward kinematics can tell from standing still
FED = 1e-3           # mm of filament per mm of way from which something is laid


def of_plan(trajectory: Trajectory, path: Toolpath, robot: Robot, period_s: float) -> Moves:
    """The moves of the path with what the planned motion does in them."""
    end = move_ends(trajectory, len(path.xyz))
    times = _times(trajectory, end, period_s)
    columns = _sampled(trajectory, robot, times)
    first = np.searchsorted(times, np.concatenate(([0.0], end[:-1])))
    last = np.maximum(np.searchsorted(times, end, side="right"), first + 1)
    spans = np.stack((np.minimum(first, len(times) - 1), last), axis=1).ravel()
    fields = [*_motion_fields(columns, spans), *_tension_fields(robot, columns["tension"], spans)]
    fields += _motor_fields(_motor_speeds(trajectory, robot, end, period_s))
    rest = [one for one in path_fields(path, end) if one.key != "asked_mm_s"]
    return Moves(path.xyz, path.role, path.layer, path.width, path.height, end, "planned", (*fields, *rest))


def move_ends(trajectory: Trajectory, count: int) -> Array:
    """(count,) s at which each move of the toolpath ends."""
    nodes = np.searchsorted(trajectory.move, np.arange(count), side="right")
    end = trajectory.time[np.clip(nodes, 0, len(trajectory.time) - 1)]
    last = np.zeros(count, np.bool_)
    last[trajectory.move[trajectory.pieces[1:] - 1]] = True          # those end before the rest that follows the piece
    end = np.where(last, trajectory.time[np.clip(nodes - 1, 0, None)], end)
    return np.maximum.accumulate(np.where(np.arange(count) == 0, 0.0, end))


def _times(trajectory: Trajectory, end: Array, period_s: float) -> Array:
    step = max(period_s, trajectory.duration / SPREAD)
    return np.unique(np.concatenate((np.arange(0.0, trajectory.duration, step), end)))


def _sampled(trajectory: Trajectory, robot: Robot, times: Array) -> dict[str, Array]:
    """Speed mm/s and acceleration mm/s^2 (K,), tensions (K, m) N at times (K,)."""
    kept: list[tuple[Array, Array, Array]] = []
    for start in range(0, len(times), BLOCK):
        found = sample(trajectory, times[start:start + BLOCK])
        speed, acceleration = (np.linalg.norm(rate[:, :3], axis=1) for rate in (found.rates, found.accels))
        kept.append((speed, acceleration, planned(robot, found)[1]))
    names = ("speed", "acceleration", "tension")
    return {name: np.concatenate(column) for name, column in zip(names, zip(*kept, strict=True), strict=True)}


def planned(robot: Robot, found: Samples) -> tuple[Array, Array]:
    """Cable lengths (K, m) mm and planned tensions (K, m) N of samples; the reference where there are none."""
    lines = kinematics.cables(robot, found.poses)
    matrix = wrench.wrench_matrix(robot, found.poses, masked=True, lines=lines)
    required = wrench.required_wrench(robot, found.poses, found.rates, found.accels, masked=True)
    bounds = robot.tension_min, robot.tension_max, robot.tension_reference
    planned = tension.unmeasured(matrix, required, *bounds).tension
    return lines.length, np.where(np.isfinite(planned), planned, robot.tension_reference)


def _motion_fields(columns: dict[str, Array], spans: Array) -> Iterator[Field]:
    yield Field("speed_mm_s", "speed", "mm/s", _over(np.maximum, columns["speed"], spans))
    yield Field("acceleration_mm_s2", "acceleration", "mm/s²", _over(np.maximum, columns["acceleration"], spans))


def _tension_fields(robot: Robot, tensions: Array, spans: Array) -> Iterator[Field]:
    inside = np.minimum(tensions - robot.tension_min, robot.tension_max - tensions).min(axis=1)
    yield Field("margin_n", "tension margin", "N", _over(np.minimum, inside, spans), LOW)
    yield Field("max_tension_n", "highest tension", "N", _over(np.maximum, tensions.max(axis=1), spans))
    yield Field("min_tension_n", "lowest tension", "N", _over(np.minimum, tensions.min(axis=1), spans), LOW)
    for i in range(robot.cables):
        high, low = (_over(reduce, tensions[:, i], spans) for reduce in (np.maximum, np.minimum))
        middle = robot.tension_reference[i]
        value = np.where(high - middle >= middle - low, high, low)
        yield Field(f"tension_{i + 1}_n", f"tension of cable {i + 1}", "N", value, FAR, i + 1)


def _motor_fields(speeds: Array | None) -> Iterator[Field]:
    if speeds is None:
        return
    yield Field("motor_rad_s", "fastest motor", "rad/s", speeds.max(axis=1))
    for i in range(speeds.shape[1]):
        yield Field(f"motor_{i + 1}_rad_s", f"speed of motor {i + 1}", "rad/s", speeds[:, i], HIGH, i + 1)


def _over(reduce: np.ufunc, column: Array, spans: Array) -> Array:
    """`column` (K, ...) reduced over [spans[2k], spans[2k + 1])."""
    return reduce.reduceat(np.append(column, column[-1:], axis=0), spans, axis=0)[::2]


def _motor_speeds(trajectory: Trajectory, robot: Robot, end: Array, period_s: float) -> Array | None:
    """(N, m) rad/s of each move: the highest of all rows of the motor file, or of a longer motion what the middle of
    each move has."""
    if robot.winders is None:
        return None
    begin = np.concatenate(([0.0], end[:-1]))
    count = row_count(trajectory.duration, period_s)
    try:
        if count > SPREAD:
            ahead, behind = (_angles(trajectory, robot, (begin + end) / 2 + shift) for shift in (period_s, -period_s))
            return np.abs(ahead - behind) / (2 * period_s)
        stream = make_stream(trajectory, robot, period_s=period_s, header={})
        speed = np.abs(np.concatenate([block.velocity for block in stream]))
    except (PoseError, ImpossibleError):
        return None
    first = np.minimum(np.searchsorted(np.arange(count) * period_s, begin), count - 1)
    last = np.maximum(np.minimum((end / period_s).astype(np.int64) + 1, count), first + 1)
    return _over(np.maximum, speed, np.stack((first, last), axis=1).ravel())


def _angles(trajectory: Trajectory, robot: Robot, times: Array) -> Array:
    found = []
    for start in range(0, len(times), BLOCK):
        at = np.clip(times[start:start + BLOCK], 0.0, trajectory.duration)
        found.append(winder.motor_angles(robot, *planned(robot, sample(trajectory, at))))
    return np.concatenate(found)


# ---- motor files

def of_stream(stream: MotorStream, robot: Robot) -> Moves:
    """A motor file played back: the place at the end of each move from angles and tensions, the worst of all rows."""
    rows, columns = _rows(stream)
    lengths = winder.pulley_lengths_of(robot, columns["angle"], columns["tension"])
    xyz = _nozzle(robot, forward(robot, lengths, np.array(stream.header["start_pose"])).poses)
    fed = np.diff(columns["filament"], prepend=columns["filament"][0])
    moved = np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1)
    laid = (moved > STILL_MM) & (fed > FED * moved)
    layer = _layers(xyz[:, 2], laid)
    tall = _layer_height(xyz[:, 2], laid)
    time = rows * stream.period_s
    speed = moved / np.maximum(np.diff(time, prepend=0.0), 1e-9)
    fields = (Field("mean_mm_s", "mean speed", "mm/s", speed), *_stream_fields(robot, columns))
    role = np.where(laid, Role.CUSTOM, Role.TRAVEL)
    return Moves(xyz, role, layer, 0.45 * laid, tall * laid, time, "played", fields)


def _nozzle(robot: Robot, poses: Array) -> Array:
    """Nozzle (K, 3) in bed coordinates of poses; where there is none the platform's origin."""
    nozzle = np.zeros(3) if robot.nozzle is None else robot.nozzle
    lever = matrix(poses[:, 3:]) @ nozzle if robot.turning is not None else nozzle
    return poses[:, :3] + (lever - (np.zeros(3) if robot.bed_origin is None else robot.bed_origin))


def _rows(stream: MotorStream) -> tuple[Array, dict[str, Array]]:
    """Rows that end moves (else rows evenly apart): angle, tension and filament there, extremes since the last one."""
    stride, keys = max(1, stream.rows // PLACES), ("angle", "tension", "filament")
    rows: list[Array] = []
    kept: dict[str, list[Array]] = {key: [] for key in (*keys, "high", "low", "speed")}
    for block in stream:
        row = np.arange(len(block))
        if block.move is not None:
            ends = np.flatnonzero(np.diff(block.move, append=block.move[-1] + 1))[:: max(1, stride // 64)]
        else:
            ends = row[stride - 1::stride]
        ends = np.unique(np.append(ends, len(block) - 1))
        starts = np.concatenate(([0], ends[:-1] + 1))
        rows.append(block.row + ends)
        for key in keys:
            kept[key].append(getattr(block, key)[ends])
        kept["high"].append(np.maximum.reduceat(block.tension, starts))
        kept["low"].append(np.minimum.reduceat(block.tension, starts))
        kept["speed"].append(np.maximum.reduceat(np.abs(block.velocity), starts))
    return np.concatenate(rows), {key: np.concatenate(column) for key, column in kept.items()}


def _stream_fields(robot: Robot, columns: dict[str, Array]) -> Iterator[Field]:
    high, low = columns["high"], columns["low"]
    spans = np.stack((np.arange(len(high)), np.arange(len(high)) + 1), axis=1).ravel()
    worst = np.where(high - robot.tension_reference >= robot.tension_reference - low, high, low)
    for one in _tension_fields(robot, worst, spans):
        extremes = {"max_tension_n": high.max(axis=1), "min_tension_n": low.min(axis=1)}
        yield replace(one, values=extremes.get(one.key, one.values))
    yield from _motor_fields(columns["speed"])


def _layers(z: Array, laid: Array) -> Array:
    """Number of the layer of each row, by the heights at which something is laid; travel counts to what follows."""
    levels = _levels(z[laid])
    if not len(levels):
        return np.zeros(len(z), np.int32)
    number = np.clip(np.searchsorted(levels, z - SAME_MM), 0, len(levels) - 1)
    follows = np.where(laid, np.arange(len(z)), len(z) - 1)
    after = np.minimum.accumulate(follows[::-1])[::-1]
    return np.where(laid, number, number[after]).astype(np.int32)


def _levels(z: Array) -> Array:
    """Heights that differ by more than SAME_MM, rising."""
    rising = np.unique(z)
    return rising[np.diff(rising, prepend=-np.inf) > SAME_MM]


def _layer_height(z: Array, laid: Array) -> float:
    levels = _levels(z[laid])
    return float(np.median(np.diff(levels))) if len(levels) > 1 else 0.2
