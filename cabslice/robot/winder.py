"""Winders: motor angle to wound cable and back, exactly, and with it from cable lengths to motor angles.

Legend (Gueners 2021, 6.2.3; Ludvigsen's Hangprinter firmware for build-up, gears and advantage)
    theta   motor angle, rad, multi-turn, winding in is positive   phi    spool angle, theta / gear
    r       radius of the cable's centre line at phi, mm           w      wound line, integral of r dphi from 0, mm
    L       cable length P to B (kinematics.lengths), mm           line   winder to P (winder_line), mm
    n       advantage: strands between frame and platform          ES     axial stiffness of all strands, N
    t       tension, the pull of all strands on the platform, N    s      strain, t / ES

Conservation, the unstretched cable of each winder:   w(theta) + (line(theta) + n L) / (1 + s) = constant,
fixed at the home pose, where theta is winders.home_angle and the tension home_tension (default: the reference tension).

The radius is piecewise linear in phi, so w is piecewise quadratic and C1; both directions are exact, by searching the
piece and solving a quadratic.  Below the first ramp the radius stays (there is no layer below 0); past the last known
layer, or outside winders.span, the answer is refused, never extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.kinematics import lengths as cable_lengths
from cabslice.robot.model import Robot, WinderColumns
from cabslice.robot.winder_line import WinderLine, constants, line_at, line_to_pulley

__all__ = [
    "FreeCable", "angle_of", "free_cable", "layer", "line_to_pulley", "loaded_length", "motor_angles", "motor_rates",
    "pulley_lengths_of", "radius", "transmission", "transmission_bounds", "wound",
]


@dataclass(frozen=True)
class _Pieces:
    """Pieces of r(phi), each anchored at its lower end (the first at its upper): columns (m, 2n)."""

    phi: Array      # rad
    radius: Array   # mm
    rate: Array     # mm/rad wound at the anchor: hypot(radius, axial)
    slope: Array    # mm/rad, of the radius
    wound: Array    # mm


def _pieces(winders: WinderColumns) -> _Pieces:
    turns = 2 * np.pi * np.arange(winders.radii.shape[1])
    starts, ends = winders.ramp_start[:, None] + turns, winders.ramp_end[:, None] + turns[:-1]
    knots, heights = np.empty((2, len(starts), 2 * len(turns)))
    knots[:, 0], knots[:, 1::2], knots[:, 2::2] = starts[:, 0], starts, ends
    heights[:, 0], heights[:, 1::2], heights[:, 2::2] = winders.radii[:, 0], winders.radii, winders.radii[:, 1:]
    slope = np.broadcast_to(winders.slope[:, None], knots.shape).copy()
    slope[:, 1:-1:2] += np.diff(winders.radii) / (winders.ramp_end - winders.ramp_start)[:, None]
    heights += winders.slope[:, None] * knots
    rate, width = np.hypot(heights, winders.axial[:, None]), np.diff(knots)
    gained = width * (rate[:, :-1] + rate[:, 1:]) / 2
    below = knots[:, :1] * (rate[:, :1] - slope[:, :1] * knots[:, :1] / 2)
    pieces = _Pieces(knots, heights, rate, slope, np.concatenate((below, below + np.cumsum(gained, axis=1)), axis=1))
    offset = _wound(pieces, np.zeros((1, len(knots))))
    return _Pieces(knots, heights, rate, slope, pieces.wound - offset.T)


def _find(knots: Array, values: Array) -> tuple[Array, Array]:
    """Index pair of the piece that holds each of values (K, m)."""
    piece = np.empty(values.shape, np.intp)
    for cable, column in enumerate(knots):
        piece[:, cable] = np.searchsorted(column[1:], values[:, cable], side="right")
    return np.broadcast_to(np.arange(len(knots)), values.shape), piece


def _wound(pieces: _Pieces, phi: Array) -> Array:
    at = _find(pieces.phi, phi)
    x = phi - pieces.phi[at]
    return pieces.wound[at] + x * (pieces.rate[at] + pieces.slope[at] * x / 2)


def _radius(pieces: _Pieces, phi: Array) -> tuple[Array, Array]:
    at = _find(pieces.phi, phi)
    return pieces.radius[at] + pieces.slope[at] * (phi - pieces.phi[at]), pieces.slope[at]


def _phi(pieces: _Pieces, wound: Array) -> Array:
    at = _find(pieces.wound, wound)
    y, rate = wound - pieces.wound[at], pieces.rate[at]
    # nan, not a warning, where a spiral was unwound to less than nothing: _check names it
    square = rate**2 + 2 * pieces.slope[at] * y
    return pieces.phi[at] + 2 * y / (rate + np.sqrt(np.where(square >= 0, square, np.nan)))


def wound(winders: WinderColumns, angle: Array) -> Array:
    """Line on the winder since motor angle 0, (K, m) mm (negative below), for motor angles (K, m) rad.

    The exact integral of the radius (Gueners 2021, 6.2.3, who divides by the current radius instead).
    Raises PoseError outside winders.span.
    """
    angle = _check(winders, np.asarray(angle, float))
    return _wound(_pieces(winders), angle / winders.gear)


def angle_of(winders: WinderColumns, wound: Array) -> Array:
    """Motor angles (K, m) rad at which `wound` (K, m) mm is on the winder: the exact inverse of `wound`.

    Raises PoseError outside winders.span.
    """
    return _check(winders, _phi(_pieces(winders), np.asarray(wound, float)) * winders.gear)


def radius(winders: WinderColumns, angle: Array) -> Array:
    """Radius of the cable's centre line where it meets the winder, (K, m) mm. Raises PoseError outside winders.span."""
    angle = _check(winders, np.asarray(angle, float))
    return _radius(_pieces(winders), angle / winders.gear)[0]


