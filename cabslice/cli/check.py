"""cabslice check"""

from __future__ import annotations

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Placing
from cabslice.cli.report import Talk
from cabslice.errors import EXIT_IMPOSSIBLE


@click.command("check")
@click.argument("file", metavar="PART")
@options.machine
@options.placing
@options.jobs
@options.talk
def check(file: str, machine: Machine, placing: Placing, jobs: int, talk: Talk) -> None:
    """Can this robot make this part? Exit code 0 yes, 4 no.

    PART is a mesh, a .layers, a .path or a .plan (of a plan the finished motion is audited as well). Prints every
    finding, and what was checked: no findings mean no more than that.
    """
    from cabslice import pipeline
    from cabslice.cli import tables
    from cabslice.cli.job import begin, summary
    from cabslice.store import Planned

    product = begin(file, machine, placing, talk)
    verdict = pipeline.check_box(product)
    if verdict is None or verdict.ok:
        with talk.progress() as tick:
            ready = product if isinstance(product, Planned) else pipeline.to_path(product, tick, jobs=jobs)
            verdict = pipeline.check(ready, tick, jobs=jobs)
    name = pipeline.profiles_of(product.origin).printer.name
    sentence = f"{name} {'can' if verdict.ok else 'cannot'} make {product.origin.part} as asked."
    content = summary("check", product) | {"ok": verdict.ok, "sentence": sentence, "verdict": verdict.as_dict()}
    if not verdict.ok:
        content["error"] = {"exit_code": EXIT_IMPOSSIBLE, "kind": "ImpossibleError", "sentence": sentence}
    reasons = [f"{finding.sentence} {finding.help}".rstrip() for finding in verdict.findings]
    answer = "\n".join([sentence, *reasons])
    talk.answer(content, answer, tables.finding_table(verdict.findings), tables.checked_lines(verdict))
    if not verdict.ok:
        raise click.exceptions.Exit(EXIT_IMPOSSIBLE)
