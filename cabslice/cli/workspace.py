"""cabslice workspace"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import asked as door
from cabslice.cli import options
from cabslice.cli.asked import Asked
from cabslice.cli.options import Numbers, Output, Target
from cabslice.cli.report import Table, Talk, Tick
from cabslice.errors import ImpossibleError, UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot
    from cabslice.robot.workspace import Grid, Measure, PrintSpace

KINDS = {"wrench-feasible": "margin_n", "wrench-closure": "closure_share"}
MAPS = {"margin": "margin_n", "first-mode": "first_mode_hz", "stiffness": "stiffness_n_mm", "cable-gap": "cable_gap_mm"}
LEAST = {     # key: how a least value of it is said
    "margin_n": "{:g} N inside the bounds", "first_mode_hz": "first mode {:g} Hz",
    "stiffness_n_mm": "{:g} N/mm at the nozzle", "cable_gap_mm": "{:g} mm between cables",
}
CLOSED = 1e-9        # closure_share above 0


@dataclass(frozen=True)
class Wanted:
    """What counts as inside: maps by key, each with the least value it must have there; None: it is only shown."""

    kind: str
    least: Mapping[str, float | None]
    turn_deg: tuple[float, ...]

    def sentence(self) -> str:
        more = [LEAST[key].format(value) for key, value in self.least.items() if value is not None and value > CLOSED]
        turn = f", turned by {' '.join(f'{angle:g}' for angle in self.turn_deg)} deg" if any(self.turn_deg) else ""
        return f"{self.kind} workspace{turn}" + (f", at least {', '.join(more)}" if more else "")


@dataclass(frozen=True)
class Found:
    grid: Grid                   # of the platform origin
    maps: dict[str, Array]       # (X, Y, Z) by key, the kind's own first
    inside: Array                # (X, Y, Z) bool
    space: PrintSpace | None = None


def _gathered(kind: str, maps: Sequence[str], turn: tuple[float, ...], **least: float | None) -> Wanted:
    wished: dict[str, float | None] = {MAPS[name]: None for name in maps}
    wished |= {key.removeprefix("min_"): value for key, value in least.items() if value is not None}
    own = CLOSED if kind == "wrench-closure" else wished.get("margin_n") or 0.0
    return Wanted(kind, {KINDS[kind]: own, **{key: value for key, value in wished.items() if key != KINDS[kind]}}, turn)


def _least(unit: str, what: str) -> Any:
    words = f"Inside only where {what} is at least this."
    return click.option(f"--min-{unit}", type=click.FloatRange(0, 1e9), help=words)


wanted = options._gather("wanted", _gathered, {
    "kind": click.option("--kind", type=click.Choice(list(KINDS)), default="wrench-feasible", show_default=True,
                         help="Carries the weight within the bounds, or any wrench if the cables are strong enough."),
    "maps": click.option("--map", "maps", multiple=True, type=click.Choice(list(MAPS)),
                         help="Tell, save and draw this as well. Repeatable."),
    "turn": click.option("--turn", type=Numbers("psi", "theta", "phi"), default=(0.0, 0.0, 0.0),
                         help="Of the platform, deg (XYZ Tait-Bryan); default: level."),
    "min_margin_n": _least("margin-n", "the way of the tensions to their bounds"),
    "min_first_mode_hz": _least("first-mode-hz", "the first natural frequency"),
    "min_stiffness_n_mm": _least("stiffness-n-mm", "the nozzle's stiffness in its softest direction"),
    "min_cable_gap_mm": _least("cable-gap-mm", "the air between the two nearest cables"),
})


@click.command("workspace")
@door.asked
@wanted
@door.output
@door.png
@options.talk
def workspace(asked: Asked, wanted: Wanted, output: Output, png: str | None, talk: Talk) -> None:
    """Where can the platform be, and where can it print?

    Asks at every node of a grid over the machine, faces included. For printers with nozzle and bed also the print
    space: nozzle positions at which no cable crosses a part thought of as a cylinder (the union over all radii), and
    the largest single cylinder. Exit code 4 where no pose is inside.
    """
    robot = asked.robot()
    target, talk = door.targets(output, png, f"{robot.name}-workspace", talk)
    from cabslice.cli import tables_robot as tables
    from cabslice.view import workspace as numbers

    with talk.progress() as tick:
        found = _survey(asked, robot, wanted, talk, tick)
    said = numbers.of_maps(found.grid, found.inside, found.maps)
    if found.space:
        low, high = door.frame(robot)
        said |= numbers.of_print_space(float((high - low).prod()), found.space)
    settings = _settings(asked, robot, wanted)
    if target:
        _save(target, settings | {"numbers": said}, robot, found)
    if png:
        _draw(png, output.overwrite, asked.sentence(robot), robot, wanted, found)
    files = ({"output": target.path} if target else {}) | ({"png": png} if png else {})
    blocks: list[str | Table] = [asked.sentence(robot), wanted.sentence(), tables.space_table(said)]
    blocks += ["\nby height of the platform", tables.height_table(found.grid, found.maps, found.inside)]
    if found.space:
        blocks += ["\nby height of the nozzle over the bed", tables.print_table(robot, found.space)]
    content = {"ok": True, "command": "workspace", **settings, "numbers": said, **files}
    talk.answer(content, *blocks, *(f"wrote {path}" for path in files.values()))


def _settings(asked: Asked, robot: Robot, wanted: Wanted) -> dict[str, Any]:
    least = {f"min_{key}": value for key, value in wanted.least.items() if value is not None and value > CLOSED}
    return {**asked.settings(robot), "kind": wanted.kind, "turn_deg": list(wanted.turn_deg),
            "step_mm": asked.step(robot), **least}


# ---- asking

def _survey(asked: Asked, robot: Robot, wanted: Wanted, talk: Talk, tick: Tick) -> Found:
    """Raises ImpossibleError where nothing is inside."""
    import numpy as np

    from cabslice.robot import workspace as room

    measures, grid = _measures(asked, wanted), asked.grid(robot, wanted.turn_deg)
    maps = {key: room.survey(robot, grid, _counted(one, key, grid, tick)).value for key, one in measures.items()}
    least = {key: value for key, value in wanted.least.items() if value is not None}
    inside = np.logical_and.reduce([maps[key] >= value for key, value in least.items()])
    if not inside.any():
        _refuse_coarse(asked, robot, wanted, measures)
        raise _nowhere(asked, robot, wanted, grid, maps)
    if robot.nozzle is None or robot.bed_origin is None or not robot.freedoms[:3].all():
        talk.say(f"no print space: {robot.name} has no nozzle, no bed (--bed-mm) or not all of x, y, z")
        return Found(grid, maps, inside)
    if any(wanted.turn_deg):
        talk.say("no print space: it is asked for level platforms")
        return Found(grid, maps, inside)

    def mask(robot: Robot, poses: Array) -> Array:
        return np.logical_and.reduce([measures[key](robot, poses) >= value for key, value in least.items()])

    return Found(grid, maps, inside, room.print_space(robot, step=asked.step(robot), mask=mask, threshold=1.0))


def _measures(asked: Asked, wanted: Wanted) -> dict[str, Measure]:
    from cabslice.robot import held
    from cabslice.robot import workspace as room

    way: dict[str, Any] = {"method": asked.distribution, "preload": asked.preload_n}
    known = {
        "margin_n": room.feasible_margin, "closure_share": room.closure, "first_mode_hz": held.first_mode(**way),
        "stiffness_n_mm": held.nozzle_stiffness(**way), "cable_gap_mm": room.least_gap,
    }
    return {key: known[key] for key in wanted.least}


def _counted(measure: Measure, stage: str, grid: Grid, tick: Tick) -> Measure:
    """The measure, telling how far it is."""
    done, total = 0, grid.shape[0] * grid.shape[1] * grid.shape[2]

    def counted(robot: Robot, poses: Array) -> Array:
        nonlocal done
        value = measure(robot, poses)
        done += len(poses)
        tick(stage, done, total)
        return value

    return counted


def _refuse_coarse(asked: Asked, robot: Robot, wanted: Wanted, measures: Mapping[str, Measure]) -> None:
    """Raises UsageError where home is inside, so that it is the grid that misses the workspace."""
    import numpy as np

    from cabslice.robot.rotation import from_angles

    home = robot.home[None].copy()
    home[0, 3:] = from_angles(np.radians(wanted.turn_deg))
    least = {key: value for key, value in wanted.least.items() if value is not None}
    if asked.box_mm is None and all(measures[key](robot, home)[0] >= value for key, value in least.items()):
        place = " ".join(f"{x:g}" for x in home[0, :3])
        raise UsageError(
            f"--step-mm {asked.step(robot):g} is too coarse: no node of the grid is in the {wanted.sentence()}, but "
            f"the home pose, {place} mm, is. Give a smaller step."
        )


def _nowhere(asked: Asked, robot: Robot, wanted: Wanted, grid: Grid, maps: Mapping[str, Array]) -> ImpossibleError:
    """Says what is missing at the pose where the kind's own measure is largest."""
    import numpy as np

    from cabslice.robot.held import why_not

    key, value = next(iter(maps.items()))
    words = f"{robot.name} has no {wanted.sentence()}: none of {value.size} poses asked about is inside."
    value = np.where(np.isfinite(value), value, -np.inf).ravel()
    best = int(value.argmax())
    if np.isfinite(value[best]):
        pose = grid.poses(slice(best, best + 1))[0]
        fault = why_not(robot, pose, method=asked.distribution, preload=asked.preload_n)
        place = " ".join(f"{x:g}" for x in pose[:3])
        words += f" The nearest, {place} mm: {fault.sentence if fault else f'{key} is {value[best]:.4g}'}."
    return ImpossibleError(words, workspace_fraction=0.0)


