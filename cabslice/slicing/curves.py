"""Infill lines that wave: gyroid and honeycomb, clipped and linked like straight rows (slicing.infill).

x, y   mm, along and across the lines     T  period along, mm     Y  distance of every second line, mm
Even lines run at y = low(x) + k Y, odd ones at y = high(x) + k Y, with low <= high <= low + Y; both are straight
between the nodes of one period. The edge of the region is cut at the nodes: between them y - low(x) is linear along
a piece of edge, so that a wave meets it where a straight row would.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.infill import Lines, crossings, linked, meetings, no_lines, turn
from cabslice.slicing.region import Region, following, to_rings

NODES = 24          # of a gyroid's line in one period: chords leave it by less than 1 % of the period
TURNS = 128         # heights at which the mean length of a gyroid's lines is taken


@dataclass(frozen=True)
class Waves:
    """nodes (P+1,) mm from 0 to T; low, high (P+1,) mm; apart: Y, mm; turn: direction of x, rad from the asked one."""

    nodes: Array
    low: Array
    high: Array
    apart: float
    turn: float = 0.0

    @property
    def length_per_mm2(self) -> float:
        """mm of line on a mm^2."""
        each = sum(np.hypot(np.diff(self.nodes), np.diff(side)).sum() for side in (self.low, self.high))
        return float(each / (self.nodes[-1] * self.apart))


def honeycomb(pitch: float, bead: float) -> Waves:
    """Hexagons of which every third side is laid twice, `bead` mm apart; 1 mm of line on `pitch` mm^2.

    With sides a and rows (3^1/2 a + 2 bead) apart by twos: 8 a of line on 3 a Y, Y = 3^1/2 a + 2 bead.
    """
    side = max(8 / 3 * pitch - 2 * bead, bead) / np.sqrt(3)
    rise = np.sqrt(3) / 2 * side
    nodes = side * np.array([0.0, 1.0, 1.5, 2.5, 3.0])
    low = rise * np.array([0.0, 0.0, 1.0, 1.0, 0.0])
    return Waves(nodes, low, 2 * rise + bead - low, 2 * (rise + bead))


def gyroid(pitch: float, z: float) -> Waves:
    """The cut at height z (mm) of sin x cos y + sin y cos z + sin z cos x = 0 (Schoen 1970), scaled so that in the mean
    over z 1 mm of line lies on `pitch` mm^2."""
    scale = pitch * _gyroid_length()
    wave = _unit_gyroid(z / scale)
    return Waves(scale * wave.nodes, scale * wave.low, scale * wave.high, scale * wave.apart, wave.turn)


def _unit_gyroid(z: float) -> Waves:
    """Period 2 pi. Lines run along x where |cos z| is the larger, else along y."""
    x = np.linspace(0, 2 * np.pi, NODES + 1)
    along = abs(np.cos(z)) >= abs(np.sin(z))
    p, q = (np.sin(x), np.cos(z)) if along else (np.sin(z), np.cos(x))
    r, size = (np.sin(z) * np.cos(x), np.hypot(p, q)) if along else (np.sin(x) * np.cos(z), np.hypot(p, q))
    bow = np.arcsin(np.clip(-r / size, -1, 1))
    if along:                                   # p cos y + q sin y = -r
        lag = np.arctan(p / q) + (np.pi if q < 0 else 0.0)
        return Waves(x, bow - lag, np.pi - bow - lag, 2 * np.pi)
    lead = np.arctan2(p, q)                     # q sin x' + p cos x' = -r, and y of the turned frame is -x'
    return Waves(x, lead - bow, np.pi + bow + lead, 2 * np.pi, np.pi / 2)


@cache
def _gyroid_length() -> float:
    """Mean over z of mm of line on a mm^2, of the gyroid of period 2 pi."""
    return float(np.mean([_unit_gyroid(z).length_per_mm2 for z in (np.arange(TURNS) + 0.5) * 2 * np.pi / TURNS]))


def wave_lines(region: Region, waves: Waves, angle: float, link: float) -> Lines:
    """The waves inside the region, x at `angle` (rad), neighbours linked along the edge up to `link` mm."""
    points, starts = to_rings(region)
    if not len(points):
        return no_lines()
    angle += waves.turn
    points, starts = _cut_at_nodes(turn(points, -angle), starts, waves)
    parts = []
    for odd, side in enumerate((waves.low, waves.high)):
        level = (points[:, 1] - _height(points[:, 0], waves, side)) / waves.apart
        base = np.full(len(points), np.floor(level.min()).astype(np.int64))
        rows = np.full(len(points), np.ceil(level.max()).astype(np.int64) - base[0] + 1)
        edge, row, share = meetings(starts, level, base, rows)
        parts.append((edge, 2 * row + odd, share))
    edge, row, share = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not len(edge):
        return no_lines()
    order = np.lexsort((share, edge))
    chains = linked(points, starts, crossings(points, starts, edge[order], row[order], share[order]), link)
    wound, begins = _bent(chains.points, chains.starts, chains.leave, waves)
    return Lines(turn(wound, angle), begins, np.full(len(begins) - 1, waves.apart / 2))


def _column(x: Array, waves: Waves) -> Array:
    """x in nodes: whole numbers at the nodes of every period."""
    period, rest = np.divmod(x, waves.nodes[-1])
    return period * (len(waves.nodes) - 1) + np.interp(rest, waves.nodes, np.arange(len(waves.nodes)))


def _node(column: Array, waves: Waves) -> Array:
    """x of whole columns, mm."""
    period, k = np.divmod(column, len(waves.nodes) - 1)
    return period * waves.nodes[-1] + waves.nodes[k]


def _height(x: Array, waves: Waves, side: Array) -> Array:
    return np.interp(np.mod(x, waves.nodes[-1]), waves.nodes, side)


def _cut_at_nodes(points: Array, starts: Array, waves: Waves) -> tuple[Array, Array]:
    """Rings with a point wherever they pass a node's x."""
    ahead = points[following(starts)]
    here, there = _column(points[:, 0], waves), _column(ahead[:, 0], waves)
    first, last = np.floor(np.minimum(here, there)) + 1, np.ceil(np.maximum(here, there)) - 1
    count = np.maximum(last - first + 1, 0).astype(np.int64)
    edge = np.repeat(np.arange(len(points)), count + 1)
    k = np.arange(len(edge)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    cut = points[edge]
    new = k > 0
    on = edge[new]
    column = np.where(there[on] > here[on], first[on] + k[new] - 1, last[on] - k[new] + 1).astype(np.int64)
    x = _node(column, waves)
    share = (x - points[on, 0]) / (ahead[on, 0] - points[on, 0])
    cut[new] = np.stack((x, points[on, 1] + share * (ahead[on, 1] - points[on, 1])), axis=1)
    return cut, starts + np.concatenate(([0], np.cumsum(count)))[starts]


def _bent(points: Array, starts: Array, leave: Array, waves: Waves) -> tuple[Array, Array]:
    """Lines with a point at every node that a segment, which ends at row `leave` (S,) of points, passes."""
    a, b = points[leave - 1], points[leave]
    here, there = _column(a[:, 0], waves), _column(b[:, 0], waves)
    first, last = np.floor(np.minimum(here, there)) + 1, np.ceil(np.maximum(here, there)) - 1
    count = np.zeros(len(points), dtype=np.int64)
    count[leave] = np.maximum(last - first + 1, 0)
    point = np.repeat(np.arange(len(points)), count + 1)
    k = np.arange(len(point)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    new = k < count[point]                       # nodes come before the end of their segment
    of = np.empty(len(points), dtype=np.int64)
    of[leave] = np.arange(len(leave))
    on = of[point[new]]
    column = np.where(there[on] > here[on], first[on] + k[new], last[on] - k[new]).astype(np.int64)
    low, high = (_height(a[:, 0], waves, side) for side in (waves.low, waves.high))
    even, odd = ((a[:, 1] - height) / waves.apart for height in (low, high))
    is_odd = np.abs(odd - np.round(odd)) < np.abs(even - np.round(even))
    row = np.round(np.where(is_odd, odd, even))
    k_node = np.mod(column, len(waves.nodes) - 1)
    y = np.where(is_odd[on], waves.high[k_node], waves.low[k_node]) + row[on] * waves.apart
    bent = points[point]
    bent[new] = np.stack((_node(column, waves), y), axis=1)
    size = np.concatenate(([0], np.cumsum(count + 1)))
    return bent, size[starts]
