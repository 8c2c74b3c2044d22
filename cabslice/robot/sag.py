"""Cables with weight: the elastic catenary, and when a straight line is good enough.

Legend (Irvine 1981, Cable Structures, ch. 1-2; Kozak, Zhou, Wang 2006)
    x, z   horizontal and vertical way from the platform to the exit point, mm        L    chord, hypot(x, z)
    s      rest (unstretched) length, mm                                              w    weight, N/mm of rest length
    H      horizontal pull, the same all along, N                                     ES   axial stiffness, N
    P, Q   vertical pull at the platform and at the exit, Q = P + w s, N              T0, T1   tensions there, N
    d      droop: largest distance of the cable from its chord, mm                    theta    slope of the chord

    x = s H/ES + (H/w) (asinh(Q/H) - asinh(P/H))        z = s (P + Q)/(2 ES) + (T1 - T0)/w

written below so that w = 0 (a straight elastic cable) and H = 0 (a cable that hangs down) are no special cases:
(asinh(Q/H) - asinh(P/H))/w = s q log1p(w s q)/(w s q) and (T1 - T0)/w = s (P + Q)/(T0 + T1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.pulley import CableLines

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Catenary:
    """How each cable hangs; all (K, m), pull (K, m, 3)."""

    rest: Array      # mm, unstretched length between platform and exit
    tension: Array   # N, at the platform
    pull: Array      # unit vector of the cable's pull on the platform
    exit: Array      # N, tension at the exit point


@dataclass(frozen=True)
class SagEstimate:
    """First-order effect of weight on each cable, all (K, m): Irvine's parabola."""

    droop: Array       # mm, w L^2 cos(theta) / (8 t)
    length: Array      # mm, by how much the rest length differs from that of a straight weightless cable
    angle: Array       # rad, between the pull on the platform and the chord
    stiffness: Array   # share of the axial stiffness that sag takes away, 1 - 1/(1 + lambda^2/12)


def hang(chord: Array, tension: Array, weight: Array, axial_stiffness: Array) -> Catenary:
    """The catenary of each cable that pulls with `tension` (K, m) N at the platform.

    chord : (K, m, 3) mm, exit minus tip; weight : (m,) N per mm of rest length; axial_stiffness : (m,) N.
    Raises PoseError where no cable that light a pull can hold spans the chord.
    Source: Irvine 1981, eq. 1.26 and 1.27, solved by Newton for rest length and direction.
    """
    flat, x, z = _plane(chord)
    tension, weight, stiff = np.broadcast_arrays(np.asarray(tension, float), weight, axial_stiffness)
    slope, rest = np.arctan2(z, x), np.hypot(x, z) / (1 + tension / stiff)

    def gap(guess: Array) -> tuple[Array, Array]:
        slope, rest = guess
        h, p = tension * np.cos(slope), tension * np.sin(slope)
        way, by_force, by_rest = _catenary(h, p, rest, weight, stiff)
        turn = np.stack((-p, h))
        return way - [x, z], np.stack((np.einsum("ij...,j...->i...", by_force, turn), by_rest), axis=1)

    slope, rest = _newton(gap, np.stack((slope, rest)), np.stack((np.ones_like(rest), rest)))
    h, p = tension * np.cos(slope), tension * np.sin(slope)
    return Catenary(rest, tension, np.cos(slope)[..., None] * flat + np.sin(slope)[..., None] * _UP,
                    np.hypot(h, p + weight * rest))


def pull_of(chord: Array, rest: Array, weight: Array, axial_stiffness: Array) -> Catenary:
    """The catenary of each cable of rest length `rest` (K, m) mm between platform and exit: its pull, slack or taut.

    chord, weight (m,) > 0, axial_stiffness as in `hang`, its inverse.  Start values: Jayaraman and Knudson 1981.
    """
    flat, x, z = _plane(chord)
    rest, weight, stiff = np.broadcast_arrays(np.asarray(rest, float), weight, axial_stiffness)
    slack = (rest**2 - z**2) / np.maximum(x, 1e-9) ** 2
    shape = np.where(slack > 1.04, np.sqrt(3 * np.maximum(slack - 1, 0.0)), 0.2)
    strain = np.maximum(np.hypot(x, z) / rest - 1, 0.0)
    h = weight * x / (2 * shape) + stiff * strain * x / np.hypot(x, z)
    p = weight / 2 * (z / np.tanh(shape) - rest) + stiff * strain * z / np.hypot(x, z)

    def gap(guess: Array) -> tuple[Array, Array]:
        way, by_force, _ = _catenary(guess[0], guess[1], rest, weight, stiff)
        return way - [x, z], by_force

    size = np.hypot(h, p) + weight * rest
    h, p = _newton(gap, np.stack((h, p)), np.stack((size, size)))
    tension = np.hypot(h, p)
    pull = (h[..., None] * flat + p[..., None] * _UP) / np.where(tension > 0, tension, 1.0)[..., None]
    return Catenary(rest, tension, pull, np.hypot(h, p + weight * rest))


