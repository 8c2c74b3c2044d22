"""cabslice start"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.report import Table, Talk, clock
from cabslice.errors import ModelError, UsageError

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream


@click.command("start")
@click.argument("file")
@click.option("--at", type=click.FloatRange(0), metavar="SECONDS",
              help="Where a machine that stopped then stands: motor angles, layers that are whole, what to zero again.")
@options.talk
def start(file: str, at: float | None, talk: Talk) -> None:
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
    table = Table((">winder", ">zero rad", ">at N", ">first row rad", ">at N"), rows)
    heating = ", ".join(f"{kind} {value:g}" for kind, value in heat.items()) or "nothing"
    reaction = [f"{what.replace('_', ' ')}: {text}" for what, text in header["drive_reaction"].items()]
    return [
        f"homing pose of the platform: {pose} mm, level", *steps, table, f"before the first row: {heating}",
        f"rows 0 to {told['tensioning_rows']} tension the cables ({told['tensioning_s']:g} s); at the end the platform "
        f"is {told['ends']}", *reaction,
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