def layer(winders: WinderColumns, angle: Array) -> Array:
    """Index of the layer being wound, (K, m) int: n from the end of its ramp on; 0 before the first."""
    angle = _check(winders, np.asarray(angle, float))
    turns = np.floor((angle / winders.gear - winders.ramp_end) / (2 * np.pi)).astype(int) + 1
    return np.clip(turns, 0, winders.radii.shape[1] - 1)


def transmission(winders: WinderColumns, angle: Array) -> Array:
    """Cable length wound per motor angle, (K, m) mm/rad: r / (gear n). A tension t asks for a torque of t times this.

    For a plain radial winder it is the radius.  Raises PoseError outside winders.span.
    """
    return np.hypot(radius(winders, angle), winders.axial) / (winders.gear * winders.advantage)


def transmission_bounds(winders: WinderColumns) -> tuple[Array, Array]:
    """Smallest and largest transmission (m,) mm/rad over winders.span: of any kind, for limits of speed and torque."""
    knots = _pieces(winders).phi * winders.gear[:, None]
    low, high = winders.span.T[..., None]
    # the radius is piecewise linear: its extremes are at knots or at the ends, and constant below the first knot
    lowest = np.where(np.isfinite(low), low, np.minimum(knots[:, :1], high))
    looked = np.clip(np.hstack((knots, lowest, high)), lowest, high)
    found = transmission(winders, looked.T)
    return found.min(axis=0), found.max(axis=0)


def motor_angles(robot: Robot, lengths: Array, tension: Array, *, home_tension: Array | None = None) -> Array:
    """Motor angles (K, m) rad that hold loaded `lengths` (K, m) mm, pulley entry to platform, at `tension` (K, m) N.

    `home_tension` (m,) N is what the cables carried when the encoders were set to home_angle at the home pose (default:
    robot.tension_reference).  Exact inverse of the radius part, Newton for the line to the pulley.
    Raises PoseError outside winders.span, or where the winder reaches its pulley.
    """
    return _wound_up(robot, lengths, tension, home_tension)[0]


