"""Which part of a layer's inside is skin: solid layers under every top and over every bottom surface, and bridges.

A point of a layer needs solid infill unless it is inside all outlines of the next `top_layers` above and the next
`bottom_layers` below; beyond the first and the last layer outlines are empty. One running intersection of outlines
serves both, and where it holds the whole inside, as it does along steep sides, nothing else is asked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, repeat

from cabslice.slicing.region import Region, difference, intersection, offset, opening, pieces

SAGS = 4.0    # bead widths: solid lines over narrower sparse infill need not be laid as bridges


@dataclass(frozen=True)
class Neighbours:
    """A layer's outline, the ones above and below it, and what is common to all layers near it.

    Beyond the ends `above` and `below` are empty; they are None where no top or bottom layers are asked for. For the
    first layer, which lies on the bed, `below` is None too. `common_below` is the common of the layer below, empty
    where there is none.
    """

    index: int
    outline: Region
    above: Region | None
    below: Region | None
    common: Region
    common_below: Region = field(default_factory=Region)


@dataclass(frozen=True)
class Window:
    """Layers first..end of `count`, and how many outlines below and above each say what is skin."""

    first: int
    end: int
    count: int
    below: int
    above: int


def neighbours(outlines: Iterable[Region], window: Window, coarse_mm: float = 0.0) -> Iterator[Neighbours]:
    """One per layer of the window, in order; holds window.above + window.below + 1 outlines at a time.

    `outlines` begin window.below + 1 layers before the first, or at the bed, and end window.above layers above the
    last, or at the top. All but a layer's own outline are simplified by coarse_mm.
    """
    queue: deque[tuple[Region, Region]] = deque()
    common = RunningIntersection()
    index, common_below = max(window.first - 1, 0), Region()
    under = repeat(Region(), max(0, window.below - index))
    over = repeat(Region(), max(0, window.end + window.above - window.count))
    for outline in chain(under, outlines, over):
        rough = outline.simplify(coarse_mm) if coarse_mm else outline
        queue.append((outline, rough))
        common.push(rough)
        if len(queue) <= window.above + window.below:
            continue
        above = queue[window.below + 1][1] if window.above else None
        below = queue[window.below - 1][1] if window.below and index else None
        if index >= window.first:
            yield Neighbours(index, queue[window.below][0], above, below, common.value(), common_below)
        common_below = common.value()
        index += 1
        queue.popleft()
        common.pop()


class RunningIntersection:
    """The intersection of a queue of regions, at about three booleans per push and pop however long the queue."""

    def __init__(self) -> None:
        self._front: list[Region] = []   # each the intersection of itself and all pushed after it, up to the turn
        self._back: list[Region] = []
        self._back_all: Region | None = None

    def push(self, region: Region) -> None:
        self._back.append(region)
        self._back_all = region if self._back_all is None else intersection(self._back_all, region)

    def pop(self) -> None:
        if not self._front:
            for region in reversed(self._back):
                self._front.append(intersection(region, self._front[-1]) if self._front else region)
            self._back, self._back_all = [], None
        self._front.pop()

    def value(self) -> Region:
        if self._back_all is None:
            return self._front[-1]
        return intersection(self._front[-1], self._back_all) if self._front else self._back_all


@dataclass(frozen=True)
class Surfaces:
    """How the inside of a layer is divided; the five do not overlap and together are the inside."""

    top: Region
    bridge: Region
    solid: Region
    sparse: Region
    over_sparse: Region = field(default_factory=Region)    # solid too, over sparse infill of the layer below


def divide(
    inside: Region, near: Neighbours, bead_mm: float, *, sparse: bool, solid: bool, bridges: bool = False,
    least_mm2: float = 0.0,
) -> Surfaces:
    """Top skin, bridges, other solid and sparse parts of a layer's inside.

    Patches narrower than a bead are no skin. Solid parts reach a bead further than they must, bridges two, to have a
    hold. What would be left of the sparse part narrower than two beads is solid too. sparse=False: there is no infill,
    what is not skin stays empty; solid=True: all of it is solid. bridges: what lies over sparse infill is told apart;
    least_mm2: smaller connected sparse parts are solid.
    """
    shell = _patches(difference(inside, near.common), bead_mm)
    if shell.is_empty():
        nothing, large = Region(), Region() if solid else _larger(inside, least_mm2)
        return Surfaces(nothing, nothing, difference(inside, large) if large is not inside else nothing, large)
    bridge, top = Region(), Region()
    if near.below is not None:
        bridge = _grown(_patches(difference(inside, near.below), bead_mm), 2 * bead_mm, inside)
    if near.above is not None:
        top = difference(_patches(difference(inside, near.above), bead_mm), bridge)
    rest = Region()
    if not solid:
        rest = difference(inside, _grown(shell, bead_mm, inside), bridge, top)
        rest = _larger(opening(rest, bead_mm), least_mm2) if sparse else rest
    full = difference(inside, top, bridge, rest)
    over = _over_sparse(full, near, bead_mm) if bridges and sparse and not solid else Region()
    return Surfaces(top, bridge, full if over.is_empty() else difference(full, over), rest, over)


def _larger(region: Region, least_mm2: float) -> Region:
    """The connected parts of at least this area; the region itself where all are."""
    parts = pieces(region) if least_mm2 > 0 else []
    small = [part for part in parts if part.area() < least_mm2]
    return difference(region, *small) if small else region


def _over_sparse(full: Region, near: Neighbours, bead: float) -> Region:
    """What of the solid parts lies over sparse infill: under it the layer below is solid a bead beyond its skins.

    Nothing narrower than SAGS, which lines cross without sagging; a bead further than it must, to have a hold.
    """
    if full.is_empty() or near.common_below.is_empty():
        return Region()
    return _grown(opening(intersection(full, offset(near.common_below, -bead)), SAGS / 2 * bead), bead, full)


def _patches(shown: Region, bead: float) -> Region:
    """Without slivers narrower than a bead."""
    return opening(shown, bead / 2) if shown.area() >= bead**2 else Region()


def _grown(patch: Region, distance: float, inside: Region) -> Region:
    return patch if patch.is_empty() else intersection(offset(patch, distance), inside)
