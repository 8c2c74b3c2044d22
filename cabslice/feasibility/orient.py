"""How a platform is best turned while it prints a path: a field of few numbers, found by trial.

Legend
    c        the numbers, deg: psi = c0 + c3 y, theta = c1 + c4 x, phi = c2 + c5 x y, with x and y from -1 to 1 over
             what is printed: a turn that is the same everywhere, tilts towards the nozzle's side, and a twist by
             quadrant. The same up to the highest point of the print, level at home
    share    of the stretches of moves looked at, cable by cable, that meet the part
    score    share taken negative; where it is 0 what cables have left to the part, mm, up to FAR. Less than all of
             these where some place has no tension within bounds, or cables too near to each other or their pulleys

A few fields are tried, then each number both ways in steps that are halved. Scores are of some stages and places:
whoever takes a field has the path checked with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility import judges
from cabslice.feasibility.obstacles import beads_of, laying, moves_of, printing_stages
from cabslice.feasibility.survey import Judge, first_cells
from cabslice.feasibility.sweep import contacts
from cabslice.feasibility.trees import Tree, tree_of_beads, tree_of_moves
from cabslice.robot.model import Robot, level_shift
from cabslice.robot.turning import Turning
from cabslice.toolpath.path import Toolpath

ROOM = 20.0          # mm of height in which the platform is turned back to level, at least
NARROW = 20.0        # mm: a print is taken to be at least this wide
STAGES, TOPMOST, MOVES, PLACES = 12, 4, 2000, 150
FAR = 20.0           # mm
FIRST = [one for size in (1.0, 0.6) for one in (
    *([0, 0, 0, size * i, size * j, 0] for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j),
    *([0, 0, size * i, 0, 0, 0] for i in (-1, 1)), *([0, 0, 0, 0, 0, size * i] for i in (-1, 1)),
)]                           # c tried first, in bounds
STEPS = (0.3, 0.15)          # of the bounds
GAIN = 1e-4          # of the score, below which a step is none
ENDLESS = 10**9


def best_turning(toolpath: Toolpath, robot: Robot, grow: Array, tilt_deg: float, yaw_deg: float) -> Turning | None:
    """A field within the bounds that scores more than the platform as it is turned now; None where none was found.

    toolpath: with its ways from and to home. grow (m,) mm: check.grown.
    """
    home = robot.home[:3] - level_shift(robot)
    laid = toolpath.xyz[laying(toolpath)]
    inner = toolpath.xyz[np.linalg.norm(toolpath.xyz - home, axis=1) > 1e-6]
    top = float(min(inner[:, 2].max(), laid[:, 2].max() + ROOM))
    if home[2] < top + ROOM or not robot.freedoms.all():
        return None
    trial = _Trial(toolpath, robot, grow, laid, top, float(home[2]))
    bounds = np.array([tilt_deg, tilt_deg, yaw_deg] * 2)
    best = trial.searched(bounds)
    return trial.field(best) if best.any() else None


class _Trial:
    """What fields are tried on."""

    def __init__(
        self, toolpath: Toolpath, robot: Robot, grow: Array, laid: Array, top: float, home: float
    ) -> None:
        self.robot, self.grow, self.heights = robot, grow, np.array([top, home])
        middle, half = (laid.min(axis=0) + laid.max(axis=0)) / 2, np.ptp(laid, axis=0) / 2
        half = np.maximum(half, NARROW / 2)
        self.x, self.y = (middle[axis] + half[axis] * np.array([-1.0, 1.0]) for axis in (0, 1))
        stages = printing_stages(toolpath)
        self.beads: Tree = tree_of_beads(beads_of(toolpath, stages))
        moves = moves_of(toolpath, stages)
        used = np.unique(beads_of(toolpath, stages).stage)
        looked = np.append(used[np.linspace(0, len(used) - 1, STAGES).astype(int)], used[-TOPMOST:])
        rows = np.flatnonzero(np.isin(moves.stage, looked))
        self.moves = moves.take(rows[::len(rows) // MOVES + 1])
        place = first_cells(moves).place
        self.places = place[::len(place) // PLACES + 1]

    def field(self, c: Array) -> Turning:
        c = np.asarray(c, float)
        angles = np.zeros((2, 2, 2, 3))
        for i, j in np.ndindex(2, 2):
            x, y = 2 * i - 1, 2 * j - 1
            angles[i, j, 0] = np.radians(np.round(c[:3] + c[3:] * [y, x, x * y], 6))
        return Turning(self.x, self.y, self.heights, angles)

    def searched(self, bounds: Array) -> Array:
        """The numbers (6,) that score best, deg; zeros where nothing scores more than the platform as it is."""
        best, most = np.zeros(6), self.score(self.robot)
        for way in np.array(FIRST, float) * bounds:
            score = self.score(replace(self.robot, turning=self.field(way))) if way.any() and most < FAR else most
            most, best = (score, way) if score > most + GAIN else (most, best)
        for step in STEPS:
            ways = [sign * step * bounds * (np.arange(6) == axis) for axis in (3, 4, 2, 5, 0, 1) for sign in (1, -1)]
            for way in ways:
                most, best = self.stepped(best, way, most, bounds)
        return best

    def stepped(self, best: Array, way: Array, most: float, bounds: Array) -> tuple[float, Array]:
        """One more step that way, as often as it is a gain and within bounds."""
        while most < FAR and way.any():
            other = best + way
            if (np.abs(other[:3]) + np.abs(other[3:]) > bounds[:3] + 1e-9).any():
                break
            score = self.score(replace(self.robot, turning=self.field(other) if other.any() else None))
            if score <= most + GAIN:
                break
            most, best = score, other
        return most, best

    def score(self, robot: Robot) -> float:
        given: list[Judge] = [judges.pulleys(robot), judges.tensions(robot)]
        if len(judges.judged_pairs(robot)):
            given.append(judges.cable_pairs(robot))
        still = np.zeros(len(self.places))
        worst = float(min(np.nan_to_num(judge(self.places, still)[0], nan=-1e3).min() for judge in given))
        if worst < 0:
            return -1.0 + max(worst, -1e6)
        met = contacts(tree_of_moves(self.moves, robot), self.beads, robot, self.grow, stop=ENDLESS, far=FAR)
        if len(met.move):
            return -len(met.move) / (len(self.moves) * robot.cables)
        return met.margin
