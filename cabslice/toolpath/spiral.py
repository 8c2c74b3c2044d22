"""The wall of a vase: ring after ring of the layers above its floors becomes one rising line without a stop.

s     share of the ring's length laid, 0..1     h     layer height, mm
A ring begins over the ring below and ends on its own outline: at s it lies (1 - s) of the way back to the ring below,
and rises from the top of the layer below to its own. The first ring, over flat ground, is s h high; a last one at the
top of the print goes down to nothing, so that the rim is level.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ModelError
from cabslice.slicing.layer import Beads, Layer, Role
from cabslice.toolpath.sequence import Drawn

FINEST = 96      # parts of a ring of changing height
TINY = 2e-3      # mm, nearer points are one


def spiral_ring(beads: Beads, position: Array, name: str) -> Array:
    """(N, 2) the layer's only closed wall from the place nearest to `position` (2,) around to it. Raises ModelError."""
    from cabslice.toolpath.rings import nearest_on_ring

    if len(beads.role) != 1 or not beads.closed[0] or beads.role[0] != Role.OUTER_WALL:
        raise ModelError(f"spiral: {name} holds more than one closed wall; expected no support, and one layer of skirt")
    ring = beads.points
    _, first, part = nearest_on_ring(ring, *position)
    begin = ring[first] + part * (ring[(first + 1) % len(ring)] - ring[first])
    return np.vstack((begin, np.roll(ring, -first - 1, axis=0)[: len(ring) if part else len(ring) - 1], begin))


def shares(points: Array) -> Array:
    """(N,) share of the line's length up to each point (N, 2)."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    return along / along[-1]


def blended(ring: Array, below: Array, position: Array) -> Array:
    """The ring (N, 2), leaving the one below (M, 2) little by little; it begins where the nozzle is."""
    from cabslice.toolpath.rings import starts_beside

    loop = below[:-1]
    count = len(ring)
    starts = np.array([0, len(loop)])
    _, first, part = starts_beside(loop, starts, np.zeros(count, np.int64), ring)
    nearest = loop[first] + part[:, None] * (loop[(first + 1) % len(loop)] - loop[first])
    share = shares(ring)[:, None]
    mixed = (1 - share) * nearest + share * ring
    mixed[0] = position
    return mixed[np.append(True, np.linalg.norm(np.diff(mixed, axis=0), axis=1) > TINY)]


def divided(points: Array) -> Array:
    """The same line with no part longer than 1 / FINEST of it."""
    share = shares(points)
    every = np.union1d(share, np.linspace(0, 1, FINEST + 1))
    every = every[np.append(np.diff(every) > TINY / FINEST, True)]
    return np.stack([np.interp(every, share, points[:, axis]) for axis in (0, 1)], axis=1)


def drawn_ring(points: Array, layer: Layer) -> Drawn:
    width = np.full(len(points), layer.beads.width[0])
    return Drawn(points, width, np.array([0, len(points)]), layer.beads.role, layer.beads.island, layer.beads.height)


def flat(layer: Layer, z: float) -> Layer:
    """The layer as it begins, on top of the one below."""
    return replace(layer, z_mm=z)


def rise(rows: dict[str, Array], points: Array, layer: Layer, *, first: bool, last: bool) -> None:
    """Heights and places of the laid rows of a ring, drawn flat on the layer below (last: on its own)."""
    laid = rows["role"] != Role.TRAVEL
    share = shares(points)
    middle = (share[1:] + share[:-1]) / 2
    if not last:
        rows["xyz"][laid, 2] += layer.height_mm * share[1:]
    if first:
        rows["height"][laid] = layer.height_mm * middle
    elif last:
        rows["height"][laid] = layer.height_mm * (1 - middle)
