"""A small picture of a toolpath for the head of a G-code file: PNG, seen from the front right and above.

Points along the beads are painted from the back to the front; a bead is the brighter the more its side faces the light.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterator

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath

POINTS = 400_000                              # painted at most
TURN, LIFT = np.radians(30.0), np.radians(35.0)     # of the eye: about z, and above the bed
LIGHT = np.radians(70.0)                      # direction it comes from, about z
COLOUR = np.array([235.0, 125.0, 40.0])
MARGIN = 0.05                                 # of the picture, left free on each side
SKINS = (Role.OUTER_WALL, Role.OVERHANG_WALL, Role.TOP_SKIN, Role.IRONING, Role.GAP_FILL)


def thumbnail_lines(path: Toolpath, width: int, height: int) -> Iterator[str]:
    """Comment lines as PrusaSlicer writes them: width x height pixels, PNG in base64."""
    text = base64.b64encode(png(picture(path, width, height))).decode()
    yield ";"
    yield f"; thumbnail begin {width}x{height} {len(text)}"
    for low in range(0, len(text), 78):
        yield f"; {text[low:low + 78]}"
    yield "; thumbnail end"
    yield ";"


def picture(path: Toolpath, width: int, height: int) -> Array:
    """(height, width, 4) uint8, red, green, blue, opacity; what no bead covers is clear."""
    image = np.zeros((height, width, 4), np.uint8)
    shown = np.isin(path.role, SKINS) & (path.lengths > 0)
    rows = np.flatnonzero(shown if shown.any() else (path.role != Role.TRAVEL) & (path.lengths > 0))
    if not len(rows):
        return image
    place, bright, depth = _seen(path, rows, max(width, height))
    span = np.ptp(place, axis=0)
    scale = (1 - 2 * MARGIN) * min(width / max(span[0], 1e-6), height / max(span[1], 1e-6))
    pixel = (place - place.min(0) - span / 2) * scale + np.array([width, height]) / 2
    column = np.clip(pixel[:, 0].astype(int), 0, width - 1)
    line = np.clip(height - 1 - pixel[:, 1].astype(int), 0, height - 1)
    order = np.argsort(depth, kind="stable")                   # the nearest last
    image[line[order], column[order], :3] = (COLOUR * bright[order, None]).astype(np.uint8)
    image[line, column, 3] = 255
    return image


def _seen(path: Toolpath, rows: Array, pixels: int) -> tuple[Array, Array, Array]:
    """Points along the beads: place (M, 2) mm in the picture, brightness (M,), nearness to the eye (M,)."""
    length = path.lengths[rows]
    size = float(np.ptp(path.xyz[rows], axis=0).max())
    step = max(size / (2 * pixels), float(length.sum()) / POINTS, 1e-6)
    count = np.maximum(np.ceil(length / step), 1).astype(int)
    row = np.repeat(rows, count)
    share = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 0.5) / np.repeat(count, count)
    way = path.xyz[row] - path.xyz[row - 1]
    x, y, z = (path.xyz[row - 1] + share[:, None] * way).T
    along, across = np.cos(TURN) * x + np.sin(TURN) * y, np.cos(TURN) * y - np.sin(TURN) * x
    place = np.column_stack((along, np.sin(LIFT) * across + np.cos(LIFT) * z))
    side = np.abs(np.sin(np.arctan2(way[:, 1], way[:, 0]) - LIGHT))
    flat = np.isin(path.role[row], (Role.TOP_SKIN, Role.IRONING))
    return place, np.where(flat, 1.0, 0.45 + 0.5 * side), np.sin(LIFT) * z - np.cos(LIFT) * across


def png(image: Array) -> bytes:
    """A picture (height, width, 4) uint8 as a PNG file (ISO/IEC 15948): one chunk, no filter."""
    height, width = image.shape[:2]
    lines = np.zeros((height, 1 + 4 * width), np.uint8)
    lines[:, 1:] = image.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
