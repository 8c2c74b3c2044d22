"""Errors of a played motor file by layer, feature and bead, and the worst places by name.

Only rows that lay filament count. "beyond the offset": with the mean error of the first layer, which calibrating the
height of the bed removes, taken away.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.simulation.deviation import spread
from cabslice.simulation.prints import Run
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath

WORST, APART_MM = 5, 2.0        # places that are named, and how far they are from each other at least


def layers_of(run: Run, header: Mapping[str, Any], path: Toolpath | None) -> Array:
    """Layer (K,) of every row: of its move, else by the times in the header of the file, else 0."""
    if path is not None and len(run) and run.move.min() >= 0:
        return path.layer[run.move]
    told = header.get("layers")
    if not told:
        return np.zeros(len(run), np.int64)
    times = np.arange(len(run)) * run.period_s
    index = np.searchsorted(np.array(told["whole_at_s"]), times)
    return np.array(told["layer"])[np.minimum(index, len(told["layer"]) - 1)]


def numbers(run: Run, header: Mapping[str, Any], path: Toolpath | None = None) -> dict[str, Any]:
    """All of a run that a user may want to know, as JSON values."""
    layer, distance = layers_of(run, header, path), run.distance
    laying = run.laying if run.laying.any() else np.ones(len(run), bool)
    offset = run.error[laying & (layer == layer[laying][0])].mean(axis=0, dtype=np.float64)
    beyond = np.linalg.norm(run.error - offset, axis=1)
    found: dict[str, Any] = {
        "rows": len(run), "duration_s": (len(run) - 1) * run.period_s, "period_s": run.period_s,
        "nozzle_error": spread(distance[laying]), "max_abs_error_mm": np.abs(run.error[laying]).max(axis=0).tolist(),
        "first_layer_offset_mm": offset.tolist(), "nozzle_error_beyond_offset": spread(beyond[laying]),
        "slack_fraction": float(run.slack.mean()),
        "least_tension_n": float(run.tension[0].min()), "largest_tension_n": float(run.tension[1].max()),
        "layers": _by(layer[laying], distance[laying], beyond[laying]),
    }
    role = None
    if path is not None and run.move.min() >= 0:
        role = path.role[run.move]
        names = {int(value): Role(value).name.lower() for value in np.unique(role[laying])}
        rows = _rows(role[laying], distance[laying], beyond[laying])
        found["features"] = {names[row.pop("key")]: row for row in rows}
        found["corner_rounding"] = spread(rounding(run, path)[laying])
    found["worst"] = _worst(run, layer, role, np.where(laying, distance, 0.0))
    return found


def _rows(keys: Array, distance: Array, beyond: Array) -> list[dict[str, Any]]:
    order = np.argsort(keys, kind="stable")
    found, starts = np.unique(keys[order], return_index=True)
    parts = zip(found, np.split(distance[order], starts[1:]), np.split(beyond[order], starts[1:]), strict=True)
    return [{"key": int(key), **spread(whole), "max_beyond_offset_mm": float(rest.max())} for key, whole, rest in parts]


def _by(layer: Array, distance: Array, beyond: Array) -> list[dict[str, Any]]:
    return [{"layer": row.pop("key"), **row} for row in _rows(layer, distance, beyond)]


def _worst(run: Run, layer: Array, role: Array | None, distance: Array) -> list[dict[str, Any]]:
    """The worst places, apart from each other."""
    left, named = distance.copy(), []
    for _ in range(WORST):
        row = int(left.argmax())
        if not left[row] > 0:
            break
        named.append({
            "t_s": row * run.period_s, "layer": int(layer[row]), "xyz_mm": run.wanted[row].tolist(),
            "error_mm": run.error[row].tolist(), "distance_mm": float(distance[row]), "move": int(run.move[row]),
            **({} if role is None else {"feature": Role(role[row]).name.lower()}),
        })
        near = (layer == layer[row]) & (np.abs(run.wanted - run.wanted[row]).max(axis=1) < APART_MM)
        left[near] = 0.0
    return named


def rounding(run: Run, path: Toolpath) -> Array:
    """How far (K,) mm the motion that was meant leaves the toolpath: its corners are rounded."""
    away = np.full(len(run), np.inf)
    for shift in (-1, 0, 1):
        move = np.clip(run.move + shift, 1, len(path.xyz) - 1)
        away = np.minimum(away, _from_segments(run.wanted, path.xyz[move - 1], path.xyz[move]))
    return away


def _from_segments(points: Array, start: Array, end: Array) -> Array:
    way = end - start
    square = np.einsum("ki,ki->k", way, way)
    share = np.einsum("ki,ki->k", points - start, way) / np.where(square > 0, square, 1.0)
    return np.linalg.norm(points - start - np.clip(share, 0, 1)[:, None] * way, axis=1)


def beads(run: Run, header: Mapping[str, Any], path: Toolpath | None = None) -> dict[str, Array]:
    """A row for every bead (consecutive rows that lay the same move): where it ends, and how far the nozzle was off."""
    rows = np.flatnonzero(run.laying)
    starts = np.flatnonzero(np.diff(run.move[rows], prepend=-2))
    distance = run.distance[rows].astype(float)
    ends = np.append(starts[1:], len(rows)) - 1
    count = np.diff(np.append(starts, len(rows)))
    columns = {
        "t_s": rows[starts] * run.period_s, "move": run.move[rows[starts]].astype(float),
        "layer": layers_of(run, header, path)[rows[starts]].astype(float),
        **{f"{axis}_mm": run.wanted[rows[ends], i].astype(float) for i, axis in enumerate("xyz")},
        "rms_mm": np.sqrt(np.add.reduceat(distance**2, starts) / count) if len(rows) else distance,
        "max_mm": np.maximum.reduceat(distance, starts) if len(rows) else distance,
    }
    return columns | ({} if path is None else {"role": path.role[run.move[rows[starts]]].astype(float)})
