"""The stages in order: part, layers, path, plan, motor file. Each takes the product before it, or any earlier one.

    read        a mesh file                      -> Placed
    read_gcode  another slicer's work            -> Laid
    to_layers   Placed                           -> Sliced    .layers
    to_path     Placed or Sliced                 -> Laid      .path
    to_plan     Placed, Sliced or Laid           -> Planned   .plan     and the Verdict that let it through
    to_stream   Planned, with its Verdict        -> MotorStream

A product carries its profiles, so a stage needs nothing but the product. A path is planned only where `check` found
nothing, and a stream is made only where the audit of the finished motion found nothing either.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.errors import ImpossibleError, ModelError, ProfileError, UsageError
from cabslice.feasibility.findings import Verdict
from cabslice.files import STDOUT, atomic
from cabslice.mesh.part import Part
from cabslice.profile import shelf
from cabslice.profile.material import Material
from cabslice.profile.printer import Printer
from cabslice.profile.process import Process
from cabslice.robot.model import Robot, robot_from_printer
from cabslice.robot.usable import usable
from cabslice.slicing.layer import Layer, Role
from cabslice.slicing.sections import NO_MODIFIERS, Modifiers
from cabslice.store import Laid, Origin, Planned, Product, Sliced
from cabslice.toolpath.path import Toolpath
from cabslice.toolpath.summary import summary
from cabslice.view import numbers

if TYPE_CHECKING:
    from cabslice.motors.start import Lead
    from cabslice.motors.stream import MotorStream

THUMBNAIL = 160, 120                          # pixels of the picture in a motor file
GCODE = (".gcode", ".gco", ".g")
Progress = Callable[[str, int, int], None]   # stage, done, total


def silent(stage: str, done: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Profiles:
    printer: Printer
    material: Material
    process: Process


@dataclass(frozen=True)
class Placement:
    unit: str = "mm"
    scale: float = 1.0
    turn_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    at_mm: tuple[float, ...] | None = None
    also: tuple[str, ...] = ()        # files of other parts on the same bed
    copies: int = 1
    gap_mm: float | None = None       # air between them; None: 10, or what the platform needs
    sequence: str = "layers"          # "objects": one part after the other


@dataclass(frozen=True)
class Foreign:
    """How another slicer's G-code is taken: what does not fit, the filament it is for, the middle of its bed."""

    mismatch: str = "refuse"                        # or "convert", "ignore": see toolpath.gcode_fit
    filament_mm: float | None = None
    origin_mm: tuple[float, float] | None = None


@dataclass(frozen=True)
class Placed:
    """A part on the bed and what it will be made with: the start of the chain, not stored.

    parts: where not empty, what `part` is made of, to be made one after the other.
    """

    origin: Origin
    part: Part
    modifiers: Modifiers = NO_MODIFIERS
    parts: tuple[Part, ...] = ()


# ---- profiles

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
    return replace(product, origin=replace(product.origin, printer=_json(printer)))


def _json(model: Printer | Material | Process) -> str:
    return model.model_dump_json(by_alias=True)


# ---- stages

def read(
    path: str | Path, profiles: Profiles, placement: Placement, *,
    blockers: Sequence[str] = (), enforcers: Sequence[str] = (),
) -> Placed:
    """A mesh file, mended and placed on the bed, and meshes that say where it gets support. Raises ModelError."""
    from cabslice.mesh.load import load_mesh
    from cabslice.mesh.place import place_with

    if (blockers or enforcers) and profiles.process.support.kind == "none":
        raise UsageError("--support-blocker and --support-enforcer are for a part with support: -s support.kind=...")
    if placement.also or placement.copies > 1:
        if blockers or enforcers:
            raise UsageError("--support-blocker and --support-enforcer are for a single part.")
        if profiles.process.spiral:
            raise UsageError("A spiral (spiral=true) is one bead without end: it is for a single part.")
        return _plate((path, *placement.also), profiles, placement)
    paths = (path, *blockers, *enforcers)
    part, *others = (load_mesh(one, unit=placement.unit, scale=placement.scale) for one in paths)
    kinds = ["support blocker"] * len(blockers) + ["support enforcer"] * len(enforcers)
    origin = Origin(
        part.name, part.sha256, part.repairs, part.warnings,
        placement.unit, float(placement.scale), tuple(placement.turn_deg), placement.at_mm,
        _json(profiles.printer), _json(profiles.material), _json(profiles.process),
        tuple(f"{kind} {one.name} sha256:{one.sha256}" for kind, one in zip(kinds, others, strict=True)),
    )
    part, *others = place_with(part, others, turn_deg=placement.turn_deg, at_mm=placement.at_mm)
    return Placed(origin, part, Modifiers(others[:len(blockers)], others[len(blockers):]))


