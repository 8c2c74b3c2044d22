"""cabslice plan"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Output, Placing
from cabslice.cli.report import Talk


@click.command("plan")
@click.argument("file", metavar="PART")
@options.machine
@options.plate
@options.engine
@options.jobs
@options.output
@options.talk
def plan(file: str, machine: Machine, placing: Placing, engine: str, jobs: int, output: Output, talk: Talk) -> None:
    """Find how fast the robot may follow the path, and audit the finished motion.

    PART is a mesh, a .layers or a .path. Writes .plan; nothing where the robot cannot make the part (exit code 4).
    """
    target, talk = options.target(output, file, ("plan",), talk)
    from cabslice import pipeline, store
    from cabslice.cli import tables
    from cabslice.cli.job import begin, summary

    product = begin(file, machine, placing, talk, planning=True)
    with talk.progress() as tick:
        planned, verdict = pipeline.to_plan(product, tick, engine=engine, jobs=jobs)
    found = pipeline.numbers_of(planned)
    store.save(planned, target.path, overwrite=target.overwrite)
    content = summary("plan", product, target.path) | {"numbers": found, "verdict": verdict.as_dict()}
    talk.answer(content, tables.number_table(found), tables.checked_lines(verdict), target.wrote)
