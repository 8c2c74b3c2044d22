"""Where a part stands: turned, then set on the bed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.mesh.part import Part


def place(part: Part, *, turn_deg: Sequence[float] = (0, 0, 0), at_mm: Sequence[float] | None = None) -> Part:
    """The part turned about x, then y, then z (degrees), resting on z = 0, the middle of its bounds at at_mm (x, y).

    Without at_mm it stands in the middle of the bed.
    """
    return place_with(part, (), turn_deg=turn_deg, at_mm=at_mm)[0]


def place_with(
    part: Part, others: Sequence[Part], *, turn_deg: Sequence[float] = (0, 0, 0), at_mm: Sequence[float] | None = None
) -> list[Part]:
    """`place`, and the others moved in the same way: what was drawn around the part stays where it is around it."""
    turned = [one.vertices @ turn_matrix(turn_deg).T if any(turn_deg) else one.vertices for one in (part, *others)]
    low, high = turned[0].min(0), turned[0].max(0)
    target = np.array([0.0, 0.0] if at_mm is None else at_mm, dtype=np.float64)
    shift = np.array([*(target - (low + high)[:2] / 2), -low[2]])
    return [replace(one, vertices=points + shift) for one, points in zip((part, *others), turned, strict=True)]


def turn_matrix(turn_deg: Sequence[float]) -> Array:
    """(3, 3) Rz Ry Rx; exact for quarter turns, so that a turned box keeps its faces on layer planes."""
    matrix = np.eye(3)
    for axis, angle in enumerate(turn_deg):
        quarter, rest = divmod(float(angle), 90.0)
        c, s = np.cos(np.radians(rest)), np.sin(np.radians(rest))
        for _ in range(int(quarter) % 4):
            c, s = -s, c
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
        matrix = turn @ matrix
    return matrix
