"""What must hold between the keys of one cable: its tensions, elasticity, pulley, winder and motor.

As in `checks`: each check takes the merged table and yields (place, sentence); nan breaks no relation.

Legend
    P, e_z    entry point of the pulley (anchor) and its swivel axis         r_p    groove radius + cable radius
    rho, z    attachment at home: distance from the axis, height along it    d      its distance from the pulley centre
"""

from __future__ import annotations

import itertools
import math

from cabslice.profile.values import Faults, Values, number, numbers, table
from cabslice.profile.winders import NEEDS, foreign, kind_of

MISSING = ""                              # the sentence of a key that a table of this kind needs and has not
CURVES = {"modulus_by_tension": ("tension_n", "modulus_gpa"), "modulus_by_frequency": ("frequency_hz", "modulus_gpa"),
          "damping": ("frequency_hz", "damping_n_s")}
UNIT_TOLERANCE = 1e-6


def cable_faults(cable: Values, home: list[float]) -> Faults:
    """All faults of one cable, places within it; `home` is where the platform origin is when homed."""
    low, high, level = (number(cable, f"{name}_tension_n") for name in ("min", "max", "reference"))
    if low >= high:
        yield ("min_tension_n",), f"expected less than max_tension_n = {high:g}, found {low:g}"
    elif level < low or level > high:
        yield ("reference_tension_n",), (
            f"expected from min_tension_n = {low:g} to max_tension_n = {high:g}, found {level:g}")
    yield from _elasticity(cable)
    for name in CURVES:
        yield from _curve(name, table(cable, name))
    yield from _pulley(cable, home)
    yield from _winder(cable)
    yield from _disc_apart(cable)
    yield from _motor(table(cable, "motor"))


def _elasticity(cable: Values) -> Faults:
    """Either a modulus, on a circle that is there, or an axial stiffness."""
    if "axial_stiffness_n" not in cable:
        if "modulus_gpa" not in cable:
            yield ("modulus_gpa",), MISSING
        elif number(cable, "diameter_mm") == 0:
            yield ("diameter_mm",), (
                "expected more than 0 with modulus_gpa (a line without thickness has axial_stiffness_n), found 0")
        return
    for name in ("modulus_gpa", "modulus_by_tension", "modulus_by_frequency"):
        if name in cable:
            yield (name,), "expected either the modulus or axial_stiffness_n, found both"


def _curve(name: str, curve: Values) -> Faults:
    """Two columns of one length, the first rising."""
    x, y = CURVES[name]
    places, levels = numbers(curve.get(x)), numbers(curve.get(y))
    if x in curve and y in curve and len(places) != len(levels):
        yield (name, y), f"expected as many numbers as in {x} ({len(places)}), found {len(levels)}"
    if any(two <= one for one, two in itertools.pairwise(places)):
        yield (name, x), f"expected numbers that rise, found {places}"


def _pulley(cable: Values, home: list[float]) -> Faults:
    pulley = table(cable, "pulley")
    axis = numbers(pulley.get("axis", [0.0, 0.0, 1.0]), 3)
    if abs(math.hypot(*axis) - 1) > UNIT_TOLERANCE:
        yield ("pulley", "axis"), f"expected a unit vector, found {axis} of length {math.hypot(*axis):.9g}"
        return
    anchor, attachment = numbers(cable.get("anchor_mm"), 3), numbers(cable.get("attachment_mm"), 3)
    reach = [c + h - a for a, c, h in zip(anchor, attachment, home, strict=True)]
    if math.hypot(*reach) < 1e-6:
        yield ("attachment_mm",), "expected a cable longer than 0 mm at home, found the attachment on the anchor"
        return
    groove = number(pulley, "groove_radius_mm", 0.0)
    radius = groove + number(cable, "diameter_mm") / 2
    along, away = _in_plane(reach, axis)
    distance = math.hypot(away - radius, along)
    if groove > 0 and min(away, distance) <= radius:
        what, found = ("swivel axis", away) if away <= radius else ("pulley's centre", distance)
        place = ", ".join(f"{a + step:g}" for a, step in zip(anchor, reach, strict=True))
        yield ("pulley", "groove_radius_mm"), (
            f"expected the attachment at home, at ({place}) mm, further than the pulley radius {radius:g} mm from the "
            f"{what}, found {found:g} mm")


def _in_plane(reach: list[float], axis: list[float]) -> tuple[float, float]:
    """Part of a vector along a unit vector, and the length of the rest."""
    along = sum(one * two for one, two in zip(reach, axis, strict=True))
    return along, math.hypot(*(one - along * two for one, two in zip(reach, axis, strict=True)))


