"""What stands beside the part on the first layer."""

from __future__ import annotations

from cabslice.slicing.region import Region, offset


def skirt(outline: Region, loops: int, gap_mm: float, bead_mm: float, spacing_mm: float) -> list[Region]:
    """Loops around the first layer, outermost first; the innermost bead's edge is gap_mm from the outline's hull."""
    if outline.is_empty():
        return []
    hull = outline.hull()
    return [offset(hull, gap_mm + bead_mm / 2 + k * spacing_mm, round_corners=True) for k in reversed(range(loops))]
