"""Products between two stages as files: save and load, the same value back, the same bytes every time.

    .layers  Sliced   .path  Laid   .plan  Planned

Layout, little-endian:
    0   8 bytes   b"CABSLICE"
    8   uint32    schema
    12  uint32    length H of the header
    16  H bytes   header, JSON: kind, version, tree of the value, columns [{dtype, shape, at}]
    ..  columns   each from a multiple of 64 bytes on, counted from the start of the file (`at`), C order
    end 32 bytes  SHA-256 of everything before

A value is a tree of frozen dataclasses. Values of the same class that stand in a tuple (layers) are stored as one:
their arrays end to end in one column with the length of each, their scalars in lists.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import struct
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cabslice import __version__
from cabslice.arrays import Array
from cabslice.errors import ProductError
from cabslice.files import atomic
from cabslice.slicing.layer import Layer
from cabslice.timing.trajectory import Trajectory
from cabslice.toolpath.path import Toolpath

MAGIC, SCHEMA, ALIGN, DIGEST = b"CABSLICE", 2, 64, 32
PREFIX = struct.Struct("<8sII")


@dataclasses.dataclass(frozen=True)
class Origin:
    """What a product was made from. The profiles are carried whole, as checked JSON: later stages need no -p."""

    part: str                                  # file name without folder
    sha256: str                                # of that file
    repairs: tuple[str, ...]
    warnings: tuple[str, ...]
    unit: str
    scale: float
    turn_deg: tuple[float, ...]
    at_mm: tuple[float, ...] | None
    printer: str
    material: str
    process: str
    modifiers: tuple[str, ...] = ()            # support blockers and enforcers: what, file name, sha256


@dataclasses.dataclass(frozen=True)
class Sliced:
    origin: Origin
    layers: tuple[Layer, ...]


@dataclasses.dataclass(frozen=True)
class Laid:
    origin: Origin
    toolpath: Toolpath


@dataclasses.dataclass(frozen=True)
class Planned:
    origin: Origin
    toolpath: Toolpath
    trajectory: Trajectory


Product = Sliced | Laid | Planned
KINDS: dict[str, type] = {"layers": Sliced, "path": Laid, "plan": Planned}


def kind_of(product: Product) -> str:
    """"layers", "path" or "plan": also the suffix of its file."""
    return next(kind for kind, cls in KINDS.items() if isinstance(product, cls))


def is_product(path: str | Path) -> bool:
    """Whether the file begins like one of ours, whatever it is called."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


# ---- saving

def save(product: Product, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a product under its name once it is whole. Raises OutputError."""
    columns: list[Array] = []
    tree = _pack([product], columns)
    header, places = _header(kind_of(product), tree, columns)
    digest = hashlib.sha256()
    with atomic(path, overwrite) as file:
        for block in _blocks(PREFIX.pack(MAGIC, SCHEMA, len(header)) + header, places, columns):
            digest.update(block)
            file.write(block)
        file.write(digest.digest())


def _blocks(head: bytes, places: Sequence[int], columns: Sequence[Array]) -> Iterator[Any]:
    yield head
    end = len(head)
    for place, column in zip(places, columns, strict=True):
        yield bytes(place - end)
        yield column.reshape(-1).view(np.uint8).data
        end = place + column.nbytes


def _header(kind: str, tree: Any, columns: Sequence[Array]) -> tuple[bytes, list[int]]:
    """The header and where each column begins. The header's own length moves them: repeat until it is still."""
    length = 0
    while True:
        at, rows = PREFIX.size + length, list[dict[str, Any]]()
        for column in columns:
            at = -(-at // ALIGN) * ALIGN
            rows.append({"dtype": column.dtype.str, "shape": list(column.shape), "at": at})
            at += column.nbytes
        content = {"kind": kind, "version": __version__, "value": tree, "columns": rows}
        header = json.dumps(content, separators=(",", ":")).encode()
        if len(header) <= length:
            return header.ljust(length), [int(row["at"]) for row in rows]
        length = len(header)


def _pack(values: Sequence[Any], columns: list[Array]) -> Any:
    """The JSON tree of values of one class; their arrays go to `columns`."""
    first = next((value for value in values if value is not None), None)
    if any(value is None for value in values) and first is not None:
        there = [value is not None for value in values]
        return {"there": there, "of": _pack([value for value in values if value is not None], columns)}
    if isinstance(first, np.ndarray):
        columns.append(_little(np.concatenate(values)) if len(values) > 1 else _little(first))
        return {"column": len(columns) - 1, "lengths": [len(value) for value in values]}
    if dataclasses.is_dataclass(first):
        names = [field.name for field in dataclasses.fields(first) if field.init]
        fields = {name: _pack([getattr(value, name) for value in values], columns) for name in names}
        return {"class": type(first).__name__, "count": len(values), "fields": fields}
    if isinstance(first, tuple) and any(_is_rich(item) for value in values for item in value):
        items = [item for value in values for item in value]
        return {"lengths": [len(value) for value in values], "many": _pack(items, columns)}
    return {"json": [_plain(value) for value in values]}


def _little(array: Array) -> Array:
    return np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).reshape(array.shape)


def _is_rich(item: Any) -> bool:
    return dataclasses.is_dataclass(item) or isinstance(item, np.ndarray)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): _plain(item) for key, item in value.items()}
    return value


