"""cabslice convert"""

from __future__ import annotations

from pathlib import Path

import click

from cabslice.cli import options
from cabslice.cli.export import FORMATS, SUFFIXES
from cabslice.cli.options import Output
from cabslice.cli.report import Talk
from cabslice.errors import ModelError, UsageError


@click.command("convert", epilog=FORMATS)
@click.argument("file", metavar="IN")
@click.argument("out", metavar="OUT")
@click.option("--format", "format_", metavar="NAME", help="Format of OUT, where its suffix does not say.")
@click.option("--overwrite", is_flag=True, help="Replace OUT if it exists.")
@click.option("--resume", is_flag=True, help="Go on with what a run that was killed has written.")
@options.talk
def convert(file: str, out: str, format_: str | None, overwrite: bool, resume: bool, talk: Talk) -> None:
    """Write the motor file IN in another format.

    The rows stay as IN has them: what a quantised format has rounded stays
    rounded. OUT's header names the formats it came through.
    """
    target, talk = options.target(Output(out, overwrite, format_), file, SUFFIXES, talk)
    from cabslice import pipeline
    from cabslice.cli import tables
    from cabslice.motors.formats import format_of

    if not Path(file).is_file():
        raise ModelError(f"{file}: there is no such file.", file=file)
    source = format_of(file)
    if source is None:
        raise UsageError(f"{file} is not a motor file: write one with cabslice export.")
    if target.path != "-" and Path(target.path).resolve() == Path(file).resolve():
        raise UsageError(f"{file} cannot be converted onto itself: give another OUT.")
    stream = pipeline.converted(source.read(file), source.name)
    with talk.progress() as tick:
        found = pipeline.save_stream(
            stream, target.path, target.format, overwrite=target.overwrite, progress=tick, resume=resume
        )
    content = {"ok": True, "command": "convert", "file": file, "kind": source.name, "output": target.path,
               "format": target.format, "numbers": found}
    talk.answer(content, tables.number_table(found), tables.cable_table(found), target.wrote)
