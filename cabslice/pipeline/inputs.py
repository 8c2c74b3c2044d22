"""What comes in: a part or several set on the bed, or the path in another slicer's G-code."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cabslice.errors import ImpossibleError, UsageError
from cabslice.mesh.part import Part
from cabslice.pipeline.profiles import Profiles, as_json
from cabslice.robot.model import robot_from_printer
from cabslice.slicing.sections import NO_MODIFIERS, Modifiers
from cabslice.store import Laid, Origin

GCODE = (".gcode", ".gco", ".g")
GAP_MM, NOZZLE_MM = 10.0, 2.0     # between parts; between the platform and a part beside it


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
    told = tuple(f"{kind} {one.name} sha256:{one.sha256}" for kind, one in zip(kinds, others, strict=True))
    origin = _origin_of_part(part, profiles, placement, told)
    part, *others = place_with(part, others, turn_deg=placement.turn_deg, at_mm=placement.at_mm)
    return Placed(origin, part, Modifiers(others[:len(blockers)], others[len(blockers):]))


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
    origin = _origin_of_part(whole, profiles, placement, stood)
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
    origin = origin_of(Path(path).name, hashlib.sha256(Path(path).read_bytes()).hexdigest(), profiles)
    return Laid(replace(origin, warnings=reading.warnings), with_stops(reading.toolpath, profiles.process))


def _origin_of_part(part: Part, profiles: Profiles, placement: Placement, modifiers: tuple[str, ...]) -> Origin:
    return replace(
        origin_of(part.name, part.sha256, profiles), repairs=part.repairs, warnings=part.warnings,
        unit=placement.unit, scale=float(placement.scale), turn_deg=tuple(placement.turn_deg), at_mm=placement.at_mm,
        modifiers=modifiers,
    )


def origin_of(name: str, sha256: str, profiles: Profiles) -> Origin:
    return Origin(name, sha256, (), (), "mm", 1.0, (0.0, 0.0, 0.0), None, as_json(profiles.printer),
                  as_json(profiles.material), as_json(profiles.process))