def _winder(cable: Values) -> Faults:
    for name, other in (("winder", "motor"), ("motor", "winder")):
        if name in cable and other not in cable:
            yield (other,), MISSING
    winder = table(cable, "winder")
    kind = kind_of(winder)
    if not kind:                          # no winder, or there is no such kind
        return
    for key in NEEDS[kind]:
        if key not in winder:
            yield ("winder", key), MISSING
    for key, owners in foreign(winder):
        yield ("winder", key), f'a winder of kind "{kind}" has no such key; it belongs to kind {" or ".join(owners)}'
    yield from _layers(winder) if kind == "radial" else _range(winder)


def _range(winder: Values) -> Faults:
    """Spiral, drum and spool: the angles they turn to hold home, and leave a radius at the emptiest."""
    low, high = numbers(winder.get("angle_range_deg"), 2)
    home = number(winder, "home_angle_deg")
    if low >= high:
        yield ("winder", "angle_range_deg"), f"expected the lower angle first, found {low:g} and {high:g}"
    elif home < low or home > high:
        yield ("winder", "home_angle_deg"), f"expected an angle from {low:g} to {high:g}, found {home:g}"
    least = _radius_at(winder, low)
    if least <= 0:
        yield ("winder", "angle_range_deg"), f"expected a radius above 0 at the lowest angle, found {least:g} mm"


def _radius_at(winder: Values, angle: float) -> float:
    """Radius of a spiral, drum or spool at a motor angle in degrees."""
    lines = number(winder, "lines_per_spool", 1.0)
    per_turn = {"spiral": number(winder, "radius_per_turn_mm"),
                "spool": math.pi * number(winder, "buildup_factor_mm") * lines}.get(kind_of(winder) or "", 0.0)
    return number(winder, "first_radius_mm") + per_turn * angle / 360 / _gear(winder)


def _gear(winder: Values) -> float:
    return number(winder, "gear_ratio", 1.0) or math.nan


def _layers(winder: Values) -> Faults:
    start, end, turn = number(winder, "ramp_start_deg"), number(winder, "ramp_end_deg"), 360 * _gear(winder)
    if end <= start:
        yield ("winder", "ramp_end_deg"), f"expected more than ramp_start_deg = {start:g}, found {end:g}"
    elif end - start > turn:
        yield ("winder", "ramp_end_deg"), f"expected a ramp of at most one turn, up to {start + turn:g}, found {end:g}"
    radii = numbers(winder.get("radii_mm"))
    if any(two <= one for one, two in itertools.pairwise(radii)):
        yield ("winder", "radii_mm"), f"expected radii that increase from layer to layer, found {radii}"
    layers = number(winder, "layers")
    if layers < len(radii):
        yield ("winder", "layers"), f"expected at least the {len(radii)} layers that radii_mm lists, found {layers:g}"
    home, full = number(winder, "home_angle_deg"), start + turn * (layers - 1)
    if home > full:
        yield ("winder", "home_angle_deg"), (
            f"expected an angle on the disc, at most {full:g} for its {layers:g} layers, found {home:g}")


def _full_radius(winder: Values) -> float:
    """Radius when nothing more may be wound."""
    if kind_of(winder) != "radial":
        return _radius_at(winder, numbers(winder.get("angle_range_deg"), 2)[1])
    radii = numbers(winder.get("radii_mm")) or [number(winder, "first_radius_mm")]
    return radii[-1] + number(winder, "layer_step_mm") * max(number(winder, "layers") - len(radii), 0)


def _disc_apart(cable: Values) -> Faults:
    """The full disc must not touch its pulley; where both stand is said in robot.winder_line."""
    winder, pulley = table(cable, "winder"), table(cable, "pulley")
    axis = numbers(pulley.get("axis", [0.0, 0.0, 1.0]), 3)
    groove = number(pulley, "groove_radius_mm", 0.0)
    small = groove + number(cable, "diameter_mm") / 2 if groove else groove
    anchor, centre = numbers(cable.get("anchor_mm"), 3), numbers(winder.get("centre_mm"), 3)
    along, away = _in_plane([one - two for one, two in zip(anchor, centre, strict=True)], axis)
    full = _full_radius(winder)
    apart = math.hypot(small + (away if winder.get("routing") == "crossed" else -away), along)
    if apart <= small + full:
        yield ("winder", "centre_mm"), (
            f"expected the full disc (radius {full:g} mm) clear of its pulley (radius {small:g} mm), "
            f"found their centres {apart:g} mm apart")


def _motor(motor: Values) -> Faults:
    peak, continuous = number(motor, "peak_torque_n_m"), number(motor, "continuous_torque_n_m")
    if peak < continuous:
        yield ("motor", "peak_torque_n_m"), f"expected at least continuous_torque_n_m = {continuous:g}, found {peak:g}"
