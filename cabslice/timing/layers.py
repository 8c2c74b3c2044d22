"""A layer takes at least the time asked for it: its beads are slowed, and what then lacks is waited at its end.

Legend
    d_p      time of piece p, s            lambda   how much slower the beads of a layer go
    c_p      how much slower piece p may go: its slowest bead may not fall below the least printing speed
    sum of d_p min(lambda, c_p) over the bead pieces = least time of the layer less the time of all else in it
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.timing.trajectory import Trajectory, slowed
from cabslice.toolpath.path import EventKind, Toolpath

HALVINGS = 60


def least_times(toolpath: Toolpath) -> dict[int, float]:
    """layer -> s, from the events; layers that share a piece with another (spirals) cannot be timed alone: left out."""
    events, layer = toolpath.events, toolpath.layer
    asked = events.kind == EventKind.MIN_LAYER_TIME
    rows = np.minimum(np.maximum(events.index[asked], 1), len(layer) - 1)
    first, last = layer[toolpath.starts[:-1]], layer[toolpath.starts[1:] - 1]
    shared = set(np.concatenate([first[first != last], last[first != last]]).tolist())
    pairs = zip(layer[rows].tolist(), events.value[asked].tolist(), strict=True)
    return {number: seconds for number, seconds in pairs if seconds > 0 and number not in shared}


def layer_spans(toolpath: Toolpath, trajectory: Trajectory) -> dict[int, tuple[int, int, float]]:
    """layer -> first and last piece, and the time (s) from the start of the one to the start of what follows (the end
    of the print for the last), dwells not counted."""
    number = toolpath.layer[toolpath.starts[:-1]]
    begin = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
    until = np.append(begin[1:], len(number))
    starts = np.append(trajectory.time[trajectory.pieces[:-1]] - trajectory.window / 2, trajectory.duration)
    waited = np.concatenate(([0.0], np.cumsum(dwells(toolpath))))
    spans: dict[int, tuple[int, int, float]] = {}
    for first, end in zip(begin.tolist(), until.tolist(), strict=True):
        seconds = float(starts[end] - starts[first] - (waited[min(end + 1, len(number))] - waited[first + 1]))
        found = spans.get(int(number[first]))
        spans[int(number[first])] = (found[0] if found else first, end - 1, seconds + (found[2] if found else 0.0))
    return spans


def dwells(toolpath: Toolpath) -> Array:
    """(P,) s waited before each piece; one asked for inside a piece waits before the next, or the last."""
    events, waits = toolpath.events, np.zeros(len(toolpath.starts) - 1)
    asked = events.kind == EventKind.DWELL
    piece = np.minimum(np.searchsorted(toolpath.starts, events.index[asked], side="left"), len(waits) - 1)
    np.add.at(waits, piece, events.value[asked])
    return waits


def paced(trajectory: Trajectory, toolpath: Toolpath) -> Trajectory:
    """The motion with every layer as long as asked."""
    wanted = least_times(toolpath)
    if not wanted:
        return trajectory
    spans, most = layer_spans(toolpath, trajectory), _slowest(toolpath, trajectory)
    spent = trajectory.time[trajectory.pieces[1:] - 1] - trajectory.time[trajectory.pieces[:-1]]
    factor, wait = np.ones(len(spent)), np.zeros(len(spent) + 1)
    for number, seconds in wanted.items():
        first, last, has = spans.get(number, (0, 0, np.inf))
        if has < seconds:
            part = slice(first, last + 1)
            factor[part], wait[last + 1] = _slow(spent[part], most[part], seconds - has)
    return _waited(slowed(trajectory, factor), wait[:-1])


def _slow(spent: Array, most: Array, missing: float) -> tuple[Array, float]:
    """How much slower each piece (B,) goes so that `missing` s are gained, and what cannot be gained."""
    lowest, highest = 1.0, float(most.max(initial=1.0))
    if (spent * (most - 1)).sum() <= missing:
        return most, missing - float((spent * (most - 1)).sum())
    for _ in range(HALVINGS):
        middle = (lowest + highest) / 2
        enough = (spent * (np.minimum(middle, most) - 1)).sum() >= missing
        lowest, highest = (lowest, middle) if enough else (middle, highest)
    return np.minimum(highest, most), 0.0


def _slowest(toolpath: Toolpath, trajectory: Trajectory) -> Array:
    """(P,) how much slower each piece may go: 1 where it lays no bead."""
    events = toolpath.events
    told = events.kind == EventKind.MIN_PRINT_SPEED
    values, rows = np.concatenate(([np.inf], events.value[told])), events.index[told]
    least = values[np.searchsorted(rows, np.arange(len(toolpath.xyz)), side="right")]
    bead = (toolpath.filament > 0) & (toolpath.lengths > 0)
    room = np.where(bead, np.maximum(toolpath.speed / np.maximum(least, 1e-9), 1.0), np.inf)
    found = np.minimum.reduceat(np.append(room, np.inf), toolpath.starts)[:-1]
    return np.where(np.isfinite(found), found, 1.0)


def _waited(trajectory: Trajectory, wait: Array) -> Trajectory:
    """The motion with a rest of wait (P,) s before each piece."""
    return replace(trajectory, time=trajectory.time + np.repeat(np.cumsum(wait), np.diff(trajectory.pieces)))
