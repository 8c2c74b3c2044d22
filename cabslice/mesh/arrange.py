"""Several parts on one bed: side by side in rows by their bounds, the same for the same parts."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.mesh.part import Part


def rows(size: Array, gap: float, bed: Array | None = None) -> Array:
    """Middles (K, 2) mm for rectangles size (K, 2), `gap` apart, around the origin; deeper ones in earlier rows.

    Of all widths the rows could have, the one whose whole fits the bed (2,) best; without a bed, the squarest.
    """
    order = np.lexsort((np.arange(len(size)), -size[:, 1]))
    bed = np.ones(2) if bed is None else np.asarray(bed, np.float64)
    tries = [_rows_of(size, order, gap, count) for count in range(1, len(size) + 1)]
    return min(tries, key=lambda tried: float((_extent(tried, size) / bed).max()))


def _rows_of(size: Array, order: Array, gap: float, count: int) -> Array:
    """Rows of `count` rectangles each, their middles in line; the whole's bounds around the origin."""
    middle, y = np.zeros((len(size), 2)), 0.0
    for low in range(0, len(order), count):
        row = order[low:low + count]
        right = np.cumsum(size[row, 0] + gap) - gap
        middle[row, 0] = right - size[row, 0] / 2 - right[-1] / 2
        depth = size[row, 1].max()
        middle[row, 1] = y + depth / 2
        y += depth + gap
    low, high = (middle - size / 2).min(0), (middle + size / 2).max(0)
    return middle - (low + high) / 2


def _extent(middle: Array, size: Array) -> Array:
    return (middle + size / 2).max(0) - (middle - size / 2).min(0)


def arrange(parts: Sequence[Part], gap: float, bed: Array | None = None, at_mm: Sequence[float] = (0, 0)) -> list[Part]:
    """The parts, already turned and on z = 0, moved apart; their whole stands with its middle at at_mm (x, y)."""
    low, high = (np.array([getattr(part.vertices, end)(0)[:2] for part in parts]) for end in ("min", "max"))
    shift = rows(high - low, gap, bed) + np.asarray(at_mm) - (low + high) / 2
    moved = zip(parts, shift, strict=True)
    return [replace(part, vertices=part.vertices + np.append(step, 0.0)) for part, step in moved]


def united(parts: Sequence[Part]) -> Part:
    """All in one; its name and hash are made of theirs."""
    if len(parts) == 1:
        return parts[0]
    counts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    names = list(dict.fromkeys(part.name for part in parts))
    times = [sum(part.name == name for part in parts) for name in names]
    said = [f"{count} x {name}" if count > 1 else name for count, name in zip(times, names, strict=True)]
    return Part(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + first for part, first in zip(parts, counts[:-1], strict=True)]),
        " + ".join(said), hashlib.sha256("".join(part.sha256 for part in parts).encode()).hexdigest(),
        repairs=_all(parts, "repairs"), warnings=_all(parts, "warnings"),
    )


def _all(parts: Sequence[Part], what: str) -> tuple[str, ...]:
    """Each sentence once, with the name of its part."""
    return tuple(dict.fromkeys(
        sentence if sentence.startswith(part.name) else f"{part.name}: {sentence}"
        for part in parts for sentence in getattr(part, what)
    ))
