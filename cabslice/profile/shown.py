"""Profiles written out again: the merged one with the origin of each value, and a starter file with every key."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cabslice.profile import shelf
from cabslice.profile.faults import checked
from cabslice.profile.keys import LIST, Key, keys
from cabslice.profile.reader import NOT_INHERITED, Draft
from cabslice.profile.toml import Place, assignment, dump, literal

Alike = Callable[[Place], bool]
DEFAULT = "default"
HEAD = ("schema", "name")                 # keys a starter file has for itself
OWN = (("cable", "anchor_mm"), ("cable", "attachment_mm"))      # what each cable has for itself, where nothing is known


@dataclass(frozen=True)
class Shown:
    """A checked profile as a table: what all cables share stands in ``cables``, the rest in each ``cable``."""

    model: Any
    values: dict[str, Any]
    files: tuple[str, ...]                 # from the furthest parent to the profile itself
    origins: dict[Place, str]              # by place in `values`: file, "--set" or "default"

    @property
    def toml(self) -> str:
        """A profile file that stands alone and means the same; behind each value the file it came from."""
        short = {label: Path(label).stem for label in self.files}
        if len(set(short.values())) < len(short):
            short = {}
        head = "".join(f"# {short.get(label, label)}: {label}\n" for label in self.files) if short else ""
        return head + dump(self.values, lambda place: short.get(self.origins[place], self.origins[place]))


def show(kind: str, ref: str, sets: Sequence[str] = ()) -> Shown:
    """Raises ProfileError with every fault."""
    chain = shelf.chain(kind, ref)
    draft = shelf.merge(chain, sets, cables=kind == "printers")
    model = checked(kind, draft)
    values = model.model_dump(mode="json", by_alias=True, exclude_none=True)
    if kind == "printers":
        cables = values.pop("cable")
        shared, own = _split(cables, lambda rest: _one_origin(draft, len(cables), rest))
        values |= {"cables": shared, "cable": own}
    origins = {place: _origin(draft, place) for place in _leaves(values, ())}
    return Shown(model, values, tuple(sheet.label for sheet in chain), origins)


def share(cables: list[dict[str, Any]]) -> tuple[dict[str, Any], list[Any]]:
    """What all cables have alike, and what is left of each."""
    return _split(cables, lambda place: True)


def _split(cables: list[dict[str, Any]], alike: Alike, at: Place = ()) -> tuple[dict[str, Any], list[Any]]:
    """What is equal in all cables and came from one place, and what is left of each."""
    within: Any
    shared: dict[str, Any] = {}
    own: list[dict[str, Any]] = [{} for _ in cables]
    for key in dict.fromkeys(key for cable in cables for key in cable):
        column = [cable.get(key) for cable in cables]
        if all(isinstance(one, dict) for one in column):
            within, left = _split([one for one in column if one is not None], alike, (*at, key))
        elif column.count(column[0]) == len(column) and alike((*at, key)):
            within, left = column[0], []
        else:
            within, left = {}, column
        if within != {}:
            shared[key] = within
        for cable, one in zip(own, left, strict=False):
            if one not in (None, {}):
                cable[key] = one
    return shared, own


def _one_origin(draft: Draft, count: int, rest: Place) -> bool:
    found = [draft.origins.get(("cable", index, *rest)) for index in range(count)]
    return len({origin.label if origin else "" for origin in found}) == 1


def _leaves(value: Any, place: Place) -> Iterator[Place]:
    """Places of all values that are not tables."""
    if isinstance(value, Mapping):
        for key, one in value.items():
            yield from _leaves(one, (*place, key))
    elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
        for index, one in enumerate(value):
            yield from _leaves(one, (*place, index))
    else:
        yield place


def _origin(draft: Draft, place: Place) -> str:
    place = ("cable", 0, *place[1:]) if place[0] == "cables" else place
    found = draft.origins.get(place)
    return found.label if found else DEFAULT


# ---- a file to start from

def starter(kind: str, name: str, parent: str | None = None, *, beside: Path | None = None) -> str:
    """A profile file with every key and what it means, each a comment until its "# " is taken away.

    With a `parent` the file inherits from it, is complete as it is, and shows the parent's values; a parent that is
    a file is named as seen from the folder `beside`. Raises ProfileError.
    """
    values = show(kind, parent).values if parent else {}
    known = list(keys(kind).values())
    rest = f"is as in {parent}" if parent else "has the default shown; REQUIRED keys have none"
    lines = [f"# A {shelf.SINGULAR[kind]} for cabslice, with every key it may have.",
             f'# Take the "# " in front of a key away to set it; what stays a comment {rest}.',
             "schema = 1", f"name = {literal(name)}"]
    lines += [f"inherits = {literal(shelf.seen_from(parent, beside or Path()))}"] if parent else []
    lines += [_line(key, values) for key in known if len(key.path) == 1 and not key.table and key.path[0] not in HEAD]
    for table in known:
        if table.table and table.path[0] != "cable":
            lines += _section(table, known, values, bool(parent))
    return "\n".join([*lines, *(_cable_sections(known, values) if kind == "printers" else [])]) + "\n"


def _section(table: Key, known: list[Key], values: Mapping[str, Any], inherits: bool) -> list[str]:
    absent = (inherits or table.seldom) and _lookup(values, table.path) is None
    within = [_line(key, values) for key in known if key.path[:-1] == table.path and not key.table]
    if table.type == LIST:
        return ["", f"# [[{table.dotted}]]    # one block for each; {table.description}", *within]
    return ["", f"{'# ' if absent else ''}[{table.dotted}]    # {table.description}", *within]


def _cable_sections(known: list[Key], values: Mapping[str, Any]) -> list[str]:
    own = [key for key in known if key.path[0] == "cable" and not key.table and _is_own(key, values)]
    lines: list[str] = []
    for table in (key for key in known if key.table and key.path[0] == "cable"):
        header, words = ".".join(("cables", *table.path[1:])), table.description
        if len(table.path) == 1:
            words = "what all cables share; a key may as well stand in each [[cable]]"
        shared = {"cable": values.get("cables", {})}
        absent = len(table.path) > 1 and (bool(values) or table.seldom) and not _has(values, table.path[1:])
        lines += ["", f"{'# ' if absent else ''}[{header}]    # {words}"]
        within = [key for key in known if key.path[:-1] == table.path and not key.table and key not in own]
        lines += [_line(key, shared) for key in within]
    for cable in values.get("cable", [] if values else [{}]):
        lines += ["", "[[cable]]" + ("" if values else "    # one block for each cable")]
        lines += [_line(key, {"cable": cable}, ".".join(key.path[1:])) for key in own]
    return lines


def _has(values: Mapping[str, Any], path: tuple[str, ...]) -> bool:
    """Whether any cable has this table."""
    return any(_lookup(one, path) is not None for one in (values.get("cables"), *values.get("cable", [])))


def _is_own(key: Key, values: Mapping[str, Any]) -> bool:
    if not values:
        return key.path in OWN
    return any(_lookup(cable, key.path[1:]) is not None for cable in values.get("cable", []))


def _line(key: Key, values: Mapping[str, Any], name: str = "") -> str:
    found = None if key.path[0] in NOT_INHERITED else _lookup(values, key.path)
    if found is None and not key.required:
        found = key.default
    name = name or key.path[-1]
    written = f"{name} =" if found is None else assignment(name, found)
    required = "REQUIRED; " if key.required and found is None else ""
    return "# " + written.replace("\n", "\n# ") + f"    # {required}{key.expected}: {key.description}"


def _lookup(values: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        values = values.get(part) if isinstance(values, Mapping) else None
    return values