GAP_MM, NOZZLE_MM = 10.0, 2.0     # between parts; between the platform and a part beside it


def _plate(paths: Sequence[str | Path], profiles: Profiles, placement: Placement) -> Placed:
    """Several parts side by side. Raises ImpossibleError where they stand too close to be made one after the other."""
    from cabslice.mesh.arrange import arrange, united
    from cabslice.mesh.load import load_mesh
    from cabslice.mesh.place import place

    loaded = [load_mesh(path, unit=placement.unit, scale=placement.scale) for path in paths]
    parts = [place(one, turn_deg=placement.turn_deg) for one in loaded for _ in range(placement.copies)]
    in_turn = placement.sequence == "objects"
    needed = _clear_of_platform(parts, profiles) if in_turn else 0.0
    gap = max(GAP_MM, needed) if placement.gap_mm is None else placement.gap_mm
    if gap < needed:
        raise ImpossibleError(
            f"Parts made one after the other need {needed:.1f} mm between them: the platform, and what is laid around "
            f"each part, would meet the finished ones at --gap {gap:g}. Give more, or --sequence layers.",
            gap_mm=gap, needed_mm=needed,
        )
    bed = profiles.printer.bed.size_mm if profiles.printer.bed else None
    parts = arrange(parts, gap, np.array(bed) if bed else None, placement.at_mm or (0, 0))
    whole = united(parts)
    stood = tuple(
        f"part {one.name} sha256:{one.sha256} in x {low[0]:.3f} to {high[0]:.3f}, y {low[1]:.3f} to {high[1]:.3f} mm"
        for one in parts for low, high in [one.bounds]
    )
    origin = Origin(
        whole.name, whole.sha256, whole.repairs, whole.warnings,
        placement.unit, float(placement.scale), tuple(placement.turn_deg), placement.at_mm,
        _json(profiles.printer), _json(profiles.material), _json(profiles.process), stood,
    )
    return Placed(origin, whole, NO_MODIFIERS, tuple(parts) if in_turn else ())


def _clear_of_platform(parts: Sequence[Part], profiles: Profiles) -> float:
    """mm between parts made one after the other: room for skirt and brim; for the platform where it hangs as low."""
    robot, process = robot_from_printer(profiles.printer), profiles.process
    around = process.brim.width_mm + process.raft.margin_mm * (process.raft.layers > 0)
    if process.skirt_loops:
        around = max(around, process.skirt_gap_mm + process.skirt_loops * process.first_bead_mm)
    assert robot.nozzle is not None
    hanging = robot.attachments - robot.nozzle
    tallest = sorted(float(part.vertices[:, 2].max()) for part in parts)[-2:][0]    # the tallest may come last
    low = hanging[hanging[:, 2] < tallest + NOZZLE_MM]
    radius = float(np.hypot(low[:, 0], low[:, 1]).max()) if len(low) else 0.0
    return 2 * around + NOZZLE_MM if not radius else max(2 * around, around + radius) + NOZZLE_MM


def read_gcode(path: str | Path, profiles: Profiles, foreign: Foreign | None = None) -> Laid:
    """The path in another slicer's G-code, with the profiles it will be made with. Raises GcodeError."""
    from cabslice.toolpath.events import with_stops
    from cabslice.toolpath.gcode_fit import fitted
    from cabslice.toolpath.gcode_read import read_gcode as read_file

    foreign = foreign or Foreign()
    assert profiles.printer.extruder is not None
    assert profiles.printer.nozzle is not None
    filament, nozzle = profiles.printer.extruder.filament_diameter_mm, profiles.printer.nozzle.diameter_mm
    reading = read_file(
        Path(path), origin=foreign.origin_mm, filament_diameter_mm=foreign.filament_mm, usual_filament_mm=filament
    )
    reading = fitted(
        reading, filament_mm=filament, nozzle_mm=nozzle, mismatch=foreign.mismatch, name=Path(path).name
    )
    origin = Origin(
        Path(path).name, hashlib.sha256(Path(path).read_bytes()).hexdigest(), (), reading.warnings,
        "mm", 1.0, (0.0, 0.0, 0.0), None, _json(profiles.printer), _json(profiles.material), _json(profiles.process),
    )
    return Laid(origin, with_stops(reading.toolpath, profiles.process))


