"""A motor file played: what the nozzle does, row by row, beside what the file meant it to do.

What the file means is in it: its angles and planned tensions stand for cable lengths, and these for one pose of the
robot it was made for (robot.forward).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, tee

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.motors.block import Block
from cabslice.motors.stream import MotorStream
from cabslice.robot.forward import forward
from cabslice.robot.model import Robot
from cabslice.robot.winder import pulley_lengths_of
from cabslice.simulation.command import Command, of_stream
from cabslice.simulation.deviation import nozzle_places
from cabslice.simulation.plant import Plant, at_rest, play_blocks
from cabslice.simulation.statics import equilibrium

FAST = 1e-6              # mm of error a step: of the fast integration
SLACK_N = 1e-6
Tick = Callable[[int], None]
Pair = tuple[Block, Command]


@dataclass(frozen=True)
class Run:
    """A motor file that was played, a row each."""

    period_s: float
    error: Array         # (K, 3) mm, nozzle minus where the file means it to be, machine axes
    wanted: Array        # (K, 3) mm, where the file means the nozzle to be, bed coordinates (machine frame without bed)
    laying: Array        # (K,) bool: filament is fed
    move: Array          # (K,) int64, row of the toolpath; -1 where the file does not say
    slack: Array         # (K,) bool: a cable does not pull
    tension: Array       # (2, m) N, least and largest that a cable has pulled with

    def __post_init__(self) -> None:
        shape = Shapes("Run")
        columns = {name: shape.column(name, getattr(self, name), "K 3", np.float32) for name in ("error", "wanted")}
        columns |= {name: shape.column(name, getattr(self, name), "K", np.bool_) for name in ("laying", "slack")}
        columns["move"] = shape.column("move", self.move, "K", np.int64)
        set_columns(self, **columns, tension=shape.column("tension", self.tension, "2 m"))

    def __len__(self) -> int:
        return len(self.move)

    @property
    def distance(self) -> Array:
        """(K,) mm"""
        return np.sqrt(np.einsum("ki,ki->k", self.error, self.error))


def intended(robot: Robot, block: Block, start: Array) -> Array:
    """Poses (n, 6) that a block's angles and planned tensions stand for, the first near start (6,)."""
    return forward(robot, pulley_lengths_of(robot, block.angle, block.tension), start).poses


def play_stream(
    stream: MotorStream, robot: Robot, plant: Plant, *, tolerance: float = FAST, rows: int | None = None,
    tick: Tick | None = None,
) -> Run:
    """Play a motor file made for `robot` on `plant`, from rest where its first row holds the plant.

    rows: stop after about so many; tick(row) is told how far it is. Raises PoseError as plant.play.
    """
    pose, parts, pulls = np.array(stream.header["start_pose"], float), [], []
    blocks, pairs = tee(_until(of_stream(plant.robot, stream), rows), 2)
    first, commands = _peeked(command for _, command in pairs)
    state = first_state(plant, first, pose)
    for (block, _), played in zip(blocks, play_blocks(plant, commands, state, tolerance=tolerance), strict=True):
        wanted = intended(robot, block, pose)
        pose, new = wanted[-1], slice(int(block.row > 0), None)
        slack: Array = np.any(played.tension <= SLACK_N, axis=1)
        parts.append([column[new] for column in (*_places(robot, played.poses, wanted), *_rows(block), slack)])
        pulls.append((played.tension.min(axis=0), played.tension.max(axis=0)))
        if tick:
            tick(block.row + len(block))
    low, high = zip(*pulls, strict=True)
    error, wanted, laying, move, slack = (np.concatenate(column) for column in zip(*parts, strict=True))
    bounds = np.stack((np.min(low, axis=0), np.max(high, axis=0)))
    return Run(stream.period_s, error, wanted, laying, move, slack, bounds)


def _until(pairs: Iterable[Pair], rows: int | None) -> Iterator[Pair]:
    for block, command in pairs:
        if rows is not None and block.row >= rows:
            return
        yield block, command


def _peeked(commands: Iterable[Command]) -> tuple[Command, Iterator[Command]]:
    """The first, and all of them."""
    rest = iter(commands)
    first = next(rest)
    return first, chain([first], rest)


def _places(robot: Robot, poses: Array, wanted: Array) -> tuple[Array, Array]:
    """The nozzle's error, and where it should be on the bed."""
    right, bed = nozzle_places(robot, wanted), robot.bed_origin
    return nozzle_places(robot, poses) - right, right if bed is None else right - bed


def _rows(block: Block) -> tuple[Array, Array]:
    """Whether filament is fed, and the move of the toolpath."""
    feed = np.gradient(block.filament) if block.feed is None else block.feed
    return feed > 0, np.full(len(block), -1) if block.move is None else block.move


def first_state(plant: Plant, command: Command, pose: Array) -> Array:
    """The state at rest in which the first row of a command holds the plant, near pose (6,)."""
    rest, line = command.rows[:1, 0], command.rows[:1, 1]
    return at_rest(plant.robot, equilibrium(plant.robot, rest, line, pose[None], wrench=plant.push)[0][0])
