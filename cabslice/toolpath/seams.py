"""Where outer walls begin, by the choice of the process."""

from __future__ import annotations

from typing import Literal

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Beads

Seam = Literal["aligned", "rear", "nearest", "random", "hidden"]
ARM_WIDTHS, REACH_WIDTHS = 1.0, 2.5      # seam corners are judged and kept over so many bead widths
SEED = 12                                # of the random seams: any number, the same in every print


def seam_places(
    beads: Beads, rings: Array, seam: Seam, *, position: Array, earlier: Array, bead_mm: float, layer: int
) -> tuple[Array, Array]:
    """On which segment (R,) of each of the closed lines `rings` (R,) it begins, and how far along it (R,), 0..1.

    aligned: near one of the seams `earlier` (S, 2) of the layer below, else hidden. rear: at the largest y. nearest:
    to the `position` (2,) from which the layer begins. random: anywhere, by the number of the layer alone. hidden: at
    the sharpest concave corner, else the sharpest convex one, else at the rear.
    """
    from cabslice.toolpath.rings import seams, starts_beside

    if seam == "rear":
        return _rear(beads, rings), np.zeros(len(rings))
    if seam == "random":
        return _anywhere(beads, rings, layer)
    if seam == "nearest":
        _, first, part = starts_beside(beads.points, beads.starts, rings, np.tile(position, (len(rings), 1)))
        return first, part
    kept = earlier if seam == "aligned" else np.empty((0, 2))
    first, part = seams(beads.points, beads.starts, rings, kept, ARM_WIDTHS * bead_mm, REACH_WIDTHS * bead_mm)
    return first, part


def _rear(beads: Beads, rings: Array) -> Array:
    loops = [beads.points[beads.starts[ring]:beads.starts[ring + 1]] for ring in rings]
    return np.array([np.lexsort((loop[:, 0], loop[:, 1]))[-1] for loop in loops], np.int64)


def _anywhere(beads: Beads, rings: Array, layer: int) -> tuple[Array, Array]:
    """Each place of a ring is as likely as any other."""
    first, part = np.zeros(len(rings), np.int64), np.zeros(len(rings))
    share = np.random.default_rng((SEED, layer)).uniform(size=len(rings))
    for k, ring in enumerate(rings):
        loop = beads.points[beads.starts[ring]:beads.starts[ring + 1]]
        along = np.cumsum(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1))
        first[k] = min(np.searchsorted(along, share[k] * along[-1], side="right"), len(loop) - 1)
        before = along[first[k] - 1] if first[k] else 0.0
        part[k] = min((share[k] * along[-1] - before) / max(along[first[k]] - before, 1e-12), 1.0)
    return first, part