def to_layers(product: Placed | Product, progress: Progress = silent, *, jobs: int = 1) -> Sliced:
    if isinstance(product, Placed):
        return Sliced(product.origin, tuple(_cut(product, progress, jobs)))
    return _only(product, Sliced, "layers")


def to_path(product: Placed | Product, progress: Progress = silent, *, jobs: int = 1) -> Laid:
    if not isinstance(product, (Placed, Sliced)):
        return _only(product, Laid, "path")
    profiles = profiles_of(product.origin)
    assert profiles.printer.extruder
    layers: Iterable[Layer] = product.layers if isinstance(product, Sliced) else _cut(product, progress, jobs)
    from cabslice.toolpath.order import lay_toolpath  # here: its compiled parts load while other processes slice

    toolpath = lay_toolpath(
        layers, profiles.process, profiles.material,
        filament_diameter_mm=profiles.printer.extruder.filament_diameter_mm,
        source=f"{product.origin.part} sha256:{product.origin.sha256}",
    )
    if not np.isin(toolpath.role, (Role.TRAVEL, Role.SKIRT), invert=True).any():
        raise ModelError(
            f"{product.origin.part}: no layer of it has room for a bead {profiles.process.outer_bead_mm:g} mm wide; "
            "is the unit right? See --unit and --scale.", file=product.origin.part,
        )
    return Laid(product.origin, toolpath)


def check(product: Laid | Planned, progress: Progress = silent, *, jobs: int = 1) -> Verdict:
    """Can this robot follow this path, from home and back? Of a plan also: does the motion keep every limit?"""
    verdict = check_path(product, progress)
    return verdict.joined(audited(product, progress, jobs=jobs)) if isinstance(product, Planned) else verdict


def check_path(
    product: Laid | Planned, progress: Progress = silent, *, far: float | None = None, bare: bool = False
) -> Verdict:
    """The margin of cables to the part is looked for up to `far` mm, where that is given. `bare`: nothing is laid."""
    from cabslice.feasibility.check import check
    from cabslice.toolpath.checks import check_toolpath

    check_toolpath(product.toolpath)
    robot, corner = robot_of(product), profiles_of(product.origin).process.corner_mm
    # the motion may leave the path by the corner tolerance, and takes the ends of the cables with it
    robot = replace(robot, clearance=robot.clearance + corner)
    whole = product if isinstance(product, Planned) else with_ends(product)
    more = {} if far is None else {"far": far}
    return check(whole.toolpath, robot, progress=partial(progress, "check"), bare=bare, **more)


def with_ends(product: Laid) -> Laid:
    """The path with the way from home before it and the way home after it, where it has none yet."""
    from cabslice.motors import approach

    start = profiles_of(product.origin).printer.start
    return Laid(product.origin, approach.with_ends(product.toolpath, robot_of(product), start))


def taken_up(product: Laid | Planned, layer: int) -> tuple[Laid, Laid]:
    """The path from `layer` on, and what has to be checked for it: the same with what stands already. UsageError."""
    from cabslice.motors import approach

    start = profiles_of(product.origin).printer.start
    moved, whole = approach.resumed(product.toolpath, robot_of(product), start, layer)
    return Laid(product.origin, moved), Laid(product.origin, whole)


def check_box(product: Placed | Product) -> Verdict | None:
    """What can be said of a part before it is sliced; None of a product, which is."""
    from cabslice.feasibility.fits import fits

    return fits(product.part.bounds, robot_of(product)) if isinstance(product, Placed) else None


