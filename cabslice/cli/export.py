"""cabslice export"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Output, Placing, Playing
from cabslice.cli.report import Talk
from cabslice.motors.names import NAMES

SUFFIXES = {row.name: row.suffix for row in NAMES.values()}
FORMATS = "\n\n".join(["Formats:", *(f"{row.name} ({row.suffix}): {row.about}" for row in NAMES.values())])


@click.command("export", epilog=FORMATS)
@click.argument("file", metavar="PART")
@options.machine
@options.plate
@options.engine
@options.accurate
@options.orientation
@options.jobs
@click.option("--period-ms", type=click.FloatRange(0.25, 50), help="Sample time of the drives; default: the printer's.")
@options.playing
@options.output
@options.talk
def export(
    file: str, machine: Machine, placing: Placing, engine: str, accuracy_um: float | None, orientation: str, jobs: int,
    period_ms: float | None, playing: Playing, output: Output, talk: Talk,
) -> None:
    """Write the motor file. From a part this does everything: slice, check, plan, audit.

    PART is a mesh, a .layers, a .path or a .plan. Writes .stream, or another
    format by the suffix of -o or --format; nothing where the check or the audit
    finds anything (exit code 4).
    """
    target, talk = options.target(output, file, SUFFIXES, talk)
    from cabslice import pipeline
    from cabslice.cli import tables
    from cabslice.cli.job import begin, summary

    product = begin(file, options.with_accuracy(machine, accuracy_um), placing, talk, planning=True)
    pipeline.refuse_format(target.format, product.origin)
    with talk.progress() as tick:
        planned, verdict = pipeline.to_plan(
            product, tick, engine=engine, jobs=jobs, from_layer=playing.from_layer, free=orientation == "free")
        planned, verdict = pipeline.at_speed(planned, verdict, playing.speed / 100, tick, jobs=jobs)
        period = period_ms / 1e3 if period_ms else pipeline.period_of(planned)
        stream = pipeline.to_stream(
            planned, verdict, period_s=period, extrude=playing.extrude, more=playing.header()
        )
        found = pipeline.save_stream(
            stream, target.path, target.format, overwrite=target.overwrite, progress=tick, resume=playing.resume
        )
    content = summary("export", product, target.path) | {"numbers": found, "verdict": verdict.as_dict()}
    name = pipeline.profiles_of(planned.origin).printer.name
    talk.answer(
        content, f"{name} can make {planned.origin.part}: check and audit found nothing against it.", *verdict.changed,
        "" if playing.extrude else "dry run: nothing is fed, heated or blown",
        tables.number_table(found), tables.cable_table(found), target.wrote,
        *([f"next: cabslice start {target.path}"] if target.path != "-" else []),
    )
