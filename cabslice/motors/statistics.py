"""The peaks of a stream, found in one pass over its blocks.

Legend
    rms   root mean square over all rows: what heats a motor over a whole print
    qdd   (theta[i+1] - 2 theta[i] + theta[i-1]) / T^2 over the rows of the stream
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.block import Block
from cabslice.robot.model import WinderColumns
from cabslice.robot.winder import layer

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream


@dataclass(frozen=True)
class Peak:
    """The greatest (or least) value of each cable and the first row that has it."""

    value: Array     # (m,)
    row: Array       # (m,) int64


@dataclass(frozen=True)
class StreamStatistics:
    rows: int
    period_s: float
    speed: Peak            # |rad/s|
    acceleration: Peak     # |rad/s^2|
    torque: Peak           # |N mm|
    tension_min: Peak      # N
    tension_max: Peak      # N
    angle_min: Peak        # rad
    angle_max: Peak        # rad
    torque_rms: Array      # (m,) N mm
    filament_mm: float     # fed at the end minus fed at the start

    def as_dict(self) -> dict[str, Any]:
        """JSON values, units in the keys: per cable the peaks and when they occur."""
        keys = {
            "speed": ("peak_motor_speed_rad_s", 1.0), "acceleration": ("peak_motor_acceleration_rad_s2", 1.0),
            "torque": ("peak_torque_n_m", 1e-3), "tension_min": ("min_tension_n", 1.0),
            "tension_max": ("max_tension_n", 1.0), "angle_min": ("min_angle_rad", 1.0),
            "angle_max": ("max_angle_rad", 1.0),
        }
        out: dict[str, Any] = {"rows": self.rows, "period_s": self.period_s, "filament_mm": self.filament_mm}
        for name, (key, scale) in keys.items():
            peak = getattr(self, name)
            out[key] = (peak.value * scale).tolist()
            out[f"{key}_at_s"] = (peak.row * self.period_s).tolist()
        out["rms_torque_n_m"] = (self.torque_rms * 1e-3).tolist()
        return out


class Tally:
    """Takes block after block, in order, and knows the statistics so far."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.rows = 0
        self.peaks: dict[str, Peak] = {}
        self.squares: Array = np.zeros(0)
        self.squares_before: Array = np.zeros(0)     # without the last block, which began at row
        self.last = 0
        self.filament: tuple[float, float] | None = None
        self.tail: Array = np.zeros((0, 0))          # last two rows of angles, for the acceleration

    def note(self) -> Any:
        """All it knows, as JSON; None before the first block."""
        if not self.rows:
            return None
        peaks = {name: [peak.value.tolist(), peak.row.tolist()] for name, peak in self.peaks.items()}
        squares = [self.squares_before.tolist(), self.squares.tolist()]
        return {"rows": self.rows, "peaks": peaks, "squares": squares, "filament": self.filament,
                "tail": self.tail.tolist(), "last": self.last}

    def restore(self, note: Any) -> None:
        """Know what `note` told, and no more."""
        if note is None:
            return
        self.rows, self.last = note["rows"], note["last"]
        self.filament, self.tail = tuple(note["filament"]), np.array(note["tail"])
        self.squares_before, self.squares = map(np.array, note["squares"])
        self.peaks = {name: Peak(np.array(value), np.array(row)) for name, (value, row) in note["peaks"].items()}

    def add(self, block: Block) -> None:
        from cabslice.motors.statistics_kernel import add_squares

        self._largest("speed", block.velocity, block.row, absolute=True)
        self._largest("torque", block.torque, block.row, absolute=True)
        self._largest("tension_max", block.tension, block.row)
        self._largest("tension_min", block.tension, block.row, sign=-1.0)
        self._largest("angle_max", block.angle, block.row)
        self._largest("angle_min", block.angle, block.row, sign=-1.0)
        self._accelerations(block)
        self.squares_before = self.squares if self.rows else np.zeros(block.torque.shape[1])
        self.squares = self.squares_before.copy()
        add_squares(block.torque, self.squares)
        self.filament = (self.filament[0] if self.filament else float(block.filament[0]), float(block.filament[-1]))
        self.rows, self.last = self.rows + len(block), block.row

    def _peak(self, name: str, columns: int) -> Peak:
        """A copy that may be written to."""
        from cabslice.motors.statistics_kernel import nothing

        known = self.peaks.get(name)
        return Peak(*nothing(columns)) if known is None else Peak(known.value.copy(), known.row.copy())

    def _accelerations(self, block: Block) -> None:
        from cabslice.motors.statistics_kernel import bends

        tail = self.tail if self.rows else np.zeros((0, block.angle.shape[1]))
        peak = self._peak("acceleration", block.angle.shape[1])
        bends(tail, block.angle, block.row - len(tail), peak.value, peak.row)
        if len(tail) + len(block) > 2:
            self.peaks["acceleration"] = peak
        self.tail = np.concatenate((tail, block.angle[-2:]))[-2:]

    def _largest(self, name: str, values: Array, first: int, *, absolute: bool = False, sign: float = 1.0) -> None:
        from cabslice.motors.statistics_kernel import largest

        peak = self._peak(name, values.shape[1])
        largest(values, absolute, sign, first, peak.value, peak.row)
        self.peaks[name] = peak

    def result(self) -> StreamStatistics:
        """Raises ValueError before the first block."""
        if self.filament is None:
            raise ValueError("a stream without rows has no statistics")
        peaks = dict(self.peaks)
        still = Peak(np.zeros(len(self.squares)), np.zeros(len(self.squares), np.int64))
        acceleration = peaks.pop("acceleration", still)
        for name in ("tension_min", "angle_min"):
            peaks[name] = Peak(-peaks[name].value, peaks[name].row)
        return StreamStatistics(
            rows=self.rows, period_s=self.period_s, torque_rms=np.sqrt(self.squares / self.rows),
            acceleration=Peak(acceleration.value / self.period_s**2, acceleration.row),
            filament_mm=self.filament[1] - self.filament[0], **peaks,
        )


def observed(blocks: Iterable[Block], tally: Tally) -> Iterator[Block]:
    """The same blocks, each counted on its way."""
    for block in blocks:
        tally.add(block)
        yield block


def statistics(stream: MotorStream) -> StreamStatistics:
    """Goes once through a stream."""
    tally = Tally(stream.period_s)
    for block in stream:
        tally.add(block)
    return tally.result()


def layers_used(winders: WinderColumns, found: StreamStatistics) -> Array:
    """(m, 2) int: lowest and highest winder layer of each cable during the print."""
    return layer(winders, np.stack((found.angle_min.value, found.angle_max.value))).T
