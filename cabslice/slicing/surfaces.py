"""Which part of a layer's inside is skin: solid layers under every top and over every bottom surface, and bridges.

For layer i with outline O_i: what shows from above is up_i = O_i - O_(i+1), from below down_i = O_i - O_(i-1). A point of
layer i has fewer than n layers above it exactly if it is in up_j for one j of i..i+n-1: it is in O_i, and j is the last
layer it stays inside. So one difference per layer serves the skins of all layers near it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.region import (
    Region,
    contains,
    difference,
    following,
    intersection,
    offset,
    opening,
    to_rings,
    union,
)


@dataclass(frozen=True)
class Exposure:
    """A layer's outline, what of it shows from above and below, and the same of the layers that make its skins solid."""

    index: int
    outline: Region
    below: Region              # outline of the layer under it, empty for the first
    up: Region
    down: Region               # air under it; empty for the first layer, which lies on the bed
    near_up: tuple[Region, ...]     # up of this layer and the next ones, as many as top layers
    near_down: tuple[Region, ...]   # down of this layer and the ones under it; the first layer's is its outline


def exposures(outlines: Iterable[Region], top_layers: int, bottom_layers: int) -> Iterator[Exposure]:
    """One Exposure per outline, in order; holds top_layers + bottom_layers + 2 layers at a time."""
    waiting: deque[tuple[int, Region, Region, Region]] = deque()  # index, outline, below, down
    ups: deque[Region] = deque()
    downs: deque[Region] = deque(maxlen=max(bottom_layers, 1))
    before = Region()

    def release() -> Exposure:
        index, outline, below, down = waiting.popleft()
        downs.append(down if index else outline)
        near_up = tuple(ups)[:top_layers]
        up = ups.popleft()
        return Exposure(index, outline, below, up, down, near_up, tuple(downs)[-bottom_layers:] if bottom_layers else ())

    for index, outline in enumerate(outlines):
        if index:
            ups.append(difference(before, outline))
        waiting.append((index, outline, before, difference(outline, before) if index else Region()))
        before = outline
        if len(ups) > top_layers:
            yield release()
    ups.append(before)
    while waiting:
        yield release()


@dataclass(frozen=True)
class Surfaces:
    """How the inside of a layer is divided; the four do not overlap and together are the inside."""

    top: Region
    bridge: Region
    solid: Region
    sparse: Region


def divide(inside: Region, seen: Exposure, bead_mm: float, *, sparse: bool, solid: bool) -> Surfaces:
    """Top skin, bridges, other solid and sparse parts of a layer's inside.

    Patches narrower than a bead are no skin. Skins and bridges reach a bead further than what shows, to have a hold; bridges
    two. What would be left of the sparse part narrower than two beads is solid too. sparse=False: there is no infill, all
    that is not skin stays empty; solid=True: all of it is solid.
    """
    bridge = _patch(inside, seen.down, bead_mm, 2 * bead_mm)
    top = difference(_patch(inside, seen.up, bead_mm, 0.0), bridge)
    if solid:
        return Surfaces(top, bridge, difference(inside, top, bridge), Region())
    shell = _patch(inside, union([*seen.near_up, *seen.near_down]), bead_mm, bead_mm)
    shell = union([shell, bridge, top])
    if shell.is_empty():
        return Surfaces(top, bridge, Region(), inside)
    rest = difference(inside, shell)
    if sparse:
        rest = opening(rest, bead_mm)
    return Surfaces(top, bridge, difference(inside, top, bridge, rest), rest)


def _patch(inside: Region, shown: Region, bead: float, grow: float) -> Region:
    """What of the inside shows, without slivers, grown."""
    patch = intersection(inside, shown)
    if patch.area() < bead**2:
        return Region()
    patch = opening(patch, bead / 2)
    return intersection(offset(patch, grow), inside) if grow and not patch.is_empty() else patch


def bridge_angle(bridge: Region, below: Region, reach_mm: float, fallback: float) -> float:
    """Direction (rad) in which lines over air are held best: the most of the bridge's edge that lies on the layer below is
    met head-on, least of the edge that hangs free.

    reach_mm is how far beyond the edge the layer below is looked for. Without any hold: the fallback.
    """
    points, starts = to_rings(offset(bridge, reach_mm))
    if not len(points):
        return fallback
    ahead = points[following(starts)]
    held = contains(*to_rings(below), (points + ahead) / 2)
    if not held.any() or held.all():
        return fallback if not held.any() else _shortest_span(points)
    along = ahead - points
    angles = np.radians(np.arange(0, 180, 5))
    met = np.abs(np.sin(angles)[:, None] * along[:, 0] - np.cos(angles)[:, None] * along[:, 1])
    return float(angles[np.argmax(np.round(met @ np.where(held, 1.0, -1.0), 6))])


def _shortest_span(points: Array) -> float:
    """Direction in which the points extend least."""
    angles = np.radians(np.arange(0, 180, 5))
    extent = np.ptp(points @ np.stack((np.cos(angles), np.sin(angles))), axis=0)
    return float(angles[np.argmin(np.round(extent, 6))])
