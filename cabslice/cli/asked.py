"""The robot that workspace and stiffness are asked about: a profile, and what the command line changes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.job import printer_name
from cabslice.cli.options import Numbers, Output, Target
from cabslice.cli.report import Talk
from cabslice.errors import UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot
    from cabslice.robot.workspace import Grid

FORMATS = ("csv", "npz")
DISTRIBUTIONS = (     # names of robot.distributions.METHODS, which --help does not import
    "nearest", "least-norm", "closed-form", "improved-closed-form", "barycentre", "puncture", "qp", "lp", "slack",
)
SIDE = 50             # steps along the longest side of the frame where --step-mm is absent
NODES = 20_000_000    # of a grid, at most: a map takes 8 bytes a node


class Bounds(click.ParamType):
    """"min:max", not negative, rising."""

    name = "MIN:MAX"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        try:
            low, high = (float(word) for word in str(value).split(":"))
        except ValueError:
            low, high = 1.0, 0.0
        if not 0 <= low < high <= 1e6:
            self.fail(f'{value!r} is no range of tensions, expected "min:max" in N, 0 <= min < max.', param, ctx)
        return low, high


@dataclass(frozen=True)
class Asked:
    """As given on the command line; None where nothing was said."""

    printer: str | None
    sets: tuple[str, ...]
    no_pulleys: bool
    mass_kg: float | None
    tension_n: tuple[float, float] | None
    preload_n: float | None
    distribution: str
    step_mm: float | None
    box_mm: tuple[float, ...] | None
    bed_mm: float | None

    def robot(self) -> Robot:
        """Read the profile and change it. Raises ProfileError; UsageError for options that do not go together."""
        import numpy as np

        from cabslice.robot.held import LEVELLED
        from cabslice.robot.model import robot_from_printer

        if self.preload_n is not None and self.distribution not in LEVELLED:
            known = ", ".join(LEVELLED)
            raise UsageError(f"--preload-n: {self.distribution} has no level to set; --distribution may be: {known}.")
        robot = robot_from_printer(self.profile(), pulleys=not self.no_pulleys)
        changes: dict[str, Any] = {"winders": None} if self.no_pulleys else {}
        if self.mass_kg is not None:
            changes["mass"] = self.mass_kg
        if self.tension_n is not None:
            low, high = self.tension_n
            changes |= {"tension_min": np.full(robot.cables, low), "tension_max": np.full(robot.cables, high)}
        if self.bed_mm is not None:
            middle = (robot.anchors.min(axis=0) + robot.anchors.max(axis=0)) / 2
            bed = middle if robot.bed_origin is None else robot.bed_origin
            changes["bed_origin"] = np.array([bed[0], bed[1], self.bed_mm])
        return replace(robot, **changes)

    def step(self, robot: Robot) -> float:
        """--step-mm, else a fiftieth of the frame's longest side."""
        return self.step_mm or float((robot.anchors.max(axis=0) - robot.anchors.min(axis=0)).max()) / SIDE

    def grid(self, robot: Robot, turn_deg: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Grid:
        """Nodes about a step apart over --box-mm, else over the frame; faces included. UsageError for too many."""
        import numpy as np

        from cabslice.robot.rotation import from_angles
        from cabslice.robot.workspace import Grid

        step, corners = self.step(robot), frame(robot) if self.box_mm is None else np.reshape(self.box_mm, (2, 3))
        low, high = corners.min(axis=0), corners.max(axis=0)
        counts = np.round((high - low) / step) + 1
        if counts.prod() > NODES:
            words = f"--step-mm {step:g} means {counts.prod():.3g} nodes here, expected at most {NODES:.0e}."
            raise UsageError(words)
        x, y, z = (np.linspace(*ends) for ends in zip(low, high, counts.astype(int), strict=True))
        return Grid(x, y, z, turn=from_angles(np.radians(turn_deg)))

    def profile(self) -> Any:
        from cabslice.profile import shelf

        return shelf.load_printer(printer_name(self.printer), self.sets)

    def settings(self, robot: Robot) -> dict[str, Any]:
        """What the answer holds for."""
        from cabslice.profile import shelf

        level = {"preload_n": self.preload_n} if self.preload_n is not None else {
            "reference_tension_n": robot.tension_reference.tolist()}
        bed = {} if robot.bed_origin is None else {"bed_mm": float(robot.bed_origin[2])}
        return {
            "profiles": {"printer": {"name": robot.name, "sha256": shelf.profile_hash(self.profile())}},
            "pulleys": not self.no_pulleys, "mass_kg": robot.mass,
            "min_tension_n": robot.tension_min.tolist(), "max_tension_n": robot.tension_max.tolist(),
            "distribution": self.distribution, **level, **bed,
        }

    def sentence(self, robot: Robot) -> str:
        """The same in words."""
        low, high = robot.tension_min.min(), robot.tension_max.max()
        level = "" if self.preload_n is None else f", {self.preload_n:g} N on average"
        lead = "point anchors" if self.no_pulleys else "pulleys as in the profile"
        return f"{robot.name}: {robot.mass:g} kg, tensions {low:g}..{high:g} N{level} ({self.distribution}), {lead}"


def frame(robot: Robot) -> Array:
    """Two corners (2, 3) mm of the box of anchors, home and bed: anchors may all be at one height, on a ceiling."""
    import numpy as np

    seen = [robot.anchors, robot.home[None, :3]] + ([] if robot.bed_origin is None else [robot.bed_origin[None]])
    return np.array([np.vstack(seen).min(axis=0), np.vstack(seen).max(axis=0)])


asked = options._gather("asked", Asked, {
    "printer": click.option("-p", "--printer", metavar="NAME|FILE", help="Printer profile; else CABSLICE_PRINTER."),
    "sets": click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE",
                         help="Change one key of the printer, checked like the file. Repeatable."),
    "no_pulleys": click.option("--no-pulleys", is_flag=True,
                               help="Cables end at their anchor points, without pulleys or winders, as in the papers."),
    "mass_kg": click.option("--mass-kg", type=click.FloatRange(0, 1e5, min_open=True), help="Mass of the platform."),
    "tension_n": click.option("--tension-n", type=Bounds(), help="Bounds of the tensions, the same for all cables."),
    "preload_n": click.option("--preload-n", type=click.FloatRange(0, 1e6, min_open=True),
                              help="Mean tension of the cables; default: what the profile's reference tension gives."),
    "distribution": click.option("--distribution", type=click.Choice(DISTRIBUTIONS), default="nearest",
                                 show_default=True, help="How tensions are chosen among those that balance."),
    "step_mm": click.option("--step-mm", type=click.FloatRange(0, 1e5, min_open=True),
                            help=f"Between nodes of the grid; default: the frame's longest side / {SIDE}."),
    "box_mm": click.option("--box-mm", type=Numbers("x", "y", "z", "x", "y", "z"), metavar='"X Y Z X Y Z"',
                           help="Two corners of the grid; default: the box of the anchors, with home and bed."),
    "bed_mm": click.option("--bed-mm", type=click.FloatRange(-1e6, 1e6), help="Height of the bed, machine frame."),
})

output = options._gather("output", Output, {
    "to": click.option("-o", "--output", "to", metavar="FILE|DIR/|-", help="Save the values: .csv or .npz."),
    "overwrite": click.option("--overwrite", is_flag=True, help="Replace output and picture if they exist."),
    "format": click.option("--format", metavar="NAME", help="csv or npz, where the suffix of -o does not say."),
})

png = click.option("--png", metavar="PICTURE", help="Draw the result.")


def targets(output: Output, png: str | None, name: str, talk: Talk) -> tuple[Target | None, Talk]:
    """Where the values go, if they are wanted, and how to talk then; found out before any work, as the picture's place.

    Raises UsageError, OutputError.
    """
    if png is not None:
        if output.to is not None and Path(output.to) == Path(png):
            raise UsageError(f"-o and --png both name {png}.")
        options.claim_picture(png, output.overwrite)
    if output.to is None and output.format is None:
        return None, talk
    return options.target(output, name, FORMATS, talk)
