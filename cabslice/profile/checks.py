"""What must hold between the keys of a profile: each check takes the merged table and yields (place, sentence).

They run on the table before it is typed, so that they report beside faults of type and bound. A number that is
missing or is no number becomes nan, and nan breaks no relation: its own fault is reported elsewhere.

Legend
    a_i, c_i    anchor (machine frame), attachment (platform frame), mm       b_i = home + c_i
    u_i         unit vector from attachment to anchor                         e_z pulley axis
    W           wrench matrix at home, columns [u_i ; c_i x u_i / s], s the largest lever: all entries of order 1
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from cabslice.profile.toml import Place

Faults = Iterator[tuple[Place, str]]
Values = Mapping[str, Any]
FREEDOMS = ("x", "y", "z", "rx", "ry", "rz")
MISSING = ""                              # the sentence of a key that a table of this kind needs and has not
WINDER_NEEDS = {
    "radial": ("layer_step_mm", "ramp_start_deg", "ramp_end_deg", "layers", "centre_mm"),
    "spiral": ("radius_per_turn_mm", "angle_range_deg", "centre_mm"),
    "drum": ("pitch_mm", "angle_range_deg", "centre_mm"),
    "spool": ("buildup_factor_mm", "angle_range_deg"),
}
UNIT_TOLERANCE = 1e-6
RANK_TOLERANCE = 1e-6                     # of the largest singular value


def relations(kind: str, values: Values) -> Faults:
    """All faults of a merged profile that concern more than one number."""
    yield from {"printers": _printer, "materials": _material, "processes": _process}[kind](values)


def _printer(values: Values) -> Faults:
    platform, cables = _table(values, "platform"), _cables(values)
    home = _numbers(platform.get("home_mm", [0.0, 0.0, 0.0]), 3)
    yield from _inertia(platform)
    yield from _home_over_bed(values, home)
    for index, cable in enumerate(cables):
        for place, sentence in _cable(cable, home):
            yield ("cable", index, *place), sentence
    yield from _freedoms(values, cables, home)


def _inertia(platform: Values) -> Faults:
    inertia = _numbers(platform.get("inertia_kg_mm2"), 3)
    largest = max(inertia)
    if largest > (sum(inertia) - largest) * (1 + 1e-9):
        yield ("platform", "inertia_kg_mm2"), (
            f"no body has this inertia: expected each moment at most the sum of the other two, found {largest:g} > "
            f"{sum(inertia) - largest:g}")


def _home_over_bed(values: Values, home: list[float]) -> Faults:
    bed, offset = _number(_table(values, "bed"), "z_mm"), _numbers(_table(values, "nozzle").get("offset_mm"), 3)
    if home[2] + offset[2] < bed:
        yield ("bed", "z_mm"), (
            f"expected the bed below the nozzle at home (z = {home[2] + offset[2]:g} mm), found {bed:g}")


def _cable(cable: Values, home: list[float]) -> Faults:
    low, high, level = (_number(cable, f"{name}_tension_n") for name in ("min", "max", "reference"))
    if low >= high:
        yield ("min_tension_n",), f"expected less than max_tension_n = {high:g}, found {low:g}"
    elif level < low or level > high:
        yield ("reference_tension_n",), (
            f"expected from min_tension_n = {low:g} to max_tension_n = {high:g}, found {level:g}")
    yield from _pulley(cable, home)
    yield from _winder(_table(cable, "winder"))
    yield from _disc_apart(cable)
    yield from _motor(_table(cable, "motor"))


def _pulley(cable: Values, home: list[float]) -> Faults:
    pulley = _table(cable, "pulley")
    axis = _numbers(pulley.get("axis", [0.0, 0.0, 1.0]), 3)
    if abs(math.hypot(*axis) - 1) > UNIT_TOLERANCE:
        yield ("pulley", "axis"), f"expected a unit vector, found {axis} of length {math.hypot(*axis):.9g}"
        return
    anchor, attachment = _numbers(cable.get("anchor_mm"), 3), _numbers(cable.get("attachment_mm"), 3)
    reach = [c + h - a for a, c, h in zip(anchor, attachment, home, strict=True)]
    if math.hypot(*reach) < 1e-6:
        yield ("attachment_mm",), "expected a cable longer than 0 mm at home, found the attachment on the anchor"
        return
    groove = _number(pulley, "groove_radius_mm", 0.0)
    radius = groove + _number(cable, "diameter_mm") / 2
    along = sum(one * two for one, two in zip(reach, axis, strict=True))
    away = math.hypot(*(one - along * two for one, two in zip(reach, axis, strict=True)))
    if groove > 0 and away <= radius:
        yield ("pulley", "groove_radius_mm"), (
            f"expected the attachment at home further than the pulley radius {radius:g} mm from the swivel axis, "
            f"found {away:g} mm")


def _winder(winder: Values) -> Faults:
    kind = winder.get("kind", "radial")
    if not winder or kind not in list(WINDER_NEEDS):       # the whole table is missing, or there is no such kind
        return
    for name in WINDER_NEEDS[kind]:
        if name not in winder:
            yield ("winder", name), MISSING
    yield from _layers(winder) if kind == "radial" else _range(kind, winder)


def _range(kind: str, winder: Values) -> Faults:
    """Spiral, drum and spool: the angles they turn to hold home, and leave a radius at the emptiest."""
    low, high = _numbers(winder.get("angle_range_deg"), 2)
    home, ratio = _number(winder, "home_angle_deg"), _number(winder, "gear_ratio", 1.0)
    if low >= high:
        yield ("winder", "angle_range_deg"), f"expected the lower angle first, found {low:g} and {high:g}"
    elif home < low or home > high:
        yield ("winder", "home_angle_deg"), f"expected an angle from {low:g} to {high:g}, found {home:g}"
    per_turn = {"spiral": _number(winder, "radius_per_turn_mm"),
                "spool": math.pi * _number(winder, "buildup_factor_mm") * _number(winder, "lines_per_spool", 1.0)}
    least = _number(winder, "first_radius_mm") + per_turn.get(kind, 0.0) * low / 360 / ratio
    if least <= 0:
        yield ("winder", "angle_range_deg"), f"expected a radius above 0 at the lowest angle, found {least:g} mm"


def _layers(winder: Values) -> Faults:
    start, end = _number(winder, "ramp_start_deg"), _number(winder, "ramp_end_deg")
    if end <= start:
        yield ("winder", "ramp_end_deg"), f"expected more than ramp_start_deg = {start:g}, found {end:g}"
    elif end - start > 360:
        yield ("winder", "ramp_end_deg"), f"expected a ramp of at most one turn, up to {start + 360:g}, found {end:g}"
    radii = _numbers(winder.get("radii_mm"))
    if any(two <= one for one, two in itertools.pairwise(radii)):
        yield ("winder", "radii_mm"), f"expected radii that increase from layer to layer, found {radii}"
    layers = _number(winder, "layers")
    if layers < len(radii):
        yield ("winder", "layers"), f"expected at least the {len(radii)} layers that radii_mm lists, found {layers:g}"
    home, full = _number(winder, "home_angle_deg"), start + 360 * (layers - 1)
    if home > full:
        yield ("winder", "home_angle_deg"), (
            f"expected an angle on the disc, at most {full:g} for its {layers:g} layers, found {home:g}")


def _disc_apart(cable: Values) -> Faults:
    """The full disc must not touch its pulley; where both stand is said in robot.winder_line."""
    winder, pulley = _table(cable, "winder"), _table(cable, "pulley")
    axis = _numbers(pulley.get("axis", [0.0, 0.0, 1.0]), 3)
    groove = _number(pulley, "groove_radius_mm", 0.0)
    small = groove + _number(cable, "diameter_mm") / 2 if groove else groove
    radii = _numbers(winder.get("radii_mm")) or [_number(winder, "first_radius_mm")]
    if winder.get("kind", "radial") == "radial":
        full = radii[-1] + _number(winder, "layer_step_mm") * max(_number(winder, "layers") - len(radii), 0)
    else:
        full = _number(winder, "first_radius_mm")
    anchor, centre = _numbers(cable.get("anchor_mm"), 3), _numbers(winder.get("centre_mm"), 3)
    reach = [one - two for one, two in zip(anchor, centre, strict=True)]
    along = sum(one * two for one, two in zip(reach, axis, strict=True))
    away = math.hypot(*(one - along * two for one, two in zip(reach, axis, strict=True)))
    apart = math.hypot(small + (away if winder.get("routing") == "crossed" else -away), along)
    if apart <= small + full:
        yield ("winder", "centre_mm"), (
            f"expected the full disc (radius {full:g} mm) clear of its pulley (radius {small:g} mm), "
            f"found their centres {apart:g} mm apart")


def _motor(motor: Values) -> Faults:
    peak, continuous = _number(motor, "peak_torque_n_m"), _number(motor, "continuous_torque_n_m")
    if peak < continuous:
        yield ("motor", "peak_torque_n_m"), f"expected at least continuous_torque_n_m = {continuous:g}, found {peak:g}"


def _freedoms(values: Values, cables: list[Values], home: list[float]) -> Faults:
    freedoms = values.get("freedoms", FREEDOMS)
    if not isinstance(freedoms, (list, tuple)) or not all(one in FREEDOMS for one in freedoms):
        return
    if len(set(freedoms)) < len(freedoms):
        yield ("freedoms",), f"expected each freedom once, found {list(freedoms)}"
    elif cables and len(cables) < len(freedoms):
        yield ("cable",), (
            f"expected at least {len(freedoms)} cables to hold {len(freedoms)} freedoms ({' '.join(freedoms)}), "
            f"found {len(cables)}")
    elif cables and freedoms:
        yield from _rank(cables, home, [FREEDOMS.index(one) for one in freedoms])


def _rank(cables: list[Values], home: list[float], rows: list[int]) -> Faults:
    import numpy as np

    anchors = np.array([_numbers(cable.get("anchor_mm"), 3) for cable in cables])
    attachments = np.array([_numbers(cable.get("attachment_mm"), 3) for cable in cables])
    reach = anchors - attachments - home
    length = np.linalg.norm(reach, axis=1, keepdims=True)
    if not np.isfinite(length).all() or not (length > 0).all():
        return
    lever = attachments / (np.linalg.norm(attachments, axis=1).max() or 1.0)
    matrix = np.concatenate((reach / length, np.cross(lever, reach / length)), axis=1).T[rows]
    left, singular, _ = np.linalg.svd(matrix, full_matrices=False)
    rank = int((singular > RANK_TOLERANCE * singular[0]).sum())
    if rank < len(rows):
        loose = FREEDOMS[rows[int(np.abs(left[:, rank:]).max(axis=1).argmax())]]
        yield ("cable",), (
            f"expected a wrench matrix of rank {len(rows)} at home, one for each freedom, found rank {rank}: "
            f"the cables do not hold {loose}")


def _material(values: Values) -> Faults:
    for key in ("nozzle_c", "bed_c", "speed_mm_s"):
        low, high = _numbers(values.get(key), 2)
        if low > high:
            yield (key,), f"expected the lowest, then the highest, found {low:g} before {high:g}"


def _process(values: Values) -> Faults:
    nozzle = _number(values, "nozzle_mm")
    for layer, beads in (("layer_mm", ("bead_mm", "outer_bead_mm")), ("first_layer_mm", ("first_bead_mm",))):
        height = _number(values, layer)
        if height > nozzle:
            yield (layer,), f"expected at most nozzle_mm = {nozzle:g}, found {height:g}"
        for bead in beads:
            if (width := _number(values, bead)) < height:
                yield (bead,), f"expected at least {layer} = {height:g} (a bead is wider than high), found {width:g}"


def _cables(values: Values) -> list[Values]:
    cables = values.get("cable")
    return cables if isinstance(cables, list) and all(isinstance(one, Mapping) for one in cables) else []


def _table(values: Values, key: str) -> Values:
    table = values.get(key)
    return table if isinstance(table, Mapping) else {}


def _number(values: Values, key: str, default: float = math.nan) -> float:
    value = values.get(key, default)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not abs(value) < 1e300:
        return math.nan
    return float(value)


def _numbers(value: Any, count: int | None = None) -> list[float]:
    """A list of numbers; of nan (or empty, without a count) where `value` is something else."""
    if isinstance(value, list) and len(value) == (count or len(value)):
        return [_number({"": one}, "") for one in value]
    return [math.nan] * (count or 0)