# ---- keeping

def _save(target: Target, head: Mapping[str, Any], robot: Robot, found: Found) -> None:
    """csv: a row a platform node. npz: axes and maps, and the print space on the nozzle's own grid."""
    from cabslice.cli.saved import save

    grid, poses = found.grid, found.grid.poses()
    rows = {"x_mm": poses[:, 0], "y_mm": poses[:, 1], "z_mm": poses[:, 2], "inside": found.inside.ravel()}
    rows |= {key: value.ravel() for key, value in found.maps.items()}
    arrays = {"x_mm": grid.x, "y_mm": grid.y, "z_mm": grid.z, "inside": found.inside, **found.maps}
    if found.space:
        space = found.space
        rows |= _print_columns(robot, poses, found.inside)
        arrays |= {
            "nozzle_x_mm": space.grid.x, "nozzle_y_mm": space.grid.y, "nozzle_z_mm": space.grid.z,
            "nozzle_free_radius_mm": space.free_radius, "nozzle_in_print_space": space.inside}
    save(target, head, rows, arrays)


def _print_columns(robot: Robot, poses: Array, inside: Array) -> dict[str, Array]:
    """Free radius at platform nodes, and which of them belong to the print space."""
    import numpy as np

    from cabslice.robot.workspace import SWEEP, free_radius

    assert robot.nozzle is not None
    assert robot.bed_origin is not None
    free = np.concatenate([free_radius(robot, poses[i: i + SWEEP]) for i in range(0, len(poses), SWEEP)])
    over = poses[:, :3] + robot.nozzle - robot.bed_origin
    printing = inside.ravel() & (free >= np.hypot(over[:, 0], over[:, 1])) & (over[:, 2] >= 0)
    return {"free_radius_mm": free, "in_print_space": printing}


def _draw(path: str, overwrite: bool, title: str, robot: Robot, wanted: Wanted, found: Found) -> None:
    from cabslice.view.plots import Chart, save_picture

    home = tuple(robot.home[:3])
    charts = [Chart(key, found.grid, value, found.inside, through=home) for key, value in found.maps.items()]
    if found.space and robot.bed_origin is not None:
        x, y, z = robot.bed_origin
        cylinder = (x, y, z, found.space.cylinder_radius, found.space.cylinder_height)
        charts.append(Chart("free_radius_mm", found.space.grid, found.space.free_radius, found.space.inside,
                            title="print space, by place of the nozzle; orange: bed, largest cylinder",
                            cylinder=cylinder, through=(x, y, z + found.space.cylinder_height / 2)))
    save_picture(robot, charts, path, title=f"{title}\n{wanted.sentence()}", overwrite=overwrite)