def to_plan(
    product: Placed | Product, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1,
    from_layer: int | None = None,
) -> tuple[Planned, Verdict]:
    """The audited motion. Raises ImpossibleError with the findings where the robot cannot make it.

    With `from_layer` only what is from that layer on, with what is below it on the bed.
    """
    if isinstance(product, Planned) and from_layer is None:
        return product, _passed(check(product, progress, jobs=jobs))
    box = check_box(product)
    if box is not None:
        _passed(box)
    if isinstance(product, Planned):
        laid = Laid(product.origin, product.toolpath)
    else:
        laid = to_path(product, progress, jobs=jobs)
    laid, shown = (laid, laid) if from_layer is None else taken_up(laid, from_layer)
    verdict = _passed(check_path(shown, progress))
    plan, proof = proven(laid, progress, engine=engine, jobs=jobs)
    return plan, verdict.joined(_passed(proof))


def proven(
    laid: Laid, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1
) -> tuple[Planned, Verdict]:
    """The motion with the audit that it passes, slowed where the audit asked for it, or fails."""
    from cabslice.simulation.accuracy import window_s
    from cabslice.timing.proof import plan_proven

    laid = with_ends(laid)
    path, robot, printer, *others = _given(laid)
    assert printer.motion is not None
    plain = printer.motion

    def make(limit: float | None) -> tuple[Any, Verdict]:
        motion = plain if limit is None else plain.model_copy(
            update={"max_acceleration_mm_s2": limit, "smoothing_ms": 1e3 * window_s(robot, plain.smoothing_ms / 1e3)})
        return plan_proven(
            path, robot, printer.model_copy(update={"motion": motion}), *others, engine=engine, jobs=jobs,
            planning=partial(progress, "plan"), auditing=partial(progress, "audit"),
        )

    trajectory, verdict = make(None) if plain.accuracy_um is None else _accurate(laid, make, progress)
    return Planned(laid.origin, laid.toolpath, trajectory), verdict


def _accurate(laid: Laid, make: Callable[[float | None], Any], progress: Progress) -> tuple[Any, Verdict]:
    """The motion that keeps motion.accuracy_um in simulation."""
    from cabslice.simulation import accuracy

    printer, robot, period = profiles_of(laid.origin).printer, robot_of(laid), period_of(laid)
    assert printer.motion is not None
    asked = (printer.motion.accuracy_um or 0.0) / 1e3

    def judged(trajectory: Any) -> Any:
        stream = stream_of(Planned(laid.origin, laid.toolpath, trajectory), {}, period)
        given = accuracy.cases(stream, robot, printer, asked)
        return accuracy.judge(stream, robot, given, laid.toolpath.layer, partial(progress, "simulate"))

    return accuracy.within(make, judged, printer.motion.max_acceleration_mm_s2, laid.toolpath.layer)


def planned(laid: Laid, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1) -> Planned:
    """The motion alone, neither checked nor audited."""
    from cabslice.timing.retime import plan

    laid, tick = with_ends(laid), partial(progress, "plan")
    return Planned(laid.origin, laid.toolpath, plan(*_given(laid), engine=engine, jobs=jobs, progress=tick))


def audited(plan: Planned, progress: Progress = silent, *, jobs: int = 1) -> Verdict:
    """The audit of the finished motion alone."""
    from cabslice.timing.audit import audit

    return audit(plan.trajectory, *_given(plan), jobs=jobs, progress=partial(progress, "audit"))


def active_limits(plan: Planned) -> dict[str, float]:
    """Limit -> share of the print time in which it is the active one."""
    from cabslice.timing.explain import time_by_limit

    return time_by_limit(plan.trajectory, *_given(plan))


def compared(plan: Planned, *, jobs: int = 1) -> list[dict[str, Any]]:
    """What printer firmware would do with one acceleration that is safe everywhere: time, and the limits it breaks."""
    from cabslice.timing import baseline

    return baseline.compared(plan.trajectory.duration, *_given(plan), jobs=jobs)


def _given(product: Laid | Planned) -> tuple[Toolpath, Robot, Printer, Material, Process]:
    profiles = profiles_of(product.origin)
    return product.toolpath, robot_of(product), profiles.printer, profiles.material, profiles.process


def at_speed(
    plan: Planned, verdict: Verdict, share: float, progress: Progress = silent, *, jobs: int = 1
) -> tuple[Planned, Verdict]:
    """The plan played at `share` of its speed, audited anew: ImpossibleError where that breaks a limit."""
    from cabslice.timing.trajectory import at_share

    if share == 1.0:
        return plan, verdict
    other = replace(plan, trajectory=at_share(plan.trajectory, share))
    found = audited(other, progress, jobs=jobs)
    remedy = f"At {100 * share:g} % of its speed: play it slower, or plan it with other speeds."
    found = replace(found, findings=tuple(replace(finding, help=remedy) for finding in found.findings))
    return other, verdict.joined(_passed(found))


