r"""Tables for drives: nothing but set-points in the file, everything else in a sidecar NAME.json beside it.

The sidecar, JSON with sorted keys:
    kind "cabslice sidecar", schema, format, rows, block_rows
    axes      name, unit, per_rad (units per motor rad; 1 for the extruder, in mm), zero_rad, first, last: what the
              first and the last row say
    columns   what stands in a row, in order                        bounds   what rounding costs (see `bounds`)
    files     of each: content, bytes, sha256, and for each block of rows where it ends and its CRC-32
    header    that of the stream                                    sha256   of this JSON without the key sha256

What a table leaves out follows on reading from what it holds, by the definitions of motors.stream: velocity and
acceleration are differences of the angle, feed those of the filament, tension is what the torque leaves for the cable
(or the torque what tension and motion ask for).
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import OutputError, ProductError
from cabslice.motors import machine
from cabslice.motors.formats import writing
from cabslice.motors.formats.reading import damaged
from cabslice.motors.formats.writing import BLOCK_ROWS, Rows, Sum, differences, neighbours
from cabslice.motors.statistics import StreamStatistics
from cabslice.motors.stream import SCHEMA, Block, MotorStream
from cabslice.robot.model import NEWTON
from cabslice.robot.winder import transmission_bounds

KIND, SIDECAR = "cabslice sidecar", ".json"
N_M = 1e-3                     # N m per N mm
DEGREES = 180 / np.pi
DERIVED = ("velocity", "torque", "tension", "feed")


@dataclass(frozen=True)
class Table:
    """One format: what a row holds and how it is written."""

    name: str
    contents: tuple[str, ...]                               # of its files, the main one first
    encode: Callable[[Rows, Mapping[str, Any]], list[bytes]]
    decode: Callable[[list[bytes], Mapping[str, Any]], dict[str, Array]]     # raises ValueError
    columns: Callable[[Mapping[str, Any]], list[str]]       # names of what stands in a row of the main file
    per_rad: Callable[[Mapping[str, Any]], Array]           # (m,) units of position per motor rad
    unit: str
    misses: Callable[[Mapping[str, Any]], dict[str, Any]]   # column: largest rounding error, in units of the stream
    head: Callable[[Mapping[str, Any]], bytes] = lambda header: b""
    about: Callable[[Mapping[str, Any]], dict[str, Any]] = lambda header: {}


def paths(table: Table, path: Path) -> list[Path]:
    """Main file, further files, sidecar."""
    more = [path.with_name(f"{path.stem}.{content}{path.suffix}") for content in table.contents[1:]]
    return [path, *more, path.with_name(path.name + SIDECAR)]


# ---- writing

def write(table: Table, stream: MotorStream, path: Any, **options: Any) -> StreamStatistics:
    """Write a table and its sidecar (see writing.write for the options and errors)."""
    return writing.write(_Encoder(table, stream), stream, path, **options)


class _Encoder:
    of_all = "sha"

    def __init__(self, table: Table, stream: MotorStream) -> None:
        self.table, self.stream, self.name = table, stream, table.name

    def paths(self, path: Path) -> list[Path]:
        return paths(self.table, path)

    def head(self, block: Block) -> list[bytes]:
        more = [b""] * (len(self.table.contents) - 1)
        return [self.table.head(self.stream.header), *more, b""]

    def rows(self, rows: Rows) -> list[bytes]:
        return [*self.table.encode(rows, self.stream.header), b""]

    def tail(self, sums: list[Sum]) -> list[bytes]:
        return [*(b"" for _ in self.table.contents), sidecar(self.table, self.stream.header, sums[:-1])]


def sidecar(table: Table, header: Mapping[str, Any], sums: list[Sum]) -> bytes:
    """The sidecar of files whose head and blocks are summed in `sums`."""
    files = [
        {"content": content, "bytes": known.size, "sha256": known.sha.hexdigest(), "ends": known.ends,
         "crc32": known.crcs}
        for content, known in zip(table.contents, sums, strict=True)
    ]
    content = {
        "kind": KIND, "schema": SCHEMA, "format": table.name, "rows": header["rows"], "block_rows": BLOCK_ROWS,
        "axes": axes(table, header), "columns": table.columns(header), "bounds": bounds(header, table.misses(header)),
        "files": files, "header": dict(header), **table.about(header),
    }
    return _text({**content, "sha256": _digest(content)})


def axes(table: Table, header: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The axes in the order of their columns: the winders, then the extruder."""
    scale = table.per_rad(header)
    first, last = np.array(header["start_angles_rad"]) * scale, header.get("end_angles_rad")
    ends = [None] * len(scale) if last is None else (np.array(last) * scale).tolist()
    rows = [
        {"name": f"winder {i + 1}", "unit": table.unit, "per_rad": float(scale[i]), "zero_rad": 0.0,
         "first": float(first[i]), "last": ends[i]}
        for i in range(len(scale))
    ]
    return [*rows, {"name": "extruder", "unit": "mm", "per_mm": 1.0, "first": 0.0}]


