"""cabslice simulate"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import asked as door
from cabslice.cli import options
from cabslice.cli.asked import DISTRIBUTIONS, Asked
from cabslice.cli.options import Numbers, Output
from cabslice.cli.report import Table, Talk
from cabslice.cli.simulated import Wrong
from cabslice.errors import UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot
    from cabslice.simulation.motion import Motion
    from cabslice.simulation.plant import Plant

SLACK_N = 1e-6
MOST_DOTS = 30_000
STARTS, APART_MM = 8, 1e-9        # of motions with slack cables
AXES = (("x", "y", "z"), ("psi", "theta", "phi"))


class DampingChoice(click.ParamType):
    """none, profile, or the damping ratio of the first mode."""

    name = "none|profile|RATIO"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        if value in ("none", "profile") or isinstance(value, float):
            return value
        try:
            ratio = float(value)
        except ValueError:
            ratio = -1.0
        if not 0 <= ratio < 1:
            self.fail(f"{value!r}: expected none, profile, or a damping ratio from 0 to below 1.", param, ctx)
        return ratio


@dataclass(frozen=True)
class Circle:
    circle: float | None
    centre: tuple[float, ...]
    centre_z: float
    time: float | None
    law: str
    backwards: bool
    distribution: str
    winding: str

    def motion(self, period_s: float) -> Motion:
        import numpy as np

        from cabslice.simulation.motion import circle

        assert self.circle is not None
        if self.time is None:
            raise UsageError("--circle needs --time, the seconds it takes.")
        return circle(self.circle, np.array([*self.centre, self.centre_z]), self.time, law=self.law,
                      period_s=period_s, backwards=self.backwards)


@dataclass(frozen=True)
class Drawn:
    """The picture asked for, if any."""

    png: str | None
    layer: int | None
    overwrite: bool

    def map(self, title: str, run: Any, layers: Array) -> None:
        """Errors of the rows that lay filament, from above. Raises UsageError where there are none."""
        if self.png is None:
            return
        import numpy as np

        from cabslice.view import charts

        rows = np.flatnonzero(run.laying if self.layer is None else run.laying & (layers == self.layer))
        if not len(rows):
            raise UsageError("There is no bead to draw.")
        error = 1e3 * run.distance[rows]
        step = -(-len(rows) // MOST_DOTS)                                    # of each stretch the worst
        kept = np.array([k + int(error[k:k + step].argmax()) for k in range(0, len(rows), step)])
        where = "" if self.layer is None else f", layer {self.layer}"
        figure = charts.error_map(run.wanted[rows[kept], :2], error[kept], unit="um", title=title + where)
        charts.save(figure, self.png, overwrite=self.overwrite)


circling = options._gather("built_in", Circle, {
    "circle": click.option("--circle", type=click.FloatRange(0, 1e5, min_open=True), metavar="RADIUS_MM",
                           help="Instead of FILE: once round a level circle, from its point of largest x."),
    "centre": click.option("--centre", type=Numbers("x", "y"), default=(0.0, 0.0), help="Of the circle, mm."),
    "centre_z": click.option("--centre-z", type=click.FloatRange(-1e5, 1e5), default=0.0,
                             help="Height of the platform origin on it, mm, machine frame."),
    "time": click.option("--time", type=click.FloatRange(0, 1e4, min_open=True), metavar="S", help="It takes so long."),
    "law": click.option("--law", type=click.Choice(["cubic", "quintic", "even"]), default="cubic", show_default=True,
                        help="How the angle goes with time: 3t^2-2t^3, 10t^3-15t^4+6t^5, or t."),
    "backwards": click.option("--backwards", is_flag=True, help="Clockwise, seen from above."),
    "distribution": click.option(
        "--distribution", default="nearest-dynamic", show_default=True, metavar="NAME",
        type=click.Choice(["none", *DISTRIBUTIONS, *(f"{name}-dynamic" for name in DISTRIBUTIONS)]),
        help="Tensions the lengths are commanded for: none, or a distribution of the weight "
             f"({', '.join(DISTRIBUTIONS)}); with -dynamic behind its name of the inertia too."),
    "winding": click.option(
        "--winding", type=click.Choice(["exact", "divided"]), default="exact", show_default=True,
        help="How cable becomes motor angle: by the inverse of what is wound, or divided by the present radius."),
})


@click.command("simulate")
@click.argument("file", required=False)
@circling
@click.option("--path", metavar="FILE", help="The .path or .plan of a motor file: errors by layer and feature.")
@click.option("-p", "--printer", metavar="NAME|FILE",
              help="Of --circle: printer profile, else CABSLICE_PRINTER. Of FILE: play it on this robot instead.")
@click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE",
              help="Change one key of the simulated printer, checked like the file. Repeatable.")
@click.option("--modulus-factor", type=click.FloatRange(0.1, 10), default=1.0, show_default=True,
              help="The cables of the simulated robot are so much stiffer than FILE takes them to be.")
@click.option("--mass-factor", type=click.FloatRange(0.1, 10), default=1.0, show_default=True,
              help="The platform of the simulated robot is so much heavier.")
@click.option("--no-pulleys", is_flag=True, help="Of --circle: cables end at their anchor points.")
@click.option("--damping", type=DampingChoice(),
              help="Of the cables: none (default of --circle), profile: as it says (default of FILE), or the damping "
                   "ratio of the first mode.")
@click.option("--drives", type=click.Choice(["ideal", "cascade"]), default="ideal", show_default=True,
              help="Of FILE: motors turn as told, or as the cascade of servo drives (drives.* of the printer) does.")
@click.option("--no-velocity-feed-forward", is_flag=True, help="The cascade is told angles only.")
@click.option("--encoder-bits", type=click.IntRange(8, 32), help="The cascade sees a turn in 2^BITS steps.")
@click.option("--sensitivity", is_flag=True,
              help="Instead of FILE: what errors of anchors, lengths, radii, modulus and mass do to the nozzle.")
@click.option("--for-um", type=click.FloatRange(0, 1e5, min_open=True), default=50.0, show_default=True,
              help="Of --sensitivity: how well must each be known for so much?")
@click.option("--draws", type=click.IntRange(0, 10000), default=50, show_default=True,
              help="Of --sensitivity: random robots, as wrong as --for-um allows each group, together.")
@click.option("--seed", type=click.IntRange(0, 2**32), default=0, show_default=True, help="Of the random robots.")
@click.option("--budget", is_flag=True,
              help="Of FILE: what the error is made of, each cause switched on alone; with --path by feature.")
@click.option("--covariance", metavar="FILE.json",
              help="Of --budget: {\"parameters\": [names of --sensitivity], \"covariance\": [[...]]} of a calibration, "
                   "mm and %.")
@click.option("--png", metavar="FILE.png|.svg",
              help="Draw it: of FILE the errors from above, of --circle both ways as a ballbar shows them.")
@click.option("--layer", type=click.IntRange(0), help="Of --png: this layer only.")
@click.option("--reference", is_flag=True, help="Integrate FILE to 1e-10 mm a step instead of 1e-6 mm.")
@door.output
@options.talk
def simulate(
    file: str | None, built_in: Circle, path: str | None, printer: str | None, sets: tuple[str, ...],
    modulus_factor: float, mass_factor: float, no_pulleys: bool, damping: str | float | None, drives: str,
    no_velocity_feed_forward: bool, encoder_bits: int | None, sensitivity: bool, for_um: float, draws: int, seed: int,
    budget: bool, covariance: str | None, png: str | None, layer: int | None, reference: bool, output: Output,
    talk: Talk,
) -> None:
    """What does the elastic robot really do? Plays FILE (a motor file or a .plan) or a circle on it.

    Tells how far the nozzle is from where it is meant to be. Cables stretch, damp, and only pull; the platform is a
    rigid body that turns as it is pulled. A circle begins at rest on its first pose; a file
    where its first row holds the platform. -o saves a row for every bead.
    """
    if (file is not None) + (built_in.circle is not None) + sensitivity != 1:
        raise UsageError("What is to be played? Give FILE, --circle RADIUS_MM or --sensitivity.")
    if sensitivity:
        from cabslice.cli import sensitive

        sensitive.answer(Asked(printer, sets, no_pulleys, None, None, None, "nearest", None, None, None), for_um, draws,
                         seed, talk)
        return
    damping = damping if damping is not None else "none" if file is None else "profile"
    if file is not None:
        wrong = Wrong(printer, sets, modulus_factor, mass_factor, drives, no_velocity_feed_forward, encoder_bits)
        drawn = Drawn(png, layer, output.overwrite)
        _file(file, path, wrong, damping, reference, (budget or bool(covariance), covariance), drawn, output, talk)
        return
    if budget or covariance:
        raise UsageError("--budget is for motor files.")
    if drives != "ideal":
        raise UsageError("--drives is for motor files.")
    asked = Asked(printer, sets, no_pulleys, None, None, None, built_in.distribution, None, None, None)
    numbers = _played(asked, built_in, damping, talk)
    robot = asked.robot()
    if png:
        from cabslice.cli.ballbar import both_ways

        numbers["ballbar"] = both_ways(asked, built_in, damping, Drawn(png, None, output.overwrite))
    content = {"ok": True, "command": "simulate", **asked.settings(robot), "damping": damping, "numbers": numbers}
    talk.answer(content, asked.sentence(robot), *_tables(numbers))


def _file(
    file: str, path: str | None, wrong: Wrong, damping: str | float, reference: bool, causes: tuple[bool, str | None],
    drawn: Drawn, output: Output, talk: Talk
) -> None:
    from cabslice.cli import simulated
    from cabslice.cli.saved import save
    from cabslice.simulation import report

    target, talk = door.targets(output, None, f"{Path(file).stem}-errors", talk)
    film = simulated.opened(file, path)
    meant, real, profile = simulated.robots(film, wrong)
    plant = simulated.plant_of(film, meant, real, profile, damping)
    drive = wrong.drive(profile)
    parts = simulated.parted(film, meant, plant, drive, reference, causes[1], talk) if causes[0] else None
    run = parts[0] if parts else simulated.played(film, meant, plant, drive, reference, talk)
    numbers = report.numbers(run, film.stream.header, film.path) | ({"budget": parts[1]} if parts else {})
    settings = {"file": Path(file).name, "robot": real.name, "modulus_factor": wrong.modulus, "mass_factor": wrong.mass,
                "damping": damping, "drives": wrong.drives, "integrator": "reference" if reference else "fast"}
    if target:
        save(target, settings, report.beads(run, film.stream.header, film.path))
    drawn.map(film.title, run, report.layers_of(run, film.stream.header, film.path))
    words = f"{film.title} on {real.name}, {numbers['duration_s']:.1f} s; {_differs(wrong, damping)}"
    content = {"ok": True, "command": "simulate", **settings, "numbers": numbers}
    talk.answer(content | ({"output": target.path} if target else {}), words, *simulated.tables(numbers),
                *simulated.budget_table(numbers),
                f"wrote {target.path}" if target else "")


def _differs(wrong: Wrong, damping: str | float) -> str:
    words = [f"{what} {100 * (factor - 1):+.3g} %" for what, factor in (
        ("modulus", wrong.modulus), ("mass", wrong.mass)) if factor != 1]
    how = {"none": "no damping", "profile": "damping of the profile"}.get(str(damping), f"damping ratio {damping}")
    return ", ".join([*words, *wrong.sets, f"{wrong.drives} drives", how])


def _played(asked: Asked, built_in: Circle, damping: str | float, talk: Talk) -> dict[str, Any]:
    from cabslice.simulation.deviation import deviation, peaks
    from cabslice.simulation.motion import commanded, tensions
    from cabslice.simulation.plant import at_rest, play

    robot, profile = asked.robot(), asked.profile()
    motion = built_in.motion(profile.stream.period_ms * 1e-3)
    planned = tensions(robot, motion, built_in.distribution)
    command = commanded(robot, motion, planned, divide=built_in.winding == "divided")
    plant = damped(robot, profile, damping, motion.poses[0], planned[0], command.rows[0, 1])
    found = play(plant, command, at_rest(robot, motion.poses[0]))
    slack = (found.tension <= SLACK_N).any(axis=1)
    if slack.any():
        talk.say(f"Cables go slack, first at {slack.argmax() * motion.period_s:.3f} s: from there on the motion is "
                 "chaotic, and the least change of anything makes another one.")
    return {
        **(_spread_of_starts(plant, command, motion) if slack.any() else {}),
        **peaks(deviation(robot, found.poses, motion.poses)),
        "duration_s": float(motion.times[-1]), "rows": len(found), "period_s": motion.period_s,
        "integrator_steps": found.steps, "slack_fraction": float(slack.mean()),
        "least_tension_n": float(found.tension.min()), "largest_tension_n": float(found.tension.max()),
    }


def _spread_of_starts(plant: Plant, command: Any, motion: Motion) -> dict[str, Any]:
    """Largest errors of motions that begin next to nothing beside the first pose: what of them means something."""
    import numpy as np

    from cabslice.simulation.deviation import deviation, peaks
    from cabslice.simulation.plant import at_rest, play

    random, found = np.random.default_rng(0), []
    for _ in range(STARTS):
        start = at_rest(plant.robot, motion.poses[0])
        start[:3] += APART_MM * random.normal(size=3)
        errors = deviation(plant.robot, play(plant, command, start).poses, motion.poses)
        found.append(peaks(errors)["max_abs_error_mm"])
    return {"starts": {"count": STARTS, "apart_mm": APART_MM, "least_max_abs_error_mm": np.min(found, axis=0).tolist(),
                       "largest_max_abs_error_mm": np.max(found, axis=0).tolist()}}


def damped(robot: Robot, profile: Any, damping: str | float, pose: Array, tension: Array, line: Array) -> Plant:
    import numpy as np

    from cabslice.simulation.damping import first_mode, of_profile, of_ratio
    from cabslice.simulation.plant import Plant

    if damping == "none":
        return Plant(robot, np.zeros(robot.cables))
    count = 1.0 if robot.winders is None else robot.winders.advantage
    mode = first_mode(robot, pose, tension, line / count)
    return Plant(robot, of_profile(profile, robot, mode) if damping == "profile" else of_ratio(
        robot, mode, float(damping)))


def _tables(numbers: dict[str, Any]) -> list[Table]:
    (mm, deg), error = (numbers["max_abs_error_mm"], numbers["max_abs_error_deg"]), numbers["nozzle_error"]
    named = [*zip(AXES[0], mm, ["mm"] * 3, strict=True), *zip(AXES[1], deg, ["deg"] * 3, strict=True)]
    axes = Table(("platform", ">largest error", ""), [(name, f"{value:.6f}", unit) for name, value, unit in named])
    nozzle = Table(("nozzle", ">rms mm", ">95 % mm", ">largest mm"),
                   [("error", *(f"{error[key]:.6f}" for key in ("rms_mm", "p95_mm", "max_mm")))])
    if "starts" not in numbers:
        return [axes, nozzle]
    starts = numbers["starts"]
    span = [f"{low:.3f} to {high:.3f}" for low, high in zip(
        starts["least_max_abs_error_mm"], starts["largest_max_abs_error_mm"], strict=True)]
    words = f"{starts['count']} starts {starts['apart_mm']:g} mm apart, largest error mm"
    return [axes, nozzle, Table((words, ">from to"), list(zip(AXES[0], span, strict=True)))]
