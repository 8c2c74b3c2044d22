"""What every toolpath keeps to (see path.Toolpath), looked at cheaply."""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ProductError
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import RESTS, Toolpath


def check_toolpath(path: Toolpath) -> None:
    """Raise ProductError with one sentence per broken rule, each naming the first row that breaks it."""
    faults = find_faults(path)
    if faults:
        raise ProductError(f"{path.source or 'toolpath'}: " + "; ".join(faults), faults=list(faults))


def find_faults(path: Toolpath) -> tuple[str, ...]:
    """Sentences: which rules of a toolpath are broken, and where first. Empty where it is sound."""
    rules = [*_start_rules(path), *_piece_rules(path), *_row_rules(path)]
    return tuple(f"{sentence} (row {where[0]})" for sentence, where in rules if len(where))


def _start_rules(path: Toolpath) -> list[tuple[str, Array]]:
    if not len(path.xyz):
        return [("a toolpath needs a row for the place where the nozzle starts", np.zeros(1, int))]
    first = path.role[0] != Role.TRAVEL or path.filament[0] != 0
    return [("row 0 lays or feeds something, expected only the start of the nozzle", np.flatnonzero([first]))]


def _piece_rules(path: Toolpath) -> list[tuple[str, Array]]:
    rows, starts = len(path.xyz), path.starts
    if not rows:
        return []
    if len(starts) == 0 or starts[0] != 1 or starts[-1] != rows or (np.diff(starts) <= 0).any():
        return [(f"pieces do not run from row 1 to row {rows} without gap", np.zeros(1, int))]
    still = path.lengths == 0
    alone = np.zeros(rows + 1, np.bool_)
    alone[starts[:-1][np.diff(starts) == 1]] = True
    still[0] = False
    return [
        ("a move of zero length shares its piece with other moves", np.flatnonzero(still & ~alone[:-1])),
        ("a move of zero length feeds no filament", np.flatnonzero(still & (path.filament == 0))),
    ]


def _row_rules(path: Toolpath) -> list[tuple[str, Array]]:
    laying = path.role != Role.TRAVEL
    still = path.lengths == 0
    index = path.events.index
    rests = index[np.isin(path.events.kind, RESTS) & (index > 0)]
    return [
        ("the layer falls", np.flatnonzero(np.diff(path.layer, prepend=path.layer[:1]) < 0)),
        ("a travel feeds filament", np.flatnonzero(~laying & ~still & (path.filament > 0))),
        ("a bead draws filament back", np.flatnonzero(laying & (path.filament < 0))),
        ("a bead has no width or height", np.flatnonzero(laying & ((path.width <= 0) | (path.height <= 0)))),
        ("a move asks for no speed", np.flatnonzero(path.speed[1:] <= 0) + 1),
        ("an unknown role", np.flatnonzero(path.role > max(Role))),
        ("an event belongs to no row", np.flatnonzero((index < 0) | (index >= max(len(path.xyz), 1)))),
        ("a rest within a piece", np.sort(rests[~np.isin(rests, path.starts)])),
        ("events are not in order", np.flatnonzero(np.diff(index, prepend=index[:1]) < 0)),
    ]
