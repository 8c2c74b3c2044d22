"""The command line: finds the command, runs it, and turns whatever goes wrong into one sentence and an exit code."""

from __future__ import annotations

import difflib
import errno
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import click

from cabslice import __version__, errors
from cabslice.cli import interrupt
from cabslice.cli.report import print_json

GARBAGE = 100_000   # objects made before Python looks for circles among them: there are few, and looking takes time
COMMANDS = {
    "Make": {
        "slice": "cut a part into layers and lay the path of the nozzle",
        "plan": "find how fast the robot may follow the path",
        "export": "write the motor file (from a part: does everything before it)",
        "batch": "motor files of many parts for one printer or several, with one manifest",
        "convert": "write a motor file in another format",
    },
    "Ask": {
        "check": "can this robot make this part? exit code 0 yes, 4 no",
        "start": "how to start a machine with a motor file, and where it stands when it stops",
        "inspect": "what is in a part, a product or a motor file; --png draws it",
        "view": "see it in the browser: robot, part, layers, speeds, tensions, findings",
        "report": "a print in figures, as a page to read or to print",
        "workspace": "where can the platform be, and where can it print?",
        "stiffness": "how stiffly do the cables hold the platform?",
        "optimize": "where a part stands best on the bed, and how large it may be",
        "simulate": "what will the elastic robot really do? errors of a motion, and their causes",
    },
    "Set up": {
        "profile": "printers, materials and processes: list, show, check, new, keys, use, ...",
    },
}

MODULES = {"report": "print_report"}      # cli.report is what is said and where

FIRST_PAGE = f"""cabslice {__version__}: from an STL to the motor angles of a cable printer.

  cabslice export PART.stl -p PRINTER    slice, check, plan, audit, and write the motor file
  cabslice check PART.stl -p PRINTER     can this robot make this part?
  cabslice inspect FILE                  what is in a part, a product or a motor file
  cabslice view FILE                     see it in the browser, moving
  cabslice profile list                  the printers, materials and processes there are

cabslice --help lists every command, cabslice COMMAND --help its options."""

UNWRITTEN = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO}
REPORT = f"This is a bug in cabslice {__version__}. Please report it with the lines above and the command you gave."


class Commands(click.Group):
    """Commands by name, each imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [name for section in COMMANDS.values() for name in section]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.list_commands(ctx):
            return None
        return getattr(importlib.import_module(f"cabslice.cli.{MODULES.get(cmd_name, cmd_name)}"), cmd_name)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            near = difflib.get_close_matches(name, self.list_commands(ctx), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise click.UsageError(f"There is no command {name!r}.{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for section, commands in COMMANDS.items():
            with formatter.section(section):
                formatter.write_dl(list(commands.items()))


@click.group(cls=Commands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="cabslice")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """From an STL to the motor angles of a cable printer.

    stdout is the answer, stderr is the talk. Exit codes: 0 done, 2 wrong command line, 3 an input file is wrong,
    4 the robot cannot make this part as asked, 5 the result could not be written, 130 interrupted, 1 a bug.
    """
    if ctx.invoked_subcommand is None:
        click.echo(FIRST_PAGE)


def run() -> None:
    gc.set_threshold(GARBAGE, 20, 20)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")   # matrices are small: other threads would only wait for work
    try:
        code = main(sys.argv[1:])
    except KeyboardInterrupt:      # a second one, while the end of the first was being told
        code = errors.EXIT_INTERRUPTED
    gc.disable()   # all goes with the process
    sys.exit(code)


def main(arguments: Sequence[str]) -> int:
    """Run one command line; the exit code."""
    interrupt.watch()
    try:
        with cli.make_context("cabslice", list(arguments)) as context:
            cli.invoke(context)
            sys.stdout.flush()
        return errors.EXIT_OK
    except click.exceptions.Exit as ended:
        return _flushed(ended.exit_code)
    except BrokenPipeError:
        return _closed_pipe()
    except BaseException as error:
        if getattr(error, "details", {}).get("quiet"):
            return _closed_pipe()
        code, words = _explained(error)
        try:
            _tell(error, code, words, as_json="--json" in arguments)
            return code
        except BrokenPipeError:
            return _closed_pipe()
        except OSError as full:      # stdout itself cannot be written
            print(f"The answer could not be written: {full.strerror}.", file=sys.stderr)
            return _closed_pipe()


def _flushed(code: int) -> int:
    try:
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        return _closed_pipe()


def _closed_pipe() -> int:
    """Whoever read us has gone: say nothing, and let nothing be said when Python flushes at its end."""
    for stream in (sys.stdout, sys.stderr):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return errors.EXIT_OUTPUT


def _explained(error: BaseException) -> tuple[int, str]:
    """Exit code and sentence of anything that can be raised."""
    if isinstance(error, (KeyboardInterrupt, click.Abort)) or interrupt.asked():
        return errors.EXIT_INTERRUPTED, "Interrupted; nothing half-written is left."
    if isinstance(error, errors.CabsliceError):
        return error.exit_code, error.sentence
    if isinstance(error, click.UsageError):
        usage = f"{error.ctx.get_usage()}\n" if error.ctx else ""
        return errors.EXIT_USAGE, usage + error.format_message()
    if isinstance(error, click.ClickException):
        return errors.EXIT_USAGE, error.format_message()
    if isinstance(error, OSError) and error.errno in UNWRITTEN:
        return errors.EXIT_OUTPUT, f"The result could not be written: {error.strerror}."
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else errors.EXIT_BUG, str(error.code)
    return errors.EXIT_BUG, f"{type(error).__name__}: {error}"


def _tell(error: BaseException, code: int, words: str, *, as_json: bool) -> None:
    findings = [finding.as_dict() for finding in getattr(error, "findings", ())]
    if code == errors.EXIT_BUG:
        traceback.print_exception(error, file=sys.stderr)
        print(REPORT, file=sys.stderr)
    if as_json:
        content: dict[str, Any] = {"exit_code": code, "kind": type(error).__name__, "sentence": words}
        details = {key: value for key, value in getattr(error, "details", {}).items() if key not in content}
        print_json({"ok": False, "error": content | details | ({"findings": findings} if findings else {})})
    elif code != errors.EXIT_BUG:
        print(words, *_reasons(findings), sep="\n", file=sys.stderr)


def _reasons(findings: Sequence[dict[str, Any]], most: int = 8) -> list[str]:
    lines = [f"  {finding['sentence']} {finding['help']}".rstrip() for finding in findings[:most]]
    return lines + ([f"  ... and {len(findings) - most} more (--json lists them all)"] if len(findings) > most else [])
