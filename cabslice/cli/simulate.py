"""cabslice simulate"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.asked import DISTRIBUTIONS, Asked
from cabslice.cli.options import Numbers
from cabslice.cli.report import Table, Talk
from cabslice.errors import UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot
    from cabslice.simulation.motion import Motion
    from cabslice.simulation.plant import Plant

SLACK_N = 1e-6
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

    def motion(self, period_s: float) -> Motion:
        import numpy as np

        from cabslice.simulation.motion import circle

        assert self.circle is not None
        if self.time is None:
            raise UsageError("--circle needs --time, the seconds it takes.")
        return circle(self.circle, np.array([*self.centre, self.centre_z]), self.time, law=self.law,
                      period_s=period_s, backwards=self.backwards)


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
})


@click.command("simulate")
@circling
@click.option("-p", "--printer", metavar="NAME|FILE", help="Printer profile; else CABSLICE_PRINTER.")
@click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE",
              help="Change one key of the printer, checked like the file. Repeatable.")
@click.option("--no-pulleys", is_flag=True, help="Cables end at their anchor points, without pulleys or winders.")
@click.option("--damping", type=DampingChoice(), default="none", show_default=True,
              help="Of the cables: none, as the profile says, or so that the first mode has this damping ratio.")
@options.talk
def simulate(
    built_in: Circle, printer: str | None, sets: tuple[str, ...], no_pulleys: bool, damping: str | float, talk: Talk
) -> None:
    """What does the elastic robot really do? Plays a motion on it and tells how far it is from where it should be.

    Cables stretch, damp, and only pull; the platform is a rigid body that turns as it is pulled; the drives are ideal.
    It starts at rest on the first pose, with the lengths that are commanded there.
    """
    if built_in.circle is None:
        raise UsageError("What is to be played? Give --circle RADIUS_MM.")
    asked = Asked(printer, sets, no_pulleys, None, None, None, built_in.distribution, None, None, None)
    numbers = _played(asked, built_in, damping, talk)
    robot = asked.robot()
    content = {"ok": True, "command": "simulate", **asked.settings(robot), "damping": damping, "numbers": numbers}
    talk.answer(content, asked.sentence(robot), *_tables(numbers))


def _played(asked: Asked, built_in: Circle, damping: str | float, talk: Talk) -> dict[str, Any]:
    from cabslice.simulation.deviation import deviation, peaks
    from cabslice.simulation.motion import commanded, tensions
    from cabslice.simulation.plant import at_rest, play

    robot, profile = asked.robot(), asked.profile()
    motion = built_in.motion(profile.stream.period_ms * 1e-3)
    planned = tensions(robot, motion, built_in.distribution)
    command = commanded(robot, motion, planned)
    plant = _plant(robot, profile, damping, motion.poses[0], planned[0], command.rows[0, 1])
    found = play(plant, command, at_rest(robot, motion.poses[0]))
    slack = (found.tension <= SLACK_N).any(axis=1)
    if slack.any():
        talk.say(f"Cables go slack, first at {slack.argmax() * motion.period_s:.3f} s: from there on the motion is "
                 "chaotic, and the least change of anything makes another one.")
    return {
        **peaks(deviation(robot, found.poses, motion.poses)),
        "duration_s": float(motion.times[-1]), "rows": len(found), "period_s": motion.period_s,
        "integrator_steps": found.steps, "slack_fraction": float(slack.mean()),
        "least_tension_n": float(found.tension.min()), "largest_tension_n": float(found.tension.max()),
    }


def _plant(robot: Robot, profile: Any, damping: str | float, pose: Array, tension: Array, line: Array) -> Plant:
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
    return [axes, nozzle]
