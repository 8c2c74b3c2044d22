"""What is told of a product: the header of its motor file, and its numbers."""

from __future__ import annotations

import base64
import json
from typing import Any

from cabslice.feasibility.findings import Verdict
from cabslice.pipeline.profiles import encoders, lead_of, period_of, placement_of, profile_names, profiles_of
from cabslice.robot.delta import machine_from_printer
from cabslice.store import Laid, Origin, Planned
from cabslice.toolpath.path import Toolpath
from cabslice.toolpath.summary import summary
from cabslice.view import numbers

THUMBNAIL = 160, 120                          # pixels of the picture in a motor file


def stream_header(plan: Planned, verdict: Verdict, period_s: float, *, extrude: bool = True) -> dict[str, Any]:
    """What a motor file says of its making: names and hashes, placement, numbers, what was checked, events, layers."""
    from cabslice.motors.events import events_of, layers_of

    origin = plan.origin
    lead_s = lead_of(origin).rows(period_s) * period_s
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
        **encoders(origin),
    }


def _thumbnail(path: Toolpath) -> dict[str, Any]:
    from cabslice.toolpath.thumbnail import thumbnail

    width, height = THUMBNAIL
    return {"width": width, "height": height, "png_base64": base64.b64encode(thumbnail(path, width, height)).decode()}


def refuse_format(format: str, origin: Origin) -> None:
    """Raises UsageError where a motor file of that format cannot be made, however the job goes."""
    from cabslice.motors.formats import FORMATS

    FORMATS[format].refuse({"cables": machine_from_printer(profiles_of(origin).printer).cables, **encoders(origin)})


def numbers_of(product: Laid | Planned, period_s: float | None = None) -> dict[str, Any]:
    """Of the path; of a plan also of the motion, sampled every period_s."""
    material = profiles_of(product.origin).material
    found = summary(product.toolpath, density_g_cm3=material.density_g_cm3)
    if material.price_per_kg is not None:
        found["cost"] = found["mass_g"] / 1000 * material.price_per_kg
    if isinstance(product, Planned):
        found |= numbers.of_motion(product.trajectory, product.toolpath, period_s or period_of(product))
    return found