def bounds(header: Mapping[str, Any], misses: Mapping[str, Any]) -> dict[str, float]:
    """What rounding costs at most. misses: column -> largest error, in units of the stream.

    motor_angle_rad, cable_mm, nozzle_mm: of the angles that are played. nozzle_read_mm: of the nozzle found from the
    file alone, which takes its tensions from it as well.
    """
    winders, period = machine.winders_of(header), float(header["period_s"])
    least, most = transmission_bounds(winders)
    angle = np.asarray(misses["angle"], float)
    tension = misses.get("tension")
    if tension is None:
        speed = np.minimum(misses.get("velocity", angle / period) / machine.CREEP, 2.0)
        torque = misses["torque"] + winders.inertia * NEWTON * 4 * angle / period**2 + winders.friction * speed
        tension = torque / least
    gain, cable = header["machine"]["nozzle_gain_mm_mm"], float((most * angle).max())
    slack = header["machine"]["cable_compliance_mm_n"] * float(np.max(tension))
    return {"motor_angle_rad": float(angle.max()), "cable_mm": cable, "nozzle_mm": gain * cable,
            "nozzle_read_mm": gain * (cable + slack)}


def largest_angles(header: Mapping[str, Any]) -> Array:
    """Largest motor angle (m,) rad that each winder is known for, or is at home at."""
    told = header["machine"]
    ends = zip(told["winders"]["span"], told["home"]["angles_rad"], strict=True)
    return np.array([max(abs(x) for x in (*span, home) if x is not None) for span, home in ends])


def integers(values: Array, dtype: str, what: str) -> Array:
    """Values rounded to integers of a type. Raises OutputError where one does not fit."""
    limits, rounded = np.iinfo(dtype), np.rint(values)
    if rounded.size and (rounded.max() > limits.max or rounded.min() < limits.min):
        worst = float(rounded.flat[np.argmax(np.abs(rounded))])
        raise OutputError(f"{what}: {worst:.6g} is too large; this format holds {limits.min} to {limits.max}.")
    return rounded.astype(dtype)


def _text(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True, allow_nan=False, indent=None).encode() + b"\n"


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(_text(content)).hexdigest()


# ---- reading

def read(table: Table, path: Any) -> MotorStream:
    """A lazy stream of a table and its sidecar; each pass reads and checks block by block.

    Raises ProductError at once where the sidecar is missing, damaged or of another file, and on the way for a damaged
    block, naming its rows.
    """
    path = Path(path)
    content = _sidecar(table, path)
    for file, row in zip(paths(table, path)[:-1], content["files"], strict=True):
        size = file.stat().st_size if file.is_file() else -1
        if size < 0:
            raise ProductError(f"{path.name} is not whole without {file.name}, which is missing.", file=path.name)
        if size != row["bytes"]:
            damaged(file, f"it has {size} bytes, its sidecar says {row['bytes']}")
    return MotorStream(content["header"], partial(_blocks, table, path, content))


