"""How the nozzle gets from one bead to the next: which way, and whether it draws back, wipes, coasts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.profile.process import Process, Retraction
from cabslice.slicing.layer import Layer, Polygons, Role
from cabslice.slicing.region import contains, from_rings, offset, to_rings
from cabslice.toolpath.combing import comb, straight_inside
from cabslice.toolpath.sequence import Drawn

SAME_PLACE = 1e-3              # mm: lines that meet so closely are laid without a travel between; less than lines.TINY
GUARD, RAIL = 0.4, 0.75        # bead widths inside the outline: shortcuts keep within, travels are led along
REACH = 1.5                    # bead widths: how far from the rail a bead may end
COARSE = 0.1                   # of the bead: detail of the outline that no travel follows
AT_ENDS = 0.47                 # bead widths of a travel at its ends that may lie over what is seen
SHORTEST_WIPE = 0.2            # mm


@dataclass(frozen=True)
class Travels:
    """To each line (L,): drawn back or not; `direct` where the nozzle travels without; else it begins on the spot.

    ways (W, 2), way_starts (L + 1,): points between the ends; wipes (V, 2), wipe_starts (L + 1,): points gone back to
    along the bead before, while the filament is drawn back.
    """

    retracted: Array
    direct: Array
    ways: Array
    way_starts: Array
    wipes: Array
    wipe_starts: Array


def travels(
    drawn: Drawn, layer: Layer, before: Array, process: Process, *, climbs: bool, stops: bool, anew: bool = False,
    covers: Sequence[Polygons] = (),
) -> Travels:
    """To the lines of a layer from `before` (L, 2).

    climbs: the first comes from another height; stops: the nozzle waits before it, drawn back; anew: it comes from
    another object; covers: outlines of the layers below and above, within which threads are not seen.
    """
    retraction, heads = process.retraction, drawn.points[drawn.starts[:-1]]
    gap = np.linalg.norm(heads - before, axis=1)
    apart = gap > SAME_PLACE
    together = np.diff(drawn.island, prepend=drawn.island[:1]) == 0
    together[0] &= not anew
    free, ways, way_starts = _inside(layer.outline, before, heads, apart & together, process)
    free &= gap <= retraction.inside_travel_mm
    asked = free & apart & (gap >= retraction.min_travel_mm)
    for cover in covers:
        free &= ~asked | _within(cover, before, heads, ways, way_starts, asked, AT_ENDS * process.bead_mm)
    free &= (drawn.role != Role.TOP_SKIN) & (np.roll(drawn.role, 1) != Role.TOP_SKIN)
    drawing_back = retraction.length_mm > 0
    retracted = apart & (~together | (~free & (gap >= retraction.min_travel_mm))) & drawing_back
    retracted[0] |= (stops and drawing_back) or anew
    direct = apart & ~retracted
    direct[0] |= climbs and not retracted[0]
    wipes, wipe_starts = _wipes(drawn, retracted, retraction)
    if len(wipes):
        left = np.where((np.diff(wipe_starts) > 0)[:, None], wipes[wipe_starts[1:] - 1], before)
        _, ways, way_starts = _inside(layer.outline, left, heads, apart & together, process)
    return Travels(retracted, direct, ways, way_starts, wipes, wipe_starts)


def _inside(
    outline: Polygons, here: Array, there: Array, wanted: Array, process: Process
) -> tuple[Array, Array, Array]:
    """Which travels (L,) stay inside the outline, as they are or led; the points of those that are led."""
    count = len(here)
    none = np.zeros((0, 2)), np.zeros(count + 1, np.int64)
    if not (len(outline.points) and wanted.any()):
        return np.zeros(count, np.bool_), *none
    free = straight_inside(outline.points, outline.starts, here, there, wanted)
    led = np.flatnonzero(wanted & ~free)
    if not len(led) or process.retraction.max_detour <= 1:
        return free, *none
    bead = process.bead_mm
    whole = from_rings(outline.points, outline.starts, simplify_mm=COARSE * bead)
    guard, rail = (to_rings(offset(whole, -share * bead).simplify(COARSE / 2 * bead)) for share in (GUARD, RAIL))
    if len(rail[0]) == 0:
        return free, *none
    points, starts = comb(
        (outline.points, outline.starts), guard, rail, here[led], there[led], REACH * bead,
        process.retraction.max_detour,
    )
    size = np.zeros(count, np.int64)
    size[led] = np.diff(starts)
    free[led] = size[led] > 0
    return free, points, np.append(0, np.cumsum(size))


def _within(
    cover: Polygons, here: Array, there: Array, ways: Array, way_starts: Array, asked: Array, near: float
) -> Array:
    """(L,) bool: which of the travels asked for, as they are led, lie inside the cover but for `near` mm at their ends,

    where the nozzle lays beads itself.
    """
    inside = np.zeros(len(here), np.bool_)
    some = np.flatnonzero(asked)
    if not (len(some) and len(cover.points)):
        return inside
    size = np.diff(way_starts)[some]
    bounds = np.append(0, np.cumsum(size + 2))
    points = np.empty((bounds[-1], 2))
    between = np.ones(len(points), np.bool_)
    between[bounds[:-1]] = between[bounds[1:] - 1] = False
    points[bounds[:-1]], points[bounds[1:] - 1] = here[some], there[some]
    points[between] = ways[np.repeat(asked, np.diff(way_starts))]
    _shorten(points, bounds[:-1], 1, near)
    _shorten(points, bounds[1:] - 1, -1, near)
    real = np.ones(len(points) - 1, np.bool_)
    real[bounds[1:-1] - 1] = False
    kept = straight_inside(cover.points, cover.starts, points[:-1], points[1:], real) | ~real
    whole = np.logical_and.reduceat(np.append(kept, True), bounds[:-1])
    inside[some] = whole & contains(cover.points, cover.starts, points[bounds[:-1]])
    return inside


def _shorten(points: Array, ends: Array, towards: int, near: float) -> None:
    """Move the points at `ends` towards the next or last one by `near` mm, half the way at most."""
    step = points[ends + towards] - points[ends]
    points[ends] += step * np.minimum(0.5, near / np.maximum(np.linalg.norm(step, axis=1), SAME_PLACE))[:, None]


def _wipes(drawn: Drawn, retracted: Array, retraction: Retraction) -> tuple[Array, Array]:
    """Ways back along the line before, for lines after the first; none where that line is very short."""
    size = np.zeros(len(retracted), np.int64)
    found = [np.zeros((0, 2))]
    if retraction.wipe_mm > 0:
        for line in (np.flatnonzero(retracted[1:]) + 1).tolist():
            back = drawn.points[drawn.starts[line - 1]:drawn.starts[line]][::-1]
            way = _beginning(back, retraction.wipe_mm)
            if _length(np.vstack((back[:1], way))) > SHORTEST_WIPE:
                found.append(way)
                size[line] = len(way)
    return np.concatenate(found), np.append(0, np.cumsum(size))


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _beginning(points: Array, long: float) -> Array:
    """The first `long` mm of a polyline (N, 2), without its first point."""
    far = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))
    last = int(np.searchsorted(far, long))
    if last >= len(far):
        return points[1:]
    done = far[last - 1] if last else 0.0
    share = (long - done) / (far[last] - done)
    end = points[last] + share * (points[last + 1] - points[last])
    return np.vstack((points[1:last + 1], end))


def coasted(drawn: Drawn, retracted: Array, retraction: Retraction) -> tuple[Drawn, Array]:
    """The lines with a point where coasting begins, and which segments (M,) are laid by pressure alone."""
    dry = np.zeros(len(drawn.points), np.bool_)
    ends = np.append(retracted[1:], False)
    if retraction.coast_mm <= 0 or not ends.any():
        return drawn, dry
    points, width, dries = [], [], []
    for line, (low, high) in enumerate(zip(drawn.starts[:-1], drawn.starts[1:], strict=True)):
        one, wide, none = drawn.points[low:high], drawn.width[low:high], np.zeros(high - low, np.bool_)
        if ends[line]:
            one, wide, none = _coast(one, wide, retraction.coast_mm)
        points.append(one)
        width.append(wide)
        dries.append(none)
    starts = np.cumsum([0, *map(len, points)])
    longer = replace(drawn, points=np.concatenate(points), width=np.concatenate(width), starts=starts)
    return longer, np.concatenate(dries)


def _coast(points: Array, width: Array, long: float) -> tuple[Array, Array, Array]:
    if _length(points) <= long:                         # shorter than the way to coast: laid whole
        return points, width, np.zeros(len(points), np.bool_)
    tail = _beginning(points[::-1], long)[::-1]
    kept = len(points) - len(tail)
    made = np.vstack((points[:kept], tail[:1], points[kept:]))
    dry = np.append(np.zeros(kept + 1, np.bool_), np.ones(len(points) - kept, np.bool_))
    return made, np.concatenate((width[:kept], width[kept:kept + 1], width[kept:])), dry
