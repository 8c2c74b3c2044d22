"""Two checked profiles of a kind, key by key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

Path = tuple[str, ...]


class Difference(NamedTuple):
    key: str                               # as --set writes it: cables.KEY for all cables, cable.3.KEY for the third
    first: Any                             # None: absent
    second: Any


def differences(first: Any, second: Any) -> list[Difference]:
    """Every key whose values differ, in the order of the keys. Names, descriptions and sources count.

    Cables are compared by position; where their numbers differ, only what all cables of a profile share is.
    """
    one, two = (model.model_dump(mode="json", by_alias=True, exclude_none=True) for model in (first, second))
    rows, others = one.pop("cable", []), two.pop("cable", [])
    found = list(_plain(one, two, ""))
    if len(rows) == len(others):
        return found + list(_by_cable([dict(_leaves(row)) for row in rows], [dict(_leaves(row)) for row in others]))
    counted = Difference("cable", f"{len(rows)} cables", f"{len(others)} cables")
    return [*found, counted, *_plain(_shared(rows), _shared(others), "cables.")]


def _plain(one: Mapping[Any, Any], two: Mapping[Any, Any], prefix: str) -> Iterator[Difference]:
    left, right = dict(_leaves(one)), dict(_leaves(two))
    for path in dict.fromkeys([*left, *right]):
        if left.get(path) != right.get(path):
            yield Difference(prefix + ".".join(path), left.get(path), right.get(path))


def _by_cable(rows: list[dict[Path, Any]], others: list[dict[Path, Any]]) -> Iterator[Difference]:
    for path in dict.fromkeys(path for row in (*rows, *others) for path in row):
        pairs = [(row.get(path), other.get(path)) for row, other in zip(rows, others, strict=True)]
        key = ".".join(path)
        if all(pair == pairs[0] for pair in pairs):
            pairs, name = pairs[:1], ["cables"]
        else:
            name = [f"cable.{index}" for index in range(1, len(pairs) + 1)]
        yield from (Difference(f"{cable}.{key}", *pair) for cable, pair in zip(name, pairs, strict=True)
                    if pair[0] != pair[1])


def _shared(rows: list[Any]) -> dict[Path, Any]:
    """What is the same in all cables."""
    leaves = [dict(_leaves(row)) for row in rows]
    return {path: value for path, value in leaves[0].items() if all(one.get(path) == value for one in leaves)}


def _leaves(table: Mapping[Any, Any], prefix: Path = ()) -> Iterator[tuple[Path, Any]]:
    for key, value in table.items():
        path = (*prefix, *key) if isinstance(key, tuple) else (*prefix, key)
        if isinstance(value, Mapping):
            yield from _leaves(value, path)
        else:
            yield path, value
