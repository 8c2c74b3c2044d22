"""A printer profile as the M669 and M666 lines of RepRapFirmware: what `reprap` reads, see its legend.

The firmware's origin is the machine at home: there the nozzle must touch the bed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

from cabslice.errors import ProfileError
from cabslice.profile.reprap import ANCHORS

TEETH = 20                                 # of the motor's gear, at least


def write_config(printer: Any) -> str:
    """The M669, M666 and M208 lines of a checked printer, as text.

    Raises ProfileError with every reason why it is no Hangprinter of the firmware.
    """
    faults = list(_unwritable(printer))
    if faults:
        raise ProfileError(printer.name, faults)
    cables, winders = printer.cable, [cable.winder for cable in printer.cable]
    home = printer.platform.home_mm
    letters = ANCHORS[:len(cables)]
    number = "" if len(cables) == 4 else f" N{len(cables)}"
    anchors = [[a - c - p + 0.0 for a, c, p in zip(one.anchor_mm, one.attachment_mm, home, strict=True)]
               for one in cables]
    teeth = [_teeth(winder.gear_ratio) for winder in winders]
    rows = [
        (f"M669 K6{number}", "a Hangprinter"),
        *((f"M669 {letter}{_joined(place)}", "anchor, mm") for letter, place in zip(letters, anchors, strict=True)),
        (f"M666 Q{_plain(winders[0].buildup_factor_mm)}", "build-up of the spools, mm"),
        (f"M666 R{_joined(map(_home_radius, winders))}", "spool radii, mm"),
        (f"M666 U{_joined(winder.mechanical_advantage for winder in winders)}", "mechanical advantages"),
        (f"M666 O{_joined(winder.lines_per_spool or 1 for winder in winders)}", "lines per spool"),
        (f"M666 L{_joined(motor for motor, _ in teeth)}", "motor gear teeth"),
        (f"M666 H{_joined(spool for _, spool in teeth)}", "spool gear teeth"),
        (f"M666 W{_plain(printer.platform.mass_kg)}", "mass, kg"),
        (f"M666 S{_plain(_strand(cables[0]))}", "N per unit strain of a line"),
        (f"M666 I{_joined(cable.min_tension_n for cable in cables)}", "least force, N"),
        (f"M666 X{_joined(cable.max_tension_n for cable in cables)}", "largest force, N"),
        *_wanted(cables),
        (f"M666 Y{_joined(winder.line_mm or 0.0 for winder in winders)}", "lines from spool to anchor, mm"),
        *_area(printer),
    ]
    width = max(len(row) for row, _ in rows)
    return f"; {printer.name}: {printer.description}\n" + "".join(f"{row:<{width}} ; {note}\n" for row, note in rows)


def _unwritable(printer: Any) -> list[str]:
    """Why the firmware has no word for this machine."""
    cables = printer.cable
    faults = []
    if set(printer.freedoms) != {"x", "y", "z"}:
        faults.append(f"freedoms: expected x, y, z, as the firmware has no others, found {' '.join(printer.freedoms)}")
    if not 3 <= len(cables) <= len(ANCHORS):
        faults.append(f"cable: expected 3 to {len(ANCHORS)} of them, found {len(cables)}")
    if any(cable.pulley.groove_radius_mm for cable in cables):
        faults.append("cables.pulley.groove_radius_mm: expected eyelets (0), the firmware knows no pulleys")
    faults += _unwritable_winders([cable.winder for cable in cables])
    if len({_strand(cable) for cable in cables}) > 1:
        faults.append("cables.axial_stiffness_n: expected one number for all lines, as M666 S is")
    height = _bed_from_home(printer)[2]
    if abs(height) > 1e-9:
        faults.append("platform.home_mm: expected the nozzle on the bed at home, which is the firmware's origin, "
                      f"found it {-height:g} mm above")
    return faults


def _unwritable_winders(winders: Sequence[Any]) -> list[str]:
    if any(winder is None or winder.kind != "spool" for winder in winders):
        return ['cables.winder.kind: expected "spool", the only one the firmware has']
    faults = []
    if any(winder.centre_mm for winder in winders):
        faults.append("cables.winder.centre_mm: expected line_mm in its place, the firmware's lines are constant there")
    if len({winder.buildup_factor_mm for winder in winders}) > 1:
        faults.append("cables.winder.buildup_factor_mm: expected one number for all spools, as M666 Q is")
    for winder in winders:
        motor, spool = _teeth(winder.gear_ratio)
        if abs(spool / motor - winder.gear_ratio) > 1e-9 * winder.gear_ratio:
            faults.append(f"cables.winder.gear_ratio: expected a ratio of whole teeth, found {winder.gear_ratio!r}")
    return list(dict.fromkeys(faults))


def _bed_from_home(printer: Any) -> list[float]:
    """Middle of the bed (3,) mm from the nozzle at home; zero where there is no bed or nozzle."""
    if printer.bed is None or printer.nozzle is None:
        return [0.0, 0.0, 0.0]
    middle = [*printer.bed.centre_mm, printer.bed.z_mm]
    return [m - h - n for m, h, n in zip(middle, printer.platform.home_mm, printer.nozzle.offset_mm, strict=True)]


def _strand(cable: Any) -> float:
    if cable.axial_stiffness_n is not None:
        return float(cable.axial_stiffness_n)
    return float(cable.modulus_gpa * 1e3 * math.pi / 4 * cable.diameter_mm**2)


def _home_radius(winder: Any) -> float:
    """dr/dangle is build-up x lines / 2 over the gear (see robot.model)."""
    slope = winder.buildup_factor_mm * (winder.lines_per_spool or 1) / 2 / winder.gear_ratio
    return float(winder.first_radius_mm + slope * math.radians(winder.home_angle_deg))


def _teeth(ratio: float) -> tuple[int, int]:
    """Teeth of motor and spool: the fewest with at least TEETH on the motor."""
    exact = Fraction(ratio).limit_denominator(10000)
    times = -(-TEETH // exact.denominator)
    return exact.denominator * times, exact.numerator * times


def _wanted(cables: Sequence[Any]) -> list[tuple[str, str]]:
    levels = {cable.reference_tension_n for cable in cables}
    return [(f"M666 T{_plain(levels.pop())}", "wanted force, N")] if len(levels) == 1 else []


def _area(printer: Any) -> list[tuple[str, str]]:
    if printer.bed is None:
        return []
    middle = _bed_from_home(printer)
    x, y = (_joined((at - side / 2, at + side / 2)) for at, side in zip(middle[:2], printer.bed.size_mm, strict=True))
    return [(f"M208 X{x} Y{y}", "the bed, mm")]


def _joined(values: Iterable[Any]) -> str:
    return ":".join(map(_plain, values))


def _plain(value: float) -> str:
    """A number that reads back the same, without an exponent, which the firmware does not know."""
    return f"{Decimal(repr(value)):f}"
