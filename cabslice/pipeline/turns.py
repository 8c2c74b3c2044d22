"""The turn of the platform as a product carries it, in its printer profile, and in words."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cabslice.feasibility.findings import Verdict
from cabslice.profile.printer import Printer, Turn
from cabslice.store import Origin

if TYPE_CHECKING:
    from cabslice.robot.turning import Turning


def with_turn(origin: Origin, turning: Turning) -> Origin:
    """The same, to be printed with the platform turned so."""
    printer = Printer.model_validate_json(origin.printer)
    degrees = np.round(np.degrees(turning.angles), 6) + 0.0
    turn = Turn(
        x_mm=turning.x.tolist(), y_mm=turning.y.tolist(), z_mm=turning.z.tolist(),
        angles_deg=degrees.reshape(-1, 3).tolist(),
    )
    platform = printer.platform.model_copy(update={"turn": turn})
    return replace(origin, printer=printer.model_copy(update={"platform": platform}).model_dump_json(by_alias=True))


def turn_sentence(turning: Turning, before: Verdict, after: Verdict) -> str:
    low, high = (np.degrees(pick(turning.angles, axis=(0, 1, 2))) + 0.0 for pick in (np.min, np.max))
    angles = ", ".join(f"{name} {a:.2f} to {b:.2f}" for name, a, b in zip(
        ("psi", "theta", "phi"), low.tolist(), high.tolist(), strict=True) if a or b)
    least = "at least " if "cable_part_mm" in after.capped else ""
    gain = f"{least}{after.margins['cable_part_mm']:.2f} mm"
    what = f"cables keep {gain} more than asked from the part"
    what += f", {before.margins['cable_part_mm']:.2f} mm before" if before.ok else "; before it could not be printed"
    return f"The platform is turned while it prints, by {angles} deg, smoothly by where the nozzle is: {what}."
