"""cabslice start"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.export import SUFFIXES
from cabslice.cli.options import Machine, Output
from cabslice.cli.report import Table, Talk, clock
from cabslice.errors import ModelError, UsageError

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream


class Start(click.Group):
    """`start FILE` is `start show FILE`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        plain = args and args[0] not in (*self.commands, "-h", "--help")
        return super().parse_args(ctx, ["show", *args] if plain else args)


@click.group("start", cls=Start)
def start() -> None:
    """How a machine is started: with a motor file (start FILE), or with motions that try it."""


@start.command("show")
@click.argument("file")
@click.option("--at", type=click.FloatRange(0), metavar="SECONDS",
              help="Where a machine that stopped then stands: motor angles, layers that are whole, what to zero again.")
@options.talk
def show(file: str, at: float | None, talk: Talk) -> None:
    """How to start a machine with the motor file FILE, and where it stands when it stops.

    Shows the homing pose, the motor angle each encoder is set to, the first row
    (the drives must stand there), what to heat, and what the drives must do when
    rows run out or a cable goes slack.
    """
    from cabslice.motors import formats

    if not Path(file).is_file():
        raise ModelError(f"{file}: there is no such file.", file=file)
    stream = formats.read(file)
    header = stream.header
    if "start" not in header:
        raise UsageError(f"{file} does not say how it begins: export it again.")
    state = stopped(stream, at) if at is not None else None
    content = {
        "ok": True, "command": "start", "file": file, "start": header["start"], "events_before": _before(header),
        "drive_reaction": header["drive_reaction"], "period_s": stream.period_s, "state": state,
    }
    talk.answer(content, *_words(header), *(_state_words(state) if state else ()))


def stopped(stream: MotorStream, at_s: float) -> dict[str, Any]:
    """Where the machine stands at a time: the row, its angles, layers, and what each kind of encoder still knows."""
    from cabslice.motors.start import after_power_loss

    header = stream.header
    row = min(round(at_s / stream.period_s), stream.rows - 1)
    angle = _angle(stream, row)
    told = header.get("layers") or {"layer": [], "z_mm": [], "whole_at_s": []}
    whole = [i for i, end in enumerate(told["whole_at_s"]) if end <= at_s]
    state: dict[str, Any] = {
        "t_s": row * stream.period_s, "row": row, "angles_rad": angle.tolist(),
        "whole_layer": told["layer"][whole[-1]] if whole else None,
        "printed_mm": told["z_mm"][whole[-1]] if whole else 0.0,
        "winders": after_power_loss(header, angle),
    }
    going_on = len(whole) < len(told["layer"])
    return state | {"from_layer": told["layer"][len(whole)] if going_on and whole else None}


def _angle(stream: MotorStream, row: int) -> Any:
    import numpy as np

    blocks = stream.later(row, np.zeros(stream.cables)) if stream.later else stream
    for block in blocks:
        if block.row + len(block) > row:
            return block.angle[row - block.row]
    raise UsageError(f"There is no row {row}.")


def _before(header: Mapping[str, Any]) -> dict[str, float]:
    """What must have happened before the first row."""
    told = header.get("events") or {"t_s": [], "kind": [], "value": []}
    rows = zip(told["t_s"], told["kind"], told["value"], strict=True)
    return {kind: value for t, kind, value in rows if t == 0 and kind in ("nozzle_c", "bed_c", "fan")}


def _words(header: Mapping[str, Any]) -> list[str | Table]:
    told, heat = header["start"], _before(header)
    pose = ", ".join(f"{x:g}" for x in told["home_pose"][:3])
    steps = [f"{i}. {step}" for i, step in enumerate(told["steps"], start=1)]
    angles = zip(told["zero_angles_rad"], told["zero_tensions_n"], told["angles_rad"], told["tensions_n"], strict=True)
    rows = [(str(i), f"{a:.6f}", f"{b:.2f}", f"{c:.6f}", f"{d:.2f}") for i, (a, b, c, d) in enumerate(angles, start=1)]
    leading = f"rows 0 to {told['tensioning_rows']} tension the cables ({told['tensioning_s']:g} s); "
    table = Table((">winder", ">zero rad", ">at N", ">first row rad", ">at N"), rows)
    heating = ", ".join(f"{kind} {value:g}" for kind, value in heat.items()) or "nothing"
    reaction = [f"{what.replace('_', ' ')}: {text}" for what, text in header["drive_reaction"].items()]
    bed = told.get("bed")
    plane = f"bed: {bed['height_mm']:g} mm at its middle (first layer offset {bed['first_layer_offset_mm']:g} mm), " \
            f"rises {bed['slope_mm_m'][0]:g} and {bed['slope_mm_m'][1]:g} mm/m towards x and y" if bed else ""
    return [
        str(header.get("about", "")), f"homing pose of the platform: {pose} mm, level", plane, *steps, table,
        f"before the first row: {heating}",
        f"{leading if told['tensioning_rows'] else ''}at the end the platform is {told['ends']}", *reaction,
    ]


