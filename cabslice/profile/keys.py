"""Every key a profile may hold, read from the models, so that help, faults and starter files cannot drift from them."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

KINDS = ("printers", "materials", "processes")
_MODELS = {"printers": "printer.Printer", "materials": "material.Material", "processes": "process.Process"}
_UNITS = {  # longest suffix first
    "_kg_mm2": "kg mm^2", "_mm3_s": "mm^3/s", "_mm_s2": "mm/s^2", "_g_cm3": "g/cm^3", "_per_kg": "per kg",
    "_rad_s": "rad/s", "_mm_s": "mm/s", "_n_m": "N m",
    "_gpa": "GPa", "_deg": "deg", "_n_s": "N s", "_mm": "mm", "_kg": "kg", "_ms": "ms", "_hz": "Hz", "_n": "N",
    "_c": "degC", "_s": "s",
}
_BOUNDS = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
_NOUNS = {"number": "a number", "integer": "a whole number", "string": "a text", "object": "a table",
          "boolean": "true or false"}
_LEAST = {1: "one", 2: "two"}
_PLURALS = {"number": "numbers", "integer": "whole numbers", "string": "texts"}


LIST = "a list of tables"


@dataclass(frozen=True)
class Key:
    """One key. `path` has no positions: ("cable", "winder", "layers") stands for the winders of all cables."""

    path: tuple[str, ...]
    type: str
    unit: str
    bound: str
    default: Any
    required: bool
    table: bool                            # a [table] (or list of tables) with keys of its own
    description: str
    seldom: bool = False                   # a table that few files have

    @property
    def dotted(self) -> str:
        return ".".join(self.path)

    @property
    def expected(self) -> str:
        """What belongs there, as the end of a sentence: "a number > 0 and <= 1000, in mm"."""
        return " ".join(filter(None, (self.type, self.bound))) + (f", in {self.unit}" if self.unit else "")

    def as_dict(self) -> dict[str, Any]:
        default = {} if self.required or self.table else {"default": self.default}
        words = {"key": self.dotted, "type": self.type, "unit": self.unit, "bound": self.bound}
        return {**words, "required": self.required, **default, "description": self.description}


def model(kind: str) -> Any:
    """The pydantic class of "printers", "materials" or "processes" (imported here, not earlier: it takes a while)."""
    module, name = _MODELS[kind].split(".")
    return getattr(importlib.import_module(f"cabslice.profile.{module}"), name)


@cache
def keys(kind: str) -> dict[tuple[str, ...], Key]:
    """All keys of a kind by path, in the order of declaration; tables stand before their own keys."""
    schema = model(kind).model_json_schema()
    return {key.path: key for key in _walk(schema, schema.get("$defs", {}), ())}


def _walk(schema: Mapping[str, Any], tables: Mapping[str, Any], prefix: tuple[str, ...]) -> Iterator[Key]:
    for name, declared in schema["properties"].items():
        path, one = (*prefix, name), _not_null(declared)
        inner = tables.get(_reference(one) or _reference(one.get("items", {})))
        if inner and one.get("type") == "array":
            one = {**one, "type": "array of tables"}
        elif inner:
            one = {**inner, **one, "type": "object"}
        description = declared.get("description") or one.get("description", "")
        required = (name in schema.get("required", ()) and "default" not in declared) or "needed" in declared
        yield Key(path, _type(one), "" if inner else _unit(path), _bound(one), declared.get("default"), required,
                  inner is not None, " ".join(description.split()), "seldom" in declared)
        if inner:
            yield from _walk(inner, tables, path)


def _not_null(schema: Mapping[str, Any]) -> dict[str, Any]:
    """The schema of a value that is there: of ``X | None`` the X."""
    for one in schema.get("anyOf", ()):
        if one.get("type") != "null":
            return dict(one)
    return dict(schema)


def _reference(schema: Mapping[str, Any]) -> str:
    return str(schema.get("$ref", "")).rpartition("/")[2]


def _type(schema: Mapping[str, Any]) -> str:
    if "const" in schema or "enum" in schema:
        allowed = schema.get("enum", [schema.get("const")])
        return " or ".join(f'"{one}"' if isinstance(one, str) else str(one) for one in allowed)
    if schema["type"] == "array of tables":
        return LIST
    if schema["type"] == "array":
        return _list_type(schema)
    return "a text that is not empty" if schema.get("minLength") else _NOUNS[schema["type"]]


def _list_type(schema: Mapping[str, Any]) -> str:
    low, high, items = schema.get("minItems", 0), schema.get("maxItems"), schema["items"]
    nested = items["type"] == "array" if "type" in items else False
    what = "lists of" + _list_type(items)[len("a list of"):] if nested else (
        _type(items) if "enum" in items else _PLURALS[items["type"]])
    count = f"{low} " if low == high else f"{_LEAST[low]} or more " if low else ""
    return f"a list of {count}{what}"


def _bound(schema: Mapping[str, Any]) -> str:
    one = schema.get("items", schema)
    return " and ".join(f"{sign} {one[name]:g}" for name, sign in _BOUNDS if name in one)


def _unit(path: tuple[str, ...]) -> str:
    """From the suffix of the key, else of the table it is in (speeds_mm_s.travel)."""
    for name in reversed(path):
        for suffix, unit in _UNITS.items():
            if name.endswith(suffix):
                return unit
    return ""


def close(name: str, known: Iterable[str]) -> list[str]:
    """Up to three known words like `name`, the likeliest first."""
    by_lower = {one.lower(): one for one in known}
    return [by_lower[one] for one in difflib.get_close_matches(name.lower(), by_lower, 3, 0.6)]


def suggest(kind: str, path: tuple[str, ...]) -> list[str]:
    """What an unknown key may have meant: a neighbour in its table, else a key of that name in another table."""
    known = keys(kind)
    siblings = [one[-1] for one in known if one[:-1] == path[:-1]]
    if near := close(path[-1], siblings):
        return near
    names = close(path[-1], {one[-1] for one in known})[:1]
    return [_written(one) for one in known if one[-1] in names]


def suggest_option(path: tuple[str, ...]) -> list[str]:
    """What an unknown --set key may have meant, among the keys of all kinds, written as --set wants them."""
    known = {_written(key.path): key for kind in KINDS for key in keys(kind).values() if not key.table}
    whole = close(_written(path), known)
    return whole or [one for one, key in known.items() if key.path[-1] in close(path[-1], {key.path[-1]})][:3]


def _written(path: tuple[str, ...]) -> str:
    return ".".join(("cables", *path[1:]) if path[0] == "cable" and len(path) > 1 else path)
