"""The file formats of motor streams: a registry of one small writer and reader each.

A writer takes ``write(stream, path, *, overwrite, progress)`` and returns the statistics of what it wrote; nothing
appears under `path` unless the whole stream went through. A reader takes ``read(path)`` and gives a lazy MotorStream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cabslice.errors import ProductError, UsageError
from cabslice.motors.formats import binary, csv
from cabslice.motors.statistics import StreamStatistics
from cabslice.motors.stream import MotorStream


class Writer(Protocol):
    def __call__(
        self, stream: MotorStream, path: Any, *, overwrite: bool = False, progress: Callable[[int], None] | None = None
    ) -> StreamStatistics: ...


@dataclass(frozen=True)
class Format:
    name: str
    suffix: str
    about: str
    begins: bytes               # first bytes of every file
    write: Writer
    read: Callable[[Any], MotorStream]


FORMATS = {
    row.name: row
    for row in (
        Format("stream", ".stream", "compact binary with checksums (default)", binary.MAGIC, binary.write, binary.read),
        Format("csv", ".csv", "text: a header of '# key: value', then one line a row", csv.MAGIC, csv.write, csv.read),
    )
}


def format_for(path: Any, name: str | None = None) -> Format:
    """The format called `name`, else the one of the path's suffix. Raises UsageError listing what there is."""
    if name is not None:
        if name not in FORMATS:
            raise UsageError(f"There is no stream format {name!r}; there are {', '.join(FORMATS)}.")
        return FORMATS[name]
    suffix = Path(path).suffix.lower()
    for row in FORMATS.values():
        if row.suffix == suffix:
            return row
    listed = ", ".join(f"{row.suffix} ({row.name})" for row in FORMATS.values())
    raise UsageError(f"{path}: no stream format has the suffix {suffix!r}; there are {listed}, or say --format.")


def format_of(path: Any) -> Format | None:
    """The format a file is in by its first bytes; None where it is no stream or cannot be read."""
    try:
        with open(path, "rb") as file:
            head = file.read(64)
    except OSError:
        return None
    return next((row for row in FORMATS.values() if head.startswith(row.begins)), None)


def read(path: Any) -> MotorStream:
    """A stream file of any format. Raises ProductError naming the file and what was expected."""
    found = format_of(path)
    if found is None:
        name = Path(path).name
        raise ProductError(f"{name} cannot be read as a motor stream ({', '.join(FORMATS)}).", file=name)
    return found.read(path)
