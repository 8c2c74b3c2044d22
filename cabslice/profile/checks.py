"""What must hold between the keys of a profile: each check takes the merged table and yields (place, sentence).

They run on the table before it is typed, so that they report beside faults of type and bound. A number that is
missing or is no number becomes nan, and nan breaks no relation: its own fault is reported elsewhere.

Legend
    a_i, c_i    anchor (machine frame), attachment (platform frame), mm       b_i = home + c_i
    u_i         unit vector from attachment to anchor                         e_z pulley axis
    W           wrench matrix at home, columns [u_i ; c_i x u_i / s], s the largest lever: all entries of order 1
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cabslice.profile.cable_checks import MISSING, cable_faults
from cabslice.profile.placeholders import PLACEHOLDERS, strangers
from cabslice.profile.turn_checks import turn_faults
from cabslice.profile.values import Faults, Values, cables_of, number, numbers, table

__all__ = ["MISSING", "relations"]

FREEDOMS = ("x", "y", "z", "rx", "ry", "rz")
LEAST_SINE = 1e-3                         # of the angle between two rails
RANK_TOLERANCE = 1e-6                     # of the largest singular value


def relations(kind: str, values: Values) -> Faults:
    """All faults of a merged profile that concern more than one number."""
    yield from {"printers": _printer, "materials": _material, "processes": _process}[kind](values)


def _printer(values: Values) -> Faults:
    platform, cables = table(values, "platform"), cables_of(values)
    home = numbers(platform.get("home_mm", [0.0, 0.0, 0.0]), 3)
    yield from _inertia(platform)
    yield from _bodies(values)
    yield from _home_over_bed(values, home)
    yield from turn_faults(values)
    yield from _own_lines(table(values, "gcode"))
    for index, cable in enumerate(cables):
        for place, sentence in cable_faults(cable, home):
            yield ("cable", index, *place), sentence
        if "winder" not in cable and any("winder" in other for other in cables):
            yield ("cable", index, "winder"), MISSING
    yield from _kind(values, home)
    if number(table(values, "extruder"), "pressure_advance_s", 0.0) > 0 and (
            number(table(values, "motion"), "smoothing_ms", 5.0) == 0):
        yield ("extruder", "pressure_advance_s"), (
            "expected 0 where motion.smoothing_ms is 0: acceleration that steps would make the filament jump")
    yield from _freedoms(values, cables, home)


def _kind(values: Values, home: list[float]) -> Faults:
    """Cables, or a Delta whose arms reach home with the carriages on their rails."""
    own, other = ("delta", "cable") if values.get("kind") == "linear-delta" else ("cable", "delta")
    if own not in values:
        yield (own,), MISSING
    if other in values:
        yield (other,), f'a printer of kind "{values.get("kind", "cable")}" has no such table'
    elif own == "delta":
        yield from _rails(table(values, "delta"), home)


def _rails(delta: Values, home: list[float]) -> Faults:
    arm, radius = number(delta, "arm_mm"), number(delta, "radius_mm")
    low, high = numbers(delta.get("travel_mm"), 2)
    if low >= high:
        yield ("delta", "travel_mm"), f"expected the lower height first, found {low:g} and {high:g}"
    angles = [math.radians(angle) for angle in numbers(delta.get("rail_angles_deg", [0.0, 120.0, 240.0]), 3)]
    sines = [math.sin(two - one) for one, two in zip(angles, [*angles[1:], angles[0]], strict=True)]
    if min(sines) < LEAST_SINE and max(sines) > -LEAST_SINE:
        yield ("delta", "rail_angles_deg"), "expected three rails all around, in turn"
    for rail, angle in enumerate(angles, start=1):
        level = math.hypot(home[0] - radius * math.cos(angle), home[1] - radius * math.sin(angle))
        if level >= arm * math.sin(math.radians(number(delta, "max_arm_angle_deg"))):
            yield ("delta", "arm_mm"), (
                f"expected arms that reach home within max_arm_angle_deg, found {level:g} mm to bridge in the level "
                f"plane from rail {rail}")
        elif not math.isnan(level + arm) and not low <= (q := home[2] + math.sqrt(arm**2 - level**2)) <= high:
            yield ("delta", "travel_mm"), f"expected carriage {rail} on its rail at home, at {q:g} mm"


def _own_lines(gcode: Values) -> Faults:
    for key, lines in gcode.items():
        for name in strangers(lines) if isinstance(lines, str) else ():
            yield ("gcode", key), f"{{{name}}} is no placeholder; expected one of {', '.join(PLACEHOLDERS)}"


def _bodies(values: Values) -> Faults:
    """Corners of a body span a volume."""
    wrong = "expected at least four corners that are not in one plane"
    for name in ("platform", "nozzle"):
        corners = table(values, name).get("hull_mm")
        if isinstance(corners, list) and corners and not _spans(corners):
            yield (name, "hull_mm"), wrong
    given = values.get("obstacles_mm")
    for index, body in enumerate(given if isinstance(given, list) else []):
        if isinstance(body, list) and not _spans(body):
            yield ("obstacles_mm", index), wrong


def _spans(corners: list[Any]) -> bool:
    import numpy as np

    points = np.array([numbers(corner, 3) for corner in corners])
    if not np.isfinite(points).all():
        return True                          # each number has its own fault
    return len(points) > 3 and bool(np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) == 3)


def _inertia(platform: Values) -> Faults:
    """The principal moments of a body are positive and obey the triangle inequality."""
    inertia = numbers(platform.get("inertia_kg_mm2"), 3)
    products = numbers(platform.get("inertia_products_kg_mm2", [0.0, 0.0, 0.0]), 3)
    if any(products):
        inertia = _principal(inertia, products)
    largest, smallest = max(inertia), min(inertia)
    if largest > (sum(inertia) - largest) * (1 + 1e-9):
        yield ("platform", "inertia_kg_mm2"), (
            f"no body has this inertia: expected each moment at most the sum of the other two, found {largest:g} > "
            f"{sum(inertia) - largest:g}")
    elif any(products) and smallest <= 0:
        yield ("platform", "inertia_products_kg_mm2"), (
            f"no body has this inertia: expected principal moments above 0, found {smallest:g}")


def _principal(diagonal: list[float], products: list[float]) -> list[float]:
    import numpy as np

    (xx, yy, zz), (xy, xz, yz) = diagonal, products
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    known = np.isfinite(matrix).all()
    return [float(one) for one in np.linalg.eigvalsh(matrix)] if known else [float("nan")] * 3


def _home_over_bed(values: Values, home: list[float]) -> Faults:
    bed, offset = number(table(values, "bed"), "z_mm"), numbers(table(values, "nozzle").get("offset_mm"), 3)
    if home[2] + offset[2] < bed:
        yield ("bed", "z_mm"), (
            f"expected the bed below the nozzle at home (z = {home[2] + offset[2]:g} mm), found {bed:g}")


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

    anchors = np.array([numbers(cable.get("anchor_mm"), 3) for cable in cables])
    attachments = np.array([numbers(cable.get("attachment_mm"), 3) for cable in cables])
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
        low, high = numbers(values.get(key), 2)
        if low > high:
            yield (key,), f"expected the lowest, then the highest, found {low:g} before {high:g}"


def _process(values: Values) -> Faults:
    nozzle = number(values, "nozzle_mm")
    for layer, beads in (("layer_mm", ("bead_mm", "outer_bead_mm")), ("first_layer_mm", ("first_bead_mm",))):
        height = number(values, layer)
        if height > nozzle:
            yield (layer,), f"expected at most nozzle_mm = {nozzle:g}, found {height:g}"
        for bead in beads:
            if (width := number(values, bead)) < height:
                yield (bead,), f"expected at least {layer} = {height:g} (a bead is wider than high), found {width:g}"
    if number(table(values, "brim"), "width_mm") > 0 and number(table(values, "raft"), "layers") > 0:
        yield ("brim", "width_mm"), "expected 0 with a raft (raft.margin_mm is how far it reaches beyond the part)"
    yield from _heights(values, nozzle)


def _heights(values: Values, nozzle: float) -> Faults:
    """Layer heights that vary: each at most what the beads allow; ranges in order, one height in one range."""
    most = min(value for value in (nozzle, number(values, "bead_mm"), number(values, "outer_bead_mm")))
    adaptive, layer = table(values, "adaptive"), number(values, "layer_mm")
    low, high = number(adaptive, "min_mm", layer / 2), number(adaptive, "max_mm", layer)
    if high > most and "max_mm" in adaptive:
        yield ("adaptive", "max_mm"), f"expected at most nozzle and beads, {most:g}, found {high:g}"
    if low > high:
        yield ("adaptive", "min_mm"), f"expected at most max_mm = {high:g}, found {low:g}"
    rows = values.get("ranges")
    ranges = rows if isinstance(rows, list) and all(isinstance(one, Mapping) for one in rows) else []
    before = 0.0
    for index, one in enumerate(ranges):
        begin, end = number(one, "from_mm"), number(one, "to_mm")
        if begin < before:
            yield ("ranges", index, "from_mm"), f"expected ranges in order, from {before:g} or higher, found {begin:g}"
        if end <= begin:
            yield ("ranges", index, "to_mm"), f"expected more than from_mm = {begin:g}, found {end:g}"
        if (height := number(one, "layer_mm", layer)) > most:
            yield ("ranges", index, "layer_mm"), f"expected at most nozzle and beads, {most:g}, found {height:g}"
        before = end
