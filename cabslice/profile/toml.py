"""Writing TOML (Python only reads it), and finding the line of a key again."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

Place = tuple[str | int, ...]              # keys and positions (from 0) down to a value
Comment = Callable[[Place], str]
LONG = 120
_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")
_PART = re.compile(r"""[\w-]+|"[^"]*"|'[^']*'""")


def literal(value: Any) -> str:
    """One value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(literal(one) for one in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_name(key)} = {literal(one)}" for key, one in value.items()) + "}"
    return str(value)                      # numbers (inf and nan too) and dates read back as they print


def assignment(key: str, value: Any) -> str:
    """``key = value``; a list of texts that would make a long line stands on several."""
    line = f"{key} = {literal(value)}"
    if len(line) <= LONG or not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        return line
    return "\n".join([f"{key} = [", *(f"  {literal(one)}," for one in value), "]"])


def dump(values: Mapping[str, Any], comment: Comment = lambda place: "") -> str:
    """A TOML document of nested tables; `comment` gives what stands behind the value of a place. None is left out."""
    return "\n".join(_table(values, (), (), comment)).strip() + "\n"


def _table(values: Mapping[str, Any], header: tuple[str, ...], place: Place, comment: Comment) -> Iterator[str]:
    plain = {key: one for key, one in values.items() if one is not None and not _is_table(one)}
    for key, one in plain.items():
        note = comment((*place, key))
        yield assignment(_name(key), one) + (f"    # {note}" if note else "")
    for key, one in values.items():
        name = ".".join(_name(part) for part in (*header, key))
        if isinstance(one, Mapping):
            body = list(_table(one, (*header, key), (*place, key), comment))
            yield from ["", f"[{name}]", *body] if _has_plain(one) else body
        elif _is_table(one):
            for index, row in enumerate(one):
                yield from ["", f"[[{name}]]", *_table(row, (*header, key), (*place, key, index), comment)]


def _is_table(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(isinstance(one, Mapping) for one in value)
    return isinstance(value, Mapping)


def _has_plain(values: Mapping[str, Any]) -> bool:
    return not values or any(one is not None and not _is_table(one) for one in values.values())


def _name(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else literal(key)


def line_of(text: str, place: Place) -> int | None:
    """The line (from 1) where `place`, or the innermost table around it that is written out, stands in a document.

    None where it cannot be told.
    """
    best, depth = None, 0
    header: Place = ()
    rows: dict[Place, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if found := _HEADER.match(line):
            header = here = _header(found[2], found[1] == "[[", rows)
        elif found := _KEY.match(line):
            here = (*header, *_parts(found[1]))
        else:
            continue
        if len(here) > depth and here == place[:len(here)]:
            best, depth = number, len(here)
    return best


def _header(written: str, is_row: bool, rows: dict[Place, int]) -> Place:
    """The place of a table header; `rows` counts the [[rows]] seen so far."""
    place: Place = ()
    parts = _parts(written)
    for position, part in enumerate(parts, 1):
        place = (*place, part)
        if is_row and position == len(parts):
            rows[place] = rows.get(place, -1) + 1
        if place in rows:
            place = (*place, rows[place])
    return place


def _parts(written: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in _PART.findall(written))
