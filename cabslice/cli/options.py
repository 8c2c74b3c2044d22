"""Every option, defined once. Each decorator hands its options over as one frozen value, under the decorator's name."""

from __future__ import annotations

import functools
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from cabslice.cli.report import Talk
from cabslice.errors import OutputError, UsageError

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Numbers(click.ParamType):
    """"x y z" or "x,y,z"."""

    def __init__(self, *names: str) -> None:
        self.names, self.name = names, " ".join(names)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(word) for word in str(value).replace(",", " ").split())
        except ValueError:
            numbers = ()
        if len(numbers) != len(self.names) or not all(abs(number) < 1e9 for number in numbers):
            self.fail(f"{value!r} is not {len(self.names)} numbers, expected \"{self.name}\".", param, ctx)
        return numbers


def _gather(name: str, make: Callable[..., Any], options: Mapping[str, Decorator]) -> Decorator:
    """A decorator that adds `options` and hands them over together as keyword `name`."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapper(**given: Any) -> Any:
            return function(**{name: make(**{key: given.pop(key) for key in options})}, **given)

        decorated: Callable[..., Any] = wrapper
        for option in reversed(list(options.values())):
            decorated = option(decorated)
        return decorated

    return decorate


talk = _gather("talk", Talk, {
    "json": click.option("--json", is_flag=True, help="Print one JSON object, also on failure."),
    "verbose": click.option("-v", "--verbose", is_flag=True, help="Say more."),
    "quiet": click.option("-q", "--quiet", is_flag=True, help="Say nothing but the answer."),
})


@dataclass(frozen=True)
class Machine:
    """Names as given on the command line; None where nothing was said."""

    printer: str | None
    material: str | None
    process: str | None
    sets: tuple[str, ...]

    @property
    def given(self) -> bool:
        return any((self.printer, self.material, self.process, self.sets))


class Layers(click.ParamType):
    """"12" or "12,40": numbers of layers, from 0."""

    name = "LAYER[,...]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, ...]:
        if isinstance(value, tuple):
            return value
        words = str(value).replace(",", " ").split()
        if not words or not all(word.isdecimal() for word in words):
            self.fail(f"{value!r} is no list of layers, expected their numbers from 0: \"12,40\".", param, ctx)
        return tuple(int(word) for word in words)


def _machine(
    printer: str | None, material: str | None, process: str | None, sets: tuple[str, ...],
    pause_at: tuple[int, ...], filament_change_at: tuple[int, ...],
) -> Machine:
    stops = {"pause_layers": pause_at, "filament_change_layers": filament_change_at}
    asked = tuple(f"{key}={sorted(layers)}" for key, layers in stops.items() if layers)
    return Machine(printer, material, process, (*sets, *asked))


machine = _gather("machine", _machine, {
    "printer": click.option("-p", "--printer", metavar="NAME|FILE", help="Printer profile; else CABSLICE_PRINTER."),
    "material": click.option("-m", "--material", metavar="NAME|FILE", help="Material; default: the printer's."),
    "process": click.option("--process", metavar="NAME|FILE", help="How to slice; default: the printer's."),
    "sets": click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE",
                         help="Change one key of a profile, checked like the file. Repeatable."),
    "pause_at": click.option("--pause-at", type=Layers(), default=(), help="Pause before these layers, from 0."),
    "filament_change_at": click.option("--filament-change-at", type=Layers(), default=(),
                                       help="Stop before these layers for another filament."),
})


@dataclass(frozen=True)
class Foreign:
    """How the G-code of another slicer is taken."""

    mismatch: str = "refuse"
    filament_mm: float | None = None
    origin_mm: tuple[float, float] | None = None

    @property
    def given(self) -> bool:
        return self != Foreign()

accurate = click.option(
    "--accuracy-um", type=click.FloatRange(0, 10000, min_open=True), metavar="UM",
    help="Simulate the elastic robot, and plan so slowly that its nozzle stays so near: -s motion.accuracy_um=UM.")


def with_accuracy(machine: Machine, accuracy_um: float | None) -> Machine:
    """The same with --accuracy-um as the key of the printer it stands for."""
    more = () if accuracy_um is None else (f"motion.accuracy_um={accuracy_um!r}",)
    return replace(machine, sets=(*machine.sets, *more))


@dataclass(frozen=True)
class Placing:
    unit: str
    scale: float
    turn: tuple[float, ...]
    at: tuple[float, ...] | None
    blockers: tuple[str, ...] = ()
    enforcers: tuple[str, ...] = ()
    foreign: Foreign = Foreign()
    also: tuple[str, ...] = ()
    copies: int = 1
    gap: float | None = None
    sequence: str = "layers"

    @property
    def given(self) -> bool:
        return replace(self, foreign=Foreign()) != Placing("mm", 1.0, (0.0, 0.0, 0.0), None)


_PLACE: dict[str, Decorator] = {
    "unit": click.option("--unit", type=click.Choice(["mm", "cm", "m", "inch", "ft"]), default="mm",
                         show_default=True, help="Unit of the model's numbers (3MF carries its own)."),
    "scale": click.option("--scale", type=click.FloatRange(0, min_open=True), default=1.0,
                          help="Size of the part times this."),
    "turn": click.option("--turn", type=Numbers("x", "y", "z"), default=(0.0, 0.0, 0.0),
                         help="Turn about x, then y, then z, degrees."),
    "at": click.option("--at", type=Numbers("x", "y"),
                       help="Where the part's middle stands on the bed, mm; default: the bed's middle."),
}
_SUPPORT: dict[str, Decorator] = {
    "blockers": click.option("--support-blocker", "blockers", multiple=True, metavar="MESH",
                             help="No support for overhangs inside this, drawn beside the part. Repeatable."),
    "enforcers": click.option("--support-enforcer", "enforcers", multiple=True, metavar="MESH",
                              help="Support for every overhang inside this, however steep. Repeatable."),
}
_FOREIGN: dict[str, Decorator] = {
    "mismatch": click.option("--mismatch", type=click.Choice(["refuse", "convert", "ignore"]), default="refuse",
                             show_default=True, help="G-code made for another filament or nozzle than the printer's: "
                             "refuse it, rescale E to the printer's filament, or take it as it is."),
    "gcode_filament_mm": click.option("--gcode-filament-mm", type=click.FloatRange(0.1, 20),
                                      help="Filament the G-code was made for, where it does not say."),
    "gcode_origin": click.option("--gcode-origin", type=Numbers("x", "y"),
                                 help="Middle of the bed in the G-code's coordinates; default: as the file says."),
}


def _placing(
    mismatch: str, gcode_filament_mm: float | None, gcode_origin: tuple[float, float] | None, **placed: Any
) -> Placing:
    return Placing(**placed, foreign=Foreign(mismatch, gcode_filament_mm, gcode_origin))


place_only = _gather("placing", Placing, _PLACE)
placing = _gather("placing", _placing, _PLACE | _SUPPORT | _FOREIGN)
plate = _gather("placing", _placing, {        # of commands that take one part, or several for one bed
    "also": click.argument("also", metavar="[PART...]", nargs=-1),
} | _PLACE | {
    "copies": click.option("--copies", type=click.IntRange(1, 10000), default=1, help="How many of each part."),
    "gap": click.option("--gap", type=click.FloatRange(0, 10000),
                        help="Air between several parts, mm; default: 10, more where the platform needs it."),
    "sequence": click.option("--sequence", type=click.Choice(["layers", "objects"]), default="layers",
                             show_default=True, help="Several parts layer by layer, or one after the other."),
} | _SUPPORT | _FOREIGN)


jobs = click.option("-j", "--jobs", type=click.IntRange(1, 256), default=lambda: os.cpu_count() or 1,
                    help="Cores to use; the result is the same for any number. Default: one a core.")
engine = click.option("--engine", type=click.Choice(["compiled", "toppra"]), default="compiled", show_default=True,
                      help="What finds the speed: our own recursion, or toppra as the reference.")


orientation = click.option(
    "--orientation", type=click.Choice(["profile", "free"]), default="profile", show_default=True,
    help="free: the platform is turned a little while it prints, within platform.tilt_max_deg and yaw_max_deg, where "
         "that keeps cables away from the part; else as platform.turn says, or level.")


@dataclass(frozen=True)
class Playing:
    """What of a plan is played, and how."""

    extrude: bool
    speed: float
    from_layer: int | None
    resume: bool

    def header(self) -> dict[str, Any]:
        """What is out of the ordinary."""
        found: dict[str, Any] = {} if self.extrude else {"dry_run": True}
        found |= {} if self.speed == 100 else {"speed_percent": self.speed}
        return found | ({} if self.from_layer is None else {"from_layer": self.from_layer})


playing = _gather("playing", Playing, {
    "extrude": click.option("--extrude/--no-extrude", default=True,
                            help="Dry run: move without filament, heat and fan."),
    "speed": click.option("--speed", type=click.FloatRange(1, 200), default=100.0, metavar="PERCENT",
                          help="Of the planned speed; every limit is audited anew."),
    "from_layer": click.option("--from-layer", type=click.IntRange(1), metavar="N",
                               help="Take a print up: layers below N (the first is 0) stand already."),
    "resume": click.option("--resume", is_flag=True, help="Go on with what a run that was killed has written."),
})


@dataclass(frozen=True)
class Output:
    to: str | None
    overwrite: bool
    format: str | None


output = _gather("output", Output, {
    "to": click.option("-o", "--output", "to", metavar="FILE|DIR/|-",
                       help="Default: the input's name with a new suffix, here."),
    "overwrite": click.option("--overwrite", is_flag=True, help="Replace the output if it exists."),
    "format": click.option("--format", metavar="NAME", help="Format of the output, where its suffix does not say."),
})


@dataclass(frozen=True)
class Target:
    """Where a result goes; path "-" is stdout."""

    path: str
    format: str
    overwrite: bool

    @property
    def wrote(self) -> str:
        """To be said when it is done."""
        return "" if self.path == "-" else f"wrote {self.path}"


def target(
    output: Output, source: str, formats: Sequence[str] | Mapping[str, str], talk: Talk
) -> tuple[Target, Talk]:
    """Where the result goes, and how to talk then. `formats` are names, or names and suffixes; the default first.

    Found out before any work: UsageError for an unknown format, OutputError where the result could not be written.
    """
    suffixes = formats if isinstance(formats, Mapping) else {name: f".{name}" for name in formats}
    if output.format is not None and output.format not in suffixes:
        raise UsageError(f"There is no output format {output.format!r} here; --format may be: {', '.join(suffixes)}.")
    default = output.format or next(iter(suffixes))
    if output.to == "-":
        if talk.json:
            raise UsageError("-o - and --json both want stdout: choose one.")
        return Target("-", default, True), replace(talk, aside=True)
    path = _path(output.to, Path(source).stem + suffixes[default])
    format = output.format or _format(path, suffixes)
    claim(path, output.overwrite)
    return Target(str(path), format, output.overwrite), talk


def _path(to: str | None, plain: str) -> Path:
    if to is None:
        return Path(plain)
    if to.endswith(("/", os.sep)) or Path(to).is_dir():
        return Path(to) / plain
    return Path(to)


def _format(path: Path, suffixes: Mapping[str, str]) -> str:
    """The format with the longest suffix that the path ends in."""
    fitting = [name for name, suffix in suffixes.items() if path.name.lower().endswith(suffix)]
    if fitting:
        return max(fitting, key=lambda name: len(suffixes[name]))
    known = ", ".join(suffixes.values())
    raise UsageError(f"{path.name} does not end in a suffix known here ({known}); name it so, or give --format.")


def claim(path: str | Path, overwrite: bool) -> None:
    """Refuse now what could not be written at the end. Raises OutputError."""
    path = Path(path)
    if path.is_dir():
        raise OutputError(f"{path} is a folder; end it with / to write into it.", file=str(path))
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists; give --overwrite to replace it, or another -o.", file=str(path))
    if not path.parent.is_dir():
        raise OutputError(f"There is no folder {path.parent}; make it, or give another -o.", file=str(path))
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OutputError(f"Nothing can be written into {path.parent}: {error.strerror}.", file=str(path)) from error


def claim_picture(path: str, overwrite: bool) -> None:
    """The same for a picture, which must be called one. Raises UsageError, OutputError."""
    if not path.lower().endswith(".png"):
        raise UsageError(f"--png draws a PNG; {path} does not end in .png.")
    claim(path, overwrite)