def _state_words(state: dict[str, Any]) -> list[str | Table]:
    layer = "no layer is whole" if state["whole_layer"] is None else (
        f"layers up to {state['whole_layer']} are whole ({state['printed_mm']:g} mm)")
    again = "" if state["from_layer"] is None else f"; go on with --from-layer {state['from_layer']}"
    rows = [(str(w["winder"]), f"{w['angle_rad']:.6f}", str(w["turn"]), f"{w['within_turn_rad']:.6f}")
            for w in state["winders"]]
    loss = state["winders"][0]
    return [
        f"after {clock(state['t_s'])} (row {state['row']}): {layer}{again}",
        Table((">winder", ">angle rad", ">turn", ">within it rad"), rows),
        f"after a power loss: multi-turn absolute encoders: {loss['multi_turn_absolute']}; single-turn absolute: the "
        "count of turns is lost, set it to the turn above while the platform is held within half a motor turn of this "
        f"row; incremental: {loss['incremental']}",
    ]


# ---- motions that try a machine

@start.command("jog")
@click.option("--cable", type=click.IntRange(1), required=True, help="Whose motor turns, from 1.")
@click.option("--turn-deg", type=click.FloatRange(-3600, 3600), default=90.0, show_default=True,
              help="How far it turns before it comes back; above 0: winds in.")
@click.option("--seconds", type=click.FloatRange(0.5, 600), default=10.0, show_default=True, help="There and back.")
@options.machine
@options.output
@options.talk
def jog(cable: int, turn_deg: float, seconds: float, machine: Machine, output: Output, talk: Talk) -> None:
    """One motor turns to and fro: is it the right one, does it wind in, does its encoder count up?

    Unhook its cable from the platform first: no tension is kept.
    """
    def make(robot: Any, header: dict[str, Any], period_s: float, lead: Any) -> MotorStream:
        from cabslice.motors import trial

        turn = math.radians(turn_deg)
        return trial.jog(robot, header, period_s=period_s, cable=cable, turn=turn, seconds=seconds)

    _trial("jog", make, machine, output, talk)


@start.command("tension")
@click.option("--seconds", type=click.FloatRange(0.1, 3600), default=20.0, show_default=True, help="Held at the end.")
@options.machine
@options.output
@options.talk
def tension(seconds: float, machine: Machine, output: Output, talk: Talk) -> None:
    """The cables are tensioned at home and held: compare the torque of every drive with the file."""
    def make(robot: Any, header: dict[str, Any], period_s: float, lead: Any) -> MotorStream:
        from cabslice.motors import trial

        return trial.tension(robot, header, period_s=period_s, lead=lead, hold_s=seconds)

    _trial("tension", make, machine, output, talk)


@start.command("circle")
@click.option("--radius", type=click.FloatRange(1, 1e4), default=100.0, show_default=True, help="mm.")
@click.option("--speed", type=click.FloatRange(1, 1e4), default=50.0, show_default=True, help="mm/s.")
@click.option("--height", type=click.FloatRange(0, 1e4), help="Of the nozzle over the bed, mm; default: as at home.")
@options.machine
@options.output
@options.talk
def circle(
    radius: float, speed: float, height: float | None, machine: Machine, output: Output, talk: Talk
) -> None:
    """The nozzle follows a circle about the bed's middle; checked, planned and audited as a print is."""
    target, talk = options.target(output, "circle", SUFFIXES, talk)
    from cabslice import pipeline

    profiles = _profiles(machine)
    with talk.progress() as tick:
        planned, verdict = pipeline.circle(profiles, radius=radius, speed=speed, height=height, progress=tick)
        pipeline.refuse_format(target.format, planned.origin)
        stream = pipeline.to_stream(planned, verdict, period_s=pipeline.period_of(planned), more={"trial": "circle"})
        found = pipeline.save_stream(stream, target.path, target.format, overwrite=target.overwrite, progress=tick)
    _told("circle", found, target, talk)


def _trial(name: str, make: Any, machine: Machine, output: Output, talk: Talk) -> None:
    target, talk = options.target(output, name, SUFFIXES, talk)
    from cabslice import pipeline
    from cabslice.motors.formats import FORMATS

    robot, header, period_s, lead = pipeline.trial(_profiles(machine))
    FORMATS[target.format].refuse({**header, "cables": robot.cables})
    stream = make(robot, header, period_s, lead)
    _told(name, pipeline.save_stream(stream, target.path, target.format, overwrite=target.overwrite), target, talk)


def _profiles(machine: Machine) -> Any:
    from cabslice import pipeline
    from cabslice.cli.job import printer_name

    return pipeline.load_profiles(printer_name(machine.printer), machine.material, machine.process, machine.sets)


def _told(name: str, found: dict[str, Any], target: Any, talk: Talk) -> None:
    from cabslice.cli import tables
    from cabslice.motors.trial import TRIAL

    content = {"ok": True, "command": f"start {name}", "output": target.path, "numbers": found}
    talk.answer(content, TRIAL[name], tables.number_table(found), tables.cable_table(found), target.wrote,
                f"next: cabslice start {target.path}" if target.path != "-" else "")
