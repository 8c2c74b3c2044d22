"""Tensions of the audit: found from differences of the motion, verified, and at some of the times found again.

Legend
    W t = w      the cables' pull t (N) gives what the platform needs, w, by Newton and Euler
    share        of a tension: its distance from the middle of its range over half the range
    again        the quadratic programme (robot.projection), which knows neither null space nor polygon: at a time drawn
                 in each hundred and at the TIGHTEST of all; both methods find the tensions nearest to the reference
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.projection import projected
from cabslice.robot.rotation import cross, matrix
from cabslice.robot.tension import unmeasured
from cabslice.robot.usable import usable_tension_max
from cabslice.robot.wrench import wrench_matrix
from cabslice.timing.trajectory import Trajectory, sample
from cabslice.timing.worst import Worst

BALANCE = 1e-6       # of the largest tension: how well the tensions must hold the wrench
SAME = 1e-6          # of the largest tension: how near the two methods must be
SPARSE = 100         # samples of which one is looked at again
SEED, CHUNK = 6, 4096


def needed(robot: Robot, before: Array, poses: Array, after: Array, step: float) -> Array:
    """(K, 6) N, N mm: what holds the platform at poses (K, 6), by differences to those step s before and after."""
    if not any(part[:, 3:].any() for part in (before, poses, after)):
        accel = (after[:, :3] - 2 * poses[:, :3] + before[:, :3]) / step**2
        force = robot.mass * (accel - robot.gravity) * NEWTON
        return np.hstack((force, cross(robot.centre_of_mass, force))) - robot.pull
    first, turn, last = (matrix(part[:, 3:]) for part in (before, poses, after))
    places = [part[:, :3] + here @ robot.centre_of_mass for part, here in (
        (before, first), (poses, turn), (after, last))]
    force = robot.mass * ((places[2] - 2 * places[1] + places[0]) / step**2 - robot.gravity) * NEWTON
    moment, back = np.cross(turn @ robot.centre_of_mass, force), turn.swapaxes(1, 2)
    spin, spun = _axial((last - first) @ back) / (2 * step), _axial((last - 2 * turn + first) @ back) / step**2
    inertia = turn @ robot.inertia @ back
    torque = np.einsum("kij,kj->ki", inertia, spun) + np.cross(spin, np.einsum("kij,kj->ki", inertia, spin))
    return np.hstack((force, moment + NEWTON * torque)) - robot.pull


def _axial(matrices: Array) -> Array:
    """(K, 3) of the antisymmetric part of (K, 3, 3)."""
    odd = (matrices - matrices.swapaxes(1, 2)) / 2
    return np.stack((odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]), axis=1)


def found_tensions(robot: Robot, wrench: Array, required: Array) -> tuple[Array, Array]:
    """Tensions (K, m) within the bounds, verified on the spot, nan where there are none; and their shares (K, m)."""
    free, highest = robot.freedoms, usable_tension_max(robot)
    found = unmeasured(wrench[:, free], required[:, free], robot.tension_min, highest, robot.tension_reference)
    supplied = np.einsum("kfm,km->kf", wrench, np.nan_to_num(found.tension))
    arm = max(float(np.abs(robot.attachments).max()), 1.0)
    missing = np.abs(supplied - required) / np.where(np.arange(6) < 3, 1.0, arm)
    held = found.feasible & (missing[:, free] <= BALANCE * robot.tension_max.max()).all(axis=1)
    half, middle = (highest - robot.tension_min) / 2, (highest + robot.tension_min) / 2
    share = np.where(held[:, None], np.abs(found.tension - middle) / half, np.inf)
    return np.where(held[:, None], found.tension, np.nan), share


def second_opinion(robot: Robot, trajectory: Trajectory, step: float, rows: int, worst: Worst, jobs: int) -> None:
    """Tensions again by their quadratic programme, of `rows` times step s apart: into `worst`."""
    drawn = np.arange(0, rows, SPARSE) + np.random.default_rng(SEED).integers(0, SPARSE, -(-rows // SPARSE))
    times = np.unique(np.concatenate((drawn * step, worst.tightest()[1])))
    chunks = [times[first:first + CHUNK] for first in range(0, len(times), CHUNK)]
    worst.again = len(times)
    with ThreadPoolExecutor(jobs) as pool:
        for found in pool.map(lambda chunk: _again(robot, trajectory, step, chunk), chunks):
            worst.merge(found)


def _again(robot: Robot, trajectory: Trajectory, step: float, times: Array) -> Worst:
    before, seen, after = (sample(trajectory, times + shift) for shift in (-step, 0.0, step))
    required, free = needed(robot, before.poses, seen.poses, after.poses, step), robot.freedoms
    wrench, highest = wrench_matrix(robot, seen.poses), usable_tension_max(robot)
    one = found_tensions(robot, wrench, required)[0]
    other = projected(wrench[:, free], required[:, free], robot.tension_min, highest, robot.tension_reference)
    apart = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
    worst = Worst()
    worst.see_cables("tension-again", apart, np.full(robot.cables, SAME * robot.tension_max.max()), times, seen.move)
    return worst
