"""Where a part can be printed: shift on the bed and turn about z, searched by branch and bound.

Legend
    pose      (c, s, x, y): cosine and sine of the turn, shift of the middle of the part's bounds, mm
    gap       least distance of cables to the part printed so far, less what they must keep, mm
    cell      square of shifts; its places differ from its middle by at most `spread`, so that gap differs by no more:
              seen from the part a shift moves the pulleys, and a cable nowhere more than its pulley
    bound     what no place of a cell can be better than

The gap is that of slabs and pixels (solid, kernel): good for ranking, not for proof. The last word on a spot is the
check of the toolpath that is laid for it. Branch and bound: Land and Doig 1960.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.optimization.field import MEASURES, Field
from cabslice.optimization.kernel import ENOUGH
from cabslice.optimization.solid import Solid

GOALS = ("clearance", "tension", "first-mode")
CELLS = 8            # along the longer side of the shifts, to begin with
APART = 5.0          # mm between parts
GAIN = 0.5           # of the goal's unit: less is not looked for


@dataclass(frozen=True)
class Spot:
    """A place for a part, and what it is worth there."""

    turn_deg: float
    x: float
    y: float
    gap_mm: float                # clearance of cables from the part, about
    tension_n: float
    air_mm: float                # beside cables, pulleys and bed
    first_mode_hz: float         # nan where not asked for

    @property
    def printable(self) -> bool:
        return min(self.gap_mm, self.tension_n, self.air_mm) >= 0

    def score(self, goal: str) -> float:
        """What is maximised; of spots that are not printable how little they miss, always negative."""
        if not self.printable:
            return min(self.gap_mm, self.tension_n, self.air_mm)
        return {"clearance": self.gap_mm, "tension": self.tension_n, "first-mode": self.first_mode_hz}[goal]


@dataclass(frozen=True)
class Standing:
    """A part that stands already."""

    solid: Solid
    spot: Spot


def spots(
    solid: Solid, field: Field, goal: str, *, turns: Sequence[float], finest: float = 5.0, border: float = 0.0,
    standing: Sequence[Standing] = (), tick: Callable[[int, int], None] | None = None,
) -> list[Spot]:
    """The best spot of each turn, best first; those of which no cable is told to touch come before the others.

    finest: mm, side of the smallest cells; border: mm kept free between the part and the edge of the bed.
    """
    search = _Search(solid, field, goal, standing)
    best = []
    for done, turn in enumerate(turns):
        spot = search.turn(turn, finest, border)
        if spot:
            best.append(spot)
        if tick:
            tick(done + 1, len(turns))
    return sorted(best, key=lambda spot: (-spot.score(goal), spot.turn_deg))


def measured(
    solid: Solid, field: Field, turn: float, x: float, y: float, *, standing: Sequence[Standing] = (),
    enough: float = -np.inf,
) -> Spot:
    """What a spot is worth. Where the gap is less than `enough` it may be anything less."""
    from cabslice.optimization import kernel

    pose, values = pose_of(turn, x, y), np.empty(len(field.values))
    kernel.least_over(solid.points, solid.starts, pose, field.values, field.low, field.step, values)
    found = Spot(turn, x, y, 0.0, *(float(values[i]) if i < len(values) else np.nan for i in range(len(MEASURES))))
    keep = float(field.grow.max())
    gap = np.inf
    for number, (one, one_pose, other, other_pose) in enumerate(_pairs(solid, pose, standing)):
        gap = min(gap, kernel.least_gap(
            one.points, one.starts, one_pose, field.dz, one.order, field.exits, field.low, field.step, field.offsets,
            other.field, other.low, other.pixel, other.radius, other_pose, enough + keep,
        ) - keep)
        if gap < enough:
            break
        if number:
            apart = kernel.least_apart(
                one.points, one.starts, one_pose, other.field, other.low, other.pixel, other_pose)
            gap = min(gap, apart - APART)
    return replace(found, gap_mm=float(gap))


def pose_of(turn: float, x: float, y: float) -> Array:
    angle = np.radians(turn)
    return np.array([np.cos(angle), np.sin(angle), x, y])


def _pairs(
    solid: Solid, pose: Array, standing: Sequence[Standing]
) -> Iterator[tuple[Solid, Array, Solid, Array]]:
    """Who prints past whom."""
    yield solid, pose, solid, pose
    for other in standing:
        place = pose_of(other.spot.turn_deg, other.spot.x, other.spot.y)
        yield solid, pose, other.solid, place
        yield other.solid, place, solid, pose


def room(solid: Solid, field: Field, turn: float, border: float) -> Array:
    """(2,) mm: how far the middle of the part may be from that of the bed, each way; negative: it does not fit."""
    c, s, *_ = pose_of(turn, 0, 0)
    turned = solid.points @ np.array([[c, s], [-s, c]])
    return np.asarray(-field.low - np.abs(turned).max(axis=0) - border)


class _Search:
    def __init__(self, solid: Solid, field: Field, goal: str, standing: Sequence[Standing]) -> None:
        self.solid, self.field, self.goal, self.standing = solid, field, goal, standing
        self.best = -np.inf          # score of the best spot of all turns so far

    def turn(self, turn: float, finest: float, border: float) -> Spot | None:
        """The best spot of one turn, or the least bad one; None where the part does not fit on the bed."""
        half = room(self.solid, self.field, turn, border)
        if (half < 0).any():
            return None
        width = max(float(half.max()) * 2 / CELLS, finest)
        found: Spot | None = None
        heap: list[tuple[float, int, float, float, float]] = []
        self.count = 0
        for x, y in self._first(half, width):
            heapq.heappush(heap, (-np.inf, self._next(), x, y, width))
        while heap:
            bound, _, x, y, width = heapq.heappop(heap)
            limit = max(self.best, -np.inf if found is None else found.score(self.goal))
            if -bound <= limit + GAIN * (limit > 0):
                continue
            spot = self._at(turn, x, y, limit, width)
            if found is None or spot.score(self.goal) > found.score(self.goal):
                found = spot
                self.best = max(self.best, spot.score(self.goal))
            better = self._bound(spot, width)
            limit = max(limit, found.score(self.goal))
            if width > finest and better > limit + GAIN * (limit > 0):
                for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                    inside = np.clip((x + i * width / 4, y + j * width / 4), -half, half)
                    heapq.heappush(heap, (-better, self._next(), float(inside[0]), float(inside[1]), width / 2))
        return found

    def _next(self) -> int:
        self.count += 1
        return self.count

    def _first(self, half: Array, width: float) -> Iterator[tuple[float, float]]:
        counts = np.maximum(np.ceil(2 * half / width), 1).astype(int)
        axes = [np.linspace(-side, side, 2 * n + 1)[1::2] for side, n in zip(half, counts, strict=True)]
        for x in sorted(axes[0], key=abs):
            for y in sorted(axes[1], key=abs):
                yield float(x), float(y)

    def _at(self, turn: float, x: float, y: float, limit: float, width: float) -> Spot:
        """Worth of the middle of a cell; the gap need not be known where no place of the cell could matter."""
        spread = width / np.sqrt(2)
        known = limit if self.goal == "clearance" or limit < 0 else 0.0
        return measured(self.solid, self.field, turn, x, y, standing=self.standing, enough=known - spread)

    def _bound(self, spot: Spot, width: float) -> float:
        """What no spot of the cell can score above."""
        spread = width / np.sqrt(2)
        slopes = [*self.field.slopes, 0.0, 0.0]
        gap = min(spot.gap_mm + spread, ENOUGH - float(self.field.grow.max()))
        tension, air = spot.tension_n + slopes[0] * spread, spot.air_mm + slopes[1] * spread
        if min(gap, tension, air) < 0:
            return min(gap, tension, air)
        mode = spot.first_mode_hz + slopes[2] * spread
        return float({"clearance": gap, "tension": tension, "first-mode": mode}[self.goal])
