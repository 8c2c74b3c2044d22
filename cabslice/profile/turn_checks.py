"""What must hold of platform.turn, how the platform is turned while it prints."""

from __future__ import annotations

import itertools
import math

from cabslice.profile.values import Faults, Values, number, numbers, table

AXES = ("x_mm", "y_mm", "z_mm")


def turn_faults(values: Values) -> Faults:
    """All but that it is level at home, which is known where the robot is made (robot.turning)."""
    platform = table(values, "platform")
    turn, place = table(platform, "turn"), ("platform", "turn")
    if not turn:
        return
    knots = [numbers(turn.get(name, [0.0])) for name in AXES]
    given = turn.get("angles_deg")
    angles = [numbers(one, 3) for one in given] if isinstance(given, list) else []
    if not angles or not all(math.isfinite(one) for row in (*knots, *angles) for one in row):
        return
    for name, row in zip(AXES, knots, strict=True):
        if any(after <= before for before, after in itertools.pairwise(row)):
            yield (*place, name), f"expected rising places, found {row}"
            return
    wanted = math.prod(map(len, knots))
    if len(angles) != wanted:
        yield (*place, "angles_deg"), f"expected angles for {wanted} knots, found {len(angles)}"
        return
    yield from _bounds(platform, angles)
    if any(any(row) for row in angles) and not {"rx", "ry", "rz"} <= set(values.get("freedoms", ("rx", "ry", "rz"))):
        yield place, "expected a platform whose turns are held by its cables (freedoms rx, ry, rz)"


def _bounds(platform: Values, angles: list[list[float]]) -> Faults:
    for name, default, columns in (("tilt_max_deg", 5.0, (0, 1)), ("yaw_max_deg", 15.0, (2,))):
        most = number(platform, name, default)
        worst = max((abs(row[i]) for row in angles for i in columns), default=0.0)
        if worst > most + 1e-9:
            yield ("platform", "turn", "angles_deg"), f"expected at most platform.{name} = {most:g}, found {worst:g}"
