"""G-code whose axes are the motors: firmware that only interpolates plays any robot, winders and elasticity included.

NAME.reprap.gcode and NAME.klipper.gcode. One axis a winder, 1 mm of it stands for 1 degree of the motor; E is filament,
mm, absolute. A line is a straight piece from a row (a knot) to a later row of the stream; rows between lie within the
tolerances (TOLERANCE_MM of cable, TENSION_N, FILAMENT_MM) of it. Lines of a block of rows:

    G1 F.. X.. Y.. ... E.. ;t1 t2 ...       a piece, and the planned tensions (N) at its end
    G4 P.. ;X.. Y.. ... E.. ;t1 t2 ...      nothing moves for so many ms
    M..., PAUSE                             events of the header (temperature, fan, pause, filament change) at their row

The first line of a block goes one row on from the block before; in the first block it is G92 (a comment for Klipper):
where the motors stand. The head holds the lines of the machine's configuration as comments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.motors.formats.csv import decimals
from cabslice.motors.formats.table import DEGREES, Table
from cabslice.motors.formats.writing import Rows
from cabslice.robot.winder import transmission_bounds

PLACES = {"angle": 4, "filament": 5, "tension": 2}       # degrees, mm, N
TOLERANCE_MM, TENSION_N, FILAMENT_MM = 0.005, 0.05, 0.005
HALF = 0.51                                              # of the last place: rounding, and that of interpolation


@dataclass(frozen=True)
class Dialect:
    """What one firmware wants otherwise than another."""

    name: str
    title: bytes                                             # first line of the file
    letters: str                                             # of the axes
    feed: Callable[[Array, Array], Array]                    # F of steps (K, c) in seconds (K,)
    seconds: Callable[[Array, Array], Array]                 # of steps (K, c) with F (K,)
    begin: Callable[[Mapping[str, Any]], list[str]]          # configuration (as comments) and first commands
    stand: bytes                                             # before the positions the motors begin at
    end: bytes
    pause: str


def tolerances(header: Mapping[str, Any]) -> tuple[float, float, float]:
    """Largest deviation at any row: motor angle rad, filament mm, tension N."""
    from cabslice.motors import machine

    radius = float(transmission_bounds(machine.winders_of(header))[1].max())
    return TOLERANCE_MM / radius, FILAMENT_MM, TENSION_N


# ---- writing

def encode(dialect: Dialect, rows: Rows, header: Mapping[str, Any]) -> list[bytes]:
    block, period = rows.block, float(header["period_s"])
    told = _events(header, block.row, len(block))
    at = _knots(rows, header, [row for row, _, _ in told])
    now, before = _rounded(block, at), _rounded(rows.before, np.zeros(1, np.int64))
    before = now[:1] if block.row == 0 else before
    steps = np.diff(np.concatenate((before, now)), axis=0)
    seconds = np.diff(at, prepend=at[0] - 1) * period
    tension = np.rint(block.tension[at] * 10.0 ** PLACES["tension"]) / 10.0 ** PLACES["tension"]
    lines = _lines(dialect, now, steps, seconds, tension)
    if block.row == 0:
        lines[0] = dialect.stand + lines[0].split(b";", 1)[1]
    text = b"".join(_with_events(dialect, lines, at, told))
    return [text + (dialect.end if block.row + len(block) == header["rows"] else b"")]


def _knots(rows: Rows, header: Mapping[str, Any], forced: list[int]) -> Array:
    from cabslice.motors.formats.chords import chords

    block, (angle, fed, tension) = rows.block, tolerances(header)
    m = block.angle.shape[1]
    values = np.hstack((block.angle * DEGREES, block.filament[:, None], block.tension))
    rounding = [10.0 ** -PLACES[name] * HALF for name in ("angle", "filament", "tension")]
    limits = [angle * DEGREES, *[fed], tension]
    tol = np.repeat([limit - miss for limit, miss in zip(limits, rounding, strict=True)], (m, 1, m))
    must = np.zeros(len(block), np.bool_)
    must[forced] = True
    return chords(values, tol, must)


def _rounded(block: Any, at: Array) -> Array:
    """Angles in degrees and filament (K, m + 1) as they are written."""
    angle = np.rint(block.angle[at] * DEGREES * 10.0 ** PLACES["angle"]) / 10.0 ** PLACES["angle"]
    fed = np.rint(block.filament[at] * 10.0 ** PLACES["filament"]) / 10.0 ** PLACES["filament"]
    return np.hstack((angle, fed[:, None]))


def _lines(dialect: Dialect, now: Array, steps: Array, seconds: Array, tension: Array) -> list[bytes]:
    """A line for each knot."""
    words = _words(now, dialect.letters)
    forces = decimals(tension, PLACES["tension"])
    forces[forces == ord(",")] = ord(" ")
    forces[:, -1] = ord("\n")
    tail = [row.tobytes().translate(None, b"\0") for row in np.hstack((words, forces))]
    still = ~steps.any(axis=1)
    feed = dialect.feed(steps[~still], seconds[~still])
    heads = np.empty(len(now), object)
    heads[~still] = [b"G1 F%s " % (b"%.8g" % value) for value in feed]
    heads[still] = [b"G4 P%s ;" % (b"%.8g" % (value * 1e3)) for value in seconds[still]]
    return [head + rest for head, rest in zip(heads, tail, strict=True)]


def _words(now: Array, letters: str) -> Array:
    """(K, width) characters: "X1.2345 Y... E...;", NUL where nothing stands."""
    m = now.shape[1] - 1
    columns = []
    for i, letter in enumerate([*letters[:m], "E"]):
        text = decimals(now[:, [i]], PLACES["angle"] if i < m else PLACES["filament"])
        text[:, -1] = ord(" " if i < m else ";")
        columns += [np.full((len(now), 1), ord(letter), np.uint8), text]
    return np.hstack(columns)


def _events(header: Mapping[str, Any], first: int, rows: int) -> list[tuple[int, str, float]]:
    """Row within the block, kind and value of what is switched there."""
    told = header.get("events") or {"row": [], "kind": [], "value": []}
    listed = zip(told["row"], told["kind"], told["value"], strict=True)
    return [(row - first, kind, value) for row, kind, value in listed
            if first <= row < first + rows and kind in ("nozzle_c", "bed_c", "fan", "pause", "filament_change")]


def _with_events(
    dialect: Dialect, lines: list[bytes], at: Array, told: list[tuple[int, str, float]]
) -> Iterator[bytes]:
    """The lines, with what is switched at a row after the line that comes to it."""
    begun = 0
    for row, kind, value in told:
        until = int(np.searchsorted(at, row)) + 1
        yield from lines[begun:until]
        begun = max(begun, until)
        wait = lines[0].startswith(dialect.stand) and row == 0
        yield _command(dialect, kind, value, wait).encode() + b"\n"
    yield from lines[begun:]


def _command(dialect: Dialect, kind: str, value: float, wait: bool) -> str:
    if kind == "fan":
        return f"M106 S{round(255 * value)}"
    if kind in ("pause", "filament_change"):
        return dialect.pause if kind == "pause" else "M600"
    code = {"nozzle_c": ("M104", "M109"), "bed_c": ("M140", "M190")}[kind][wait]
    return f"{code} S{value:g}"


# ---- reading

def decode(dialect: Dialect, parts: list[bytes], header: Mapping[str, Any]) -> dict[str, Array]:
    m, period = int(header["cables"]), float(header["period_s"])
    values = _numbers(dialect, parts[0])
    now, tension = values[:, 2 : m + 3], values[:, m + 3 :]
    if tension.shape[1] != m:
        raise ValueError(f"its lines hold {values.shape[1]} numbers, expected {2 * m + 3}")
    steps = np.diff(now, axis=0, prepend=now[:1])
    still = values[:, 0] != 1
    seconds = np.empty(len(now))
    seconds[still] = values[still, 1] / 1e3
    seconds[~still] = dialect.seconds(steps[~still], values[~still, 1])
    at = np.concatenate(([0], np.cumsum(np.rint(seconds[1:] / period)))).astype(np.int64)
    row = np.arange(at[-1] + 1)
    columns = [np.interp(row, at, column) for column in np.hstack((now, tension)).T]
    return {"angle": np.array(columns[:m]).T / DEGREES, "filament": columns[m], "tension": np.array(columns[m + 1 :]).T}


def _numbers(dialect: Dialect, text: bytes) -> Array:
    """A row for each knot: 1 or 4, F or P, positions, tensions."""
    lines = text.split(b"\n")
    if lines[0].startswith(dialect.stand):
        lines[0] = b"G4 P0 ;" + lines[0].removeprefix(dialect.stand)
    letters = b"GFPE;" + dialect.letters.encode()
    plain = bytes.maketrans(letters, b" " * len(letters))
    kept = [line.translate(plain).decode("ascii") for line in lines if line[:3] in (b"G1 ", b"G4 ")]
    return np.loadtxt(kept, ndmin=2, comments=None)


# ---- both

def per_rad(header: Mapping[str, Any]) -> Array:
    return np.full(header["cables"], DEGREES)


def columns(dialect: Dialect, header: Mapping[str, Any]) -> list[str]:
    return [*(f"{letter}, degrees" for letter in dialect.letters[: header["cables"]]), "E, mm"]


def misses(header: Mapping[str, Any]) -> dict[str, Any]:
    angle, _, tension = tolerances(header)
    return {"angle": np.full(header["cables"], angle), "tension": tension}


def head(dialect: Dialect, header: Mapping[str, Any]) -> bytes:
    refuse(dialect, header)
    lines = dialect.begin(header)
    return dialect.title + "".join(f"{line}\n" for line in lines).encode()


def refuse(dialect: Dialect, header: Mapping[str, Any]) -> None:
    if header["cables"] > len(dialect.letters):
        raise UsageError(f"{dialect.name} has {len(dialect.letters)} axes, not {header['cables']}: use another format.")


def about(header: Mapping[str, Any]) -> dict[str, Any]:
    angle, fed, tension = tolerances(header)
    return {"tolerances": {"motor_angle_rad": angle, "filament_mm": fed, "tension_n": tension}}


def table_of(dialect: Dialect) -> Table:
    return Table(
        dialect.name, ("motion",), partial(encode, dialect), partial(decode, dialect), partial(columns, dialect),
        per_rad, "deg", misses, head=partial(head, dialect), about=about,
    )


# ---- configuration

def limits(header: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Of each motor: steps per degree (None where the profile has no counts), degrees/s, lowest and highest angle."""
    told = header["machine"]["winders"]
    counts = header.get("encoder_counts_per_turn") or [None] * header["cables"]
    return [
        {"steps": count and count / 360, "speed": float(speed * DEGREES),
         "low": None if low is None else low * DEGREES, "high": None if high is None else high * DEGREES}
        for count, speed, (low, high) in zip(counts, told["max_speed"], told["span"], strict=True)
    ]
