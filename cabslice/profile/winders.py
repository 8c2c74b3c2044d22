"""Kinds of winders: which keys each must have, may have and cannot have.

A [cables.winder] is one of these kinds; a key of another kind is a fault. Where a profile names another kind than the
one it inherits from, the keys of the old kind go.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

NEEDS = {
    "radial": ("layer_step_mm", "ramp_start_deg", "ramp_end_deg", "layers", "centre_mm"),
    "spiral": ("radius_per_turn_mm", "angle_range_deg", "centre_mm"),
    "drum": ("pitch_mm", "angle_range_deg", "centre_mm"),
    "spool": ("buildup_factor_mm", "angle_range_deg"),
}
MAY = {"radial": ("radii_mm",), "spool": ("lines_per_spool", "line_mm", "centre_mm")}
DEFAULT = "radial"


def kind_of(winder: Any) -> str | None:
    """The kind of a winder's table; None where there is no table, or no such kind."""
    kind = winder.get("kind", DEFAULT) if isinstance(winder, dict) and winder else None
    return kind if isinstance(kind, str) and kind in NEEDS else None


def foreign(winder: Any) -> Iterator[tuple[str, list[str]]]:
    """Keys of a winder's table that belong to other kinds only, each with these kinds."""
    kind = kind_of(winder)
    for key in winder if kind else ():
        owners = [one for one in NEEDS if key in NEEDS[one] or key in MAY.get(one, ())]
        if owners and kind not in owners:
            yield key, owners
