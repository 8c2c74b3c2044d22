"""cabslice stiffness"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import asked as door
from cabslice.cli import options
from cabslice.cli.asked import Asked
from cabslice.cli.options import Numbers, Output
from cabslice.cli.report import Table, Talk
from cabslice.errors import ImpossibleError, PoseError, UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.held import Held
    from cabslice.robot.model import Robot
    from cabslice.robot.workspace import Grid

Pose = tuple[float, ...]
POSE = ("x", "y", "z", "psi", "theta", "phi")
MANY = 8         # poses that are named one by one when they cannot be held


@dataclass(frozen=True)
class Answer:
    content: dict[str, Any]              # for --json
    blocks: list[str | Table]            # the same for people
    rows: dict[str, Array]               # for -o: a row a pose
    draw: Callable[[str, bool], None]    # path, overwrite


@dataclass(frozen=True)
class Nodes:
    """Which poses of a grid to ask about."""

    grid: Grid            # of the platform origin
    inside: Array         # (X, Y, Z) bool
    over: str
    sentence: str


@click.command("stiffness")
@door.asked
@click.option("--pose", "poses", multiple=True, type=Numbers(*POSE), metavar='"X Y Z PSI THETA PHI"',
              help="Of the platform, mm and deg (XYZ Tait-Bryan), machine frame. Repeatable; without it: a grid.")
@click.option("--over", type=click.Choice(["print-space", "workspace"]),
              help="Which nodes of the grid; default: the print space, for printers with a nozzle and a bed.")
@door.output
@door.png
@options.talk
def stiffness(
    asked: Asked, poses: Sequence[Pose], over: str | None, output: Output, png: str | None, talk: Talk
) -> None:
    """How stiffly do the cables hold the platform? Stiffness, natural frequencies and tensions.

    At each --pose: the diagonals of K_cable (cables stretch), K_lat (they swing), K_force (levers turn) and their sum,
    the modes of the whole, and the tensions that carry the weight. Without --pose: mean, least and largest over the
    level poses of a grid. Exit code 4 where a cable cannot run, or no tensions within the bounds exist.
    """
    if poses and (over or asked.step_mm or asked.box_mm):
        raise UsageError("--pose asks about poses; --over, --step-mm and --box-mm about a grid: choose one.")
    robot = asked.robot()
    target, talk = door.targets(output, png, f"{robot.name}-stiffness", talk)
    answer = _at_poses(asked, robot, poses) if poses else _over_grid(asked, robot, over, talk)
    settings = asked.settings(robot)
    if target:
        from cabslice.cli.saved import save

        head = {key: value for key, value in answer.content.items() if key != "numbers"}     # these are in the rows
        save(target, settings | head, answer.rows)
    if png:
        answer.draw(png, output.overwrite)
    files = ({"output": target.path} if target else {}) | ({"png": png} if png else {})
    content = {"ok": True, "command": "stiffness", **settings, **answer.content, **files}
    talk.answer(content, asked.sentence(robot), *answer.blocks, *(f"wrote {path}" for path in files.values()))


# ---- at poses

def _at_poses(asked: Asked, robot: Robot, given: Sequence[Pose]) -> Answer:
    from cabslice.cli.tables_robot import pose_tables
    from cabslice.view.stiffness import of_held, one_or_rows

    columns = of_held(robot, _hold(asked, robot, given))
    blocks: list[str | Table] = []
    for i, pose in enumerate(given):
        blocks += [f"\n{_said(pose)}", *pose_tables({key: column[i] for key, column in columns.items()})]

    def draw(path: str, overwrite: bool) -> None:
        from cabslice.view.plots_poses import save_picture

        names = [" ".join(f"{number:g}" for number in pose) for pose in given]
        save_picture(robot, columns, names, path, title=asked.sentence(robot), overwrite=overwrite)

    content = {"poses_mm_deg": [list(pose) for pose in given], "numbers": one_or_rows(columns)}
    return Answer(content, blocks, {"pose_mm_deg": _array(given), **columns}, draw)


def _hold(asked: Asked, robot: Robot, given: Sequence[Pose]) -> Held:
    """Raises ImpossibleError naming every pose that cannot be held, with cables and newtons."""
    import numpy as np

    from cabslice.robot.held import hold
    from cabslice.robot.rotation import from_angles

    rows = _array(given)
    poses = np.hstack((rows[:, :3], from_angles(np.radians(rows[:, 3:]))))
    refusals = [
        {**fault.details, "pose": i + 1, "sentence": f"{_said(given[i])}: {_plain(fault)}."}
        for i, pose in enumerate(poses) if (fault := _fault(asked, robot, pose)) is not None]
    if refusals:
        sentences = [row["sentence"] for row in refusals[:MANY]]
        more = [f"... and {len(refusals) - MANY} more poses"] if len(refusals) > MANY else []
        raise ImpossibleError("\n".join(sentences + more), poses=refusals)
    return hold(robot, poses, method=asked.distribution, preload=asked.preload_n)


def _fault(asked: Asked, robot: Robot, pose: Array) -> PoseError | None:
    from cabslice.robot.held import why_not

    try:
        return why_not(robot, pose, method=asked.distribution, preload=asked.preload_n)
    except PoseError as error:      # a cable that cannot run
        return error


def _plain(fault: PoseError) -> str:
    """Without the number the pose has inside the library, where it is asked about alone."""
    return fault.sentence.replace(" at pose 0:", ":", 1)


def _said(pose: Pose) -> str:
    x, y, z, *turn = pose
    return f"Pose {x:g} {y:g} {z:g} mm, {' '.join(f'{angle:g}' for angle in turn)} deg"


def _array(given: Sequence[Pose]) -> Array:
    import numpy as np

    return np.array(given, dtype=float)


# ---- over a grid

def _over_grid(asked: Asked, robot: Robot, over: str | None, talk: Talk) -> Answer:
    import numpy as np

    from cabslice.cli.tables_robot import node_tables
    from cabslice.view.stiffness import of_poses, over_nodes

    nodes = _nodes(asked, robot, over)
    poses = nodes.grid.poses()[nodes.inside.ravel()]
    if not len(poses):
        raise ImpossibleError(f"{robot.name}: there are no {nodes.sentence} (cabslice workspace says why).")
    with talk.progress() as tick:
        columns = of_poses(robot, poses, method=asked.distribution, preload=asked.preload_n,
                           progress=lambda done: tick("stiffness", done, len(poses)))
    share = float(np.isfinite(columns["mean_tension_n"]).mean())
    if not share:
        what = asked.distribution if asked.preload_n is None else f"a mean tension of {asked.preload_n:g} N"
        raise ImpossibleError(f"{robot.name}: {what} keeps the bounds at none of {len(poses)} {nodes.sentence}.")
    numbers = {"nodes": len(poses), "held_fraction": share, **over_nodes(columns)}
    sentence = f"{len(poses)} {nodes.sentence}" + ("" if share == 1 else f"; {100 * share:.1f} % of them are held so")

    def draw(path: str, overwrite: bool) -> None:
        _draw(robot, nodes, columns, path, f"{asked.sentence(robot)}\n{sentence}", overwrite)

    rows = {"x_mm": poses[:, 0], "y_mm": poses[:, 1], "z_mm": poses[:, 2], **columns}
    content = {"over": nodes.over, "step_mm": asked.step(robot), "numbers": numbers}
    return Answer(content, [sentence, *node_tables(numbers)], rows, draw)


def _nodes(asked: Asked, robot: Robot, over: str | None) -> Nodes:
    """Level poses of the print space, or where that is not known or not wanted, of the workspace."""
    from dataclasses import replace

    from cabslice.robot import workspace

    step, grid = asked.step(robot), asked.grid(robot)
    if over == "workspace" or (over is None and (robot.nozzle is None or robot.bed_origin is None)):
        found = workspace.survey(robot, grid, workspace.feasible_margin)
        return Nodes(grid, found.inside, "workspace", f"wrench-feasible level poses, {step:g} mm apart")
    if robot.nozzle is None or robot.bed_origin is None:
        raise UsageError(f"{robot.name} has no nozzle or no bed, so no print space: --over workspace, or --bed-mm.")
    space = workspace.print_space(robot, step=step)
    x, y, z = (axis - shift for axis, shift in zip(
        (space.grid.x, space.grid.y, space.grid.z), robot.nozzle, strict=True))
    return Nodes(replace(space.grid, x=x, y=y, z=z), space.inside, "print-space",
                 f"level poses of the print space, bed at {robot.bed_origin[2]:g} mm, {step:g} mm apart")


def _draw(robot: Robot, nodes: Nodes, columns: dict[str, Array], path: str, title: str, overwrite: bool) -> None:
    import numpy as np

    from cabslice.view.plots import Chart, save_picture

    def chart(key: str, column: Array) -> Chart:
        values = np.full(nodes.inside.shape, np.nan)
        values[nodes.inside] = column
        return Chart(key, nodes.grid, values)

    drawn = {"first_mode_hz": columns["modes_hz"][:, 0], "stiffness_n_mm": columns["k_nozzle_least_kn_m"]}
    save_picture(robot, [chart(*item) for item in drawn.items()], path, title=title, overwrite=overwrite)
