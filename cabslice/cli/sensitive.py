"""simulate --sensitivity: which parameters of the robot must be known how well?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cabslice.cli.asked import Asked
from cabslice.cli.report import Table, Talk
from cabslice.errors import UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot

SIDE, HEIGHTS_MM = (-0.3, 0.0, 0.3), (0.0, 50.0, 100.0)      # places: shares of the bed, heights of the nozzle


def answer(asked: Asked, bound_um: float, draws: int, seed: int, talk: Talk) -> None:
    from cabslice.simulation.deviation import spread
    from cabslice.simulation.sensitivity import UNITS, monte_carlo, needed, sensitivity, standing

    robot = asked.robot()
    at = standing(robot, _places(robot))
    needs = needed(sensitivity(at), bound_um / 1e3)
    numbers: dict[str, Any] = {"poses": len(at.poses), "bound_um": bound_um, "groups": needs}
    blocks: list[str | Table] = [Table(
        ("parameter", ">um of the nozzle", "", ">one alone", ">all, std. dev.", "", "worst"),
        [(name, f"{1e3 * row['nozzle_mm_per_unit']:.1f}", f"per {UNITS[name]}", f"{row['one_alone']:.4g}",
          f"{row['standard_deviation_of_all']:.4g}", UNITS[name], str(row["worst"])) for name, row in needs.items()])]
    if draws:
        import numpy as np

        sigma = {name: float(row["standard_deviation_of_all"]) / len(needs) ** 0.5 for name, row in needs.items()}
        size = np.linalg.norm(monte_carlo(at, sigma, draws=draws, seed=seed), axis=2)
        numbers["monte_carlo"] = {"draws": draws, "seed": seed, "sigma": sigma, **spread(size.ravel())}
        row = {key: 1e3 * value for key, value in spread(size.ravel()).items()}
        blocks.append(f"{draws} random robots, each group wrong by its share of that: nozzle off by "
                      f"{row['rms_mm']:.1f} um rms, {row['p95_mm']:.1f} (95 %), {row['max_mm']:.1f} at most")
    talk.answer({"ok": True, "command": "simulate", **asked.settings(robot), "numbers": numbers},
                f"{robot.name}: nozzle at {len(at.poses)} places, motors at rest; known so well it stays within "
                f"{bound_um:g} um", *blocks)


def _places(robot: Robot) -> Array:
    """Level poses over the bed that can be held."""
    import numpy as np

    from cabslice.robot.model import nozzle_poses
    from cabslice.robot.tension import nearest_tension
    from cabslice.robot.wrench import required_wrench

    if robot.bed_size is None or robot.nozzle is None:
        raise UsageError(f"{robot.name} has no bed or no nozzle: there is nothing to look at.")
    x, y = robot.bed_size
    poses = nozzle_poses(robot, np.array([[a * x, b * y, z] for z in HEIGHTS_MM for a in SIDE for b in SIDE]))
    held = nearest_tension(robot, poses, required_wrench(robot, poses)).feasible
    if not held.any():
        raise UsageError(f"{robot.name} cannot be held over its bed.")
    return poses[held]
