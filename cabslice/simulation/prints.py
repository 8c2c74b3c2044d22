"""A motor file played: what the nozzle does, row by row, beside what the file meant it to do.

What the file means is in it: its angles and planned tensions stand for cable lengths, and these for one pose of the
robot it was made for (robot.forward).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.motors.block import Block, cut, joined
from cabslice.motors.stream import MotorStream
from cabslice.robot.forward import forward
from cabslice.robot.model import Robot
from cabslice.robot.winder import pulley_lengths_of
from cabslice.simulation.command import Command, of_block
from cabslice.simulation.deviation import nozzle_places
from cabslice.simulation.drives import Drive, Drives
from cabslice.simulation.plant import Plant, Played, Player, at_rest
from cabslice.simulation.statics import equilibrium

FAST = 1e-6              # mm of error a step: of the fast integration
SLACK_N, RESTING_MM = 1e-6, 1e-5      # a cable below it is slack; a row that moves the nozzle by less is a rest
Tick = Callable[[int], None]


@dataclass(frozen=True)
class Run:
    """A motor file that was played, a row each."""

    period_s: float
    error: Array         # (K, 3) mm, nozzle minus where the file means it to be, machine axes
    wanted: Array        # (K, 3) mm, where the file means the nozzle to be, bed coordinates (machine frame without bed)
    laying: Array        # (K,) bool: filament is fed while the nozzle moves (priming at rest lays no bead)
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
    drive: Drive | None = None, tick: Tick | None = None,
) -> Run:
    """Play a motor file made for `robot` on `plant`, from rest where its first row holds the plant.

    rows: stop after about so many; drive: what the motors are driven by, None: they do as told; tick(row) is told how
    far it is. Raises PoseError as plant.play.
    """
    return play_all(stream, robot, [plant], tolerance=tolerance, rows=rows, drive=drive, tick=tick)[0]


def play_all(
    stream: MotorStream, robot: Robot, plants: Sequence[Plant], *, tolerance: float = FAST, rows: int | None = None,
    drive: Drive | None = None, tick: Tick | None = None,
) -> list[Run]:
    """As play_stream on several plants, in one pass of the file."""
    pose = np.array(stream.header["start_pose"], float)
    players: list[Player] = []
    parts: list[list[tuple[Array, ...]]] = [[] for _ in plants]
    motors = _motors(robot, drive, stream.period_s)
    for block in _overlapping(stream, rows):
        turned = block if motors is None else motors.played(block)
        commands = [of_block(plant.robot, turned, stream.period_s) for plant in plants]
        players = players or [Player(plant, first_state(plant, command, pose), tolerance)
                              for plant, command in zip(plants, commands, strict=True)]
        wanted = intended(robot, block, pose)
        pose = wanted[-1]
        for player, command, part in zip(players, commands, parts, strict=True):
            part.append(_columns(robot, block, wanted, player.play(command)))
        if tick:
            tick(block.row + len(block))
    return [_run(stream.period_s, part) for part in parts]


def _motors(robot: Robot, drive: Drive | None, period_s: float) -> Drives | None:
    if drive is None or robot.winders is None:
        return None
    return Drives(drive, robot.winders, period_s)


def _overlapping(stream: MotorStream, rows: int | None) -> Iterator[Block]:
    """Blocks that begin with the last row of the one before."""
    last: Block | None = None
    for block in stream:
        if rows is not None and block.row >= rows:
            return
        yield block if last is None else joined([last, block])
        last = cut(block, len(block) - 1, len(block))


def _columns(robot: Robot, block: Block, wanted: Array, played: Played) -> tuple[Array, ...]:
    """The columns of a run, without the row that the block before had; and the bounds of its tensions, (1, m) each."""
    slack: Array = np.any(played.tension <= SLACK_N, axis=1)
    rows, new = (*_places(robot, played.poses, wanted), *_rows(block, wanted), slack), slice(int(block.row > 0), None)
    ends = played.tension.min(axis=0)[None], played.tension.max(axis=0)[None]
    return (*(column[new] for column in rows), *ends)


def _run(period_s: float, parts: list[tuple[Array, ...]]) -> Run:
    error, wanted, laying, move, slack, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Run(period_s, error, wanted, laying, move, slack, np.stack((low.min(axis=0), high.max(axis=0))))


def _places(robot: Robot, poses: Array, wanted: Array) -> tuple[Array, Array]:
    """The nozzle's error, and where it should be on the bed."""
    right, bed = nozzle_places(robot, wanted), robot.bed_origin
    return nozzle_places(robot, poses) - right, right if bed is None else right - bed


def _rows(block: Block, wanted: Array) -> tuple[Array, Array]:
    """Whether a bead is laid, and the move of the toolpath."""
    feed = np.gradient(block.filament) if block.feed is None else block.feed
    moving = np.abs(np.gradient(wanted[:, :3], axis=0)).max(axis=1) > RESTING_MM
    return (feed > 0) & moving, np.full(len(block), -1) if block.move is None else block.move


def first_state(plant: Plant, command: Command, pose: Array) -> Array:
    """The state at rest in which the first row of a command holds the plant, near pose (6,)."""
    rest, line = command.rows[:1, 0], command.rows[:1, 1]
    return at_rest(plant.robot, equilibrium(plant.robot, rest, line, pose[None], wrench=plant.push)[0][0])
