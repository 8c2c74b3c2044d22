"""From TOML files to one merged table that remembers which file gave each value.

A profile is a chain of files, parent first, each laid over what came before: tables merge key by key, lists are
replaced, [[cable]] blocks merge by position. Within one file, [cables] goes under each of its [[cable]] blocks. Then
come the `--set` options. A winder of another kind, or another way to say how stiff a cable is, replaces what earlier
files said of it. Nothing is judged here except what cannot be merged; `faults` and `checks` do that.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cabslice.errors import ProfileError, UsageError
from cabslice.profile.hulls import with_hulls
from cabslice.profile.toml import Place, literal
from cabslice.profile.winders import foreign

SET = "--set"
NOT_INHERITED = ("name", "description", "inherits")
STIFFNESS = (("modulus_gpa", "modulus_by_tension", "modulus_by_frequency"), ("axial_stiffness_n",))   # one or the other


@dataclass(frozen=True)
class Sheet:
    """One file as it was read."""

    label: str                             # what messages call it: its path, or "--set"
    values: dict[str, Any]
    text: str = ""


@dataclass(frozen=True)
class Origin:
    """Where a value was written: in which file, and under which keys there."""

    label: str
    place: Place


@dataclass
class Draft:
    """A profile after merging, before it is checked."""

    label: str
    cables: bool = True
    values: dict[str, Any] = field(default_factory=dict)
    origins: dict[Place, Origin] = field(default_factory=dict)      # of every value that is not a table
    texts: dict[str, str] = field(default_factory=dict)             # by label
    faults: list[tuple[Place, str]] = field(default_factory=list)   # what could not be merged
    shared: dict[str, Any] = field(default_factory=dict)            # [cables] of files that came before any [[cable]]

    def origin(self, place: Place) -> Origin | None:
        """Where the value at `place` was written, or the list it is in, or the first value of the table it is."""
        for length in range(len(place), 0, -1):
            if found := self.origins.get(place[:length]):
                return Origin(found.label, (*found.place, *place[length:]))
        for leaf, found in self.origins.items():
            if leaf[:len(place)] == place and len(found.place) > len(leaf) - len(place):
                return Origin(found.label, found.place[:len(place) - len(leaf)])
        return None


def read_sheet(path: Path) -> Sheet:
    """Raises ProfileError with the line of a syntax error, or where the file, or the STL of a body, cannot be read."""
    text = ""
    try:
        text = path.read_text(encoding="utf-8")
        return Sheet(str(path), with_hulls(tomllib.loads(text), path.parent, str(path), text), text)
    except tomllib.TOMLDecodeError as error:
        where = str(error).replace("at end of document", f"at end of document, line {text.count(chr(10)) + 1}")
        raise ProfileError(str(path), [f"not valid TOML: {where}"]) from error
    except UnicodeDecodeError as error:
        fault = f"not valid TOML: not UTF-8 text ({error.reason} at byte {error.start})"
        raise ProfileError(str(path), [fault]) from error
    except OSError as error:
        raise ProfileError(str(path), [f"cannot be read: {error.strerror}"]) from error


def merge(chain: Sequence[Sheet], sets: Sequence[str] = (), *, cables: bool = True) -> Draft:
    """Lay the sheets over each other, parent first, then the options ``table.key=value``.

    ``cables=False`` for materials and processes: there [cables] and [[cable]] are keys like any other.
    """
    draft = Draft(chain[-1].label, cables=cables)
    for sheet in chain:
        draft.texts[sheet.label] = sheet.text
        for name in NOT_INHERITED:
            draft.values.pop(name, None)
            draft.origins.pop((name,), None)
        _lay(draft, sheet)
    draft.values.pop("inherits", None)
    draft.values.setdefault("name", Path(draft.label).stem)
    for option in sets:
        _set(draft, *parse_set(option))
    for index in range(len(draft.values.get("cable", [])) if cables else 0):
        _replaced(draft, ("cable", index))
    return draft


def _lay(draft: Draft, sheet: Sheet) -> None:
    apart = ("cable", "cables") if draft.cables else ()
    own = {key: value for key, value in sheet.values.items() if key not in apart}
    _overlay(draft, draft.values, (), own, Origin(sheet.label, ()))
    if not draft.cables:
        return
    shared, rows = sheet.values.get("cables", {}), sheet.values.get("cable", [])
    if not isinstance(shared, Mapping):
        draft.faults.append((("cables",), f"expected a table [cables], found {literal(shared)}"))
        shared = {}
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        draft.faults.append((("cable",), f"expected one [[cable]] block for each cable, found {literal(rows)}"))
        rows = []
    _lay_cables(draft, sheet.label, shared, rows)


def _lay_cables(draft: Draft, label: str, shared: Mapping[str, Any], rows: list[Any]) -> None:
    cables = draft.values.get("cable", [])
    if rows and cables and len(rows) != len(cables):
        draft.faults.append((("cable",), f"expected {len(cables)} [[cable]] blocks as in the profile it inherits from, "
                                         f"found {len(rows)} in {label}"))
    if not cables and not rows:
        draft.shared[label] = shared
        return
    if not cables:
        cables = draft.values["cable"] = [{} for _ in rows]
        for index, cable in enumerate(cables):
            for earlier, table in draft.shared.items():
                _overlay(draft, cable, ("cable", index), table, Origin(earlier, ("cables",)))
    for index, cable in enumerate(cables):
        _overlay(draft, cable, ("cable", index), shared, Origin(label, ("cables",)))
        if index < len(rows):
            _overlay(draft, cable, ("cable", index), rows[index], Origin(label, ("cable", index)))


def _overlay(draft: Draft, target: dict[str, Any], place: Place, source: Mapping[str, Any], origin: Origin) -> None:
    """Deep-merge `source` into `target`, which stands at `place` of the merged profile."""
    for key, value in source.items():
        here, written = (*place, key), Origin(origin.label, (*origin.place, key))
        if isinstance(value, Mapping):
            if not isinstance(target.get(key), dict):
                target[key] = {}
                draft.origins.pop(here, None)
            _overlay(draft, target[key], here, value, written)
        else:
            target[key] = value
            draft.origins[here] = written


def _replaced(draft: Draft, cable: Place) -> None:
    """Forget what a later file replaced without naming it: keys of another kind of winder, the other stiffness."""
    winder = (*cable, "winder")
    table = _at(draft, winder)
    for key, _ in list(foreign(table)):
        if _said(draft, (*winder, key)) < _said(draft, (*winder, "kind")):
            _forget(draft, (*winder, key))
    one, other = ([(*cable, key) for key in keys] for keys in STIFFNESS)
    for old, new in ((one, other), (other, one)):
        latest = max(_said(draft, place) for place in new)
        for place in old:
            if 0 <= _said(draft, place) < latest:
                _forget(draft, place)


def _at(draft: Draft, place: Place) -> Any:
    """The value at a place; None where there is none."""
    value: Any = draft.values
    for part in place:
        if isinstance(part, int):
            value = value[part]
        else:
            value = value.get(part) if isinstance(value, dict) else None
    return value


def _said(draft: Draft, place: Place) -> int:
    """How late in the chain a value, or any value of a table, was written: 0 the furthest parent; -1 nowhere."""
    order = [*draft.texts, SET]
    length = len(place)
    return max((order.index(found.label) for at, found in draft.origins.items() if at[:length] == place), default=-1)


def _forget(draft: Draft, place: Place) -> None:
    _at(draft, place[:-1]).pop(place[-1], None)
    for leaf in [leaf for leaf in draft.origins if leaf[:len(place)] == place]:
        del draft.origins[leaf]


def parse_set(option: str) -> tuple[tuple[str, ...], Any]:
    """("cables", "max_tension_n"), 80 from ``cables.max_tension_n=80``: TOML value syntax, else the bare text."""
    key, equals, written = option.partition("=")
    parts = tuple(part.strip() for part in key.split("."))
    if not equals or not all(parts):
        raise UsageError(f"--set {option}: expected table.key=value, for example cables.max_tension_n=80.")
    try:
        return parts, tomllib.loads(f"value = {written}")["value"]
    except tomllib.TOMLDecodeError:
        return parts, written.strip()


def _set(draft: Draft, key: tuple[str, ...], value: Any) -> None:
    """``cables.x`` is x of every cable; ``cable.3.x`` counts from 1; anything else is itself."""
    cables = draft.values.get("cable", []) if draft.cables else []
    if not draft.cables or key[0] not in ("cable", "cables"):
        _overlay(draft, draft.values, (), with_hulls(_nested(key, value), Path(), SET), Origin(SET, ()))
    elif key[0] == "cables" and len(key) > 1:
        for index, cable in enumerate(cables):
            _overlay(draft, cable, ("cable", index), _nested(key[1:], value), Origin(SET, ("cables",)))
    elif len(key) > 2 and key[1].isdigit() and 1 <= int(key[1]) <= len(cables):
        index = int(key[1]) - 1
        _overlay(draft, cables[index], ("cable", index), _nested(key[2:], value), Origin(SET, ("cable", index)))
    else:
        wanted = f"cables.key (of all cables) or cable.N.key (N from 1 to {len(cables)})"
        draft.faults.append((key, f"--set expected {wanted}, found {'.'.join(key)}"))


def _nested(key: tuple[str, ...], value: Any) -> dict[str, Any]:
    return {key[0]: _nested(key[1:], value) if len(key) > 1 else value}
