"""From a file and the options of a command to a product with its profiles: the one way in for every command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice.cli import first_run
from cabslice.cli.options import Machine, Placing
from cabslice.cli.report import Talk
from cabslice.errors import ModelError, UsageError

if TYPE_CHECKING:
    from cabslice.pipeline import Placed
    from cabslice.store import Product


OF_GCODE = {
    "corner_mm", "pause_layers", "filament_change_layers", "reorder_islands", "reroute_travels", "max_flow_mm3_s",
    "density_g_cm3", "price_per_kg",
}


def begin(file: str, machine: Machine, placing: Placing, talk: Talk, *, planning: bool = False) -> Placed | Product:
    """Read a part or an earlier product; say on stderr which profiles are used and what was mended."""
    from cabslice import pipeline, store
    from cabslice.mesh.load import SUFFIXES

    for name in (file, *placing.also):
        if not Path(name).is_file():
            raise ModelError(f"{name}: there is no such file.", file=name)
    gcode = Path(file).suffix.lower() in pipeline.GCODE
    if placing.foreign.given and not gcode:
        raise UsageError(f"{file} is no G-code: --mismatch, --gcode-filament-mm and --gcode-origin are for G-code.")
    if Path(file).suffix.lower() not in SUFFIXES and is_motor_file(file):
        raise UsageError(f"{file} is a motor file already: cabslice convert writes it in another format.")
    if store.is_product(file) or Path(file).suffix.removeprefix(".") in store.KINDS:
        product: Any = _adapted(store.load(file)[1], file, machine, placing)
        tell_profiles(product.origin, talk)
        first_run.prepare(product.origin, talk, planning=planning)
        return product
    profiles = pipeline.load_profiles(printer_name(machine.printer), machine.material, machine.process, machine.sets)
    if gcode:
        if placing.given:
            raise UsageError(
                f"{file} is G-code: other parts, --unit, --scale, --turn, --at, --copies, --gap, --sequence and "
                "--support-... are for the part; slice it again."
            )
        _refuse_idle(file, machine)
        start: Any = pipeline.read_gcode(file, profiles, pipeline.Foreign(**vars(placing.foreign)))
    else:
        place = pipeline.Placement(
            placing.unit, placing.scale, placing.turn, placing.at,
            placing.also, placing.copies, placing.gap, placing.sequence,
        )
        start = pipeline.read(file, profiles, place, blockers=placing.blockers, enforcers=placing.enforcers)
    tell_profiles(start.origin, talk)
    first_run.prepare(start.origin, talk, planning=planning)
    for sentence in (*start.origin.repairs, *start.origin.warnings):
        talk.say(sentence if sentence.startswith(start.origin.part) else f"{start.origin.part}: {sentence}")
    return start


def _refuse_idle(file: str, machine: Machine) -> None:
    """UsageError where a setting is asked for that another slicer's G-code has settled already."""
    from cabslice.profile import shelf

    _, *settled = shelf.split_sets(machine.sets)
    idle = [one.partition("=")[0].strip() for sets in settled for one in sets]
    idle = [key for key in idle if key not in OF_GCODE]
    if idle:
        raise UsageError(
            f"{file} is G-code, which {', '.join(idle)} cannot change any more: slice the part again. "
            f"Of process and material only these count here: {', '.join(sorted(OF_GCODE))}."
        )


def is_motor_file(file: str) -> bool:
    """By its first bytes or its sidecar; the G-code of motors looks like that of a slicer."""
    from cabslice.motors.formats import format_of

    return format_of(file) is not None


def printer_name(given: str | None) -> str:
    """-p, else CABSLICE_PRINTER, else the user's choice; else UsageError that lists the printers."""
    from cabslice.profile import shelf

    name = given or shelf.default_printer()
    if not name:
        raise UsageError(f"Which printer? Give -p one of: {', '.join(shelf.names('printers'))}.")
    return name


def tell_profiles(origin: Any, talk: Talk) -> None:
    from cabslice import pipeline

    profiles = pipeline.profiles_of(origin)
    talk.say(f"printer {profiles.printer.name}, material {profiles.material.name}, process {profiles.process.name}")


def _adapted(product: Product, file: str, machine: Machine, placing: Placing) -> Product:
    """A product keeps what it was made with; only the printer may still be another one, until it is planned for."""
    from cabslice import pipeline, store
    from cabslice.profile import shelf

    if not machine.given and not placing.given:
        return product
    old = pipeline.profiles_of(product.origin)
    printer_sets, material_sets, process_sets = shelf.split_sets(machine.sets)
    fixed = [name for name, given in (
        ("placement", placing.given), ("material", material_sets or machine.material not in (None, old.material.name)),
        ("process", process_sets or machine.process not in (None, old.process.name)),
    ) if given]
    if not fixed and (machine.printer or printer_sets):
        printer = shelf.load_printer(machine.printer or old.printer.name, printer_sets)
        if printer == old.printer:
            return product
        if not isinstance(product, store.Planned):
            return pipeline.for_printer(product, printer)
        fixed = ["printer"]
    if fixed:
        raise UsageError(f"{file} has its own {' and '.join(fixed)}: to change that, start from an earlier file.")
    return product


def summary(command: str, product: Placed | Product, output: str | None = None) -> dict[str, Any]:
    """What every command's JSON begins with."""
    from cabslice import pipeline

    origin = product.origin
    content = {
        "ok": True, "command": command, "part": origin.part, "profiles": pipeline.profile_names(origin),
        "placement": pipeline.placement_of(origin), "repairs": origin.repairs, "warnings": origin.warnings,
    }
    return content | ({"output": output} if output else {})
