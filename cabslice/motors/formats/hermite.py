r"""The `.hermite` file: cubic pieces instead of rows, for controllers that evaluate them (file layout: see frames).

Between two knots a and b, h rows apart, a channel follows the cubic with value v and slope s per row at both (see
hermite_kernel). Every frame begins and ends with a knot; between two frames lies one row and no piece. "layout" in the
header holds groups [{name, channels, tolerance, quantum, slope_quantum}]; the groups angle, tension and filament have
knots of their own. A value is within `tolerance` of the row it stands for, at every row; "bounds" says what that costs.

The payload is deflated (zlib). Inflated it has for each group in order, C channels, K knots:
    4 bytes       uint32 K
    8 * 2C bytes  int64 of each channel: the first value, the first slope, in quanta
    planes        of h - 1 (K-1), of slope[i+1] - slope[i] (C, K-1), of value[i+1] - predicted (C, K-1),
                  predicted = value[i] + rint((slope[i] + slope[i+1]) h slope_quantum / (2 quantum))
    where planes are 1 byte P and P byte planes of integers, lowest first, channel after channel, each integer d as
    2d for d >= 0, -2d - 1 for d < 0 ("zigzag").

Velocity and feed are differences of what the pieces give at the rows; the torque is that of the tension (machine).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError
from cabslice.motors import machine
from cabslice.motors.formats import frames
from cabslice.motors.formats.frames import Codec
from cabslice.motors.formats.writing import Rows, differences, neighbours
from cabslice.motors.stream import Block
from cabslice.robot.model import NEWTON
from cabslice.robot.winder import transmission, transmission_bounds

MAGIC = b"\x89CUBICS\n"
CABLE_MM, TENSION_N, FILAMENT_MM = 2e-3, 0.1, 5e-3      # tolerances; that of the angle follows the largest radius
LEVEL = 9                                               # of deflate
LARGEST = 2.0**60                                       # of integers
FINER = 8                                               # quanta in a tolerance


def tolerances(header: Mapping[str, Any]) -> dict[str, float]:
    """Largest deviation of a column at any row, in its own unit."""
    radius = float(header.get("largest_radius_mm", 100.0))
    return {"angle": 2.0 ** np.floor(np.log2(CABLE_MM / radius)), "tension": TENSION_N, "filament": FILAMENT_MM}


def layout(header: Mapping[str, Any], block: Block) -> dict[str, Any]:
    groups = [
        {"name": name, "channels": 1 if name == "filament" else block.angle.shape[1], "tolerance": tolerance,
         "quantum": tolerance / FINER, "slope_quantum": tolerance / FINER}
        for name, tolerance in tolerances(header).items()
    ]
    return {"groups": groups, "bounds": bounds(header)}


def bounds(header: Mapping[str, Any]) -> dict[str, float]:
    """What the deviations cost at most: of the angles played, of the columns that follow, of the nozzle."""
    found, period = tolerances(header), float(header["period_s"])
    winders, told = machine.winders_of(header), header["machine"]
    most = transmission_bounds(winders)[1].max()
    bend = 4 * found["angle"] / period**2
    torque = most * found["tension"] + float((winders.inertia * NEWTON * bend + 2 * winders.friction).max())
    cable, slack = float(most * found["angle"]), told["cable_compliance_mm_n"] * found["tension"]
    gain = told["nozzle_gain_mm_mm"]
    return {"motor_angle_rad": found["angle"], "motor_speed_rad_s": found["angle"] / period, "torque_n_mm": torque,
            "tension_n": found["tension"], "cable_mm": cable, "nozzle_mm": gain * cable,
            "nozzle_read_mm": gain * (cable + slack)}


# ---- writing

def pack(rows: Rows, told: dict[str, Any]) -> bytes:
    """The payload of a block."""
    return zlib.compress(b"".join(part for group in told["groups"] for part in _pack_group(rows, group)), LEVEL)


def _pack_group(rows: Rows, group: dict[str, Any]) -> Iterator[bytes]:
    from cabslice.motors.formats.hermite_kernel import knots

    before, values, after = (_columns(block, group) for block in (rows.before, rows.block, rows.after))
    slopes = differences(before, values, after, 1.0)[0]
    v, s = _quanta(values, group["quantum"], group), _quanta(slopes, group["slope_quantum"], group)
    tight = np.full(group["channels"], group["tolerance"] - group["quantum"] / 2)
    at = knots(v * group["quantum"], s * group["slope_quantum"], tight)
    v, s = np.ascontiguousarray(v[at].T), np.ascontiguousarray(s[at].T)
    yield np.array(len(at), "<u4").tobytes() + np.stack((v[:, 0], s[:, 0]), axis=1).astype("<i8").tobytes()
    step = np.diff(at)
    yield from planes(zigzag(step - 1))
    yield from planes(zigzag(np.diff(s, axis=1)))
    yield from planes(zigzag(np.diff(v, axis=1) - _predicted(s, step, group)))


def _columns(block: Block, group: dict[str, Any]) -> Array:
    return getattr(block, group["name"]).reshape(len(block), -1)


def _quanta(values: Array, quantum: float, group: dict[str, Any]) -> Array:
    scaled = np.rint(values / quantum)
    if not (np.abs(scaled) < LARGEST / 4).all():
        raise OutputError(f"The {group['name']} column holds {np.abs(values).max():.6g}: too large for this format.")
    return scaled.astype(np.int64)


def _predicted(slopes: Array, step: Array, group: dict[str, Any]) -> Array:
    mean = (slopes[:, 1:] + slopes[:, :-1]) * (step * (group["slope_quantum"] / (2 * group["quantum"])))
    return np.rint(mean).astype(np.int64)


def zigzag(d: Array) -> Array:
    """Integers with small sizes of either sign as small ones >= 0: 2d, or -2d - 1 below 0."""
    return (d << 1) ^ (d >> 63)


def planes(z: Array) -> Iterator[bytes]:
    """1 byte P, then P byte planes of integers >= 0, lowest first."""
    z = z.view(np.uint64)
    count = (int(z.max()).bit_length() + 7) // 8 if z.size else 0
    yield bytes([count])
    raw = np.ascontiguousarray(z, "<u8").view(np.uint8).reshape(-1, 8)
    for plane in range(count):
        yield np.ascontiguousarray(raw[:, plane]).tobytes()


# ---- reading

def unpack(payload: memoryview, row: int, rows: int, told: dict[str, Any]) -> Block:
    """The block of a payload: angle, tension and filament at its rows; zeros in the columns that follow from them."""
    found: dict[str, Any] = {}
    at, payload = 0, memoryview(zlib.decompress(payload))
    for group in told["groups"]:
        values, at = _unpack_group(payload, at, rows, group)
        found[group["name"]] = values[:, 0] if group["name"] == "filament" else values
    nothing = np.zeros_like(found["angle"])
    return Block(row, velocity=nothing, torque=nothing, feed=np.zeros(rows), **found)


def _unpack_group(payload: memoryview, at: int, rows: int, group: dict[str, Any]) -> tuple[Array, int]:
    count, channels = int(np.frombuffer(payload, "<u4", 1, at)[0]), group["channels"]
    first = np.frombuffer(payload, "<i8", 2 * channels, at + 4).reshape(channels, 2)
    at += 4 + first.nbytes
    step, at = unzigzag(payload, at, 1, count - 1)
    rise, at = unzigzag(payload, at, channels, count - 1)
    rest, at = unzigzag(payload, at, channels, count - 1)
    s = np.concatenate((first[:, 1:], first[:, 1:] + np.cumsum(rise, axis=1)), axis=1)
    step = step[0] + 1
    v = np.cumsum(np.concatenate((first[:, :1], rest + _predicted(s, step, group)), axis=1), axis=1)
    knot = np.concatenate(([0], np.cumsum(step)))
    return evaluate(knot, v.T * group["quantum"], s.T * group["slope_quantum"], np.arange(rows)), at


def unzigzag(payload: memoryview, at: int, channels: int, count: int) -> tuple[Array, int]:
    """Integers (channels, count) of the planes at byte `at`, and where the next thing begins."""
    size, deep = channels * count, payload[at]
    at += 1
    raw = np.zeros((size, 8), np.uint8)
    for plane in range(deep):
        raw[:, plane] = np.frombuffer(payload, np.uint8, size, at)
        at += size
    z = raw.view("<u8").reshape(channels, -1).astype(np.uint64)
    return ((z >> np.uint64(1)) ^ (np.uint64(0) - (z & np.uint64(1)))).view(np.int64), at


def evaluate(knot: Array, value: Array, slope: Array, at: Array) -> Array:
    """Values (n, c) at rows `at` (n,), which need not be whole, of pieces with knots (K,), values and slopes (K, c)."""
    if len(knot) == 1:
        return np.repeat(value, len(at), axis=0)
    piece = np.clip(np.searchsorted(knot, at, side="right") - 1, 0, len(knot) - 2)
    h = (knot[piece + 1] - knot[piece]).astype(float)[:, None]
    x = (at - knot[piece])[:, None] / h
    y = 1 - x
    start = (1 + 2 * x) * y * y * value[piece] + x * y * y * h * slope[piece]
    return start + x * x * (3 - 2 * x) * value[piece + 1] - x * x * y * h * slope[piece + 1]


def finish(blocks: Iterable[Block], header: Mapping[str, Any]) -> Iterator[Block]:
    """The blocks with velocity, feed and torque."""
    winders, period = machine.winders_of(header), float(header["period_s"])
    for rows in neighbours(blocks):
        block, before, after = rows.block, rows.before, rows.after
        velocity, bend = differences(before.angle, block.angle, after.angle, period)
        torque = transmission(winders, block.angle) * block.tension + machine.moving(winders, velocity, bend)
        feed = differences(before.filament, block.filament, after.filament, period)[0]
        yield Block(block.row, block.angle, velocity, torque, block.tension, block.filament, feed=feed)


CODEC = Codec("hermite", MAGIC, layout, pack, unpack, finish)
write = partial(frames.write, CODEC)
read = partial(frames.read, CODEC)
