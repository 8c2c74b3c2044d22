"""The file formats of motor streams: a registry of one small writer and reader each, loaded when they are wanted.

A writer takes ``write(stream, path, *, overwrite, progress, resume)`` and returns the statistics of what it wrote;
nothing appears under `path` unless the whole stream went through. A reader takes ``read(path)`` and gives a lazy
MotorStream.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cabslice.errors import ProductError
from cabslice.motors.names import NAMES, Name, name_for
from cabslice.motors.statistics import StreamStatistics
from cabslice.motors.stream import MotorStream

SIDECAR = ".json"


class Writer(Protocol):
    def __call__(
        self, stream: MotorStream, path: Any, *, overwrite: bool = False,
        progress: Callable[[int], None] | None = None, resume: bool = False,
    ) -> StreamStatistics: ...


@dataclass(frozen=True)
class Format:
    about: Name

    @property
    def name(self) -> str:
        return self.about.name

    @property
    def suffix(self) -> str:
        return self.about.suffix

    @property
    def write(self) -> Writer:
        return self._module().write

    @property
    def read(self) -> Callable[[Any], MotorStream]:
        return self._module().read

    def refuse(self, header: Mapping[str, Any]) -> None:
        """Raises UsageError where a stream of such a header (cables, encoder) cannot be written, whatever its rows."""
        getattr(self._module(), "refuse", lambda header: None)(header)

    def files(self, path: Path) -> list[Path]:
        """All files that are written for `path`, which is the first."""
        from cabslice.motors.formats import table

        found = getattr(self._module(), "TABLE", None)
        return [path] if found is None else table.paths(found, path)

    def _module(self) -> Any:
        return importlib.import_module(f"cabslice.motors.formats.{self.about.module}")


class _Registry(Mapping[str, Format]):
    def __getitem__(self, name: str) -> Format:
        return Format(NAMES[name])

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)


FORMATS: Mapping[str, Format] = _Registry()


def format_for(path: Any, name: str | None = None) -> Format:
    """The format called `name`, else the one of the path's suffix. Raises UsageError listing what there is."""
    return Format(name_for(str(path), name))


def format_of(path: Any) -> Format | None:
    """The format a file is in, by its first bytes or its sidecar; None where it is no stream or cannot be read."""
    try:
        with open(path, "rb") as file:
            head = file.read(64)
    except OSError:
        return None
    found = next((name for name in NAMES.values() if name.begins and head.startswith(name.begins)), None)
    if found is None:
        found = NAMES.get(_told(Path(f"{path}{SIDECAR}")))
    return Format(found) if found else None


def _told(sidecar: Path) -> str:
    """The name of the format a sidecar speaks of; "" where there is none."""
    try:
        content = json.loads(sidecar.read_bytes())
    except (OSError, ValueError):
        return ""
    return str(content.get("format", "")) if isinstance(content, dict) else ""


def read(path: Any) -> MotorStream:
    """A stream file of any format. Raises ProductError naming the file and what was expected."""
    found = format_of(path)
    if found is None:
        name = Path(path).name
        raise ProductError(f"{name} cannot be read as a motor stream ({', '.join(FORMATS)}).", file=name)
    return found.read(path)
