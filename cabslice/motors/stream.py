"""What the drives are told: rows at a fixed period, made and passed on in blocks, never whole in memory.

Legend
    theta    motor angle (multi-turn, rad); winding in is positive     T     period (s); row i is played at i T
    qd, qdd  (theta[i+1] - theta[i-1]) / 2T and (theta[i+1] - 2 theta[i] + theta[i-1]) / T^2 of the commanded angles
    t        planned cable tension (N), inertia of the platform included, and the elastic rest lengths from it
    a        acceleration of the platform the tension is planned for: (-p[i-2] + 16 p[i-1] - 30 p[i] + 16 p[i+1]
             - p[i+2]) / 12 T^2 of the poses in the rows, since corners shorter than a row accelerate in peaks that rows
             cannot carry: taken as they are, they make the platform ring (0.1 mm on a robot whose first mode is 20 Hz)
    alpha    (-omega[i+2] + 8 omega[i+1] - 8 omega[i-1] + omega[i-2]) / 12 T of its angular velocity, where it turns
    b        relaxation time of a damping cable, viscosity over modulus (s): a cable that is to pull t(t) while it damps
             is stretched by t - b dt/dt; that is the tension in the rows, dt/dt by central differences
    r        cable wound per motor angle (mm/rad; the radius of a plain winder)
    I, c     inertia (kg mm^2) and Coulomb friction (N mm) of motor and winder
    tau      feed-forward torque r t + I qdd + c clip(qd / CREEP, -1, 1)   (N mm): friction without a step through rest

The machine is at rest before the first and after the last row. Both ends are mirrored (theta[-1] = theta[1]): a motion
that starts from rest is even in time to second order, so qd is exactly 0 there and qdd is that of the first period.
"""

from __future__ import annotations

import json
import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from cabslice import __version__
from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, PoseError, UsageError
from cabslice.feasibility.findings import Finding
from cabslice.motors import machine
from cabslice.motors.block import Block, cut, present, rechunk
from cabslice.motors.limits import Limits, nozzle_xyz, when_where
from cabslice.motors.start import Lead, reaction, start_header
from cabslice.robot import delta, kinematics, tension, winder, wrench
from cabslice.robot.delta import Delta, Machine

__all__ = ["Block", "MotorStream", "cut", "make_stream", "present", "rechunk", "row_count"]

SCHEMA = 1
REACH = 2               # rows on either side that the acceleration is taken from
BLOCK_ROWS = 8192
UNITS = {
    "angle": "rad", "velocity": "rad/s", "torque": "N mm", "tension": "N",
    "filament": "mm of filament fed since the start", "feed": "mm/s of filament", "move": "row of the toolpath",
    "pose": "mm, rotation vector rad, machine frame",
}


@dataclass(frozen=True)
class MotorStream:
    """A header and blocks of rows that can be gone through again and again.

    header: JSON values only. schema, kind, version, robot, period_s, rows, cables, duration_s, units, start_pose,
    start_angles_rad, start_tensions_n, largest_radius_mm, machine (see motors.machine), and what the caller gave
    (hashes of part and profiles; "printer", its whole profile, which motors.machine.robot_of reads). Nothing in it
    depends on clock, user or folder. `blocks` begins a new pass. `later(row, squares)`, where there is one, begins a
    pass at a block that holds `row` or ends before it; squares (m,) is the sum of torque^2 of all rows before `row`.
    """

    header: Mapping[str, Any]
    blocks: Callable[[], Iterable[Block]]
    later: Callable[[int, Array], Iterable[Block]] | None = None

    def __post_init__(self) -> None:
        plain = json.loads(json.dumps(dict(self.header)), parse_constant=lambda _: None)   # JSON has no infinity
        object.__setattr__(self, "header", MappingProxyType(plain))

    def __iter__(self) -> Iterator[Block]:
        return iter(self.blocks())

    @property
    def rows(self) -> int:
        return int(self.header["rows"])

    @property
    def cables(self) -> int:
        return int(self.header["cables"])

    @property
    def period_s(self) -> float:
        return float(self.header["period_s"])