def to_stream(
    plan: Planned, verdict: Verdict, *, period_s: float, extrude: bool = True, more: Mapping[str, Any] | None = None
) -> MotorStream:
    """The motor commands of a plan that `verdict` let through; computed as the stream is gone through.

    Without `extrude` nothing is fed, heated or blown. `more` goes into the header.
    """
    header = {**stream_header(plan, _passed(verdict), period_s, extrude=extrude), **(more or {})}
    return stream_of(plan, header, period_s, extrude=extrude)


def stream_of(plan: Planned, header: Mapping[str, Any], period_s: float, *, extrude: bool = True) -> MotorStream:
    from cabslice.motors.stream import make_stream
    from cabslice.simulation.damping import relaxation

    return make_stream(
        plan.trajectory, robot_of(plan), period_s=period_s, layers=plan.toolpath.layer, header=header,
        lead=_lead(plan.origin), extrude=extrude,
        relaxation=relaxation(profiles_of(plan.origin).printer, robot_of(plan)),
    )


def _lead(origin: Origin) -> Lead:
    start = profiles_of(origin).printer.start
    from cabslice.motors.start import Lead

    return Lead(start.tensioning_s, start.first_tension)


def trial(profiles: Profiles) -> tuple[Robot, dict[str, Any], float, Lead]:
    """What a motion that tries a machine needs: the robot, the header of its file, the period, the tensioning."""
    origin = _origin("trial", "", profiles)
    header = {"profiles": profile_names(origin), "printer": json.loads(origin.printer), **_encoders(origin)}
    return robot_from_printer(profiles.printer), header, profiles.printer.stream.period_ms / 1e3, _lead(origin)


def circle(
    profiles: Profiles, *, radius: float, speed: float, height: float | None, progress: Progress = silent
) -> tuple[Planned, Verdict]:
    """A circle to try a machine with, checked, planned and audited. Raises ImpossibleError."""
    from cabslice.motors import trial as motions

    assert profiles.printer.extruder is not None
    path = motions.circle(robot_from_printer(profiles.printer), radius=radius, speed=speed, height=height,
                          filament_mm=profiles.printer.extruder.filament_diameter_mm)
    laid = Laid(_origin("circle", hashlib.sha256(path.xyz.tobytes()).hexdigest(), profiles), path)
    verdict = _passed(check_path(laid, progress, bare=True))
    plan, proof = proven(laid, progress)
    return plan, verdict.joined(_passed(proof))


def _origin(name: str, sha256: str, profiles: Profiles) -> Origin:
    return Origin(name, sha256, (), (), "mm", 1.0, (0.0, 0.0, 0.0), None, _json(profiles.printer),
                  _json(profiles.material), _json(profiles.process))


def converted(stream: MotorStream, source: str) -> MotorStream:
    """The same rows, to be written in another format than `source`; the header remembers what they came through."""
    header = {**stream.header, "converted_from": [*stream.header.get("converted_from", ()), source]}
    return replace(stream, header=header)


def save_stream(
    stream: MotorStream, path: str | Path, format: str, *, overwrite: bool = False, progress: Progress = silent,
    resume: bool = False,
) -> dict[str, Any]:
    """Write a motor file and read it back; the numbers of its header and, per cable, of the rows that are in it.

    With `resume`, what a run that was killed has written of the same file is gone on with.
    """
    from cabslice.motors.formats import FORMATS

    tick = partial(progress, "write")
    rows = FORMATS[format].write(
        stream, path, overwrite=overwrite, progress=lambda row: tick(row, stream.rows), resume=resume
    )
    if str(path) == STDOUT:
        return rows.as_dict() | dict(stream.header.get("numbers", {}))
    return numbers.of_stream(FORMATS[format].read(path))


def save_gcode(laid: Laid, path: str | Path, *, overwrite: bool = False, flavor: str = "marlin") -> None:
    """The path as G-code for ordinary viewers and printers; the robot is not driven with it."""
    from cabslice.toolpath.gcode import write_gcode

    profiles = profiles_of(laid.origin)
    bed = profiles.printer.bed
    with atomic(path, overwrite) as file:
        write_gcode(
            laid.toolpath, file,
            printer_name=profiles.printer.name, material=profiles.material, process=profiles.process,
            flavor=flavor, bed_mm=(bed.size_mm[0], bed.size_mm[1]) if bed else None,
        )


