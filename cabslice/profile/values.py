"""Numbers out of a merged table that nobody has checked yet: what is missing or no number becomes nan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from cabslice.profile.toml import Place

Faults = Iterator[tuple[Place, str]]
Values = Mapping[str, Any]


def cables_of(values: Values) -> list[Values]:
    """The [[cable]] blocks; none where there is something else."""
    cables = values.get("cable")
    return cables if isinstance(cables, list) and all(isinstance(one, Mapping) for one in cables) else []


def table(values: Values, key: str) -> Values:
    """A table by its key; empty where there is none."""
    found = values.get(key)
    return found if isinstance(found, Mapping) else {}


def number(values: Values, key: str, default: float = math.nan) -> float:
    """One number by its key; `default` where there is none, nan where it is no number."""
    value = values.get(key, default)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not abs(value) < 1e300:
        return math.nan
    return float(value)


def numbers(value: Any, count: int | None = None) -> list[float]:
    """A list of numbers; of nan (or empty, without a count) where `value` is something else."""
    if isinstance(value, list) and len(value) == (count or len(value)):
        return [number({"": one}, "") for one in value]
    return [math.nan] * (count or 0)