def angles_and_levers(robot: Robot, lengths: Array, tension: Array) -> tuple[Array, Array]:
    """Motor angles (K, m) rad as motor_angles gives, and the transmission (K, m) mm/rad there."""
    return _wound_up(robot, lengths, tension, None)


def _wound_up(robot: Robot, lengths: Array, tension: Array, home_tension: Array | None) -> tuple[Array, Array]:
    from cabslice.robot.winder_kernel import wind

    winders = _winders(robot)
    pieces, strain = _pieces(winders), 1 + _strain(robot, tension)
    goal = _constant(robot, winders, home_tension) - winders.advantage * lengths / strain
    home = winders.home_angle / winders.gear
    columns = (winders.gear, winders.advantage, winders.axial, home, robot.pulley_radii, *constants(robot),
               _line(robot, winders, pieces, home[None])[0].length[0])
    strain = np.ascontiguousarray(np.broadcast_to(strain, goal.shape))
    table = np.stack((pieces.phi, pieces.radius, pieces.rate, pieces.slope, pieces.wound))
    angle, lever = np.empty((2, *goal.shape))
    wind(goal, strain, table, np.stack(np.broadcast_arrays(*columns), axis=1).astype(float), angle, lever)
    if np.isnan(angle).any():
        angle = searched_angles(robot, goal, strain)        # says what is wrong, or takes the longer way
        lever = transmission(winders, angle)
    return _check(winders, angle), lever


def searched_angles(robot: Robot, goal: Array, strain: Array) -> Array:
    """Motor angles (K, m) rad where wound + line / strain = goal (K, m) mm, all samples at once. Errors as above."""
    winders = _winders(robot)
    pieces = _pieces(winders)

    def fault(on: Array) -> tuple[Array, Array]:
        phi = _phi(pieces, on)
        line, climb, rate = _line(robot, winders, pieces, phi)
        return on + line.length / strain - goal, 1 + climb / (rate * strain)

    start = goal - _line(robot, winders, pieces, winders.home_angle[None] / winders.gear)[0].length / strain
    return _check(winders, _phi(pieces, _newton(fault, start)) * winders.gear)


def pulley_lengths_of(robot: Robot, angle: Array, tension: Array, *, home_tension: Array | None = None) -> Array:
    """Loaded lengths (K, m) mm, pulley entry to platform, at motor angles (K, m) rad and tensions (K, m) N.

    The inverse of `motor_angles`, closed form.  Raises PoseError outside winders.span.
    """
    winders = _winders(robot)
    pieces, phi = _pieces(winders), _check(winders, np.asarray(angle, float)) / winders.gear
    rest = _constant(robot, winders, home_tension) - _wound(pieces, phi)
    line = _line(robot, winders, pieces, phi)[0].length
    return (rest * (1 + _strain(robot, tension)) - line) / winders.advantage


def motor_rates(
    robot: Robot, angle: Array, lengths: Array, tension: Array, length_rates: Array, tension_rates: Array
) -> Array:
    """Motor speeds (K, m) rad/s: the time derivative of the conservation, for mm, N, mm/s and N/s (all (K, m))."""
    winders = _winders(robot)
    pieces, phi = _pieces(winders), _check(winders, np.asarray(angle, float)) / winders.gear
    strain, stretching = 1 + _strain(robot, tension), _strain(robot, tension_rates)
    line, climb, rate = _line(robot, winders, pieces, phi)
    taken = winders.advantage * length_rates - (line.length + winders.advantage * lengths) * stretching / strain
    return -winders.gear * taken / (rate * strain + climb)


@dataclass(frozen=True)
class FreeCable:
    """What the motors leave free of each cable, all (K, m) mm and mm/s."""

    rest: Array         # unstretched length of what is not wound, all strands
    line: Array         # from winder to pulley entry
    rest_rate: Array
    line_rate: Array


