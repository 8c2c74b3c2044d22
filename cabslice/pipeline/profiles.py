"""The profiles a job is made with, and what they say of its product: robot, period, placement, names and hashes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from cabslice.errors import ProfileError, UsageError
from cabslice.profile import shelf
from cabslice.profile.material import Material
from cabslice.profile.printer import Printer
from cabslice.profile.process import Process
from cabslice.robot.delta import Delta, Machine, machine_from_printer
from cabslice.robot.model import Robot, robot_from_printer
from cabslice.store import Laid, Origin, Product, Sliced

if TYPE_CHECKING:
    from cabslice.motors.start import Lead


@dataclass(frozen=True)
class Profiles:
    printer: Printer
    material: Material
    process: Process


class Made(Protocol):
    """A part or a product: whatever says what it is made of and with."""

    @property
    def origin(self) -> Origin: ...


def load_profiles(printer: str, material: str | None, process: str | None, sets: Sequence[str] = ()) -> Profiles:
    """Find, check and match them; the printer's defaults where material or process is None.

    Raises ProfileError, or UsageError where the printer names no default.
    """
    printer_sets, material_sets, process_sets = shelf.split_sets(sets)
    machine = shelf.load_printer(printer, printer_sets)
    material = material or machine.defaults.material
    process = process or machine.defaults.process
    if material is None or process is None:
        missing, option = ("material", "-m") if material is None else ("process", "--process")
        names = ", ".join(shelf.names("materials" if material is None else "processes"))
        raise UsageError(f"Printer {machine.name} has no default {missing}; give {option} one of: {names}.")
    return matched(
        Profiles(machine, shelf.load_material(material, material_sets), shelf.load_process(process, process_sets))
    )


def matched(profiles: Profiles) -> Profiles:
    """The same profiles, or ProfileError where they do not go together or the printer cannot print."""
    printer, process = profiles.printer, profiles.process
    shelf.require_printing(printer)
    assert printer.nozzle is not None
    if abs(printer.nozzle.diameter_mm - process.nozzle_mm) > 1e-6:
        raise ProfileError(printer.name, [
            f"nozzle.diameter_mm is {printer.nozzle.diameter_mm:g}, but process {process.name} is made for "
            f"{process.nozzle_mm:g} mm: choose another --process, or -s nozzle.diameter_mm={process.nozzle_mm:g}."
        ])
    return profiles


def profiles_of(origin: Origin) -> Profiles:
    """The profiles a product carries."""
    return Profiles(
        Printer.model_validate_json(origin.printer),
        Material.model_validate_json(origin.material),
        Process.model_validate_json(origin.process),
    )


def for_printer(product: Sliced | Laid, printer: Printer) -> Sliced | Laid:
    """The same layers or path, to be made by another printer with the same nozzle and filament."""
    old = profiles_of(product.origin)
    matched(Profiles(printer, old.material, old.process))
    assert printer.extruder is not None
    filament = printer.extruder.filament_diameter_mm
    if isinstance(product, Laid) and filament != product.toolpath.filament_diameter_mm:
        raise UsageError(
            f"The path was laid for filament of {product.toolpath.filament_diameter_mm:g} mm, {printer.name} takes "
            f"{filament:g} mm: start from the part or its .layers."
        )
    return replace(product, origin=replace(product.origin, printer=as_json(printer)))


def as_json(model: Printer | Material | Process) -> str:
    return model.model_dump_json(by_alias=True)


def period_of(product: Product) -> float:
    """Sample time of the printer's drives, s."""
    return profiles_of(product.origin).printer.stream.period_ms / 1e3


def robot_of(product: Made) -> Robot:
    """The robot of its printer; see robot_for."""
    return robot_for(profiles_of(product.origin).printer)


def robot_for(printer: Printer) -> Robot:
    """The robot as it may be used: no tension above what its motors hold. ProfileError where it has no cables."""
    from cabslice.robot.usable import usable  # here: slicing needs no compiled parts of the robot

    return usable(robot_from_printer(printer))


def machine_of(product: Made) -> Machine:
    """The machine of its printer; see machine_for."""
    return machine_for(profiles_of(product.origin).printer)


def machine_for(printer: Printer) -> Machine:
    """The robot as it may be used, or a machine of another kind, for what does not ask for cables."""
    from cabslice.robot.usable import usable

    machine = machine_from_printer(printer)
    return machine if isinstance(machine, Delta) else usable(machine)


def placement_of(origin: Origin) -> dict[str, Any]:
    place = {"unit": origin.unit, "scale": origin.scale, "turn_deg": origin.turn_deg, "at_mm": origin.at_mm}
    return place | ({"modifiers": origin.modifiers} if origin.modifiers else {})


def profile_names(origin: Origin) -> dict[str, dict[str, str]]:
    """Name and hash of each profile."""
    profiles = profiles_of(origin)
    models: dict[str, Printer | Material | Process] = {
        "printer": profiles.printer, "material": profiles.material, "process": profiles.process,
    }
    return {kind: {"name": model.name, "sha256": shelf.profile_hash(model)} for kind, model in models.items()}


def encoders(origin: Origin) -> dict[str, Any]:
    printer = profiles_of(origin).printer
    motors = [printer.delta.motor] * 3 if printer.delta else [cable.motor for cable in printer.cable]
    counts = [motor and motor.counts_per_turn for motor in motors]
    return {"encoder_counts_per_turn": counts} if all(counts) else {}


def lead_of(origin: Origin) -> Lead:
    printer = profiles_of(origin).printer
    from cabslice.motors.start import Lead

    start = printer.start
    return Lead() if printer.delta else Lead(start.tensioning_s, start.first_tension)
