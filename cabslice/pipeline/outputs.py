"""What goes out: motor files, G-code, and motions that try a machine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice.feasibility.findings import Verdict
from cabslice.files import STDOUT, atomic
from cabslice.pipeline.headers import stream_header
from cabslice.pipeline.inputs import origin_of
from cabslice.pipeline.profiles import Profiles, encoders, lead_of, machine_for, profile_names, profiles_of, robot_for
from cabslice.pipeline.stages import Progress, check_path, passed, proven, silent, stream_of
from cabslice.robot.model import Robot
from cabslice.store import Laid, Planned
from cabslice.view import numbers

if TYPE_CHECKING:
    from cabslice.motors.start import Lead
    from cabslice.motors.stream import MotorStream


def to_stream(
    plan: Planned, verdict: Verdict, *, period_s: float, extrude: bool = True, more: Mapping[str, Any] | None = None
) -> MotorStream:
    """The motor commands of a plan that `verdict` let through; computed as the stream is gone through.

    Without `extrude` nothing is fed, heated or blown. `more` goes into the header.
    """
    header = {**stream_header(plan, passed(verdict), period_s, extrude=extrude), **(more or {})}
    return stream_of(plan, header, period_s, extrude=extrude)


def trial(profiles: Profiles) -> tuple[Robot, dict[str, Any], float, Lead]:
    """What a motion that tries a machine needs: the robot, the header of its file, the period, the tensioning."""
    origin = origin_of("trial", "", profiles)
    header = {"profiles": profile_names(origin), "printer": json.loads(origin.printer), **encoders(origin)}
    return robot_for(profiles.printer), header, profiles.printer.stream.period_ms / 1e3, lead_of(origin)


def circle(
    profiles: Profiles, *, radius: float, speed: float, height: float | None, progress: Progress = silent
) -> tuple[Planned, Verdict]:
    """A circle to try a machine with, checked, planned and audited. Raises ImpossibleError."""
    from cabslice.motors import trial as motions

    assert profiles.printer.extruder is not None
    path = motions.circle(machine_for(profiles.printer), radius=radius, speed=speed, height=height,
                          filament_mm=profiles.printer.extruder.filament_diameter_mm)
    laid = Laid(origin_of("circle", hashlib.sha256(path.xyz.tobytes()).hexdigest(), profiles), path)
    verdict = passed(check_path(laid, progress, bare=True))
    plan, proof = proven(laid, progress)
    return plan, verdict.joined(passed(proof))


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
            flavor=flavor, start=profiles.printer.gcode.start, end=profiles.printer.gcode.end,
            bed_mm=(bed.size_mm[0], bed.size_mm[1]) if bed else None,
        )
