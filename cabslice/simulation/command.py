"""What is commanded, as cables: rest length and line to the pulley at a fixed period.

Between two rows both follow the cubic through their values and rates, as a drive does that is told angle and velocity.
Legend as in plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.motors.block import Block
from cabslice.robot.model import Robot
from cabslice.robot.winder import free_cable


@dataclass(frozen=True)
class Command:
    period_s: float
    rows: Array        # (K, 4, m): rest length, line (mm), and their rates (mm/s)

    def __post_init__(self) -> None:
        set_columns(self, rows=Shapes("Command").column("rows", self.rows, "K 4 m"))

    def __len__(self) -> int:
        return len(self.rows)


def holding(rest: Array, line: Array | float = 0.0, *, rows: int, period_s: float) -> Command:
    """Motors at rest: rest lengths (m,) and lines mm for so many rows."""
    row = np.zeros((4, len(rest)))
    row[0], row[1] = rest, line
    return Command(period_s, np.repeat(row[None], rows, axis=0))


def of_lengths(loaded: Array, tension: Array, robot: Robot, period_s: float) -> Command:
    """Rest lengths of cables that are `loaded` (K, m) mm long at `tension` (K, m) N, winders left out.

    The rates are those of the not-a-knot cubic spline through the rows.
    """
    from scipy.interpolate import CubicSpline

    rest = loaded / (1 + tension / robot.axial_stiffness)
    spline = CubicSpline(np.arange(len(rest)) * period_s, rest)
    still = np.zeros_like(rest)
    return Command(period_s, np.stack((rest, still, spline.c[2, [*range(len(rest) - 1), -1]], still), axis=1))


def of_block(robot: Robot, block: Block, period_s: float) -> Command:
    """What the drives are told in a block of a motor file: angles and velocities, as cable."""
    cable = free_cable(robot, block.angle, block.velocity)
    return Command(period_s, np.stack((cable.rest, cable.line, cable.rest_rate, cable.line_rate), axis=1))

