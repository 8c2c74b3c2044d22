"""A vase: over solid floors one closed wall, that the toolpath lets rise without a stop (toolpath.spiral)."""

from __future__ import annotations

from itertools import pairwise

from cabslice.errors import ModelError
from cabslice.profile.process import Process
from cabslice.slicing.region import Region, offset, ring_areas, to_rings


def floors(process: Process) -> int:
    """Layers of the part that are printed flat, with walls and skins, before the wall begins to rise."""
    return max(1, process.bottom_layers)


def vase(process: Process) -> Process:
    """The process of the floors: nothing over them needs infill or a top."""
    return process.model_copy(update={"infill": 0.0, "top_layers": 0})


def spiral_wall(outline: Region, width: float, z: float) -> Region:
    """The wall's centre line, as the edge of a region; holes in the outline are left out.

    Raises ModelError where the outline is not one piece with room for a wall: a spiral cannot jump.
    """
    points, starts = to_rings(outline)
    areas = ring_areas(points, starts)
    loops = [points[a:b] for (a, b), area in zip(pairwise(starts), areas, strict=True) if area > 0]
    wall = offset(Region([loops[0]]), -width / 2) if len(loops) == 1 else Region()
    if wall.num_contour() != 1:
        found = f"{len(loops)} outlines" if len(loops) != 1 else f"an outline narrower than a wall of {width:g} mm"
        raise ModelError(f"spiral: expected one closed wall at z = {z:.2f} mm, found {found}. Print it without spiral.")
    return wall
