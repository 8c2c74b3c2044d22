"""What lies in the way of the cables: the beads laid so far and the bed plate; and where the nozzle must not be.

Legend (domain of the affine images: a level platform, so that attachments move as the nozzle does)
    A    exit point of a cable, mm                     b    its attachment, b = q + d, q the nozzle, d fixed
    h    a height between A and b                      s    (h - A_z) / (b_z - A_z)
    x    a point of the part at height h: the cable meets it where q_xy = (x_xy - (1 - s) A_xy) / s - d_xy

All in bed coordinates. The doorway to shapely.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.toolpath.path import Toolpath

BED = -1             # `move` of the edges of the bed plate
DEEP = 1e6           # mm: the bed plate reaches this far down
LENGTH = 20.0        # mm: longer moves and beads are cut, so that neighbours are small and exit points hardly move
CORNERS = 16         # of the polygons that stand for discs, drawn around them
GAP_MM = 5.0         # infill gaps up to twice this count as inside the part when a depth is told


@dataclass(frozen=True)
class Obstacles:
    """Beads as columns: all points within `half` of the centre line in plan, low <= z <= top; mm."""

    first: Array         # (B, 2)
    last: Array          # (B, 2)
    half: Array          # (B,)
    low: Array           # (B,)
    top: Array           # (B,)
    stage: Array         # (B,) int32: see printing_stages
    move: Array          # (B,) int64: row of the toolpath, or BED

    def __len__(self) -> int:
        return len(self.half)

    def take(self, rows: Array | slice) -> Obstacles:
        return Obstacles(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Moves:
    """Stretches of straight moves of the nozzle, as columns."""

    start: Array         # (M, 3) mm
    end: Array           # (M, 3) mm
    stage: Array         # (M,) int32
    move: Array          # (M,) int64, row of the toolpath

    def __len__(self) -> int:
        return len(self.move)

    def take(self, rows: Array | slice) -> Moves:
        return Moves(self.start[rows], self.end[rows], self.stage[rows], self.move[rows])


def moves_of(toolpath: Toolpath, stages: Array) -> Moves:
    """All moves of the nozzle that have a length, travels too, in stretches of at most LENGTH."""
    rows = np.flatnonzero(moving(toolpath))
    part, start, end = cut_lines(toolpath.xyz[rows - 1], toolpath.xyz[rows], LENGTH)
    return Moves(start, end, stages[rows[part]], rows[part])


def beads_of(toolpath: Toolpath, stages: Array) -> Obstacles:
    """Every bead as prisms: its line grown by half its width, from the lower end of the line minus its height up."""
    rows = np.flatnonzero(laying(toolpath))
    part, start, end = cut_lines(toolpath.xyz[rows - 1], toolpath.xyz[rows], LENGTH)
    rows = rows[part]
    return Obstacles(
        start[:, :2], end[:, :2], toolpath.width[rows] / 2,
        np.minimum(start[:, 2], end[:, 2]) - toolpath.height[rows], np.maximum(start[:, 2], end[:, 2]),
        stages[rows], rows,
    )


def cut_lines(start: Array, end: Array, longest: float) -> tuple[Array, Array, Array]:
    """Lines (K, n) in equal stretches no longer than `longest`: the line each is of, its start and its end."""
    way = end - start
    count = np.maximum(np.ceil(np.sqrt(np.einsum("ki,ki->k", way, way)) / longest), 1).astype(int)
    row = np.repeat(np.arange(len(count)), count)
    if len(row) == len(count):
        return row, start, end
    start, end = start[row], end[row]
    cut = np.flatnonzero(count[row] > 1)
    line = row[cut]
    part = cut - (np.cumsum(count) - count)[line]
    step, origin = way[line] / count[line, None], start[cut].copy()
    start[cut], end[cut] = origin + part[:, None] * step, origin + (part + 1)[:, None] * step
    return row, start, end


def bed_edges(size: Array, slope: Array | None = None) -> Obstacles:
    """The four sides of a bed plate (2,) mm that fills everything below its surface, z = slope . (x, y).

    A cable with both ends outside the plate cannot enter it without meeting a side. Sides that rise are cut in
    stretches of at most LENGTH, each as high as its higher end.
    """
    x, y = size / 2
    ring = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    rise = ring @ (np.zeros(2) if slope is None else slope)
    corners = np.column_stack((ring, rise))
    longest = LENGTH if rise.any() else np.inf
    _, start, end = cut_lines(corners, np.roll(corners, -1, axis=0), longest)
    zero = np.zeros(len(start))
    stage, move = np.full(len(start), -1, np.int32), np.full(len(start), BED, np.int64)
    return Obstacles(start[:, :2], end[:, :2], zero, zero - DEEP, np.maximum(start[:, 2], end[:, 2]), stage, move)


def printing_stages(toolpath: Toolpath) -> Array:
    """(N,) int32, never falling: what was laid in a stage counts as laid for all moves of that stage and later ones.

    A stage ends where the layer number changes, in any order, so that objects printed one after the other are kept
    apart; and where within a layer the bead has climbed by its height, as in a spiral vase.
    """
    rows = np.arange(len(toolpath.layer))
    laid = np.maximum.accumulate(np.where(laying(toolpath), rows, -1))
    fresh = np.diff(toolpath.layer, prepend=toolpath.layer[0] - 1) != 0
    run = np.cumsum(fresh) - 1
    begin = np.flatnonzero(fresh)[run]
    here = laid >= begin
    height = toolpath.height[laid]
    base = np.full(run[-1] + 1, np.inf)
    np.minimum.at(base, run[here], toolpath.xyz[laid[here], 2])
    climbed = np.where(here & (height > 0), toolpath.xyz[laid, 2] - base[run], 0.0)
    step = np.floor(np.where(climbed > 0, climbed, 0.0) / np.where(height > 0, height, 1.0) + 1e-6)
    change = fresh[1:] | (np.diff(step) != 0)
    return np.concatenate(([0], np.cumsum(change))).astype(np.int32)


def island_stages(toolpath: Toolpath, stages: Array, first: int) -> Array:
    """(N,) int32: printing_stages with one more for each run of beads in stages from `first` on, so that what is laid
    in a layer counts once its run is laid."""
    beads = laying(toolpath)
    begins = beads & ~np.concatenate(([False], beads[:-1])) & (stages >= first)
    return (stages + np.cumsum(begins)).astype(np.int32)


def laying(toolpath: Toolpath) -> Array:
    """(N,) bool: moves that lay a bead, with a length and filament fed."""
    return moving(toolpath) & (toolpath.filament > 0)


def moving(toolpath: Toolpath) -> Array:
    """(N,) bool: moves of the nozzle that have a length."""
    xyz = toolpath.xyz
    away = [xyz[1:, axis] != xyz[:-1, axis] for axis in range(3)]
    return np.concatenate(([False], away[0] | away[1] | away[2]))


# ---- plan views

def forbidden_region(
    beads: Obstacles, exits: Array, offset: Array, nozzle_z: float, grow: float,
    window: tuple[Array, Array] | None = None,
) -> Any:
    """Nozzle positions (shapely, plan, mm) at height nozzle_z from which a cable comes within `grow` of a bead.

    exits (3,): A, taken as fixed; offset (3,): d, attachment minus nozzle. The affine images of the beads' sections,
    over all heights from `grow` below to `grow` above each bead. Conservative: the bead is grown by a cylinder instead
    of a ball, and discs by the polygons drawn around them. window: two corners (2,) of a box in plan; what does not
    reach into it is left out.
    """
    import shapely

    rise = nozzle_z + offset[2] - exits[2]
    heights = np.clip(np.stack((beads.low - grow, beads.top + grow)) - exits[2], *sorted((1e-3 * rise, rise)))
    rows = np.flatnonzero(heights[0] != heights[1])
    if not len(rows):
        return shapely.Polygon()
    share = heights[:, rows] / rise
    ends = np.stack((beads.first[rows], beads.last[rows]))
    images = exits[:2] + (ends - exits[:2]) / share[:, None, :, None] - offset[:2]
    radii = (beads.half[rows] + grow) / share
    if window is not None:
        reach = (radii / np.cos(np.pi / CORNERS))[:, None, :, None]
        low, high = (images - reach).min(axis=(0, 1)), (images + reach).max(axis=(0, 1))
        near = np.flatnonzero(((low < window[1]) & (high > window[0])).all(axis=1))
        images, radii, rows = images[:, :, near], radii[:, near], rows[near]
        if not len(rows):
            return shapely.Polygon()
    corners = images[..., None, :] + radii[:, None, :, None, None] * _around()
    cloud = corners.transpose(2, 0, 1, 3, 4).reshape(len(rows), -1, 2)
    return shapely.union_all(shapely.convex_hull(shapely.linestrings(cloud)))


def section(beads: Obstacles) -> Any:
    """Plan view (shapely) of some beads, gaps up to 2 GAP_MM filled: the part as a reader of a depth thinks of it."""
    import shapely

    lines = shapely.linestrings(np.stack((beads.first, beads.last), axis=1))
    union = shapely.union_all(shapely.buffer(lines, beads.half + GAP_MM))
    return shapely.buffer(union, -GAP_MM)


def depths(region: Any, points: Array) -> Array:
    """How far inside a region points (K, 2) lie, mm; 0 outside."""
    import shapely

    places = shapely.points(points)
    return np.where(shapely.intersects(region, places), shapely.distance(shapely.boundary(region), places), 0.0)


def _around() -> Array:
    """(CORNERS, 2): corners of a polygon around the unit disc."""
    turn = 2 * np.pi / CORNERS * np.arange(CORNERS)
    return np.stack((np.cos(turn), np.sin(turn)), axis=1) / np.cos(np.pi / CORNERS)
