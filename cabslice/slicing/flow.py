"""How much a bead holds, and how far apart beads lie that together fill a layer.

w  bead width, mm        h  bead height = layer height, mm
A  cross-section, mm^2   s  spacing of neighbouring centre lines, mm: A = s h
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array


def bead_area(width: Array | float, height: Array | float) -> Array:
    """Cross-section of a bead, mm^2: a rectangle with half-round sides (the model of PrusaSlicer's flow page).

    Where the bead is narrower than it is high it is taken as a rectangle of the same width.
    """
    width, height = np.asarray(width, dtype=np.float64), np.asarray(height, dtype=np.float64)
    return np.where(width > height, (width - height) * height + np.pi / 4 * height**2, width * height)


def bead_spacing(width: Array | float, height: Array | float) -> Array:
    """Distance between the centre lines of neighbouring beads that together fill the layer, mm."""
    return bead_area(width, height) / height


def bead_width(spacing: Array | float, height: Array | float) -> Array:
    """Width of the bead that fills a strip of the given width, mm: the inverse of `bead_spacing`.

    The area of a bead jumps where its width passes its height; of two possible widths this is the wider, rounded one.
    """
    spacing = np.asarray(spacing, dtype=np.float64)
    return np.where(spacing > np.pi / 4 * height, spacing + (1 - np.pi / 4) * height, spacing)