def period_of(product: Product) -> float:
    """Sample time of the printer's drives, s."""
    return profiles_of(product.origin).printer.stream.period_ms / 1e3


def robot_of(product: Placed | Product) -> Robot:
    """The robot as it may be used: no tension above what its motors hold."""
    return usable(robot_from_printer(profiles_of(product.origin).printer))


def stream_header(plan: Planned, verdict: Verdict, period_s: float, *, extrude: bool = True) -> dict[str, Any]:
    """What a motor file says of its making: names and hashes, placement, numbers, what was checked, events, layers."""
    from cabslice.motors.events import events_of, layers_of

    origin = plan.origin
    lead_s = _lead(origin).rows(period_s) * period_s
    return {
        "events": events_of(plan.trajectory, plan.toolpath, period_s, lead_s=lead_s, extrude=extrude),
        "layers": layers_of(plan.trajectory, plan.toolpath, lead_s=lead_s),
        "part": {"name": origin.part, "sha256": origin.sha256},
        "repairs": list(origin.repairs),
        "placement": placement_of(origin),
        "profiles": profile_names(origin),
        "printer": json.loads(origin.printer),
        "numbers": numbers_of(plan, period_s),
        "verdict": verdict.as_dict(),
        "thumbnail": _thumbnail(plan.toolpath),
        **_encoders(origin),
    }


def _thumbnail(path: Toolpath) -> dict[str, Any]:
    from cabslice.toolpath.thumbnail import thumbnail

    width, height = THUMBNAIL
    return {"width": width, "height": height, "png_base64": base64.b64encode(thumbnail(path, width, height)).decode()}


def refuse_format(format: str, origin: Origin) -> None:
    """Raises UsageError where a motor file of that format cannot be made, however the job goes."""
    from cabslice.motors.formats import FORMATS

    FORMATS[format].refuse({"cables": len(profiles_of(origin).printer.cable), **_encoders(origin)})


def _encoders(origin: Origin) -> dict[str, Any]:
    counts = [cable.motor and cable.motor.counts_per_turn for cable in profiles_of(origin).printer.cable]
    return {"encoder_counts_per_turn": counts} if all(counts) else {}


def numbers_of(product: Laid | Planned, period_s: float | None = None) -> dict[str, Any]:
    """Of the path; of a plan also of the motion, sampled every period_s."""
    material = profiles_of(product.origin).material
    found = summary(product.toolpath, density_g_cm3=material.density_g_cm3)
    if material.price_per_kg is not None:
        found["cost"] = found["mass_g"] / 1000 * material.price_per_kg
    if isinstance(product, Planned):
        found |= numbers.of_motion(product.trajectory, product.toolpath, period_s or period_of(product))
    return found


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


def _cut(placed: Placed, progress: Progress, jobs: int) -> Iterator[Layer]:
    """The layers of the part; of several made one after the other, numbered on from one to the next."""
    from cabslice.slicing.slicer import slice_part

    profiles = profiles_of(placed.origin)
    assert profiles.printer.nozzle
    nozzle = profiles.printer.nozzle.diameter_mm
    tick = partial(progress, "slice")
    parts = sorted(placed.parts, key=lambda part: float(part.vertices[:, 2].max())) or [placed.part]   # tallest last
    done = 0
    for part in parts:
        layers = slice_part(
            part, profiles.process, nozzle_mm=nozzle, progress=tick, jobs=jobs, modifiers=placed.modifiers
        )
        if len(parts) == 1:
            yield from layers
            return
        for layer in layers:
            yield replace(layer, index=done + layer.index)
        done += layer.index + 1


def _only(product: Any, cls: type, stage: str) -> Any:
    if isinstance(product, cls):
        return product
    raise UsageError(f"The file is already past the stage \"{stage}\": start from the part or an earlier product.")


def _passed(verdict: Verdict) -> Verdict:
    if verdict.ok:
        return verdict
    count = len(verdict.findings)
    raise ImpossibleError(
        f"The robot cannot make this part as asked: {count} reason{'s' if count > 1 else ''}.", verdict.findings,
        checked=list(verdict.checked),
    )
