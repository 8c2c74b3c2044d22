"""A process and a material out of the settings of another slicer: PrusaSlicer's, Cura's and OrcaSlicer's.

Only what the file says is written down; all else is inherited from the shipped process for the same nozzle and the
shipped material of the same kind. Keys that have no counterpart here are named.
"""

from __future__ import annotations

import configparser
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cabslice.errors import ProfileError
from cabslice.profile import shelf
from cabslice.profile.faults import checked
from cabslice.profile.imported import name_from
from cabslice.profile.orca import orca_settings
from cabslice.profile.reader import Sheet, merge
from cabslice.profile.slicer_keys import CURA, PRUSA, Rule, Settings
from cabslice.profile.toml import Place, dump

SUFFIXES = (".ini", ".gcode", ".gco", ".curaprofile", ".cfg", ".json")
PRUSA_LINE = re.compile(r"^;?\s*([a-z][a-z0-9_]+)\s*=\s?(.*)$")


@dataclass(frozen=True)
class Taken:
    """Checked process and material, each with its text as a profile file; keys of the file that were not taken."""

    process: Any
    process_toml: str
    material: Any
    material_toml: str
    left_out: tuple[str, ...]


@dataclass
class _Draft:
    values: dict[str, Any] = field(default_factory=dict)
    notes: dict[Place, str] = field(default_factory=dict)

    def put(self, place: Place, value: Any, note: str) -> None:
        table = self.values
        for part in place[:-1]:
            table = table.setdefault(str(part), {})
        table[str(place[-1])] = value
        self.notes[place] = note


def read_settings(path: Path, name: str | None = None) -> Taken:
    """The settings in an .ini or G-code of PrusaSlicer, a .curaprofile, .cfg or G-code of Cura, a .json of OrcaSlicer.

    Raises ProfileError: no settings in it, or values that a profile refuses.
    """
    texts, rules, slicer = _read(path)
    settings = Settings(texts)
    base, first = name_from(name or path.stem), f"imported from {slicer} settings in {path.name}"
    process, material = _Draft(), _Draft()
    used: set[str] = set()
    for rule in rules:
        value = rule.value(settings)
        if value is not None:
            used |= set(rule.keys)
            (material if rule.of_material else process).put(rule.place, value, ", ".join(rule.keys))
    kind = (settings.text("filament_type") or "").lower()
    used |= settings.asked
    made = _finish("processes", process, base, _process_parent(process.values), first)
    parent = kind if kind in shelf.names("materials") else "pla"
    other = _finish("materials", material, f"{base}-material", parent, first)
    return Taken(*made, *other, tuple(sorted(set(texts) - used)))


def _process_parent(values: Mapping[str, Any]) -> str:
    """The shipped process for the nozzle, else that for 0.4 mm."""
    named = f"standard-{values.get('nozzle_mm', 0.4):g}"
    return named if named in shelf.names("processes") else "standard-0.4"


def _finish(kind: str, draft: _Draft, name: str, parent: str, source: str) -> tuple[Any, str]:
    values = {"schema": 1, "name": name, "inherits": parent, "description": source, "source": source} | draft.values
    sheets = [*shelf.chain(kind, parent), Sheet(name, values)]
    model = checked(kind, merge(sheets, cables=False))
    return model, dump(values, lambda place: draft.notes.get(place, ""))


def _read(path: Path) -> tuple[dict[str, str], tuple[Rule, ...], str]:
    """Settings by name, how they are read, and the slicer's name."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ProfileError(str(path), [f"cannot be read: {error.strerror}"]) from error
    for reader, rules, slicer in _readers(path, data):
        if found := reader():
            return found, rules, slicer
    raise ProfileError(str(path), [
        "no settings in it; expected an .ini or G-code of PrusaSlicer, a .curaprofile, .cfg or G-code of Cura, or a "
        "process or filament .json of OrcaSlicer"
    ])


def _readers(path: Path, data: bytes) -> Iterator[tuple[Callable[[], dict[str, str]], tuple[Rule, ...], str]]:
    text = data.decode("utf-8-sig", "replace")
    if path.suffix.lower() == ".curaprofile":
        yield lambda: _zipped(data, path), CURA, "Cura"
    elif path.suffix.lower() == ".cfg":
        yield lambda: _cura_values(text, path), CURA, "Cura"
    elif path.suffix.lower() == ".json":
        yield lambda: _orca(text, path), PRUSA, "OrcaSlicer"
    elif path.suffix.lower() == ".ini":
        yield lambda: _assignments(text, ""), PRUSA, "PrusaSlicer"
    else:
        yield lambda: _setting_3(text, path), CURA, "Cura"
        yield lambda: _assignments(text, ";"), PRUSA, "PrusaSlicer"


def _assignments(text: str, lead: str) -> dict[str, str]:
    """Lines "key = value"; in G-code behind a semicolon, and only where there are settings of a print."""
    found = {}
    for line in text.splitlines():
        if line.startswith(lead) and (match := PRUSA_LINE.match(line)):
            found[match[1]] = match[2].strip()
    return found if {"layer_height", "perimeters", "nozzle_diameter", "temperature"} & set(found) else {}


def _orca(text: str, path: Path) -> dict[str, str]:
    try:
        return orca_settings(text)
    except ValueError as error:
        raise ProfileError(str(path), [f"not a profile of OrcaSlicer: {error}"]) from error


def _cura_values(text: str, path: Path) -> dict[str, str]:
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise ProfileError(str(path), [f"not a profile of Cura: {str(error).splitlines()[0]}"]) from error
    return dict(parser["values"]) if parser.has_section("values") else {}


def _zipped(data: bytes, path: Path) -> dict[str, str]:
    """All the files of a .curaprofile; those of the first extruder over the global ones."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            found = [_cura_values(archive.read(name).decode("utf-8", "replace"), path) for name in archive.namelist()]
    except (zipfile.BadZipFile, OSError) as error:
        raise ProfileError(str(path), [f"not a .curaprofile: {error}"]) from error
    return {key: value for values in found for key, value in values.items()}


def _setting_3(text: str, path: Path) -> dict[str, str]:
    """The settings Cura writes at the end of its G-code: JSON in pieces, with files like .cfg in it."""
    pieces = "".join(line[len(";SETTING_3 "):] for line in text.splitlines() if line.startswith(";SETTING_3 "))
    if not pieces:
        return {}
    try:
        told = json.loads(pieces)
    except ValueError as error:
        raise ProfileError(str(path), [f"the lines ;SETTING_3 are damaged: {error}"]) from error
    extruders = told.get("extruder_quality", [])[:1]
    files = [told.get("global_quality", ""), *extruders]
    return {key: value for one in files for key, value in _cura_values(one.replace("\\n", "\n"), path).items()}
