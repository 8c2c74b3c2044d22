"""Forward kinematics: the pose that cable lengths hold the platform in.

Legend (Pott 2018, 4.3; Levenberg 1944, Marquardt 1963)
    L     lengths wanted, pulley entry to platform, mm        f      freedoms of the robot (rows of robot.freedoms)
    e     L(pose) - L (K, m), mm                              J      dL/d(translation, left rotation vector)
    h     lever, mm: size of the platform; turns are counted in mm of its rim, so all columns of J have one unit
    lam   damping: (J^T J + lam I) step = -J^T e              step   mm and mm of the rim

With more cables than freedoms the pose is the least-squares one, and the residual says how well the lengths agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.kinematics import cables, jacobian
from cabslice.robot.model import Robot
from cabslice.robot.rotation import turned

_STRIDE, _BLOCK = 64, 2048        # poses between two supports of a path; poses solved at once


@dataclass(frozen=True)
class ForwardResult:
    poses: Array        # (K, 6)
    residual: Array     # (K,) mm, 2-norm of the lengths' misfit
    iterations: Array   # (K,) int
    converged: Array    # (K,) bool: the last step was below the tolerance
    far: Array          # (K,) bool: branch warning, the pose is not where the linear model of its start points to


def forward(
    robot: Robot, lengths: Array, start: Array, *, tolerance: float = 1e-9, most: int = 60
) -> ForwardResult:
    """Poses (K, 6) whose cable lengths are `lengths` (K, m) mm, by Levenberg-Marquardt, all poses at once.

    start : (K, 6) near each pose, or (6,) near the first pose of a path: then each stretch of the path starts from the
        one before.  Freedoms the robot has not stay as they are in start.
    tolerance : mm, the step (of the platform's rim too) at which a pose is accepted.

    `far` is a warning, not a failure: cables hold several poses of the same lengths (assembly modes), and a pose that
    lies elsewhere than the first linear step from its start may be in another one.  Raises nothing for lengths no
    pose has: see residual and converged.  Source: Pott 2018, 4.3.
    """
    lengths, start = np.asarray(lengths, float), np.asarray(start, float)
    strayed = np.zeros(len(lengths), bool)
    if start.ndim == 1:
        start, strayed = _along(robot, lengths, start, most)
    blocks = [_solve(robot, lengths[i: i + _BLOCK], start[i: i + _BLOCK], tolerance, most)
              for i in range(0, max(len(lengths), 1), _BLOCK)]
    names = ("poses", "residual", "iterations", "converged", "far")
    columns = {name: np.concatenate([getattr(block, name) for block in blocks]) for name in names}
    return ForwardResult(**{**columns, "far": columns["far"] | strayed})


def _along(robot: Robot, lengths: Array, start: Array, most: int) -> tuple[Array, Array]:
    """Starts (K, 6) for a path: supports found one after the other, straight lines between them; and their warnings."""
    if not len(lengths):
        return np.zeros((0, 6)), np.zeros(0, bool)
    supports = np.unique(np.append(np.arange(0, len(lengths), _STRIDE), len(lengths) - 1))
    poses, far = np.empty((len(supports), 6)), np.empty(len(supports))
    for row, index in enumerate(supports):
        found = _solve(robot, lengths[index: index + 1], start[None], 1e-3, most)
        poses[row], far[row] = found.poses[0], found.far[0]
        start = poses[row]
    steps = np.arange(len(lengths))
    starts = np.stack([np.interp(steps, supports, column) for column in poses.T], axis=1)
    return starts, np.interp(steps, supports, far) > 0


@dataclass
class _State:
    """What changes while a batch is solved; rows of those still moving are `live`."""

    poses: Array
    miss: Array       # (K, m) e
    slope: Array      # (K, m, f) J in mm per mm of the rim
    damping: Array    # (K,)
    last: Array       # (K,) size of the last step
    live: Array       # (K,) indices


def _solve(robot: Robot, lengths: Array, start: Array, tolerance: float, most: int) -> ForwardResult:
    lever = _lever(robot)
    miss, slope = _linear(robot, start, lengths, lever)
    state = _State(start.copy(), miss, slope, np.full(len(start), 1e-9), np.zeros(len(start)),
                   np.arange(len(start)))
    count, converged = np.zeros(len(start), int), np.zeros(len(start), bool)
    first = np.zeros((len(start), slope.shape[2]))
    for round_ in range(most):
        if not len(state.live):
            break
        count[state.live] += 1
        step = _step(state)
        if round_ == 0:
            first = step
        converged[_advance(robot, state, lengths, lever, step, tolerance)] = True
    rim = _rim(robot, start, state.poses, lever)
    gap = np.linalg.norm(rim - first, axis=1)
    far = ~(gap <= np.maximum(0.5 * np.linalg.norm(rim, axis=1), 0.01 * lever))
    return ForwardResult(state.poses, np.linalg.norm(state.miss, axis=1), count, converged, far)


def _advance(robot: Robot, state: _State, lengths: Array, lever: float, step: Array, tolerance: float) -> Array:
    """Take the steps that help, damp the others more; drop and return the rows that arrived."""
    live = state.live
    poses = _moved(robot, state.poses[live], step, lever)
    miss, slope = _linear(robot, poses, lengths[live], lever)
    size = np.linalg.norm(step, axis=1)
    before, after = (np.einsum("km,km->k", e, e) for e in (state.miss[live], miss))
    # at the bottom rounding decides: a step of nothing is no step back
    better = after <= before + 1e-10 * np.sqrt(before) + 1e-20
    taken = live[better]
    state.poses[taken], state.miss[taken], state.slope[taken] = poses[better], miss[better], slope[better]
    damping = state.damping[live]
    state.damping[live] = np.where(better, np.maximum(damping / 10, 1e-12), np.maximum(damping * 10, 1e-3))
    # a convergent row's next step is about size^2 / last: no need to make it when it is below the tolerance
    with np.errstate(divide="ignore", invalid="ignore"):
        shrink = size / state.last[live]
    done = better & (size * np.fmin(1.0, shrink) < tolerance)
    state.last[taken] = size[better]
    state.live = live[~done]
    return live[done]


def _linear(robot: Robot, poses: Array, lengths: Array, lever: float) -> tuple[Array, Array]:
    """Misfit (K, m) and its slope (K, m, f); 1e9 and 0 where a pose puts an attachment into its pulley."""
    lines = cables(robot, poses, refuse=False)
    slope = jacobian(robot, poses, lines=lines)
    slope[:, :, 3:] /= lever
    miss = lines.length - lengths
    if not np.isfinite(miss).all():
        miss, slope = np.where(np.isfinite(miss), miss, 1e9), np.where(np.isfinite(slope), slope, 0.0)
    return miss, slope[:, :, robot.freedoms]


def _step(state: _State) -> Array:
    slope = state.slope[state.live]
    normal = np.swapaxes(slope, 1, 2) @ slope
    normal += state.damping[state.live, None, None] * np.eye(normal.shape[1])
    push = -np.einsum("kmf,km->kf", slope, state.miss[state.live])
    return np.linalg.solve(normal, push[..., None])[..., 0]


def _moved(robot: Robot, poses: Array, step: Array, lever: float) -> Array:
    full = np.zeros_like(poses)
    full[:, robot.freedoms] = step
    return np.hstack((poses[:, :3] + full[:, :3], turned(poses[:, 3:], full[:, 3:] / lever)))


def _rim(robot: Robot, start: Array, poses: Array, lever: float) -> Array:
    """The way from start to pose (K, f), in mm of translation and of the rim."""
    way = np.hstack((poses[:, :3] - start[:, :3], lever * turned(-start[:, 3:], poses[:, 3:])))
    return way[:, robot.freedoms]


def _lever(robot: Robot) -> float:
    size = float(np.linalg.norm(robot.attachments, axis=1).mean())
    return size if size > 0 else 1.0
