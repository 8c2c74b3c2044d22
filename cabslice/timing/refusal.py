"""Why a path cannot be timed, and where: layer, place of the nozzle, limit."""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.feasibility.findings import Finding
from cabslice.robot.delta import Delta, Machine, spans
from cabslice.robot.kinematics import cables
from cabslice.robot.model import nozzle_poses
from cabslice.robot.usable import usable_tension_max
from cabslice.timing.path import Path, evaluate
from cabslice.toolpath.path import Toolpath


def cannot_rest(
    robot: Machine, toolpath: Toolpath, path: Path, move: int, sigma: float, margin: float
) -> ImpossibleError:
    """No tensions hold the platform at sigma mm into a move: margin is what lacks, a share of the range."""
    layer, xyz, place = _place(toolpath, path, move, sigma)
    if isinstance(robot, Delta):
        sentence = f"layer {layer}: the motors do not hold the platform for ever with the nozzle near {place}"
        return ImpossibleError(sentence, [Finding(
            "motor-torque", layer, xyz, 0, margin * 1e-3, 0.0, "N m", sentence,
            "a lighter platform, or motors of more continuous_torque_n_m")])
    most = usable_tension_max(robot)
    held = f" (the motors hold {most.min():.1f} N for ever)" if (most < robot.tension_max).any() else ""
    sentence = f"layer {layer}: no cable tensions within bounds{held} hold the platform with the nozzle near {place}"
    return ImpossibleError(sentence, [Finding(
        "tension", layer, xyz, 0, margin if np.isfinite(margin) else -1.0, 0.0, "of the range", sentence,
        "move the part towards the middle of the bed or lower its height")])


def cannot_time(toolpath: Toolpath, path: Path, move: int, sigma: float) -> ImpossibleError:
    """No speed above zero was found at sigma mm into a move."""
    layer, xyz, place = _place(toolpath, path, move, sigma)
    sentence = (f"layer {layer}: the motion cannot be timed with the nozzle near {place}: a cable cannot run, or "
                "a move is too short to be timed")
    return ImpossibleError(sentence, [Finding(
        "untimed", layer, xyz, 0, 0.0, 0.0, "mm/s", sentence, "move the part towards the middle of the bed")])


def cannot_run(robot: Machine, toolpath: Toolpath, xyz: Array, move: Array) -> ImpossibleError:
    """A cable cannot run at one of the places xyz (K, 3) in moves (K,): the first, else the nearest to it, is told."""
    if isinstance(robot, Delta):
        return _cannot_reach(robot, toolpath, xyz, move)
    free = cables(robot, nozzle_poses(robot, xyz), refuse=False).free
    at, cable = divmod(int(np.argmin(np.nan_to_num(free, nan=-np.inf))), free.shape[1])
    layer, (told, place) = int(toolpath.layer[move[at]]), _told(xyz[at])
    sentence = (f"layer {layer}: cable {cable + 1} cannot run with the nozzle near {place}: the platform is at its "
                "pulley or anchor")
    return ImpossibleError(sentence, [Finding(
        "pulley", layer, told, cable + 1, 0.0, 0.0, "mm", sentence,
        "move the part towards the middle of the bed or lower its height")])


def _cannot_reach(robot: Delta, toolpath: Toolpath, xyz: Array, move: Array) -> ImpossibleError:
    level = spans(robot, nozzle_poses(robot, xyz))
    at, arm = divmod(int(np.argmax(level)), 3)
    layer, (told, place) = int(toolpath.layer[move[at]]), _told(xyz[at])
    sentence = (f"layer {layer}: arm {arm + 1} does not reach with the nozzle near {place}: {level[at, arm]:.1f} mm "
                f"lie between its ends in the level plane")
    return ImpossibleError(sentence, [Finding(
        "arm-angle", layer, told, arm + 1, float(level[at, arm]), robot.arm, "mm", sentence,
        "move the part towards the middle of the bed")])


def _place(toolpath: Toolpath, path: Path, move: int, sigma: float) -> tuple[int, tuple[float, float, float], str]:
    xyz = evaluate(path, np.array([move]), np.array([sigma])).q[0]
    return int(toolpath.layer[move]), *_told(xyz)


def _told(xyz: Array) -> tuple[tuple[float, float, float], str]:
    x, y, z = (float(value) for value in xyz)
    return (x, y, z), f"x {x:.1f} y {y:.1f} z {z:.1f} mm"
