"""Every fault of a profile as one sentence: which key, where it stands, what was expected, what was there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from cabslice.errors import ProfileError
from cabslice.profile.checks import MISSING, relations
from cabslice.profile.keys import Key, keys, model, suggest
from cabslice.profile.reader import Draft
from cabslice.profile.toml import Place, line_of, literal

LONGEST = 80                               # characters of a value quoted in a sentence


class Fault(NamedTuple):
    place: Place                           # in the merged profile; cables count from 0
    sentence: str
    absent: bool = False                   # there is no value whose file could be named


def checked(kind: str, draft: Draft) -> Any:
    """The profile as a frozen pydantic model, or ProfileError with all its faults."""
    from pydantic import ValidationError

    result = None
    errors: list[Any] = []
    try:
        result = model(kind).model_validate(draft.values, strict=True)
    except ValidationError as error:
        errors += error.errors(include_url=False)
    errors += [{"type": "missing", "loc": place} for place, sentence in relations(kind, draft.values)
               if sentence == MISSING]
    found = list(_typed(kind, draft, errors))
    found += [Fault(place, sentence) for place, sentence in relations(kind, draft.values) if sentence != MISSING]
    told = [place for place, _ in draft.faults]
    found = [fault for fault in found if not (fault.absent and fault.place in told)]
    found = [Fault(place, sentence, absent=True) for place, sentence in draft.faults] + found
    if found:
        raise ProfileError(draft.label, list(_sentences(draft, found)))
    return result


def _typed(kind: str, draft: Draft, errors: list[Any]) -> Iterator[Fault]:
    """What pydantic found, in our words; a missing key that was only misspelt is told once, as the unknown key."""
    meant = set()
    for error in errors:
        if error["type"] == "extra_forbidden":
            place = tuple(error["loc"])
            near = suggest(kind, _path(place))
            meant |= {(*place[:-1], one) for one in near[:1]}
            yield Fault(place, "unknown key" + (f"; did you mean {' or '.join(near)}?" if near else ""))
    for error in errors:
        place = tuple(error["loc"])
        if error["type"] == "missing" and place not in meant:
            yield Fault(place, f"missing; {_wanted(kind, keys(kind)[_path(place)])}", absent=True)
        elif error["type"] not in ("missing", "extra_forbidden"):
            place, key = _declared(kind, place)
            finite = ", finite" if error["type"] == "finite_number" else ""
            yield Fault(place, f"expected {key.expected}{finite}, found {_quoted(draft, place)}")


def _wanted(kind: str, key: Key) -> str:
    """What a missing key should hold; of a table, the keys that must stand in it."""
    within = [one.path[-1] for one in keys(kind).values() if one.path[:-1] == key.path and one.required]
    return f"expected {key.expected}" + (f" with {', '.join(within)}" if within else "") + f" ({key.description})"


def _declared(kind: str, place: Place) -> tuple[Place, Key]:
    """The key a place belongs to, and its own place: an element of a list is a fault of the list."""
    known = keys(kind)
    for length in range(len(place), 0, -1):
        path, last = _path(place[:length]), place[length - 1]
        if path in known and (isinstance(last, str) or known[path].table):
            return place[:length], known[path]
    raise KeyError(place)


def _path(place: Place) -> tuple[str, ...]:
    return tuple(part for part in place if isinstance(part, str))


def _quoted(draft: Draft, place: Place) -> str:
    value: Any = draft.values
    for part in place:
        value = value[part]
    text = literal(value)
    return text if len(text) <= LONGEST else text[:LONGEST] + "..."


def _sentences(draft: Draft, faults: list[Fault]) -> Iterator[str]:
    """Each fault once: what comes from [cables], or is missing in every cable, is not told for each cable."""
    told = set()
    for fault in faults:
        origin = None if fault.absent else draft.origin(fault.place)
        place = origin.place if origin else _everywhere(draft, fault, faults)
        written = (origin.label if origin else "", place, fault.sentence)
        if written not in told:
            told.add(written)
            yield f"{dotted(place)}{_where(draft, *written[:2])}: {fault.sentence}"


def _everywhere(draft: Draft, fault: Fault, faults: list[Fault]) -> Place:
    """("cables", ...) where every cable has the same fault, else the place itself."""
    if len(fault.place) < 3 or fault.place[0] != "cable":
        return fault.place
    alike = sum(one.place[:1] + one.place[2:] == fault.place[:1] + fault.place[2:] and one.absent for one in faults)
    return ("cables", *fault.place[2:]) if alike == len(draft.values["cable"]) else fault.place


def _where(draft: Draft, label: str, place: Place) -> str:
    if not label:
        return ""
    line = line_of(draft.texts.get(label, ""), place)
    parts = [label] if label != draft.label else []
    parts += [f"line {line}"] if line else []
    return f" ({', '.join(parts)})" if parts else ""


def dotted(place: Place) -> str:
    """A place as the user writes it: cable.3.anchor_mm is the third cable."""
    return ".".join(str(part + 1) if isinstance(part, int) else part for part in place)