def sag_estimate(lines: CableLines, tension: Array, weight: Array, axial_stiffness: Array) -> SagEstimate:
    """What weight does to cables at `tension` (K, m) N, to first order in w L / t.

    weight (m,) N/mm; lines from kinematics.cables.  lambda^2 = (w L cos(theta)/t)^2 ES/t is Irvine's parameter
    (Irvine 1981, 2.4).  The length is that of the arc (w L cos(theta)/t)^2 L/24 plus the stretch of its own weight.
    """
    chord = lines.exit - lines.tip
    tension, weight, length = np.asarray(tension, float), np.asarray(weight, float), lines.free
    load = weight * np.hypot(chord[..., 0], chord[..., 1]) / tension
    stretch = length * weight * np.abs(chord[..., 2]) / (2 * axial_stiffness)
    share = load**2 * axial_stiffness / tension / 12
    return SagEstimate(load * length / 8, load**2 * length / 24 + stretch, load / 2, share / (1 + share))


def straight_enough(
    estimate: SagEstimate, *, length_mm: float = 0.01, stiffness_share: float = 0.02
) -> Array:
    """True (K, m) where a straight cable is good enough: rest length and axial stiffness hold within these limits."""
    return (estimate.length <= length_mm) & (estimate.stiffness <= stiffness_share)


def _plane(chord: Array) -> tuple[Array, Array, Array]:
    """Horizontal unit vector (K, m, 3) of each cable's vertical plane, and the chord in it."""
    x = np.hypot(chord[..., 0], chord[..., 1])
    flat = chord * [1.0, 1.0, 0.0] / np.where(x > 0, x, 1.0)[..., None]
    return flat, x, chord[..., 2]


def _catenary(h: Array, p: Array, rest: Array, weight: Array, stiff: Array) -> tuple[Array, Array, Array]:
    """Way (2, ...) from platform to exit, its derivatives with (H, P) (2, 2, ...) and with the rest length (2, ...)."""
    q = p + weight * rest
    t0, t1 = np.hypot(h, p), np.hypot(h, q)
    # from the end that pulls down the less, so that nothing cancels on steep cables: low = T + its vertical pull
    a, ta = np.where(p + q >= 0, p, -q), np.where(p + q >= 0, t0, t1)
    low = np.where(a > 0, ta + a, h * h / np.where(a > 0, 1.0, ta - a))
    rise = (1 + np.abs(p + q) / (t0 + t1)) / np.where(low > 0, low, 1.0)
    turn = rest * rise * _log_share(weight * rest * rise)
    climb = rest * (p + q) / (t0 + t1)
    way = np.stack((h * rest / stiff + h * turn, rest * (p + q) / (2 * stiff) + climb))
    across = rest * (t0 - p * (p + q) / (t0 + t1)) / (t0 * t1)
    mixed = -h * climb / (t0 * t1)
    flex = rest / stiff
    by_force = np.stack((np.stack((flex + turn - across, mixed)), np.stack((mixed, flex + across))))
    return way, by_force, np.stack((h, q)) * (1 / stiff + 1 / t1)


def _log_share(x: Array) -> Array:
    """log1p(x)/x, 1 at 0."""
    return np.where(x == 0, 1.0, np.log1p(x) / np.where(x == 0, 1.0, x))


def _newton(gap: Callable[[Array], tuple[Array, Array]], guess: Array, scale: Array, most: int = 80) -> Array:
    """Root of a batch of two equations in two unknowns; steps limited to a third of `scale` while far."""
    for _ in range(most):
        value, slope = gap(guess)
        determinant = slope[0, 0] * slope[1, 1] - slope[0, 1] * slope[1, 0]
        step = np.stack((slope[1, 1] * value[0] - slope[0, 1] * value[1],
                         slope[0, 0] * value[1] - slope[1, 0] * value[0])) / determinant
        size = np.abs(step / scale).max(axis=0)
        guess = guess - step / np.maximum(1.0, 3 * size)
        if not np.any(~(size < 1e-13)):
            return guess
        if not np.isfinite(guess).all():
            break
    if np.nanmax(size) < 1e-9:
        return guess
    worst = np.unravel_index(np.argmax(np.where(np.isfinite(size), size, np.inf)), size.shape)
    cable, pose = int(worst[-1]) + 1, int(worst[0])
    fault = f"cable {cable} at pose {pose}: no catenary found, expected more tension for its weight"
    raise PoseError(fault, cable=cable, pose=pose)
