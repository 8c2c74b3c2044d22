"""The last gate before a motor file: every row against tension, motor and winder, whatever planned it.

Legend
    tau      torque asked of the motor (N mm); its root mean square over the print must stay below the continuous torque

Whether the winders hold the cable is not asked here: robot.winder refuses angles outside what they hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.feasibility.findings import Finding
from cabslice.motors.block import Block
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.rotation import matrix

Place = tuple[int, tuple[float, float, float]]
TENSION_SLACK = 1e-6      # N: rounding of the distribution at a bound
SLOWER = "Plan again with a lower speed or acceleration."


@dataclass(frozen=True)
class _Rule:
    """value <= limit in every row; both carry the sign that makes it so."""

    code: str
    what: str
    unit: str
    scale: float              # from inside units to those of the sentence
    value: Callable[[Block], Array]
    limit: Array              # (m,)
    help: str


class Limits:
    """Looks at the blocks of one pass in order. `place(row)` gives layer and nozzle, to name them.

    A pass that goes on at row `rows` is told the sum of torque^2 (m,) of the rows before.
    """

    def __init__(
        self, robot: Machine, period_s: float, place: Callable[[int], Place], rows: int = 0,
        squares: Array | None = None,
    ) -> None:
        self.robot, self.period_s, self.place = robot, period_s, place
        self.rules, self.each = _rules(robot), "motor" if isinstance(robot, Delta) else "cable"
        self.rows, self.squares = rows, np.zeros(robot.cables) if squares is None else squares

    def look_at(self, block: Block) -> None:
        """Raises ImpossibleError with one finding for each limit and cable broken in this block, at its worst row."""
        fresh = block.torque[max(self.rows - block.row, 0):]
        self.squares = self.squares + np.einsum("nm,nm->m", fresh, fresh)
        self.rows += len(fresh)
        findings = [finding for rule in self.rules for finding in self._broken(rule, block)]
        if findings:
            raise ImpossibleError(findings[0].sentence, findings)

    def finish(self) -> None:
        """Raises ImpossibleError where a motor would overheat over the whole print."""
        winders = self.robot.winders
        assert winders is not None
        rms = np.sqrt(self.squares / max(self.rows, 1))
        findings = [self._overheated(int(cable), rms) for cable in np.flatnonzero(rms > winders.continuous_torque)]
        if findings:
            raise ImpossibleError(findings[0].sentence, findings)

    def _broken(self, rule: _Rule, block: Block) -> list[Finding]:
        value = rule.value(block)
        if not (value > rule.limit).any():
            return []
        rows = np.argmax(value, axis=0)
        worst = value[rows, np.arange(value.shape[1])]
        broken = np.flatnonzero(worst > rule.limit)
        return [self._finding(rule, int(cable), block.row + int(rows[cable]), worst[cable]) for cable in broken]

    def _finding(self, rule: _Rule, cable: int, row: int, value: float) -> Finding:
        layer, xyz = self.place(row)
        value, limit = abs(float(value)) * rule.scale, abs(float(rule.limit[cable])) * rule.scale
        sentence = (
            f"{when_where(row * self.period_s, xyz)} {rule.what} of {self.each} {cable + 1} is {value:.6g} "
            f"{rule.unit}; its limit is {limit:.6g} {rule.unit}."
        )
        return Finding(rule.code, layer, xyz, cable + 1, value, limit, rule.unit, sentence, rule.help)

    def _overheated(self, cable: int, rms: Array) -> Finding:
        assert self.robot.winders is not None
        layer, xyz = self.place(0)
        value, limit = float(rms[cable]) * 1e-3, float(self.robot.winders.continuous_torque[cable]) * 1e-3
        sentence = (
            f"The torque of motor {cable + 1} is {value:.4g} N m in root mean square over the print; "
            f"it stands {limit:.4g} N m continuously."
        )
        remedy = SLOWER if isinstance(self.robot, Delta) else "Lower the reference tension."
        return Finding("stream-torque-rms", layer, xyz, cable + 1, value, limit, "N m", sentence, remedy)


def _rules(robot: Machine) -> tuple[_Rule, ...]:
    winders = robot.winders
    assert winders is not None
    speed, torque = winders.max_speed, winders.peak_torque
    motors = (
        _Rule("stream-speed", "the motor speed", "rad/s", 1.0, lambda block: np.abs(block.velocity), speed, SLOWER),
        _Rule("stream-torque", "the motor torque", "N m", 1e-3, lambda block: np.abs(block.torque), torque, SLOWER),
    )
    if isinstance(robot, Delta):
        return motors
    low, high = TENSION_SLACK - robot.tension_min, TENSION_SLACK + robot.tension_max
    return (
        *motors,
        _Rule("stream-tension-max", "the tension", "N", 1.0, lambda block: block.tension, high, SLOWER),
        _Rule("stream-tension-min", "the tension", "N", 1.0, lambda block: -block.tension, low, SLOWER),
    )


def nozzle_xyz(robot: Machine, pose: Array) -> tuple[float, float, float]:
    """Nozzle of one pose (6,) in bed coordinates, mm; the platform origin in the machine frame where there is none."""
    if robot.nozzle is None or robot.bed_origin is None:
        return float(pose[0]), float(pose[1]), float(pose[2])
    xyz = pose[:3] + matrix(pose[None, 3:])[0] @ robot.nozzle - robot.bed_origin
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


def when_where(time_s: float, xyz: tuple[float, float, float]) -> str:
    return f"At {time_s:.3f} s (nozzle at {xyz[0]:.2f}, {xyz[1]:.2f}, {xyz[2]:.2f} mm)"