def free_cable(robot: Robot, angle: Array, speed: Array, *, home_tension: Array | None = None) -> FreeCable:
    """Free cable at motor angles (K, m) rad and speeds (K, m) rad/s: what they command, whatever the platform does.

    home_tension as in motor_angles.  Raises PoseError outside winders.span.
    """
    winders = _winders(robot)
    pieces, phi = _pieces(winders), _check(winders, np.asarray(angle, float)) / winders.gear
    line, climb, rate = _line(robot, winders, pieces, phi)
    turning = np.asarray(speed, float) / winders.gear
    rest = _constant(robot, winders, home_tension) - _wound(pieces, phi)
    return FreeCable(rest, line.length, -rate * turning, climb * turning)


def loaded_length(robot: Robot, lengths: Array, angle: Array) -> Array:
    """Whole loaded length of each cable (K, m) mm, winder to platform: what sets its axial stiffness.

    Of n strands only one reaches the winder, so the line between them counts 1/n: with ES of all strands the platform
    feels ES / rest length.  Without winders: `lengths` as they are.
    """
    if robot.winders is None:
        return lengths
    winders, angle = robot.winders, _check(robot.winders, np.asarray(angle, float))
    return _line(robot, winders, _pieces(winders), angle / winders.gear)[0].length / winders.advantage + lengths


def _line(robot: Robot, winders: WinderColumns, pieces: _Pieces, phi: Array) -> tuple[WinderLine, Array, Array]:
    """The line to the pulley at spool angles, its growth and what is wound per spool angle (mm/rad)."""
    reach, slope = _radius(pieces, phi)
    line = line_at(robot, reach, winders.axial * (phi - winders.home_angle / winders.gear))
    return line, line.by_radius * slope + line.by_offset * winders.axial, np.hypot(reach, winders.axial)


def _constant(robot: Robot, winders: WinderColumns, home_tension: Array | None) -> Array:
    """Unstretched cable of each winder, (m,) mm: what stays the same."""
    pieces, phi = _pieces(winders), (_check(winders, winders.home_angle[None]) / winders.gear)
    tension = robot.tension_reference if home_tension is None else np.asarray(home_tension, float)
    line = _line(robot, winders, pieces, phi)[0].length + winders.advantage * cable_lengths(robot, robot.home[None])
    return (_wound(pieces, phi) + line / (1 + _strain(robot, tension)))[0]


def _strain(robot: Robot, tension: Array) -> Array:
    return np.asarray(tension, float) / robot.axial_stiffness


def _newton(fault: Callable[[Array], tuple[Array, Array]], x: Array, tolerance: float = 1e-10, most: int = 20) -> Array:
    """Root of a nearly linear batched function; `fault` gives value and derivative."""
    for _ in range(most):
        value, derivative = fault(x)
        step = value / derivative
        x = x - step
        if not np.any(np.abs(step) > tolerance + 4 * np.spacing(np.abs(x))):
            return x
    raise PoseError("the line between a winder and its pulley changes faster than the winder winds")


def _check(winders: WinderColumns, angle: Array) -> Array:
    low, high = winders.span.T
    slack = 1e-9
    wrong = ~((angle >= low - slack) & (angle <= high + slack))
    if wrong.any():
        row, cable = (int(i) for i in np.argwhere(wrong)[0])
        raise PoseError(
            f"winder {cable + 1} at sample {row}: motor angle {angle[row, cable]:.4f} rad is outside what it holds, "
            f"expected {low[cable]:.4f} to {high[cable]:.4f} rad", cable=cable + 1, sample=row,
            value=float(angle[row, cable]), span=(float(low[cable]), float(high[cable])))
    return angle


def _winders(robot: Robot) -> WinderColumns:
    if robot.winders is None:
        raise ValueError(f"robot {robot.name!r} has no winders")
    return robot.winders
