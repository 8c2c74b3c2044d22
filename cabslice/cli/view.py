"""cabslice view"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Output, Placing
from cabslice.cli.report import Talk


@click.command("view")
@click.argument("file", metavar="PRODUCT")
@options.machine
@options.placing
@click.option("--verdict", metavar="JSON", help="Mark the findings in what `cabslice check --json` printed.")
@click.option("--check", "checked", is_flag=True, help="Check a path or plan first and mark what is found.")
@options.output
@options.talk
def view(
    file: str, machine: Machine, placing: Placing, verdict: str | None, checked: bool, output: Output, talk: Talk
) -> None:
    """See it: one HTML file that any browser opens, offline.

    PRODUCT is a mesh, .layers, .path, .plan, G-code, a motor file, what `check --json` printed, or what `workspace -o`
    saved (.csv, .npz). Shows the robot, the part growing, sliders for layer and time, colours by feature, speed, flow,
    tension and whatever else the product knows; the values of a move under the pointer; findings to fly to.
    """
    target, talk = options.target(output, file, {"html": ".html"}, talk)
    from cabslice.cli.shown import scene_of
    from cabslice.view.page import save_page

    with talk.progress() as tick:
        scene = scene_of(file, machine, placing, verdict, checked, tick)
    size = save_page(scene, target.path, overwrite=target.overwrite)
    numbers = {
        "bytes": size, "moves": 0 if scene.moves is None else len(scene.moves.xyz) - 1, "findings": len(scene.findings),
    }
    content = {"ok": True, "command": "view", "file": file, "kind": scene.kind, "output": target.path}
    words = f"wrote {target.path} ({size / 1e6:.1f} MB): open it in a browser"
    talk.answer(content | {"numbers": numbers}, words)
