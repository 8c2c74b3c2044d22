"""cabslice batch"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cabslice.cli import options
from cabslice.cli.export import FORMATS
from cabslice.cli.options import Placing
from cabslice.cli.report import Table, Talk, clock
from cabslice.errors import UsageError


@click.command("batch", epilog=FORMATS)
@click.argument("parts", metavar="PART...|JOBS.toml", nargs=-1, required=True)
@click.option("-p", "--printer", "printers", metavar="NAME|FILE", multiple=True,
              help="Printer profile; repeated: every part for each of them.")
@click.option("-m", "--material", metavar="NAME|FILE", help="Material; default: the printer's.")
@click.option("--process", metavar="NAME|FILE", help="How to slice; default: the printer's.")
@click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE", help="Change one key of a profile.")
@options.placing
@click.option("--period-ms", type=click.FloatRange(0.25, 50), help="Sample time of the drives; default: the printer's.")
@click.option("--format", "format_", metavar="NAME", default="stream", show_default=True, help="Of the motor files.")
@click.option("-o", "--output", "folder", metavar="DIR", default=".", help="Where everything goes; default: here.")
@options.jobs
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler instead.")
@click.option("--resume", is_flag=True, help="Go on with a batch that was stopped, or make again what has changed.")
@click.option("--overwrite", is_flag=True, help="Replace what is there.")
@options.talk
def batch(
    parts: tuple[str, ...], printers: tuple[str, ...], material: str | None, process: str | None,
    sets: tuple[str, ...], placing: Placing, period_ms: float | None, format_: str, folder: str, jobs: int,
    scheduler: str | None, resume: bool, overwrite: bool, talk: Talk,
) -> None:
    """Make the motor files of many parts, for one printer or several.

    Writes them, manifest.json and manifest.csv into -o DIR. A part that cannot be
    made does not stop the others. Exit code 0: all were made; else the worst of
    5 (unwritten), 4 (impossible), 3 (wrong input).
    """
    from cabslice.batch import jobs as asked
    from cabslice.batch import run
    from cabslice.motors.names import name_for

    name_for("", format_)
    row = asked.Row.model_validate({
        "printers": printers, "material": material, "process": process, "set": sets, "unit": placing.unit,
        "scale": placing.scale, "turn_deg": placing.turn, "at_mm": placing.at, "format": format_,
        "period_ms": period_ms,
    })
    wanted = _of_file(parts, row) if any(part.endswith(".toml") for part in parts) else asked.of_parts(parts, row)
    with talk.progress() as tick:
        def tell(record: Mapping[str, Any], trace: str, done: int, total: int) -> None:
            tick("batch", done, total)
            talk.detail(f"{done} of {total}  {record['name']}: {record['verdict']}")
            if trace:
                talk.say(trace)

        try:
            told = run.run(
                wanted, folder, processes=jobs, scheduler=scheduler, resume=resume, overwrite=overwrite, tell=tell
            )
        except KeyboardInterrupt:
            talk.say("What is made is kept: go on with --resume.")
            raise
    code = run.exit_code(told)
    content = {"ok": code == 0, "command": "batch", "exit_code": code, "output": str(Path(folder) / "manifest.json")}
    talk.answer(content | told, _table(told), _sum(told), f"wrote {Path(folder) / 'manifest.json'}")
    if code:
        sys.stdout.flush()
        raise click.exceptions.Exit(code)


def _of_file(parts: tuple[str, ...], row: Any) -> Any:
    from cabslice.batch import jobs as asked

    if len(parts) > 1 or row != asked.Row():
        raise UsageError("A jobs.toml says everything itself: give it alone, with -o, -j, --scheduler at most.")
    return asked.of_file(Path(parts[0]))


def _table(told: Mapping[str, Any]) -> Table:
    rows = [_row(record) for record in told["jobs"]]
    return Table(("job", "printer", "verdict", ">time", ">filament m", "why not"), rows)


def _row(record: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = record.get("numbers", {})
    time = clock(numbers["duration_s"]) if "duration_s" in numbers else ""
    filament = f"{numbers['filament_mm'] / 1e3:.3f}" if "filament_mm" in numbers else ""
    findings = record.get("findings") or [record]
    why = "" if record["verdict"] == "made" else str(findings[0]["sentence"]).splitlines()[0]
    return record["name"], record["printer"], record["verdict"], time, filament, why


def _sum(told: Mapping[str, Any]) -> str:
    counts = ", ".join(f"{count} {verdict}" for verdict, count in told["counts"].items())
    totals = told["totals"]
    return f"{counts}; print time {clock(totals['duration_s'])}, filament {totals['filament_mm'] / 1e3:.3f} m"
