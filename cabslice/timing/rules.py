"""Two ways to the same answer: rows and recursion compiled together, or rows in numpy and any engine.

The compiled rules serve level platforms with six freedoms and two cables more; the array rules serve every robot,
and toppra.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.model import Robot
from cabslice.robot.usable import usable_tension_max
from cabslice.timing import rails
from cabslice.timing.limits import RESERVE, Limits, Nodes, rows, winder_speed_x, winding_caps

CELL = 10.0      # mm
LARGEST_TABLE = 1_000_000
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)] + [[0.5, 0.5, 0.5]])
QUIET = 0.9      # largest share of a cable limit that counts as never reached
NodeRows = Callable[[Nodes], tuple[Array, Array, Array]]
Engine = Callable[[Array, Array, Array, Array, Array], Array]


class Rules(Protocol):
    """How fast, and how much of the limits a motion uses."""

    def solve(self, nodes: Nodes, tight: Array, top: Array, step: Array, offsets: Array) -> tuple[Array, Array]:
        """x (G,) mm^2/s^2 and margin (G,) at rest (<= 0: the platform cannot rest there)."""

    def used(self, nodes: Nodes, u: Array, x: Array) -> Array:
        """(K,) largest share of any limit, the reserve left aside."""


class CompiledRules:
    def __init__(self, robot: Robot, limits: Limits) -> None:
        from cabslice.timing import kernel

        winding, speed = winding_caps(robot)
        self.kernel, self.limits = kernel, limits
        self.columns = kernel.columns(robot, usable_tension_max(robot), winding, speed, limits.acceleration,
                                      limits.feed_acceleration, 1 - RESERVE)
        self.cells: dict[tuple[int, ...], bool] = {}

    def solve(self, nodes: Nodes, tight: Array, top: Array, step: Array, offsets: Array) -> tuple[Array, Array]:
        places = _contiguous(nodes)
        return self.kernel.solve(*places, self.quiet(places[0]), tight, top, step, offsets, self.columns)

    def used(self, nodes: Nodes, u: Array, x: Array) -> Array:
        places = _contiguous(nodes)
        return self.kernel.used(*places, self.quiet(places[0]), u, x, self.columns)

    def quiet(self, positions: Array) -> Array:
        """(K,) bool: no cable limit can be reached there at the accelerations the axes may have.

        Judged at the corners and the middle of cells of CELL mm with a tenth to spare; the audit proves it in the end.
        """
        if not np.isfinite(self.limits.acceleration):
            return np.zeros(len(positions), np.bool_)
        cell = np.floor(positions / CELL).astype(np.int64)
        low = cell.min(axis=0)
        size = cell.max(axis=0) - low + 1
        number, back = _numbered(np.ravel_multi_index(tuple((cell - low).T), tuple(size)), int(size.prod()))
        keys = [tuple(row) for row in (np.stack(np.unravel_index(number, size), axis=1) + low).tolist()]
        new = [key for key in keys if key not in self.cells]
        if new:
            points = (np.array(new)[:, None] + CORNERS).reshape(-1, 3) * CELL
            worst = self.kernel.at_worst(points, self.limits.speed, self.columns).reshape(len(new), -1).max(axis=1)
            self.cells.update(zip(new, (worst < QUIET).tolist(), strict=True))
        return np.array([self.cells[key] for key in keys])[back]


def _numbered(values: Array, size: int) -> tuple[Array, Array]:
    """As np.unique with return_inverse, of whole numbers below `size`: by a table where that is not large."""
    if size > LARGEST_TABLE:
        number, back = np.unique(values, return_inverse=True)
        return number, back
    table = np.zeros(size, np.int64)
    table[values] = 1
    number = np.flatnonzero(table)
    table[number] = np.arange(len(number))
    return number, table[values]


def _contiguous(nodes: Nodes) -> tuple[Array, Array, Array, Array, Array]:
    q, d1, d2 = (np.ascontiguousarray(column[:, :3]) for column in (nodes.poses, nodes.d1, nodes.d2))
    return q, d1, d2, np.ascontiguousarray(nodes.feed), np.ascontiguousarray(nodes.acceleration)


class ArrayRules:
    """The plug-in point for other machines: `rows` gives a, b (K, R) of a u + b x <= 1 and the margin (K,) at rest,
    `highest` the largest x (K,), of the nodes."""

    def __init__(self, rows: NodeRows, highest: Callable[[Nodes], Array], engine: Engine) -> None:
        self.rows, self.highest, self.engine = rows, highest, engine

    def solve(self, nodes: Nodes, tight: Array, top: Array, step: Array, offsets: Array) -> tuple[Array, Array]:
        a, b, margin = self.rows(nodes)
        if not (margin > 0).all():
            return np.zeros(len(top)), margin
        a, b = a * tight[:, None], b * tight[:, None]
        top = np.minimum(top, self.highest(nodes))
        return self.engine(a, b, top, step, offsets), margin

    def used(self, nodes: Nodes, u: Array, x: Array) -> Array:
        a, b, _ = self.rows(nodes)
        by_rows = (a * u[:, None] + b * x[:, None]).max(axis=1, initial=0.0)
        return np.maximum(by_rows, x / self.highest(nodes))


def array_rules(robot: Machine, limits: Limits, engine: Engine) -> ArrayRules:
    if isinstance(robot, Delta):
        return ArrayRules(partial(rails.rows, robot, limits), partial(rails.speed_x, robot), engine)
    return ArrayRules(partial(rows, robot, limits), partial(winder_speed_x, robot), engine)


def rules_for(robot: Machine, limits: Limits, engine: str) -> Rules:
    """The rules of an engine: "compiled" (the default) or "toppra" (the reference). Raises UsageError."""
    if engine == "toppra":
        from cabslice.timing.stock import retime as stock
        return array_rules(robot, limits, stock)
    if engine != "compiled":
        raise UsageError(f"unknown engine '{engine}': expected compiled or toppra")
    from cabslice.timing import kernel, recursion

    if isinstance(robot, Delta) or not kernel.serves(robot) or robot.turning is not None:
        return array_rules(robot, limits, recursion.retime)
    return CompiledRules(robot, limits)


