"""The finished motion judged by someone who did not plan it.

Positions are taken from the trajectory at even times; speeds and accelerations are their finite differences, and
tensions are found anew from them (audit_forces). Nothing of the planner is used: not its rows, not its grid, not its
derivatives.

Legend
    p_k          position of the nozzle (or the centre of mass) at time k dt
                 v = (p_k+1 - p_k-1) / 2 dt;  a = (p_k+1 - 2 p_k + p_k-1) / dt^2
    share        value over limit; above 1 is a finding
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.kinematics import cables
from cabslice.robot.model import NEWTON, Robot, nozzle_places
from cabslice.robot.pulley import CableLines
from cabslice.robot.rotation import matrix
from cabslice.robot.winder import angles_and_levers
from cabslice.robot.wrench import wrench_matrix
from cabslice.timing import audit_filament, audit_rails
from cabslice.timing.audit_forces import found_tensions, needed, second_opinion
from cabslice.timing.audit_words import ADVICE, SENTENCES, UNITS, UNKEPT
from cabslice.timing.layers import dwells, layer_spans, least_times
from cabslice.timing.trajectory import Samples, Trajectory, sample
from cabslice.timing.worst import ROUNDING, Worst
from cabslice.toolpath.path import RESTS, Toolpath

STEP_S = 1e-3
BLOCK_ROWS = 8_000          # so that what is made of them stays near the processor
PLACE_MM = 1e-6
STILL_MM = 1e-9
TURN_RAD = 1e-6
MERGED_MM = 1e-3            # vertices nearer than this may be taken for one
FINER = 8
WARY = 2.0                  # times a step squared times the acceleration: more than looking finer moves the chords
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Subject:
    trajectory: Trajectory
    toolpath: Toolpath
    robot: Machine
    printer: Any
    material: Any
    process: Any
    step: float
    asked: Array          # (N,) mm/s asked of the nozzle in each move; 0 where only filament moves
    fed: audit_filament.Fed


def audit(
    trajectory: Trajectory, toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any,
    *, step_s: float = STEP_S, jobs: int = 1, progress: Progress | None = None,
) -> Verdict:
    """Samples the motion every step_s seconds and says whether it keeps every limit.

    Margins of the verdict are the largest shares of each limit used (1 is the limit; of a tension, how far from the
    middle of its range to a bound).
    """
    return examine(
        trajectory, toolpath, robot, printer, material, process, step_s=step_s, jobs=jobs, progress=progress)[0]


def examine(
    trajectory: Trajectory, toolpath: Toolpath, robot: Machine, printer: Any, material: Any, process: Any,
    *, step_s: float = STEP_S, jobs: int = 1, progress: Progress | None = None,
) -> tuple[Verdict, Array, Array]:
    """The audit, and every time (B,) s at which a slower motion would help with its share (B,) of the limit."""
    asked = np.where(_moved(toolpath) > 0, toolpath.speed, 0.0)
    fed = audit_filament.fed_by(toolpath)
    subject = Subject(trajectory, toolpath, robot, printer, material, process, step_s, asked, fed)
    worst, blocks = Worst(), list(_blocks(trajectory.duration, step_s))
    with ThreadPoolExecutor(jobs) as pool:
        for done, found in enumerate(pool.map(lambda block: _judge(subject, *block), blocks)):
            worst.merge(found)
            if progress:
                progress(done + 1, len(blocks))
    worst.merge(_ends(subject))
    _coverage(subject, worst)
    _heat(subject, worst)
    if isinstance(robot, Robot):
        second_opinion(robot, trajectory, step_s, blocks[-1][1] if blocks else 0, worst, jobs)
    times, shares = (np.concatenate([found[k] for found in worst.broken] or [np.zeros(0)]) for k in (0, 1))
    return _verdict(subject, worst, blocks[-1][1] if blocks else 0), times, shares


def _moved(toolpath: Toolpath) -> Array:
    """(N,) mm, lengths of the moves; what is shorter than STILL_MM stands still."""
    return np.where(toolpath.lengths < STILL_MM, 0.0, toolpath.lengths)


def _blocks(duration: float, step: float) -> Iterator[tuple[int, int]]:
    last = int(np.ceil(duration / step)) + 1
    for first in range(0, last, BLOCK_ROWS):
        yield first, min(first + BLOCK_ROWS, last)


def _judge(subject: Subject, first: int, last: int) -> Worst:
    """Rows first..last-1 of the even times, with two neighbours on each side: the outer ones for the motors alone."""
    step, toolpath = subject.step, subject.toolpath
    times = np.arange(first - 2, last + 2) * step
    seen = sample(subject.trajectory, times)
    place = nozzle_places(subject.robot, seen.poses)
    accel = (place[2:] - 2 * place[1:-1] + place[:-2]) / step**2
    worst = Worst()
    if isinstance(subject.robot, Delta):
        audit_rails.see(subject.robot, worst, times[2:-2], seen.move[2:-2], seen.poses[1:-1], step)
    else:
        _forces(subject, subject.robot, worst, times, seen)
        _turns(subject.robot, worst, times, seen, place)
    laid = seen.laid[1:-1]
    times, place, move, fed, accel = times[1:-1], place[1:-1], seen.move[1:-1], seen.filament[1:-1], accel[1:-1]
    now, at = times[1:-1], move[1:-1]
    around = np.stack((move[:-2], move[1:-1], move[2:]))
    stride = np.linalg.norm(np.diff(place, axis=0), axis=1) / step
    _kinematic(subject, worst, now, at, around, np.maximum(stride[1:], stride[:-1]), accel)
    _feeding(subject, worst, now, at, around, fed, laid)
    extruder, window = subject.printer.extruder, subject.trajectory.window
    audit_filament.see(subject.fed, worst, extruder, window, times, move, laid)
    off = _off_path(toolpath, place[1:-1], at, subject.process.corner_mm / 2)
    worst.see("path", np.maximum(off - PLACE_MM, 0), subject.process.corner_mm, now, at)
    _vertices(subject, worst, times, place, move, float(np.linalg.norm(accel, axis=1).max()))
    return worst


def _kinematic(
    subject: Subject, worst: Worst, now: Array, at: Array, around: Array, speed: Array, accel: Array
) -> None:
    motion = subject.printer.motion
    worst.see("speed", speed, motion.max_speed_mm_s, now, at)
    worst.see("feature-speed", speed, np.maximum(_over_moves(np.maximum, subject.asked, around), 1e-9), now, at)
    if motion.max_acceleration_mm_s2:
        worst.see("acceleration", np.abs(accel).max(axis=1), motion.max_acceleration_mm_s2, now, at)


def _over_moves(reduce: np.ufunc, column: Array, around: Array) -> Array:
    """`column` (N,) reduced over all moves from the sample before to the sample after, (K,)."""
    spans = np.stack((around[0], around[2] + 1), axis=1).ravel()
    return reduce.reduceat(np.append(column, column[-1]), spans)[::2]


def _feeding(
    subject: Subject, worst: Worst, now: Array, at: Array, around: Array, filament: Array, laid: Array
) -> None:
    extruder, step = subject.printer.extruder, subject.step
    feed = np.diff(filament) / step                                    # mean over each step
    both = np.maximum(np.abs(feed[1:]), np.abs(feed[:-1]))
    worst.see("filament-speed", both, extruder.max_speed_mm_s, now, at)
    moving = _over_moves(np.minimum, subject.asked, around) > 0
    rate = np.diff(laid) / step
    flow = np.maximum(np.abs(rate[1:]), np.abs(rate[:-1]))[moving] * subject.toolpath.filament_area_mm2
    melted = min(extruder.max_flow_mm3_s, subject.material.max_flow_mm3_s)
    worst.see("flow", flow, melted, now[moving], at[moving])
    jump = extruder.max_jump_mm_s * np.maximum(around[2] - around[0], 1) + extruder.max_acceleration_mm_s2 * 2 * step
    worst.see("filament-step", np.abs(np.diff(feed)), jump, now, at)
    if ahead := extruder.pressure_advance_s:
        off = np.abs(filament[1:-1] - laid[1:-1] - ahead * (rate[1:] + rate[:-1]) / 2)[moving]
        bend = np.pad(np.abs(np.diff(rate)), 1, mode="edge")          # how much the rate may differ from its mean there
        unsure = ahead * 2 * np.maximum.reduce([bend[:-2], bend[1:-1], bend[2:]]) + PLACE_MM
        worst.see("pressure-advance", off, unsure[moving], now[moving], at[moving])


def _forces(subject: Subject, robot: Robot, worst: Worst, times: Array, seen: Samples) -> None:
    lines = cables(robot, seen.poses[1:-1])
    tension = _cables(subject, robot, worst, times[1:-1], seen.move[1:-1], seen.poses, lines)
    _motors(subject, robot, worst, times[2:-2], seen.move[2:-2], lines.length, tension)


def _turns(robot: Robot, worst: Worst, times: Array, seen: Samples, place: Array) -> None:
    """The platform is turned as it was when the path was checked."""
    turning, found = robot.turning, seen.poses[:, 3:]
    if turning is None and not found.any():
        return
    right = np.tile(np.eye(3), (len(found), 1, 1)) if turning is None else turning.matrices(place)
    off = np.abs(right - matrix(found)).max(axis=(1, 2))
    worst.see("turn", off, np.full(len(off), TURN_RAD), times, seen.move)


def _cables(
    subject: Subject, robot: Robot, worst: Worst, now: Array, at: Array, around: Array, lines: CableLines
) -> Array:
    """Tensions (K, m) that hold the platform on the motion, poses around (K + 2, 6), exist within the bounds: found,
    then verified on the spot; nan where not."""
    wrench = wrench_matrix(robot, around[1:-1], lines=lines)
    tension, share = found_tensions(robot, wrench, needed(robot, around[:-2], around[1:-1], around[2:], subject.step))
    worst.see_cables("tension", share, np.ones(robot.cables), now, at)
    worst.see_tight(share, now)
    return tension


def _motors(
    subject: Subject, robot: Robot, worst: Worst, now: Array, at: Array, length: Array, tension: Array
) -> None:
    """Speed and torque of the motors by differences of their angles at cable lengths (K + 2, m) under tension
    (K + 2, m), the take-up of what the cables stretch included; rows without tensions were found already."""
    winders, step = robot.winders, subject.step
    known: Array = np.isfinite(tension.sum(axis=1))
    whole: Any = known[2:] & known[1:-1] & known[:-2]
    if winders is None or not np.any(whole):
        return
    pull = tension
    if known.all():
        whole = slice(None)                                            # spares copies
    else:
        pull = np.where(known[:, None], tension, robot.tension_reference)
    angle, lever = angles_and_levers(robot, length, pull)
    speed = (angle[2:] - angle[:-2])[whole] / (2 * step)
    spin = (angle[2:] - 2 * angle[1:-1] + angle[:-2])[whole] / step**2
    torque = (lever * pull)[1:-1][whole]
    torque = (torque + winders.inertia * spin * NEWTON + winders.friction * np.sign(speed)) * 1e-3
    worst.see_cables("motor-speed", np.abs(speed), winders.max_speed, now[whole], at[whole])
    worst.see_cables("motor-torque", np.abs(torque), winders.peak_torque * 1e-3, now[whole], at[whole])
    worst.squares, worst.rows = worst.squares + np.einsum("km,km->m", torque, torque), worst.rows + len(torque)


def _heat(subject: Subject, worst: Worst) -> None:
    """The root-mean-square torque of each motor over the whole print."""
    if subject.robot.winders is None or not worst.rows:
        return
    last = np.array([len(subject.toolpath.xyz) - 1])
    for cable, square in enumerate(np.atleast_1d(worst.squares)):
        most = subject.robot.winders.continuous_torque[[cable]] * 1e-3
        worst.see("motor-heat", np.sqrt([square / worst.rows]), most, np.zeros(1), last, cable + 1)


def distance_to_path(toolpath: Toolpath, xyz: Array, move: Array) -> Array:
    """(K,) mm from points (K, 3) to the polyline near moves (K,): the move itself and its two neighbours."""
    last = len(toolpath.xyz) - 1
    near = [np.clip(move + offset, 1, last) for offset in (-1, 0, 1)]
    return np.min([_to_segment(xyz, toolpath.xyz[k - 1], toolpath.xyz[k]) for k in near], axis=0)


def _off_path(toolpath: Toolpath, xyz: Array, move: Array, enough: float) -> Array:
    """As distance_to_path; at most `enough` it may be too large where it is not the largest."""
    own = np.clip(move, 1, len(toolpath.xyz) - 1)
    off = _to_segment(xyz, toolpath.xyz[own - 1], toolpath.xyz[own])
    far = ~(off <= enough)
    off[far] = distance_to_path(toolpath, xyz[far], move[far])
    if off[far].max(initial=0.0) < off[~far].max(initial=0.0):
        return distance_to_path(toolpath, xyz, move)
    return off


def _to_segment(point: Array, start: Array, end: Array) -> Array:
    along = end - start
    share = np.einsum("ki,ki->k", point - start, along) / np.maximum(np.einsum("ki,ki->k", along, along), 1e-300)
    return np.linalg.norm(point - start - np.clip(share, 0, 1)[:, None] * along, axis=1)


def _vertices(subject: Subject, worst: Worst, times: Array, place: Array, move: Array, fastest: float) -> None:
    """Every vertex passed between two samples lies within the corner tolerance of the motion there, looked at
    FINER times as often where it could be the worst of them or too far away. fastest: largest acceleration, mm/s^2,
    which bounds the bulge between two looks; place (K, 3): the nozzle in bed coordinates."""
    count = np.diff(move)[1:]
    pair = np.repeat(np.arange(1, len(times) - 1), count)
    ahead = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count)
    vertex = subject.toolpath.xyz[move[pair] + ahead]
    worst.vertices += len(pair)
    off = _to_segment(vertex, place[pair], place[pair + 1])
    least = min(float(off.max(initial=0.0)), subject.process.corner_mm) - 2 * WARY * fastest * subject.step**2
    far = off >= least
    pair, vertex = pair[far], vertex[far]
    looks = times[pair, None] + subject.step * np.linspace(0, 1, FINER + 1)
    place = nozzle_places(subject.robot, sample(subject.trajectory, looks.ravel()).poses)
    place = place.reshape(len(pair), FINER + 1, 3)
    off = np.min([_to_segment(vertex, place[:, k], place[:, k + 1]) for k in range(FINER)], axis=0)
    bulge = fastest * (subject.step / FINER) ** 2 / 4
    worst.see("vertex", np.maximum(off - bulge - PLACE_MM, 0), subject.process.corner_mm, times[pair], move[pair])


def _ends(subject: Subject) -> Worst:
    """The motion ends at the last vertex with all filament fed, and rests at both ends of every piece."""
    trajectory, toolpath = subject.trajectory, subject.toolpath
    end = sample(trajectory, np.array([trajectory.duration]))
    missing = np.linalg.norm(nozzle_places(subject.robot, end.poses) - toolpath.xyz[-1:], axis=1)
    worst, last = Worst(), np.array([len(toolpath.xyz) - 1])
    at_end = np.array([trajectory.duration])
    worst.see("vertex", np.maximum(missing - PLACE_MM, 0), subject.process.corner_mm, at_end, last)
    lost = np.abs(end.filament - toolpath.filament.sum())
    worst.see("filament", lost, np.full(1, 1e-6 + 1e-12 * np.abs(toolpath.filament).sum()), at_end, last)
    begin = sample(trajectory, np.zeros(1))
    astray = np.linalg.norm(nozzle_places(subject.robot, begin.poses) - toolpath.xyz[:1], axis=1)
    worst.see("vertex", np.maximum(astray - PLACE_MM, 0), subject.process.corner_mm, np.zeros(1), np.zeros(1, np.int64))
    _whole_pieces(subject, worst)
    ends = trajectory.pieces[1:] - 1
    rate = np.sqrt(np.maximum(trajectory.x[ends], trajectory.x[trajectory.pieces[:-1]]))
    worst.see("rest", rate, np.full(len(rate), 1e-6), trajectory.time[ends], trajectory.move[ends])
    return worst


def _whole_pieces(subject: Subject, worst: Worst) -> None:
    """Every piece is run from its start to the end of its length, with the rest before it that was asked for."""
    trajectory, toolpath = subject.trajectory, subject.toolpath
    first, last = trajectory.pieces[:-1], trajectory.pieces[1:] - 1
    lengths = _moved(toolpath)
    span = np.where(lengths > 0, lengths, np.abs(toolpath.filament))
    length = np.add.reduceat(np.append(span, 0.0), toolpath.starts)[:-1]
    merged = np.add.reduceat(np.append(np.where((lengths > 0) & (lengths < MERGED_MM), lengths + MERGED_MM, 0.0), 0.0),
                             toolpath.starts)[:-1]
    short = np.maximum(np.abs(trajectory.s[first]), np.abs(trajectory.s[last] - length))
    worst.see("missed", short, 1e-6 + 1e-9 * length + merged, trajectory.time[last], trajectory.move[last])
    waits = dwells(toolpath)
    rested = trajectory.time[first] - np.concatenate(([0.0], trajectory.time[last[:-1]]))
    short = np.maximum(waits - rested, 0)
    worst.see("dwell", short, np.full(len(waits), 1e-6), trajectory.time[first], trajectory.move[first])
    _layers(subject, worst)


def _layers(subject: Subject, worst: Worst) -> None:
    """Every layer but the last takes the time asked for it; a pause finds the nozzle at rest."""
    trajectory, toolpath = subject.trajectory, subject.toolpath
    spans, wanted = layer_spans(toolpath, trajectory), least_times(toolpath)
    final = int(toolpath.layer[-1])
    for number, seconds in wanted.items():
        first, _, has = spans.get(number, (0, 0, np.inf))
        if number != final:
            node = trajectory.pieces[[first]]
            short = np.array([max(seconds - has, 0.0)])
            worst.see("layer-time", short, np.full(1, 1e-6 + 1e-9 * seconds), trajectory.time[node],
                      trajectory.move[node])
    stops = toolpath.events.index[np.isin(toolpath.events.kind, RESTS)]
    lost = ~np.isin(stops, np.append(toolpath.starts, 0))
    worst.see("pause", lost.astype(float), np.full(len(stops), 0.5), np.zeros(len(stops)),
              np.minimum(stops, len(toolpath.xyz) - 1))


def _coverage(subject: Subject, worst: Worst) -> None:
    """No vertex was passed over: each of the moves was entered once, or lies where the motion begins or ends."""
    moves, start = int(subject.toolpath.starts[-1] - subject.toolpath.starts[0]), int(subject.toolpath.starts[0])
    before = subject.toolpath.xyz[start - 1:max(int(subject.trajectory.move[0]), start)]
    left = subject.toolpath.xyz[int(subject.trajectory.move[-1]):]
    still = sum(len(run) - 1 for run, end in ((before, before[0]), (left, left[-1]))
                if np.linalg.norm(run - end, axis=1).max() <= 2 * MERGED_MM)
    missed, last = abs(moves - 1 - still - worst.vertices), np.array([moves])
    worst.see("missed", np.array([float(missed)]), np.array([0.5]), np.array([subject.trajectory.duration]), last)


def _verdict(subject: Subject, worst: Worst, rows: int) -> Verdict:
    seen = sorted(worst.seen.items())
    names = ", ".join(code for code, _ in seen)
    checked = (f"the finished motion at {rows} times {subject.step * 1e3:g} ms apart: {names}",
               *([f"tensions by another method, their quadratic programme, at {worst.again} of these times: one in a "
                  "hundred, drawn, and the tightest"] if worst.again else []))
    findings = tuple(_finding(subject, code, entry) for code, entry in seen if not entry[0] <= 1 + ROUNDING)
    margins = {f"{code.replace('-', '_')}_share": entry[0] for code, entry in seen}
    return Verdict(checked, findings, margins)


def _finding(subject: Subject, code: str, entry: tuple[float, float, float, float, int, int]) -> Finding:
    _, value, limit, time, move, cable = entry
    layer = int(subject.toolpath.layer[move])
    x, y, z = (float(number) for number in subject.toolpath.xyz[move])
    unit = UNITS[code] if code != "tension" else "of the range"
    named = f" ({'cable' if code.startswith('tension') else 'motor'} {cable})" if cable else ""
    sentence = (f"layer {layer}: {SENTENCES[code]}{named} at {time:.3f} s, nozzle near x {x:.1f} y {y:.1f} "
                f"z {z:.1f} mm: {value:.4g}, limit {limit:.4g} {unit}")
    return Finding(code, layer, (x, y, z), cable, value, limit, unit, sentence, ADVICE.get(code, UNKEPT))
