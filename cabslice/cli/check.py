"""cabslice check"""

from __future__ import annotations

from typing import Any

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Placing
from cabslice.cli.report import Talk
from cabslice.errors import EXIT_IMPOSSIBLE


@click.command("check")
@click.argument("file", metavar="PART")
@options.machine
@options.plate
@options.orientation
@options.jobs
@click.option("--try/--no-try", "try_", default=True, help="Where it cannot: try what would help, or only say why not.")
@options.talk
def check(file: str, machine: Machine, placing: Placing, orientation: str, jobs: int, try_: bool, talk: Talk) -> None:
    """Can this robot make this part? Exit code 0 yes, 4 no.

    PART is a mesh, a .layers, a .path or a .plan (of a plan the finished motion is audited as well). Prints every
    finding, and what was checked: no findings mean no more than that. Where a mesh cannot be made it tries what would
    help: a turn, a shift, another size, a height to split at, another printer.
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
            verdict = pipeline.check(ready, tick, jobs=jobs, free=orientation == "free")
    name = pipeline.profiles_of(product.origin).printer.name
    sentence = f"{name} {'can' if verdict.ok else 'cannot'} make {product.origin.part} as asked."
    content = summary("check", product) | {"ok": verdict.ok, "sentence": sentence, "verdict": verdict.as_dict()}
    if not verdict.ok:
        content["error"] = {"exit_code": EXIT_IMPOSSIBLE, "kind": "ImpossibleError", "sentence": sentence}
    reasons = [f"{finding.sentence} {finding.help}".rstrip() for finding in verdict.findings]
    answer = "\n".join([sentence, *reasons])
    ways = _tried(product, verdict, talk) if try_ and not verdict.ok else []
    if ways:
        content["tried"] = [way.as_dict() for way in ways]
    talk.answer(content, answer, tables.finding_table(verdict.findings), _ways(ways), tables.checked_lines(verdict))
    if not verdict.ok:
        raise click.exceptions.Exit(EXIT_IMPOSSIBLE)


def _tried(product: Any, verdict: Any, talk: Talk) -> list[Any]:
    """What would help a part; of a path or G-code, or without cables, nothing is tried."""
    from cabslice.pipeline import Placed, profiles_of

    if not isinstance(product, Placed) or profiles_of(product.origin).printer.kind != "cable":
        return []
    from cabslice import advice

    talk.say("trying what would help")
    with talk.progress() as tick:
        return list(advice.help_for(product, verdict, tick))


def _ways(ways: list[Any]) -> str:
    if not ways:
        return ""
    return "\n".join(["what would help, tried with the walls of the part:", *(f"  {way.sentence}" for way in ways)])