def _sidecar(table: Table, path: Path) -> dict[str, Any]:
    file = path.with_name(path.name + SIDECAR)
    try:
        content = json.loads(file.read_bytes())
    except OSError as error:
        sentence = f"{path.name} cannot be read without its sidecar {file.name}: {error.strerror}."
        raise ProductError(sentence, file=path.name) from error
    except ValueError as error:
        damaged(file, f"it is not JSON ({error})")
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise ProductError(f"{file.name} is not a sidecar of cabslice.", file=file.name)
    if content.get("schema") != SCHEMA:
        damaged(file, f"it has schema {content.get('schema')}, this cabslice reads schema {SCHEMA}")
    digest = content.pop("sha256", None)
    if digest != _digest(content) or file.read_bytes() != _text({**content, "sha256": digest}):
        damaged(file, "its content does not match its checksum")
    if content["format"] != table.name:
        raise ProductError(f"{file.name} speaks of {content['format']}, not {table.name}.", file=file.name)
    return content


def _blocks(table: Table, path: Path, content: dict[str, Any]) -> Iterator[Block]:
    header = content["header"]
    known, raw = _known(table, header), _raw(table, path, content)
    missing = [name for name in DERIVED if name not in known]
    winders = machine.winders_of(header) if {"tension", "torque"} & set(missing) else None
    for rows in neighbours(raw):
        yield completed(rows, missing, float(header["period_s"]), winders)


def _known(table: Table, header: Mapping[str, Any]) -> set[str]:
    """Columns the table itself holds."""
    return set(table.misses(header)) | {"angle", "filament"}


def _raw(table: Table, path: Path, content: dict[str, Any]) -> Iterator[Block]:
    """Blocks as the files have them; zeros where they say nothing."""
    row, total, header = 0, int(content["rows"]), content["header"]
    with ExitStack() as stack:
        files = [stack.enter_context(open(file, "rb")) for file in paths(table, path)[:-1]]
        for number in range(len(content["files"][0]["ends"])):
            parts = [_part(file, told, number, row) for file, told in zip(files, content["files"], strict=True)]
            if not number:
                continue
            count = min(BLOCK_ROWS, total - row)
            try:
                columns = table.decode(parts, header)
                yield _block(row, count, int(header["cables"]), columns)
            except ValueError as error:
                damaged(path, f"block {number - 1} of rows (from row {row}) does not hold {count} rows ({error})")
            row += count
    if row != total:
        damaged(path, f"its {row} rows are not the {total} its sidecar says")


def _part(file: Any, told: dict[str, Any], number: int, row: int) -> bytes:
    start = told["ends"][number - 1] if number else 0
    part = file.read(told["ends"][number] - start)
    if zlib.crc32(part) != told["crc32"][number]:
        what = f"block {number - 1} of rows (from row {row}, byte {start})" if number else "its first line"
        damaged(Path(file.name), f"{what} does not match its checksum")
    return part


def _block(row: int, count: int, cables: int, columns: dict[str, Array]) -> Block:
    zeros = {name: np.zeros((count, cables)) for name in ("velocity", "torque", "tension")}
    return Block(row, **{**zeros, "feed": np.zeros(count), **columns})


def completed(rows: Rows, missing: list[str], period_s: float, winders: Any) -> Block:
    """The block with the columns it lacks, from those it has."""
    block, before, after = rows.block, rows.before, rows.after
    new: dict[str, Any] = {}
    velocity, acceleration = differences(before.angle, block.angle, after.angle, period_s)
    if "velocity" in missing:
        new["velocity"] = velocity
    if "feed" in missing:
        new["feed"] = differences(before.filament, block.filament, after.filament, period_s)[0]
    speed = new.get("velocity", block.velocity)
    if "torque" in missing:
        new["torque"] = machine.torque(winders, block.angle, speed, acceleration, block.tension)
    if "tension" in missing:
        new["tension"] = machine.tension(winders, block.angle, speed, acceleration, block.torque)
    return replace(block, **new)
