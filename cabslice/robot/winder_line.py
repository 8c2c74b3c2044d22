"""The straight cable between winder and guide pulley: a common tangent that moves as the winding radius grows.

Legend (Gueners 2021, 6.2.2; his 6.3-6.7 carry sign and quadrant slips: derived anew here)
    P, e_z   pulley entry point and arrival direction (robot.anchors, pulley_axes)     r_p   pulley radius
    E        centre of the disc, in the plane of P, e_z and E                          r     winding radius
    e        unit vector in that plane, square to e_z: the pulley centre is M = P + r_p e;
             towards E for an open tangent (disc and pulley on the same side of the cable), away if crossed
    side     +1 open, -1 crossed              c     r_p - side r: r_p + r if crossed
    T        tangent length, sqrt(|EM|^2 - c^2)
    delta    tilt of the tangent from e_z towards e, rad: atan2(EM.e, EM.e_z) - atan2(c, T)
    a        offset along the axis of a helical drum, mm: its exit point leaves the plane, T becomes sqrt(T^2 + a^2)

Counted from a cable that arrives at P along e_z, the tilt takes r_p delta off the pulley and puts side r delta on the
disc, so the line is T - c delta.  A string's length changes with a radius by the angle touched: d line/dr = side delta.
Where a cable meets the disc at its design radius (E at distance r from the e_z line) delta is 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.model import Robot


@dataclass(frozen=True)
class WinderLine:
    """All (K, m)."""

    tangent: Array     # mm, straight part
    tilt: Array        # rad, delta
    length: Array      # mm, straight part and signed wraps: winder to pulley entry
    by_radius: Array   # mm/mm, d length / d radius
    by_offset: Array   # mm/mm, d length / d offset along the drum's axis


def line_to_pulley(robot: Robot, radius: Array) -> Array:
    """Length (K, m) mm from winder to pulley entry for winding radii (K, m) mm: tangent and signed wraps.

    winders.line where the centre of the winder is not known (nan).  Raises PoseError where disc and pulley overlap.
    Source: common tangents after Gueners 2021, 6.2.2.
    """
    return line_at(robot, np.asarray(radius, float), np.zeros(1)).length


def line_at(robot: Robot, radius: Array, offset: Array) -> WinderLine:
    """The line for winding radii (K, m) mm and offsets (K, m) mm along the axis of a helical drum. Raises as above."""
    lean, along, side = _plane(robot)[2:]
    square, c = lean**2 + along**2, robot.pulley_radii - side * radius
    _refuse_overlap(robot, np.sqrt(square), radius)
    flat = np.sqrt(square - c * c)
    tangent = np.sqrt(flat**2 + offset**2)
    tilt = np.arctan2(lean, along) - np.arctan2(c, flat)
    known = np.isfinite(square)
    columns = tangent, tilt, tangent - c * tilt, side * tilt + side * c * (1 / tangent - 1 / flat), offset / tangent
    constant = 0.0, 0.0, robot.winders.line if robot.winders else 0.0, 0.0, 0.0
    return WinderLine(*(np.where(known, column, rest) for column, rest in zip(columns, constant, strict=True)))


def constants(robot: Robot) -> tuple[Array, Array, Array, Array]:
    """What line_at needs of each winder, (m,): side, EM squared (nan: centre not known), direction of EM from e, line
    where the centre is not known."""
    lean, along, side = _plane(robot)[2:]
    assert robot.winders is not None
    return side, lean**2 + along**2, np.arctan2(lean, along), robot.winders.line


def touch_points(robot: Robot, radius: Array) -> tuple[Array, Array]:
    """Where the tangent leaves the disc and where it meets the pulley, (K, m, 3) mm each, machine frame."""
    e, centre, _, _, side = _plane(robot)
    assert robot.winders is not None
    tilt = line_at(robot, np.asarray(radius, float), np.zeros(1)).tilt[..., None]
    out = -np.cos(tilt) * e + np.sin(tilt) * robot.pulley_axes
    disc = robot.winders.centre + (side * radius)[..., None] * out
    return disc, centre + robot.pulley_radii[:, None] * out


def _plane(robot: Robot) -> tuple[Array, Array, Array, Array, Array]:
    """e (m, 3), pulley centre M (m, 3), EM along e and e_z (m,), side (m,)."""
    if robot.winders is None:
        raise ValueError(f"robot {robot.name!r} has no winders")
    winders, axis = robot.winders, robot.pulley_axes
    side = np.where(winders.crossed, -1.0, 1.0)
    away = winders.centre - robot.anchors
    away = away - np.einsum("mi,mi->m", away, axis)[:, None] * axis
    # a disc centred on the axis may stand in any plane through it
    away = np.where(np.linalg.norm(away, axis=1)[:, None] < 1e-9, _square_to(axis), away)
    e = side[:, None] * away / np.linalg.norm(away, axis=1)[:, None]
    centre = robot.anchors + robot.pulley_radii[:, None] * e
    reach = centre - winders.centre
    return e, centre, np.einsum("mi,mi->m", reach, e), np.einsum("mi,mi->m", reach, axis), side


def _square_to(axis: Array) -> Array:
    least = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    return least - np.einsum("mi,mi->m", least, axis)[:, None] * axis


def _refuse_overlap(robot: Robot, distance: Array, radius: Array) -> None:
    room = distance - robot.pulley_radii - radius
    if (room <= 0).any():
        row, cable = (int(i) for i in np.argwhere(room <= 0)[0])
        raise PoseError(
            f"winder {cable + 1}: its disc of radius {radius[row, cable]:.3f} mm and the pulley of radius "
            f"{robot.pulley_radii[cable]:.3f} mm are {distance[cable]:.3f} mm apart, expected more than their sum",
            cable=cable + 1)
