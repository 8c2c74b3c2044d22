"""A small picture of what a toolpath lays, as PNG: for the headers of G-code and motor files.

    picture(path, 220, 124)     pixels
    thumbnail(path, 220, 124)   bytes of a PNG
    png(pixels)                 bytes of a PNG from an array of pixels
    comment(png, 220, 124)      the same as the lines that G-code viewers and print servers look for

Legend
    view     seen from the front right, from above: right, up and near are unit vectors of the eye
    point    places on the beads, about a pixel apart; where several fall on one pixel, the nearest to the eye is seen
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath

TURN, TILT = np.radians(-35.0), np.radians(28.0)     # of the eye, from the front and above the bed
FINER = 2                                            # pixels of the raster per pixel of the picture, each way
BORDER = 0.06                                        # of the picture, left free on each side
POINTS = 2_000_000                                   # at most; beyond, they stand wider apart
COLOUR = np.array([230, 120, 30])                    # of a face that looks at the light, 0..255
HIDDEN = (Role.TRAVEL, Role.SKIRT, Role.SUPPORT, Role.SUPPORT_INTERFACE)
INNER = (Role.INNER_WALL, Role.SPARSE_INFILL)
UP, LIGHT = np.array([0.0, 0.0, 1.0]), np.array([-0.28, -0.50, 0.82])


def thumbnail(path: Toolpath, width: int, height: int) -> bytes:
    """PNG of `picture`."""
    return png(picture(path, width, height))


def thumbnail_lines(path: Toolpath, width: int, height: int) -> Iterator[str]:
    """Comment lines as PrusaSlicer writes them, with an empty one on both sides."""
    yield ";"
    yield from comment(thumbnail(path, width, height), width, height)
    yield ";"


def picture(path: Toolpath, width: int, height: int) -> Array:
    """(height, width, 4) uint8, red green blue and cover, of the beads without travel, skirt and support."""
    if min(width, height) < 1:
        raise ValueError(f"a picture of {width} x {height} pixels has none")
    view = _view(path, width, height)
    if view is None:
        return np.zeros((height, width, 4), np.uint8)
    seen, depth = np.zeros((*view.raster[::-1], 4)), np.full(view.raster[::-1], -np.inf)
    for low, high in path.spans():
        rows = _shown(path, low, high, view.hidden)
        if len(rows):
            shown, near = _raster(path, rows, view)
            nearer = near >= depth
            seen[nearer], depth[nearer] = shown[nearer], near[nearer]
    return _reduced(seen)


@dataclass(frozen=True)
class _View:
    """Size (mm) of a pixel of the raster (2,), where its corner (2,) is, how far apart points on beads are (mm), pixels
    that a point covers, and roles that are not shown."""

    pixel: float
    corner: Array
    raster: Array
    apart: float
    stamp: list[tuple[int, int]]
    hidden: tuple[Role, ...]


def _view(path: Toolpath, width: int, height: int) -> _View | None:
    """The whole path from `_eye`; inner walls and sparse infill are shown only where there is nothing else."""
    for hidden in ((*HIDDEN, *INNER), HIDDEN):
        low, high, long, sizes = np.full(2, np.inf), np.full(2, -np.inf), 0.0, [np.empty((0, 2))]
        for begin, end in path.spans():
            rows = _shown(path, begin, end, hidden)
            if len(rows):
                flat = _ends(path, rows) @ np.stack(_eye()[:2], axis=1)
                low, high = np.minimum(low, flat.min(axis=(0, 1))), np.maximum(high, flat.max(axis=(0, 1)))
                long += path.lengths_of(begin, end)[rows - begin].sum()
                sizes.append(np.stack((path.width[rows], path.height[rows]), axis=1))
        if np.isfinite(low).all():
            raster = np.array([width, height]) * FINER
            pixel = float(np.max(np.maximum(high - low, 1e-3) / (raster * (1 - 2 * BORDER))))
            bead, tall = np.median(np.concatenate(sizes), axis=0).tolist()
            stamp = _stamp(bead, tall, pixel)
            return _View(pixel, (low + high) / 2 - raster * pixel / 2, raster, max(pixel, long / POINTS), stamp, hidden)
    return None


def comment(content: bytes, width: int, height: int) -> Iterator[str]:
    """Lines of a G-code comment that carry a PNG, in the layout that PrusaSlicer introduced."""
    text = base64.b64encode(content).decode()
    yield f"; thumbnail begin {width}x{height} {len(text)}"
    yield from (f"; {text[i:i + 78]}" for i in range(0, len(text), 78))
    yield "; thumbnail end"


def png(pixels: Array) -> bytes:
    """A PNG of pixels (H, W, 3 or 4) uint8, red green blue and cover. Source: ISO/IEC 15948, PNG."""
    height, width, channels = pixels.shape
    lines = np.zeros((height, 1 + width * channels), np.uint8)          # each line begins with its filter: none
    lines[:, 1:] = pixels.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes(), 9)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts)


def _shown(path: Toolpath, low: int, high: int, hidden: tuple[Role, ...]) -> Array:
    """Moves of low..high that can be seen from outside; of very many, some."""
    rows = np.flatnonzero(~np.isin(path.role[low:high], hidden) & (path.lengths_of(low, high) > 0)) + low
    return rows[::1 + len(path.role) // POINTS]


def _ends(path: Toolpath, rows: Array) -> Array:
    """(2, K, 3) mm, where the moves `rows` begin and end."""
    return np.stack((path.xyz[rows - 1], path.xyz[rows]))


def _eye() -> tuple[Array, Array, Array]:
    """Unit vectors right, up and near (towards the eye)."""
    near = np.array([-np.sin(TURN) * np.cos(TILT), -np.cos(TURN) * np.cos(TILT), np.sin(TILT)])
    right = np.cross([0.0, 0.0, 1.0], near) / np.cos(TILT)
    return right, np.cross(near, right), near


def _raster(path: Toolpath, rows: Array, view: _View) -> tuple[Array, Array]:
    """Pixels (H, W, 4), 0..1, of the moves `rows`, and how near (H, W) what they show is, mm."""
    ends, eye, size = _ends(path, rows), _eye(), view.raster
    which, place = _points(ends, view.apart)
    near = place @ eye[2] + _lift(path, rows)[which]
    order = np.argsort(near, kind="stable")     # near ones last: they paint over
    x, y = np.floor((place[order] @ np.stack(eye[:2], axis=1) - view.corner) / view.pixel).astype(np.int64).T
    front = np.full(size[0] * size[1], -1, np.int64)
    for dx, dy in view.stamp:
        row, column = np.clip(size[1] - 1 - y - dy, 0, size[1] - 1), np.clip(x + dx, 0, size[0] - 1)
        np.maximum.at(front, row * size[0] + column, np.arange(len(row)))
    out, depth, seen = np.zeros((len(front), 4)), np.full(len(front), -np.inf), front >= 0
    out[seen, :3] = _shades(path, rows, ends, eye[2])[which[order[front[seen]]]]
    out[seen, 3] = 1.0
    depth[seen] = near[order[front[seen]]]
    return out.reshape(size[1], size[0], 4), depth.reshape(size[1], size[0])


def _points(ends: Array, apart: float) -> tuple[Array, Array]:
    """Which move each point lies on (P,), and where (P, 3): evenly spaced, `apart` mm."""
    length = np.linalg.norm(ends[1] - ends[0], axis=1)
    count = np.maximum(np.ceil(length / apart), 1).astype(np.int64)
    which = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[which]
    return which, ends[0][which] + share[:, None] * (ends[1] - ends[0])[which]


def _lift(path: Toolpath, rows: Array) -> Array:
    """What fills a surface lies before the wall behind it (K,) mm."""
    return np.where(_is_wall(path, rows), 0.0, path.width[rows])


def _stamp(width: float, tall: float, pixel: float) -> list[tuple[int, int]]:
    """Pixels that a point covers: about as many as a bead is wide or tall."""
    reach = min(4, max(1, round(max(tall * np.cos(TILT), 0.5 * width) / pixel)))
    span = range(-(reach // 2), reach - reach // 2)
    return [(i, j) for i in span for j in span]


def _is_wall(path: Toolpath, rows: Array) -> Array:
    return np.isin(path.role[rows], (Role.OUTER_WALL, Role.INNER_WALL, Role.OVERHANG_WALL, Role.CUSTOM))


def _shades(path: Toolpath, rows: Array, ends: Array, near: Array) -> Array:
    """Colour (K, 3), 0..1, of each move: walls face sideways, towards the eye; what fills a surface faces up."""
    way = ends[1] - ends[0]
    side = np.stack((way[:, 1], -way[:, 0], np.zeros(len(way))), axis=1)
    side /= np.maximum(np.linalg.norm(side, axis=1), 1e-12)[:, None]
    side *= np.where(side @ near < 0, -1.0, 1.0)[:, None]
    normal = np.where(_is_wall(path, rows)[:, None], side + 0.25 * UP, UP)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    bright = 0.42 + 0.58 * np.maximum(normal @ LIGHT, 0.0)
    return np.clip(bright[:, None] * COLOUR / 255 + 0.12 * bright[:, None] ** 6, 0, 1)


def _reduced(seen: Array) -> Array:
    """FINER x FINER pixels into one: colours weighed by cover."""
    height, width = (side // FINER for side in seen.shape[:2])
    cells = seen.reshape(height, FINER, width, FINER, 4).transpose(0, 2, 1, 3, 4).reshape(height, width, -1, 4)
    cover = cells[..., 3].mean(axis=2)
    colour = cells[..., :3].sum(axis=2) / np.maximum(cells[..., 3].sum(axis=2), 1)[..., None]
    return np.rint(255 * np.concatenate((colour, cover[..., None]), axis=2)).astype(np.uint8)
