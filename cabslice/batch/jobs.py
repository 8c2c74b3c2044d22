"""What a batch is asked to make: every part on every printer, or the rows of a jobs.toml.

    jobs.toml   [defaults]   keys that hold for every job that does not say otherwise
                [[job]]      part = "a.stl" (or "*.stl", relative to the file), and any key of Row
"""

from __future__ import annotations

import difflib
import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cabslice import __version__, pipeline, store
from cabslice.errors import ModelError, ProfileError, UsageError
from cabslice.motors.names import name_for
from cabslice.pipeline import Placement, Profiles
from cabslice.profile import shelf
from cabslice.profile.toml import line_of

Pair = tuple[float, float]
Triple = tuple[float, float, float]


PLACING = ("unit", "scale", "turn_deg", "at_mm", "copies", "gap_mm", "sequence",
           "support_blockers", "support_enforcers")


class Row(BaseModel):
    """A table of a jobs.toml; also what the options of the command line say for every part."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    printers: tuple[str, ...] = Field(default=(), description="names or files; every part is made for each")
    material: str | None = None
    process: str | None = None
    set: tuple[str, ...] = Field(default=(), description="table.key=value, as -s")
    unit: Literal["mm", "cm", "m", "inch", "ft"] = "mm"
    scale: float = Field(default=1.0, gt=0)
    turn_deg: Triple = (0.0, 0.0, 0.0)
    at_mm: Pair | None = None
    copies: int = Field(default=1, ge=1, le=10_000, description="of the part, on one bed")
    gap_mm: float | None = Field(default=None, ge=0, description="air between copies, as --gap")
    sequence: Literal["layers", "objects"] = "layers"
    support_blockers: tuple[str, ...] = Field(default=(), description="meshes, as --support-blocker")
    support_enforcers: tuple[str, ...] = Field(default=(), description="meshes, as --support-enforcer")
    format: str = "stream"
    period_ms: float | None = Field(default=None, ge=0.25, le=50)


class Asked(Row):
    part: str = Field(description="a file, or a pattern that names several; relative to the jobs.toml")
    name: str | None = Field(default=None, min_length=1, description="of the output, without suffix")


@dataclass(frozen=True)
class Wanted:
    """One part for one printer, as asked: nothing of it is read yet."""

    name: str                    # of the output, without suffix
    part: str
    printer: str
    row: Row


@dataclass(frozen=True)
class Job:
    """One part for one printer with all that its bytes depend on, but the part itself, which is a file."""

    name: str
    part: str
    sha256: str                  # of the part
    profiles: tuple[str, str, str]          # printer, material, process: checked JSON
    placement: Placement
    format: str
    period_ms: float | None
    blockers: tuple[str, ...] = ()
    enforcers: tuple[str, ...] = ()
    meshes: tuple[str, ...] = ()            # sha256 of blockers and enforcers
    version: str = __version__

    @property
    def key(self) -> str:
        """Two jobs with the same key give the same record and the same bytes."""
        told = [self.name, Path(self.part).name, self.sha256, self.profiles, list(vars(self.placement).values()),
                len(self.blockers), self.meshes, self.format, self.period_ms, self.version]
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def of_parts(parts: Iterable[str], row: Row) -> list[Wanted]:
    """Every part for every printer of `row`. Raises UsageError."""
    return _named([(part, None, row) for part in parts])


def of_file(path: Path) -> list[Wanted]:
    """The jobs of a jobs.toml. Raises ProfileError with all faults of the file."""
    try:
        text = path.read_bytes().decode()
        values = tomllib.loads(text)
    except OSError as error:
        raise ProfileError(str(path), [f"cannot be read: {error.strerror}"]) from error
    except ValueError as error:
        raise ProfileError(str(path), [f"is no TOML: {error}"]) from error
    faults = [f"{key}: unknown key; expected [defaults] and [[job]]" for key in values.keys() - {"defaults", "job"}]
    jobs = values.get("job")
    defaults = values.get("defaults", {})
    if not isinstance(jobs, list) or not jobs or not isinstance(defaults, dict):
        raise ProfileError(str(path), [*faults, "expected [[job]] tables, one for each part, each with part = ..."])
    faults += list(_faults(Row, defaults, text, ("defaults",)))
    rows = [row if isinstance(row, dict) else {} for row in jobs]
    for index, row in enumerate(rows):
        faults += list(_faults(Asked, row, text, ("job", index)))
    if faults:
        raise ProfileError(str(path), faults)
    asked = [Asked.model_validate({**defaults, **row}) for row in rows]
    return _named([(part, row.name, _beside(row, path)) for row in asked for part in _matching(row.part, path)])


def _faults(kind: type[Row], values: Mapping[str, Any], text: str, place: tuple[str | int, ...]) -> Iterator[str]:
    """Each fault of a table as one sentence, with its line."""
    try:
        kind.model_validate(values)
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            key = str(fault["loc"][0])
            line = line_of(text, (*place, key))
            near = difflib.get_close_matches(key, kind.model_fields, n=1) if fault["type"] == "extra_forbidden" else []
            words = "unknown key" if fault["type"] == "extra_forbidden" else fault["msg"]
            hint = f"; did you mean {near[0]}?" if near else ""
            yield f"{'.'.join(str(part) for part in (place[0], key))} (line {line}): {words}{hint}"


def _beside(row: Row, path: Path) -> Row:
    """Profiles that are files lie beside the jobs.toml."""
    def file(ref: str) -> str:
        return str(path.parent / ref) if ref.endswith(".toml") else ref

    return row.model_copy(update={
        "printers": tuple(map(file, row.printers)), "material": row.material and file(row.material),
        "process": row.process and file(row.process),
        "support_blockers": tuple(str(path.parent / mesh) for mesh in row.support_blockers),
        "support_enforcers": tuple(str(path.parent / mesh) for mesh in row.support_enforcers),
    })


def _matching(part: str, path: Path) -> list[str]:
    """Files of a pattern in order; what names none stays as it is, to be told as missing."""
    whole = str(path.parent / part)
    return sorted(glob(whole)) or [whole]


def _named(parts: list[tuple[str, str | None, Row]]) -> list[Wanted]:
    """One Wanted for each part and printer; no two of one name. Raises UsageError where no printer is known."""
    found: list[Wanted] = []
    taken: dict[str, int] = {}
    for part, name, row in parts:
        printers = row.printers or ((shelf.default_printer() or "",))
        for printer in printers:
            if not printer:
                raise UsageError(f"Which printer? Give -p one of: {', '.join(shelf.names('printers'))}.")
            plain = name or Path(part).stem
            plain = f"{plain}-{Path(printer).stem}" if len(printers) > 1 else plain
            taken[plain] = taken.get(plain, 0) + 1
            found.append(Wanted(plain if taken[plain] == 1 else f"{plain}-{taken[plain]}", part, printer, row))
    _distinct(found)
    return found


def _distinct(found: list[Wanted]) -> None:
    names = [wanted.name for wanted in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UsageError(f"Several jobs would be called {twice[0]}: give each a name in a jobs.toml.")
    if odd := [name for name in names if Path(name).name != name or name.startswith(".")]:
        raise UsageError(f"{odd[0]!r} is no name for an output: expected a file name without folder.")


def ready(wanted: Wanted, known: dict[Any, Profiles] | None = None) -> Job:
    """Read the profiles and hash the part; `known` remembers profiles. Raises what is wrong with them."""
    row, path = wanted.row, Path(wanted.part)
    name_for(wanted.name, row.format)
    sha256 = _hash(path)
    _refuse_placing(path, row)
    known = {} if known is None else known
    profiles = _of_product(path, wanted) if store.is_product(path) else _profiles(wanted, known)
    texts = [model.model_dump_json(by_alias=True) for model in (profiles.printer, profiles.material, profiles.process)]
    placement = Placement(
        row.unit, row.scale, row.turn_deg, row.at_mm, copies=row.copies, gap_mm=row.gap_mm, sequence=row.sequence)
    meshes = tuple(_hash(Path(mesh)) for mesh in (*row.support_blockers, *row.support_enforcers))
    return Job(wanted.name, wanted.part, sha256, (texts[0], texts[1], texts[2]), placement, row.format, row.period_ms,
               row.support_blockers, row.support_enforcers, meshes)


def _hash(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ModelError(f"{path.name} cannot be read: {error.strerror}.", file=path.name) from error


def _refuse_placing(path: Path, row: Row) -> None:
    """G-code lies where it lies."""
    if path.suffix.lower() in pipeline.GCODE:
        given = [key for key in PLACING if getattr(row, key) != getattr(Row(), key)]
        if given:
            raise UsageError(f"{path.name} is G-code: {given[0]} is for a part; slice it again.")


def _profiles(wanted: Wanted, known: dict[Any, Profiles]) -> Profiles:
    row = wanted.row
    key = wanted.printer, row.material, row.process, row.set
    if key not in known:
        known[key] = pipeline.load_profiles(*key)
    return known[key]


def _of_product(path: Path, wanted: Wanted) -> Profiles:
    """The profiles a product carries, with the printer it is wanted for."""
    row = wanted.row
    plain = Row(printers=row.printers, format=row.format, period_ms=row.period_ms, set=row.set)
    printer_sets, *others = shelf.split_sets(row.set)
    if row != plain or any(others):
        raise UsageError(f"{path.name} has its own material, process and place: only the printer may be another one.")
    product = store.load(path)[1]
    printer = shelf.load_printer(wanted.printer, printer_sets)
    own = pipeline.profiles_of(product.origin)
    if printer == own.printer:
        return own
    if isinstance(product, store.Planned):
        raise UsageError(f"{path.name} is planned for {own.printer.name}: for another printer start from its path.")
    return pipeline.profiles_of(pipeline.for_printer(product, printer).origin)