# ---- loading

def load(path: str | Path) -> tuple[str, Product]:
    """(kind, product). Raises ProductError for a file that is damaged, not ours or of another schema."""
    name = Path(path).name
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ProductError(f"{name} cannot be read: {error.strerror}.", file=name) from error
    header, body = _open(content, name)
    try:
        columns = [_column(body, row) for row in header["columns"]]
        product = _unpack(header["value"], columns, _classes(KINDS[header["kind"]]))[0]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ProductError(f"{name} does not hold what its header says ({error}); make it again.", file=name) from error
    return header["kind"], product


def _open(content: bytes, name: str) -> tuple[dict[str, Any], memoryview]:
    again = "; make it again from the part."
    if content[: len(MAGIC)] != MAGIC:
        raise ProductError(f"{name} is not a file of cabslice (it does not begin with CABSLICE).", file=name)
    if len(content) < PREFIX.size + DIGEST:
        raise ProductError(f"{name} ends after {len(content)} bytes, before its header{again}", file=name)
    _, schema, length = PREFIX.unpack_from(content)
    if schema != SCHEMA:
        raise ProductError(
            f"{name} has schema {schema}, this cabslice {__version__} reads schema {SCHEMA}{again}",
            file=name, schema=schema, expected=SCHEMA,
        )
    body = memoryview(content)[:-DIGEST]
    if hashlib.sha256(body).digest() != content[-DIGEST:]:
        raise ProductError(
            f"{name} is damaged or cut short: the SHA-256 of its {len(body)} bytes is not the one at its end{again}",
            file=name,
        )
    return json.loads(bytes(body[PREFIX.size : PREFIX.size + length])), body


def _column(body: memoryview, row: dict[str, Any]) -> Array:
    dtype, shape = np.dtype(row["dtype"]), tuple(row["shape"])
    count = int(np.prod(shape, dtype=np.int64))
    return np.frombuffer(body, dtype, count, row["at"] if count else 0).reshape(shape)


def _unpack(node: dict[str, Any], columns: list[Array], classes: dict[str, type]) -> list[Any]:
    """The values that _pack was given."""
    if "there" in node:
        items = iter(_unpack(node["of"], columns, classes))
        return [next(items) if there else None for there in node["there"]]
    if "column" in node:
        return _split(columns[node["column"]], node["lengths"])
    if "class" in node:
        cls = classes[node["class"]]
        fields = {name: _unpack(of, columns, classes) for name, of in node["fields"].items()}
        return [cls(**{name: items[i] for name, items in fields.items()}) for i in range(node["count"])]
    if "many" in node:
        return [tuple(part) for part in _split(_unpack(node["many"], columns, classes), node["lengths"])]
    return [_frozen(value) for value in node["json"]]


def _split(values: Any, lengths: Sequence[int]) -> list[Any]:
    ends = np.cumsum([0, *lengths])
    return [values[a:b] for a, b in itertools.pairwise(ends)]


def _frozen(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def _classes(cls: type) -> dict[str, type]:
    """The dataclasses that stand in the fields of `cls`, at any depth, by name."""
    found: dict[str, type] = {cls.__name__: cls}
    for hint in typing.get_type_hints(cls).values():
        for inner in _inner(hint):
            if found.get(inner.__name__, inner) is not inner:
                raise TypeError(f"two classes called {inner.__name__} in one product")
            if inner.__name__ not in found:
                found |= _classes(inner)
    return found


def _inner(hint: Any) -> list[type]:
    if dataclasses.is_dataclass(hint):
        return [typing.cast(type, hint)]
    return [cls for part in typing.get_args(hint) for cls in _inner(part)]
