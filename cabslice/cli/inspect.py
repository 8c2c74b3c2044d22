"""cabslice inspect"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Placing
from cabslice.cli.report import Talk


@click.command("inspect")
@click.argument("file")
@options.place_only
@click.option("--png", metavar="PICTURE", help="Draw path, speed and tensions (.gcode .path .plan .stream .csv).")
@click.option("--overwrite", is_flag=True, help="Replace the picture if it exists.")
@options.talk
def inspect(file: str, placing: Placing, png: str | None, overwrite: bool, talk: Talk) -> None:
    """What is in FILE: a mesh, .gcode, .layers, .path, .plan, .stream or .csv.

    Shows size, layers, filament, print time, and the peaks of speed, acceleration, tension and torque of each cable.
    """
    if png:
        options.claim_picture(png, overwrite)
    from cabslice.cli import tables
    from cabslice.cli.opened import opened

    seen = opened(file, placing)
    if png:
        from cabslice.view.picture import save_picture

        save_picture(seen.curve(), png, overwrite=overwrite)
        talk.say(f"drew {png}")
    content = {"ok": True, "command": "inspect", "file": file, "kind": seen.kind, **seen.about, "numbers": seen.numbers}
    talk.answer(content, seen.title, tables.number_table(seen.numbers), tables.cable_table(seen.numbers), seen.notes)
