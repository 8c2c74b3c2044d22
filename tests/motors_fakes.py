"""Motions given by formulas, and streams of smooth columns, for the tests of the motor room."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np

from cabslice.motors.stream import UNITS, Block, MotorStream


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


def smooth_stream(rows, *, cables=8, seed=0, move=True, block_rows=1000, period_s=0.002):
    """A stream of sines: no robot behind it."""
    rng = np.random.default_rng(seed)
    pitch, phase = rng.uniform(0.5, 3, (2, cables))

    def blocks():
        for start in range(0, rows, block_rows):
            t = np.arange(start, min(start + block_rows, rows)) * period_s
            sine, cosine = np.sin(pitch * t[:, None] + phase), np.cos(pitch * t[:, None] + phase)
            index = (t * 7).astype(np.int64) if move else None
            yield Block(start, 12 + 2 * sine, 2 * pitch * cosine, 3000 * (1 + 0.3 * sine), 50 + 20 * sine, 3 * t, index)

    header = {"schema": 1, "kind": "stream", "robot": "sines", "period_s": period_s, "rows": rows, "cables": cables,
              "duration_s": (rows - 1) * period_s, "units": UNITS, "largest_radius_mm": 62.6}
    return MotorStream(header, blocks)


def noisy_stream(rows, *, cables=3, seed=0, move=False, scale=1.0):
    """Columns without any smoothness, of both signs."""
    rng = np.random.default_rng(seed)
    columns = [rng.normal(0, scale * size, (rows, cables)) for size in (20, 5, 9000, 60)]
    index = rng.integers(0, 2**40, rows) if move else None
    header = {**smooth_stream(2).header, "rows": rows, "cables": cables}
    block = partial(Block, 0, *columns, scale * rng.normal(0, 1e4, rows), index)
    return MotorStream(header, lambda: iter([block()]))


def whole(stream):
    """All rows of a stream as one namespace of arrays."""
    blocks = list(stream)
    names = [name for name in vars(blocks[0]) if name != "row" and getattr(blocks[0], name) is not None]
    return SimpleNamespace(**{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})
