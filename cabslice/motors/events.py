"""What is switched while a motor file plays: heaters, fan, retraction, pauses, with time and row.

Legend
    T    period of the rows, s          lead    time before the motion begins, s
Columns, as they stand in the header under "events": t_s, row (the first at or after that time), kind, value.
    nozzle_c, bed_c   degC       fan   0..1       retract, prime   mm of filament, at its start; it is in the rows too
    dwell             s, at its start; it is in the rows too
    pause, filament_change    the rows stand still here: hold this row until the user goes on
    min_layer_time_s, min_print_speed_mm_s   as asked for; the rows have what came of it
What has time 0 must have happened before the first row is played.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Role
from cabslice.timing.trajectory import Trajectory
from cabslice.toolpath.path import EventKind, Toolpath

KINDS = {
    EventKind.NOZZLE_TEMPERATURE: "nozzle_c", EventKind.BED_TEMPERATURE: "bed_c", EventKind.FAN: "fan",
    EventKind.DWELL: "dwell", EventKind.PAUSE: "pause", EventKind.MIN_LAYER_TIME: "min_layer_time_s",
    EventKind.FILAMENT_CHANGE: "filament_change", EventKind.MIN_PRINT_SPEED: "min_print_speed_mm_s",
}
HOT = ("nozzle_c", "bed_c", "fan")


def events_of(trajectory: Trajectory, path: Toolpath, period_s: float, *, lead_s: float = 0.0,
              extrude: bool = True) -> dict[str, list[Any]]:
    """The events as columns, in order of time. Without `extrude` neither heat, fan nor filament is among them."""
    asked = [(int(i), KINDS[EventKind(kind)], float(value)) for i, kind, value in
             zip(path.events.index, path.events.kind, path.events.value, strict=True)]
    still = np.flatnonzero((path.lengths == 0) & (path.filament != 0))
    fed = [(int(i), "retract" if path.filament[i] < 0 else "prime", float(path.filament[i])) for i in still]
    if not extrude:
        asked, fed = [row for row in asked if row[1] not in HOT], []
    rows = sorted((*asked, *fed), key=lambda row: row[0])
    times = lead_s + starts_of(trajectory, np.array([row[0] for row in rows], np.int64))
    times = np.where([row[0] == 0 for row in rows], 0.0, times)
    times = np.maximum(times - _rested(rows), 0.0)
    return {
        "t_s": [round(float(t), 6) for t in times], "row": np.ceil(times / period_s - 1e-9).astype(int).tolist(),
        "kind": [row[1] for row in rows], "value": [row[2] for row in rows],
    }


def _rested(rows: list[tuple[int, str, float]]) -> Array:
    """Time (n,) s from an event to its move: a dwell's whole length, half of it for what holds the rows."""
    spent = {index: 0.0 for index, _, _ in rows}
    for index, kind, value in rows:
        spent[index] += value if kind == "dwell" else 0.0
    share = {"dwell": 1.0, "pause": 0.5, "filament_change": 0.5}
    return np.array([spent[index] * share.get(kind, 0.0) for index, kind, _ in rows])


def starts_of(trajectory: Trajectory, moves: Array) -> Array:
    """Times (n,) s at which moves (n,) begin; that of a piece is when it begins to leave rest."""
    node = np.minimum(np.searchsorted(trajectory.move, moves), len(trajectory.move) - 1)
    first = np.isin(node, trajectory.pieces[:-1])
    return trajectory.time[node] - np.where(first, trajectory.window / 2, 0.0)


def layers_of(trajectory: Trajectory, path: Toolpath, *, lead_s: float = 0.0) -> dict[str, list[Any]]:
    """The layers of a motion, the height each is printed at, and when it is whole: places to take the print up at."""
    rows = np.flatnonzero(path.role != Role.TRAVEL)
    if not len(rows):
        return {"layer": [], "z_mm": [], "whole_at_s": []}
    layers, back = np.unique(path.layer[rows][::-1], return_index=True)
    last = rows[len(rows) - 1 - back]
    ends = starts_of(trajectory, np.minimum(last + 1, len(path.layer) - 1))
    if last[-1] == len(path.layer) - 1:
        ends[-1] = trajectory.duration
    return {"layer": layers.tolist(), "z_mm": [round(float(z), 6) for z in path.xyz[last, 2]],
            "whole_at_s": [round(float(t), 6) for t in lead_s + ends]}
