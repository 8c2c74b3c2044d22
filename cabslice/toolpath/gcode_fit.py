"""Does the G-code of another slicer fit the printer it is to be made with: filament, nozzle, beads that can be?

A file made for another filament is refused, or converted (E rescaled so that the same volume is laid); one for another
nozzle is refused, or taken as it is. Files that do not tell their filament give themselves away by their beads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import GcodeError
from cabslice.slicing.flow import bead_area, bead_width
from cabslice.slicing.layer import Role
from cabslice.toolpath.gcode_read import GcodeReading
from cabslice.toolpath.path import Toolpath

REFUSE, CONVERT, IGNORE = "refuse", "convert", "ignore"
SAME_MM = 0.005                  # nozzles and filaments that differ by less are the same
LONG_MM = 0.5                    # shorter moves say little: their E is rounded
WIDEST_MM, WIDEST = 10.0, 12.0   # no bead is wider than this, nor than so many nozzles
PLENTY, SCANT = 2.5, 0.6         # of what the beads should hold: outside, most beads are of another filament
USUAL = (1.75, 2.85, 3.0)        # mm, filaments there are


@dataclass(frozen=True)
class _Beads:
    """Long beads that belong to the part: their rows, mm, mm^2 from the filament, mm^2 as they should be."""

    row: Array
    length: Array
    section: Array
    wanted: Array


def fitted(
    reading: GcodeReading, *, filament_mm: float, nozzle_mm: float, mismatch: str = REFUSE, name: str = "G-code"
) -> GcodeReading:
    """The reading as the printer with this filament and nozzle (mm) will make it.

    mismatch: "refuse", "convert" or "ignore" what was made for another filament or nozzle. Raises GcodeError.
    """
    said: list[str] = []
    path = _for_filament(reading, filament_mm, mismatch, name, said)
    _check_nozzle(reading, nozzle_mm, mismatch, name, said)
    _check_beads(reading, path, nozzle_mm, mismatch, name, said)
    return replace(reading, toolpath=path, warnings=(*reading.warnings, *said))


def _for_filament(reading: GcodeReading, printer_mm: float, mismatch: str, name: str, said: list[str]) -> Toolpath:
    path, own = reading.toolpath, reading.toolpath.filament_diameter_mm
    if abs(own - printer_mm) < SAME_MM:
        return path
    share = (printer_mm / own) ** 2
    if mismatch == REFUSE:
        raise GcodeError(
            f"{name}: made for filament of {own:g} mm, the printer takes {printer_mm:g} mm: it would lay {share:.2g} "
            "times the plastic. Slice it again for this filament, or give --mismatch convert to have E rescaled.",
            file=name, expected_mm=printer_mm, found_mm=own,
        )
    if mismatch == IGNORE:
        said.append(
            f"{name}: made for filament of {own:g} mm and taken as it is: with {printer_mm:g} mm it lays {share:.2g} "
            "times the plastic."
        )
        return replace(path, filament_diameter_mm=printer_mm)
    said.append(f"{name}: E was divided by {share:.4g}, from filament of {own:g} mm to {printer_mm:g} mm.")
    return replace(path, filament=path.filament / share, filament_diameter_mm=printer_mm)


def _check_nozzle(reading: GcodeReading, nozzle_mm: float, mismatch: str, name: str, said: list[str]) -> None:
    text = reading.settings.get("nozzle_diameter", "").split(",")[0]
    try:
        own = float(text)
    except ValueError:
        return
    if abs(own - nozzle_mm) < SAME_MM:
        return
    if mismatch == REFUSE:
        raise GcodeError(
            f"{name}: made for a nozzle of {own:g} mm, the printer has {nozzle_mm:g} mm. Slice it again for that, "
            f"give -s nozzle.diameter_mm={own:g} with a --process for it, or --mismatch ignore to take it as it is.",
            file=name, expected_mm=nozzle_mm, found_mm=own,
        )
    said.append(f"{name}: made for a nozzle of {own:g} mm and taken as it is, the printer has {nozzle_mm:g} mm.")


def _check_beads(
    reading: GcodeReading, path: Toolpath, nozzle_mm: float, mismatch: str, name: str, said: list[str]
) -> None:
    beads = _beads(path, reading.sized, nozzle_mm)
    if not len(beads.row):
        return
    height = path.height[beads.row]
    width = bead_width(beads.section / height, height)
    _refuse_one(reading, beads.row[width > max(WIDEST_MM, WIDEST * nozzle_mm)], width, beads, path, name)
    share = _median(beads.section / beads.wanted, beads.length)
    if SCANT < share < PLENTY:
        return
    own = path.filament_diameter_mm
    near = [d for d in USUAL if 0.7 < share * (d / own) ** 2 < 1.4]
    hint = f" With filament of {near[0]:g} mm they would be right: see --gcode-filament-mm." if near else ""
    sentence = (
        f"{name}: most beads hold {share:.2g} times what they should (E, taken as filament of {own:g} mm, for beads "
        f"about {_median(width, beads.length):.3g} mm wide)."
    )
    if mismatch != IGNORE:
        raise GcodeError(f"{sentence}{hint} Slice it again, or give --mismatch ignore to take it as it is.", file=name)
    said.append(sentence)


def _beads(path: Toolpath, sized: Array, nozzle_mm: float) -> _Beads:
    length = path.lengths
    rows = np.flatnonzero((path.role != Role.TRAVEL) & (path.role != Role.CUSTOM) & (length > LONG_MM))
    section = path.filament[rows] * path.filament_area_mm2 / length[rows]
    width = np.where(sized[rows], path.width[rows], nozzle_mm)
    return _Beads(rows, length[rows], section, bead_area(width, path.height[rows]))


def _refuse_one(
    reading: GcodeReading, absurd: Array, width: Array, beads: _Beads, path: Toolpath, name: str
) -> None:
    if not len(absurd):
        return
    row = int(absurd[0])
    wide, line = float(width[np.searchsorted(beads.row, row)]), int(reading.line[row])
    raise GcodeError(
        f"{name}, line {line}: feeds {path.filament[row]:.4g} mm of filament over {path.lengths[row]:.4g} mm, a bead "
        f"{wide:.3g} mm wide in a layer of {path.height[row]:.3g} mm; expected a bead that a nozzle can lay. Is E "
        "absolute where the file says M83, or the layer height wrong?", file=name, line=line,
    )


def _median(values: Array, weight: Array) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])