def row_count(duration_s: float, period_s: float) -> int:
    """Rows that reach the end: the last one is the end of the motion, at most a period after the one before."""
    return max(2, math.ceil(duration_s / period_s - 1e-9) + 1)


def make_stream(
    trajectory: Any,
    robot: Machine,
    *,
    period_s: float,
    header: Mapping[str, Any],
    layers: Array | None = None,
    sample: Callable[[Any, Array], Any] | None = None,
    block_rows: int = BLOCK_ROWS,
    jobs: int = 1,
    lead: Lead | None = None,
    extrude: bool = True,
    relaxation: Array | float = 0.0,
) -> MotorStream:
    """The motor commands of a trajectory, computed block by block each time the stream is gone through.

    `jobs` threads compute blocks ahead; the rows do not depend on it. The rows of `lead` come before the motion;
    without `extrude` no filament is fed. relaxation (m,) s is b of the cables.

    `header` holds what only the caller knows (hashes of part and profiles). `layers` (N,) is the layer of each move,
    to name it in findings. `sample(trajectory, t (K,))` gives poses, rates, accels (K, 6), filament and move (K,);
    timing's own unless told. Going through the stream raises ImpossibleError (with findings that name time, xyz and
    cable) at the first block that breaks a limit of tension, motor speed, peak torque or winder, and after the last
    block where the root-mean-square torque of the print is above the continuous torque.
    """
    if robot.winders is None:
        raise UsageError(f"The printer {robot.name or 'given'} has no winders: there are no motors to command.")
    if not period_s > 0:
        raise UsageError(f"The period of the stream is {period_s} s; it must be above 0.")
    lead = lead or Lead()
    rows = row_count(trajectory.duration, period_s) + lead.rows(period_s)
    source = _Source(trajectory, robot, period_s, rows, sample or timing_sample(), layers, lead, extrude,
                     np.broadcast_to(np.asarray(relaxation, float), robot.cables))

    def blocks(row: int = 0, squares: Array | None = None) -> Iterator[Block]:
        limits = Limits(robot, period_s, source.place, row, squares)
        starts = range(row // block_rows * block_rows, rows, block_rows)
        for block in _ahead(lambda start: source.block(start, min(start + block_rows, rows)), starts, jobs):
            limits.look_at(block)
            yield block
        limits.finish()

    return MotorStream(_header(header, source), blocks, blocks)


def _ahead(make: Callable[[int], Block], starts: Iterable[int], jobs: int) -> Iterator[Block]:
    """The blocks in order, up to 2 jobs of them in the making."""
    if jobs <= 1:
        yield from map(make, starts)
        return
    with ThreadPoolExecutor(jobs) as pool:
        waiting: deque[Future[Block]] = deque()
        try:
            for start in starts:
                waiting.append(pool.submit(make, start))
                if len(waiting) > 2 * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def moving_time(rows: Array, period_s: float, lead_rows: int, duration: float) -> Array:
    """Time (K,) s of the motion that rows (K,) stand for."""
    return np.clip((np.asarray(rows) - lead_rows) * period_s, 0.0, duration)


def timing_sample() -> Callable[[Any, Array], Any]:
    from cabslice.timing.trajectory import sample

    return sample


@dataclass(frozen=True)
class _Rows:
    """The motion at some rows, as timing.trajectory.Samples."""

    poses: Array
    rates: Array
    accels: Array
    filament: Array
    move: Array

    def taken(self, rows: Array) -> _Rows:
        return _Rows(self.poses[rows], self.rates[rows], self.accels[rows], self.filament[rows], self.move[rows])


@dataclass(frozen=True)
class _Source:
    trajectory: Any
    robot: Machine
    period_s: float
    rows: int
    sample: Callable[[Any, Array], Any]
    layers: Array | None
    lead: Lead
    extrude: bool
    relaxation: Array      # (m,) s

    def block(self, start: int, stop: int) -> Block:
        """Rows start:stop; one row more on either side is computed so that the differences see no border."""
        winders, inner = self.robot.winders, slice(1, -1)
        assert winders is not None
        samples, planned, angle = self.commanded(self._mirrored(np.arange(start - 1, stop + 1)))
        velocity = (angle[2:] - angle[:-2]) / (2 * self.period_s)
        acceleration = (angle[2:] - 2 * angle[inner] + angle[:-2]) / self.period_s**2
        torque = machine.torque(winders, angle[inner], velocity, acceleration, planned[inner])
        filament, move = samples.filament * self.extrude, samples.move[inner]
        feed = (filament[2:] - filament[:-2]) / (2 * self.period_s)
        return Block(start, angle[inner], velocity, torque, planned[inner], filament[inner], move, feed)

    def commanded(self, rows: Array) -> tuple[_Rows, Array, Array]:
        """Samples, tensions (K, m) and motor angles (K, m) of rows (K,); ImpossibleError where there are none."""
        low, high = int(rows.min()), int(rows.max())
        wide = np.arange(low - 1, high + 2)
        samples, planned, length = self.planned(wide)
        pull = planned[1:-1] - self.relaxation * (planned[2:] - planned[:-2]) / (2 * self.period_s)
        try:
            if isinstance(self.robot, Delta):
                angle = delta.motor_angles(self.robot, length[1:-1])
            else:
                angle = winder.motor_angles(self.robot, length[1:-1], pull)
        except PoseError as error:
            self._refuse_pose(wide[1:-1], error)
        return samples.taken(rows - low + 1), pull[rows - low], angle[rows - low]

    def planned(self, rows: Array) -> tuple[_Rows, Array, Array]:
        """Samples, tensions (K, m) and cable lengths (K, m) of rows (K,); ImpossibleError where there are none.

        Of a Delta: the forces along its rails and the heights of its carriages.
        """
        robot, samples = self.robot, self.moving(rows)
        if isinstance(robot, Delta):
            force = delta.forces(robot, samples.poses, samples.rates, samples.accels)
            return samples, force, delta.carriages(robot, samples.poses)
        try:
            lines = kinematics.cables(robot, samples.poses)
            matrix = wrench.wrench_matrix(robot, samples.poses, masked=True, lines=lines)
            required = wrench.required_wrench(robot, samples.poses, samples.rates, samples.accels, masked=True)
            bounds = robot.tension_min, robot.tension_max, self._reference(rows)
            find = tension.unmeasured if bounds[2].ndim == 1 else tension.nearest
            found = find(matrix, required, *bounds)
            if not found.feasible.all():
                self._refuse_tension(rows, tension.nearest(matrix, required, *bounds))
        except PoseError as error:
            self._refuse_pose(rows, error)
        return samples, found.tension, lines.length

    def moving(self, rows: Array) -> _Rows:
        """The motion at rows (K,) near each other, the accelerations as the rows can carry them (see the legend)."""
        low, high = int(rows.min()), int(rows.max())
        wide = self.at(np.arange(low - REACH, high + REACH + 1))
        p, inner = wide.poses[:, :3], slice(REACH, -REACH)
        accels = wide.accels[inner].copy()
        accels[:, :3] = (16 * (p[3:-1] + p[1:-3]) - (p[4:] + p[:-4]) - 30 * p[inner]) / (12 * self.period_s**2)
        if wide.poses[:, 3:].any():
            w = wide.rates[:, 3:]
            accels[:, 3:] = (8 * (w[3:-1] - w[1:-3]) - (w[4:] - w[:-4])) / (12 * self.period_s)
        accels[self._rests(np.arange(low, high + 1))] = 0.0
        whole = _Rows(wide.poses[inner], wide.rates[inner], accels, wide.filament[inner], wide.move[inner])
        return whole.taken(rows - low)

    def _rests(self, rows: Array) -> Array:
        """(K,) bool: before the motion begins and once it has ended; the file ends as it began, tension for tension."""
        time = moving_time(rows, self.period_s, self.lead_rows, self.trajectory.duration)
        return (time <= 0) | (time >= self.trajectory.duration)

    def at(self, rows: Array) -> Any:
        return self.sample(self.trajectory, moving_time(rows, self.period_s, self.lead_rows, self.trajectory.duration))

    @property
    def lead_rows(self) -> int:
        return self.lead.rows(self.period_s)

    def _reference(self, rows: Array) -> Array:
        """Level (m,) or (K, m) N the tensions are kept near: the plain one where the lead is over."""
        assert not isinstance(self.robot, Delta)
        reference = self.robot.tension_reference
        if rows.min() >= self.lead_rows:
            return reference
        return self.lead.level(rows, self.period_s)[:, None] * reference

    def place(self, row: int) -> tuple[int, tuple[float, float, float]]:
        """Layer (-1 where not known) and nozzle of a row."""
        samples = self.at(np.array([row]))
        layer = -1 if self.layers is None else int(self.layers[int(samples.move[0])])
        return layer, nozzle_xyz(self.robot, samples.poses[0])

    def _mirrored(self, rows: Array) -> Array:
        last = self.rows - 1
        return last - np.abs(last - np.abs(rows))

    def _refuse_tension(self, rows: Array, found: Any) -> NoReturn:
        at = int(np.argmin(np.where(found.feasible, np.inf, found.margin)))
        margin = float(found.margin[at])
        sentence = f"no cable tensions within bounds hold the platform in this motion: {-margin:.3f} N are missing."
        self._refuse("stream-tension", int(rows[at]), 0, (margin, 0.0, "N"), sentence, "Plan it slower.")

    def _refuse_pose(self, rows: Array, error: PoseError) -> NoReturn:
        """A winder that is full, or a pose the cables cannot be led to: with time and place of the first such row."""
        told = error.details
        row = int(rows[told.get("sample", told.get("pose", 0))])
        value, (low, high) = told.get("value", 0.0), told.get("span", (0.0, 0.0))
        sentence = re.sub(r" at (sample|pose) \d+", "", error.sentence) + "."
        given = (value, low if value < low else high, "rad")
        self._refuse("stream-winder" if "span" in told else "stream-pose", row, told.get("cable", 0), given, sentence,
                     "Move the part, or give the winder more layers.")

    def _refuse(
        self, code: str, row: int, cable: int, given: tuple[float, float, str], what: str, remedy: str
    ) -> NoReturn:
        """`given`: value, limit and unit."""
        layer, xyz = self.place(row)
        sentence = f"{when_where(row * self.period_s, xyz)} {what}"
        raise ImpossibleError(sentence, [Finding(code, layer, xyz, cable, *given, sentence, remedy)])


def _header(given: Mapping[str, Any], source: _Source) -> dict[str, Any]:
    samples, planned, angle = source.commanded(np.zeros(1, dtype=np.int64))
    robot = source.robot
    assert robot.winders is not None
    rigid = isinstance(robot, Delta)
    header = {
        **given,
        "schema": SCHEMA, "kind": "stream", "version": __version__, "robot": robot.name,
        "units": UNITS | ({"tension": "N, force of the motor along its rail, above 0: lifting"} if rigid else {}),
        "period_s": source.period_s, "rows": source.rows, "cables": robot.cables,
        "duration_s": float(source.trajectory.duration) + source.lead_rows * source.period_s,
        "lead_rows": source.lead_rows, "extrude": source.extrude, "drive_reaction": reaction(cables=not rigid),
        "start_pose": samples.poses[0].tolist(),
        "start_angles_rad": angle[0].tolist(), "start_tensions_n": planned[0].tolist(),
        "end_angles_rad": _end_angles(source),
        "largest_radius_mm": float(winder.transmission_bounds(robot.winders)[1].max()),
        "machine": machine.machine_header(robot, _places(source), angle[0]),
    }
    return header | {"start": start_header(header, source.lead, source.period_s)}


def _end_angles(source: _Source) -> list[float] | None:
    """Where the motors stop; None where the stream will not get there, as going through it tells."""
    try:
        return list(source.commanded(np.array([source.rows - 1]))[2][0].tolist())
    except ImpossibleError:
        return None


def _places(source: _Source) -> Array:
    """Poses (K, 6) spread over the motion."""
    return source.at(np.unique(np.linspace(0, source.rows - 1, machine.PLACES).astype(np.int64))).poses
