"""Support as regions, layer by layer: found from the top down before any bead is laid.

S_k  outline of layer k     z_k  its top, h_k its height, mm     O_i  overhang of layer i (slicing.overhang)
Straight support is the shadow of all overhangs: A_k = (A_(k+1) + O_(k+1)) - S_k. What is printed of it keeps clear of
the outlines of the layers within the gaps above and below, and by the xy gap of its own layer's.
"""

from __future__ import annotations

import numpy as np

from cabslice.profile.stand import Support
from cabslice.slicing.heights import Heights
from cabslice.slicing.overhang import COARSE, Marks, overhangs
from cabslice.slicing.region import Region, difference, intersection, opening, union
from cabslice.slicing.sections import NO_MODIFIERS, Modifiers, Solid
from cabslice.slicing.standing import Nearby, Standing, clearances, from_above, outlines_of, room_for


def plan_support(
    part: Solid, heights: Heights, asked: Support, bead_mm: float, modifiers: Modifiers = NO_MODIFIERS
) -> list[Standing]:
    """One per layer. Holds two simplified regions per layer, and the outlines of a few layers at a time."""
    marks = Marks(outlines_of(modifiers.blockers, heights.plane), outlines_of(modifiers.enforcers, heights.plane))
    around = asked.model_copy(update={"where": "everywhere"}) if asked.kind == "tree" else asked   # branches go around
    hanging = overhangs(outlines_of([part], heights.plane), heights.plane, around, bead_mm, marks)
    if all(region.is_empty() for region in hanging):
        return [Standing(Region(), Region())] * len(hanging)
    if asked.kind == "tree":
        from cabslice.slicing.tree import trees

        return trees(part, heights, asked, bead_mm, hanging)
    return _columns(part, heights, asked, bead_mm, hanging)


def _columns(part: Solid, heights: Heights, asked: Support, bead: float, hanging: list[Region]) -> list[Standing]:
    clear, layers = clearances(heights, asked), len(hanging)
    floor = asked.bottom_interface_layers
    near = Nearby(from_above(part, heights.plane), layers, int(clear.above.max()), int(clear.below.max()) + floor)
    found: list[Standing] = []
    shadow = Region()
    for k in reversed(range(layers)):
        near.move(k)
        if k + 1 < layers:
            shadow = union([shadow, hanging[k + 1]])
        shadow = difference(shadow, *near.at(k, k)).simplify(COARSE / 4)
        region = room_for(shadow, near, k, clear, asked, bead)
        roof = union(hanging[slice(*np.searchsorted(clear.contact, (k, k + asked.interface_layers)))])
        low = k - int(clear.below[k]) - 1
        ground = union(near.at(low - floor + 1, low)) if floor else Region()
        found.append(Standing(region, opening(intersection(region, union([roof, ground])), bead / 2)))
    return found[::-1]
