"""Motions given by formulas, and streams of smooth columns, for the tests of the motor room."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np

from cabslice.motors.machine import torque as machine_torque
from cabslice.motors.machine import winders_json
from cabslice.motors.stream import UNITS, Block, MotorStream
from cabslice.robot.model import WinderColumns


@dataclass(frozen=True)
class Turn:
    """`turns` of a circle at constant height, at rest at both ends: the angle follows a quintic of time."""

    duration: float
    turns: float = 1.0
    radius: float = 60.0
    centre: tuple[float, float, float] = (0.0, 0.0, -250.0)
    rise: float = 0.0            # mm over the whole motion
    feed: float = 0.03           # mm of filament per mm


def sample_turn(turn, t):
    t = np.asarray(t, float)
    assert (t >= 0).all()
    assert (t <= turn.duration).all()
    x, d = t / turn.duration, turn.duration
    share, rate = x**3 * (10 - 15 * x + 6 * x * x), 30 * x**2 * (1 - x) ** 2 / d
    accel = 60 * x * (1 - x) * (1 - 2 * x) / d**2
    angle, full = 2 * np.pi * turn.turns * share, 2 * np.pi * turn.turns
    out, along = np.stack((np.cos(angle), np.sin(angle)), 1), np.stack((-np.sin(angle), np.cos(angle)), 1)
    poses, rates, accels = np.zeros((3, len(t), 6))
    poses[:, :3] = turn.centre
    poses[:, :2] += turn.radius * out
    poses[:, 2] += turn.rise * share
    rates[:, :2], rates[:, 2] = turn.radius * full * rate[:, None] * along, turn.rise * rate
    accels[:, :2] = turn.radius * (full * accel[:, None] * along - (full * rate[:, None]) ** 2 * out)
    accels[:, 2] = turn.rise * accel
    filament = turn.feed * turn.radius * full * share
    move = 1 + np.minimum(10 * x, 9).astype(np.int64)
    return SimpleNamespace(poses=poses, rates=rates, accels=accels, filament=filament, move=move)


def winders(cables, *, friction=0.0):
    """Drums of radius 62.6 mm without layers."""
    each = np.ones(cables)
    return WinderColumns(
        radii=62.6 * each[:, None], ramp_start=0 * each, ramp_end=np.pi * each, home_angle=8 * each,
        centre=np.full((cables, 3), np.nan), crossed=np.zeros(cables, bool), max_speed=10.5 * each,
        continuous_torque=6000 * each, peak_torque=18000 * each, inertia=440 * each, friction=friction * each,
        span=np.tile([-1000.0, 1000.0], (cables, 1)),
    )


def fake_header(rows, cables, period_s=0.002, friction=0.0):
    home = {"pose": [0.0] * 6, "angles_rad": [8.0] * cables, "tensions_n": [30.0] * cables, "wound_mm": [0.0] * cables}
    machine = {"winders": winders_json(winders(cables, friction=friction)), "home": home, "nozzle_gain_mm_mm": 4.0,
               "cable_compliance_mm_n": 0.06, "start_winder_layers": [0] * cables}
    return {"schema": 1, "kind": "stream", "robot": "sines", "period_s": period_s, "rows": rows, "cables": cables,
            "duration_s": (rows - 1) * period_s, "units": UNITS, "largest_radius_mm": 62.6, "machine": machine,
            "encoder_counts_per_turn": [1 << 20] * cables, "start_angles_rad": [12.0] * cables,
            "start_pose": [0.0] * 6}


def smooth_stream(rows, *, cables=8, seed=0, move=True, block_rows=1000, period_s=0.002, friction=0.0):
    """A stream of sines whose columns follow from each other as they should: no robot behind it."""
    rng = np.random.default_rng(seed)
    pitch, phase = rng.uniform(0.5, 3, (2, cables))
    header = fake_header(rows, cables, period_s, friction)

    def at(row):
        t = np.abs((rows - 1) - np.abs((rows - 1) - np.abs(row))) * period_s
        return 12 + 2 * np.sin(pitch * t[:, None] + phase), 3 * t

    def blocks():
        for start in range(0, rows, block_rows):
            row = np.arange(start, min(start + block_rows, rows))
            (angle, fed), (before, fed_before), (after, fed_after) = at(row), at(row - 1), at(row + 1)
            velocity, bend = (after - before) / (2 * period_s), (after - 2 * angle + before) / period_s**2
            tension = 50 + 10 * (angle - 12)
            torque = machine_torque(winders(cables, friction=friction), angle, velocity, bend, tension)
            index = (row * period_s * 7).astype(np.int64) if move else None
            yield Block(start, angle, velocity, torque, tension, fed, index, (fed_after - fed_before) / (2 * period_s))

    return MotorStream(header, blocks)


def noisy_stream(rows, *, cables=3, seed=0, move=False, scale=1.0):
    """Columns without any smoothness, of both signs, nor any bearing on each other."""
    rng = np.random.default_rng(seed)
    columns = [rng.normal(0, scale * size, (rows, cables)) for size in (20, 5, 9000, 60)]
    index = rng.integers(0, 2**40, rows) if move else None
    feed = rng.normal(0, scale * 30, rows) if seed % 2 else None
    block = partial(Block, 0, *columns, scale * rng.normal(0, 1e4, rows), index, feed)
    return MotorStream(fake_header(rows, cables), lambda: iter([block()]))


def whole(stream):
    """All rows of a stream as one namespace of arrays."""
    blocks = list(stream)
    names = [name for name in vars(blocks[0]) if name != "row" and getattr(blocks[0], name) is not None]
    return SimpleNamespace(**{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})
