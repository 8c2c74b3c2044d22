"""cabslice slice"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Output, Placing
from cabslice.cli.report import Talk

FORMATS = ("path", "gcode", "layers")


@click.command("slice")
@click.argument("file", metavar="PART")
@options.machine
@options.plate
@options.jobs
@click.option("--flavor", type=click.Choice(["marlin", "klipper", "reprapfirmware"]), default="marlin",
              show_default=True, help="Firmware that G-code is written for.")
@options.output
@options.talk
def slice(
    file: str, machine: Machine, placing: Placing, jobs: int, flavor: str, output: Output, talk: Talk
) -> None:
    """Cut a part into layers and lay the path of the nozzle.

    PART is a mesh (STL, OBJ, PLY, OFF, 3MF) or a .layers file. Writes .path, which the later commands take;
    -o PART.gcode for ordinary viewers, -o PART.layers for the beads before they are put in order.
    """
    target, talk = options.target(output, file, FORMATS, talk)
    from cabslice import pipeline, store
    from cabslice.cli import tables
    from cabslice.cli.job import begin, summary
    from cabslice.view import numbers

    product = begin(file, machine, placing, talk)
    with talk.progress() as tick:
        if target.format == "layers":
            sliced = pipeline.to_layers(product, tick, jobs=jobs)
            found = numbers.of_layers(sliced.layers)
            store.save(sliced, target.path, overwrite=target.overwrite)
        else:
            laid = pipeline.to_path(product, tick, jobs=jobs)
            found = pipeline.numbers_of(laid)
            if target.format == "path":
                store.save(laid, target.path, overwrite=target.overwrite)
            else:
                pipeline.save_gcode(laid, target.path, overwrite=target.overwrite, flavor=flavor)
    content = summary("slice", product, target.path) | {"numbers": found}
    talk.answer(content, tables.number_table(found), target.wrote)
