"""The audit of the filament: at every vertex of the toolpath as much is fed as the toolpath says.

Averaging the motion over w lets filament lead or lag where its feed changes at a vertex: where the n vertices within
the window each change it by at most the step the extruder stands, and it accelerates by at most a in between, by

    n step w / 8 + a w^2 / 24

A vertex passed between two samples dt apart is looked at with what was fed at both: it must lie between, or where the
filament turns there from rest (a retraction) no more than a dt^2 / 8 beyond. Vertices nearer than
MERGED_MM may be passed as one: what they feed may come with their neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.timing.worst import Worst
from cabslice.toolpath.path import Toolpath

MERGED_MM = 1e-3
ROUNDED = 1e-9       # mm of filament, and that share of all of it


@dataclass(frozen=True)
class Fed:
    """Of every vertex (N,): mm fed up to it, and mm that may come with a neighbour."""

    total: Array
    apart: Array


def fed_by(toolpath: Toolpath) -> Fed:
    tiny, number = toolpath.lengths < MERGED_MM, np.arange(len(toolpath.xyz))
    tiny[0] = False
    tiny[toolpath.starts[:-1][np.diff(toolpath.starts) == 1]] = False           # a retraction is a piece of its own
    run = np.cumsum(np.where(tiny, np.abs(toolpath.filament), 0.0))
    before = np.maximum.accumulate(np.where(tiny, 0, number))
    after = np.minimum.accumulate(np.where(np.append(tiny[1:], False), len(number) - 1, number)[::-1])[::-1]
    return Fed(np.cumsum(toolpath.filament), run[after] - run[before])


def see(fed: Fed, worst: Worst, extruder: Any, window: float, times: Array, move: Array, filament: Array) -> None:
    """Every vertex passed between the inner ones of even times (K,), where moves (K,) are made and filament (K,) is
    fed."""
    step, count = float(times[1] - times[0]), np.diff(move)[1:]
    pair = np.repeat(np.arange(1, len(times) - 1), count)
    vertex = move[pair] + np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count)
    if not len(pair):
        return
    due, one, other = fed.total[vertex], filament[pair], filament[pair + 1]
    off = np.maximum(np.maximum(due - np.maximum(one, other), np.minimum(one, other) - due), 0.0)
    reach = int(np.ceil(window / 2 / step))
    near = move[np.minimum(pair + 1 + reach, len(move) - 1)] - move[np.maximum(pair - reach, 0)]
    kinks = extruder.max_jump_mm_s * near * window / 8
    most = kinks + extruder.max_acceleration_mm_s2 * window**2 / 24
    most = most + extruder.max_acceleration_mm_s2 * step**2 / 8
    most = most + fed.apart[vertex] + ROUNDED * (1 + np.abs(fed.total[-1]))
    worst.see("filament-at-vertex", off, most, times[pair], vertex)
