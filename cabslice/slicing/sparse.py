"""Sparse infill of some layers: each on its own, or several layers' at once in beads as high as they are together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from cabslice.profile.process import Process
from cabslice.slicing.beads import BeadList
from cabslice.slicing.fill import Filling, fill_sparse, together
from cabslice.slicing.layer import Role
from cabslice.slicing.lightning import Lines, clipped
from cabslice.slicing.patterns import Sparse
from cabslice.slicing.region import Region, difference, intersection, offset, opening

LEAST = 4.0     # bead widths: what is narrower in all the layers is not laid at once


@dataclass(frozen=True)
class SparseLayer:
    """What is sparse in one layer, the filling of the layer, and where its beads go."""

    index: int
    top_mm: float
    region: Region
    filling: Filling
    beads: BeadList


def lay_trees(layers: Sequence[SparseLayer], trees: Sequence[Lines]) -> None:
    """Lays planned lines (slicing.lightning), one set for each layer of the part, where the layers are sparse."""
    for layer in layers:
        room = offset(layer.region, layer.filling.overlap_mm - layer.filling.spacing_mm / 2)
        points, starts = clipped(trees[layer.index], room, layer.filling.width_mm / 4)
        layer.beads.add(points, starts, layer.filling.width_mm, Role.SPARSE_INFILL)


def lay_sparse(layers: Sequence[SparseLayer], process: Process, pitch: float) -> None:
    """Fills the sparse regions of consecutive layers, `infill_every` layers at once where all of them have it."""
    count = together(process)
    for first in range(0, len(layers), count):
        group = layers[first:first + count]
        common = _common(group) if len(group) == count > 1 else Region()
        for layer in group:
            rest = layer.region if common.is_empty() else _rest(layer, common)
            fill_sparse(layer.beads, rest, layer.filling, _pattern(layer, process, pitch), process.infill)
        if not common.is_empty():
            last = group[-1]
            high = replace(last.filling, height_mm=sum(one.filling.height_mm for one in group), several=True)
            fill_sparse(last.beads, common, high, _pattern(last, process, pitch), process.infill)


def _common(group: Sequence[SparseLayer]) -> Region:
    return opening(reduce(intersection, (layer.region for layer in group)), LEAST / 2 * group[0].filling.width_mm)


def _rest(layer: SparseLayer, common: Region) -> Region:
    return opening(difference(layer.region, common), layer.filling.width_mm)


def _pattern(layer: SparseLayer, process: Process, pitch: float) -> Sparse:
    number = layer.index // together(process)
    angle = float(np.radians(process.infill_angle_deg))
    return Sparse(process.pattern, angle, pitch, layer.filling.width_mm, number, layer.top_mm)
