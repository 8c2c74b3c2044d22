"""Lower the acceleration of a motion where, and only where, it makes a wrong robot ring too much.

A place that rings beyond the bound has been shaken in the time before it: the moves made then have their acceleration
lowered and are planned again, the rest stays. Slower moves shake at other frequencies, so this is done again until the
whole motion keeps the bound. The print is looked at in stretches, each by itself: what is calm is not looked at again.

Legend
    share    error over bound, beyond the offset of the first layer     calm   share of the acceleration a move may have
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.simulation.ringing import STEP_S, Ringing
from cabslice.timing.path import evaluate
from cabslice.timing.retime import Block, Task, block_of, speeds_of, timed
from cabslice.timing.trajectory import Trajectory

ROUNDS, GENTLE_ROUNDS = 40, 3        # at most; and how many go by the gentle power
POWERS = (0.7, 1.1)                  # of the share, by which acceleration is lowered: ringing falls with it, or faster
BLAME_S, LONG_S = 0.2, 0.5           # before a place; after FEW rounds the longer one
FEW = 8
STRETCH_S = 20.0                     # of the motion, looked at by itself
LEAST = 0.01                         # of the acceleration is left to every move
FIRST_S = 600.0                      # of the first layer gives its offset
Progress = Callable[[int, int], None]


class Calming:
    """A motion that can be made calmer, bound after bound."""

    def __init__(self, task: Task, ringings: Callable[[Trajectory], Sequence[Ringing]], *, jobs: int = 1,
                 progress: Progress | None = None) -> None:
        starts = task.toolpath.starts
        self.pieces, self.jobs, self.progress = np.arange(len(starts) - 1), jobs, progress
        self.task = replace(task, calm=np.ones(len(task.toolpath.xyz)))
        self.piece = np.searchsorted(starts, np.arange(len(task.toolpath.xyz)), side="right") - 1
        self.x = speeds_of(task, self.pieces, jobs=jobs)
        self.whole = block_of(task.grid, self.pieces)
        self.motion = timed(task, self.x)
        self.ringings = ringings(self.motion)
        self.offsets = [self._offset(one) for one in self.ringings]
        begin = self.motion.time[self.motion.pieces[:-1]]
        self.first = np.flatnonzero(np.diff(begin // STRETCH_S, prepend=-1.0))      # piece of each stretch

    def largest(self) -> float:
        """mm, of the present motion."""
        return float(max((share.max(initial=0.0) for share, _ in self._shares(self._all, 1.0)), default=0.0))

    @property
    def least_mm_s2(self) -> float:
        """The lowest limit of any move."""
        assert self.task.calm is not None
        return float(self.task.calm.min() * self.task.limits.acceleration)

    @property
    def _all(self) -> Array:
        return np.arange(len(self.first))

    def keep(self, bound_mm: float) -> Trajectory:
        """The motion, calmed until no ringing is beyond bound_mm, or ROUNDS are over."""
        loud = self._all
        for number in range(ROUNDS):
            found = self._shares(loud, bound_mm, number >= FEW)
            need = np.ones(len(self.piece))
            for share, move in found:
                np.maximum.at(need, move, share)
            loud = loud[[bool(share.max(initial=0.0) > 1) for share, _ in found]]
            if self.progress:
                self.progress(len(self.first) - len(loud), len(self.first))
            if not len(loud):
                break
            self._lower(need, number)
        return self.motion

    def _lower(self, need: Array, number: int) -> None:
        assert self.task.calm is not None
        hit, power = need > 1, POWERS[number >= GENTLE_ROUNDS]
        calm = self.task.calm.copy()
        used = np.minimum(calm, np.maximum(self._used(), LEAST))
        calm[hit] = np.maximum(used[hit] / need[hit]**power, LEAST)
        self.task = replace(self.task, calm=calm)
        again = np.unique(self.piece[hit])
        at = block_of(self.task.grid, again)
        rows = np.repeat(self.whole.offsets[again] - at.offsets[:-1], np.diff(at.offsets)) + np.arange(at.offsets[-1])
        self.x[rows] = speeds_of(self.task, again, jobs=self.jobs)
        self.motion = timed(self.task, self.x)

    def _shares(self, stretches: Array, bound_mm: float, late: bool = False) -> list[tuple[Array, Array]]:
        """Of each stretch: (K,) the largest share that a row leads to, and the moves of the rows."""
        begin = np.append(self.motion.time[self.motion.pieces[self.first]], self.motion.duration)
        begin[0] = 0.0

        def one(k: int) -> tuple[Array, Array]:
            worst, move = np.zeros(0), np.zeros(0, np.int64)
            since = max(float(begin[k]) - LONG_S, 0.0)
            for ringing, offset in zip(self.ringings, self.offsets, strict=True):
                found = ringing.play(self.motion, since, float(begin[k + 1]))
                size = np.where(found.laying, np.linalg.norm(found.error - offset, axis=1), 0.0) / bound_mm
                worst, move = (np.maximum(worst, size) if len(worst) else size), found.move
            return _ahead(worst, round((LONG_S if late else BLAME_S) / STEP_S)), move

        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(one, stretches.tolist()))

    def _offset(self, ringing: Ringing) -> Array:
        layer = self.task.toolpath.layer
        found = ringing.play(self.motion, 0.0, min(self._first_layer_s(), FIRST_S))
        laying = found.laying & (layer[found.move] == self._first_layer())
        return found.error[laying].mean(axis=0) if laying.any() else np.zeros(3)

    def _first_layer(self) -> int:
        toolpath = self.task.toolpath
        laid = np.flatnonzero((toolpath.filament > 0) & (toolpath.lengths > 0))
        return int(toolpath.layer[laid[0]]) if len(laid) else 0

    def _first_layer_s(self) -> float:
        """s, when the first layer that lays filament is over."""
        beyond = np.flatnonzero(self.task.toolpath.layer[self.motion.move] > self._first_layer())
        return float(self.motion.time[beyond[0]]) if len(beyond) else self.motion.duration

    def _used(self) -> Array:
        """(N,) share of the acceleration that the plan uses in each move, before it is averaged."""
        return used(self.task, self.whole, self.x)


def used(task: Task, block: Block, x: Array) -> Array:
    """(N,) largest acceleration along an axis, over the limit, in each move of a block with x (G,) at its nodes."""
    start = block.start
    u = np.zeros(len(x))
    u[start] = (x[start + 1] - x[start]) / (2 * block.step[start])
    motion, found = evaluate(task.path, block.move, block.sigma), np.zeros(len(task.toolpath.xyz))
    first = np.abs(motion.d1 * u[:, None] + motion.d2 * x[:, None]).max(axis=1)
    last = np.abs(motion.d1[start + 1] * u[start, None] + motion.d2[start + 1] * x[start + 1, None]).max(axis=1)
    np.maximum.at(found, block.move, first)
    np.maximum.at(found, block.move[start], last)
    return found / task.limits.acceleration


def _ahead(share: Array, rows: int) -> Array:
    """(K,) the largest of share (K,) from each row to `rows` later."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(share, rows + 1, origin=-(rows // 2), mode="constant"))
