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
@options.accurate
@options.orientation
@options.jobs
@options.output
@click.option("--compare", is_flag=True, help="Beside it the time at one acceleration that is safe everywhere.")
@options.talk
def plan(
    file: str, machine: Machine, placing: Placing, engine: str, accuracy_um: float | None, orientation: str, jobs: int,
    output: Output, compare: bool, talk: Talk,
) -> None:
    """Find how fast the robot may follow the path, and audit the finished motion.

    PART is a mesh, a .layers or a .path. Writes .plan; nothing where the robot cannot make the part (exit code 4).
    Tells which limits the print time is spent at: what would make it faster.
    """
    target, talk = options.target(output, file, ("plan",), talk)
    from cabslice import pipeline, store
    from cabslice.cli import tables
    from cabslice.cli.job import begin, summary

    product = begin(file, options.with_accuracy(machine, accuracy_um), placing, talk, planning=True)
    with talk.progress() as tick:
        planned, verdict = pipeline.to_plan(product, tick, engine=engine, jobs=jobs, free=orientation == "free")
    found = pipeline.numbers_of(planned)
    found["time_share_by_limit"] = pipeline.active_limits(planned)
    rows = pipeline.compared(planned, jobs=jobs) if compare else []
    store.save(planned, target.path, overwrite=target.overwrite)
    content = summary("plan", product, target.path) | {"numbers": found, "verdict": verdict.as_dict()}
    content |= {"compared": rows} if compare else {}
    talk.answer(content, tables.number_table(found), tables.share_table("time by limit", found["time_share_by_limit"]),
                tables.feature_table(found["duration_s_by_feature"]), *map(tables.compared_line, rows),
                tables.checked_lines(verdict), target.wrote)
