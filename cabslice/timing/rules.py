"""Two ways to the same answer: rows and recursion compiled together, or rows in numpy and any engine.

The compiled rules serve robots with six freedoms and two cables more; the array rules serve every robot, and toppra.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.robot.model import Robot
from cabslice.timing.limits import (
    RESERVE,
    Limits,
    Nodes,
    highest_tension,
    rows,
    winder_speed_x,
    winding_caps,
)

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
        self.kernel, self.window = kernel, limits.window
        self.columns = kernel.columns(robot, highest_tension(robot), winding, speed, limits.acceleration,
                                      limits.feed_acceleration, 1 - RESERVE)

    def solve(self, nodes: Nodes, tight: Array, top: Array, step: Array, offsets: Array) -> tuple[Array, Array]:
        return self.kernel.solve(*_contiguous(nodes), tight, top, step, offsets, self.window, self.columns)

    def used(self, nodes: Nodes, u: Array, x: Array) -> Array:
        return self.kernel.used(*_contiguous(nodes), u, x, self.columns)


def _contiguous(nodes: Nodes) -> tuple[Array, Array, Array, Array]:
    q, d1, d2 = (np.ascontiguousarray(column[:, :3]) for column in (nodes.poses, nodes.d1, nodes.d2))
    return q, d1, d2, np.ascontiguousarray(nodes.feed)


class ArrayRules:
    def __init__(self, robot: Robot, limits: Limits, engine: Engine) -> None:
        self.robot, self.limits, self.engine = robot, limits, engine

    def solve(self, nodes: Nodes, tight: Array, top: Array, step: Array, offsets: Array) -> tuple[Array, Array]:
        from cabslice.timing.recursion import widened

        a, b, margin = rows(self.robot, self.limits, nodes)
        if (margin <= 0).any():
            return np.zeros(len(top)), margin
        a, b = a * tight[:, None], b * tight[:, None]
        top = widened(b, np.minimum(top, winder_speed_x(self.robot, nodes)), step, offsets, self.limits.window)
        return self.engine(a, b, top, step, offsets), margin

    def used(self, nodes: Nodes, u: Array, x: Array) -> Array:
        a, b, _ = rows(self.robot, self.limits, nodes)
        by_rows = (a * u[:, None] + b * x[:, None]).max(axis=1, initial=0.0)
        return np.maximum(by_rows, x / winder_speed_x(self.robot, nodes))


def rules_for(robot: Robot, limits: Limits, engine: str) -> Rules:
    """The rules of an engine: "compiled" (the default) or "toppra" (the reference). Raises UsageError."""
    if engine == "toppra":
        from cabslice.timing.stock import retime as stock
        return ArrayRules(robot, limits, stock)
    if engine != "compiled":
        raise UsageError(f"unknown engine '{engine}': expected compiled or toppra")
    from cabslice.timing import kernel, recursion

    return CompiledRules(robot, limits) if kernel.serves(robot) else ArrayRules(robot, limits, recursion.retime)


