"""The orientation of the platform while it prints: a smooth function of where the nozzle is.

Legend
    q            nozzle, bed coordinates, mm                 a(q)   angles psi, theta, phi, rad; R = Rx Ry Rz
    x_i y_j z_k  knots, mm                                   v_ijk  the angles there
    w(t)         6 t^5 - 15 t^4 + 10 t^3: from one knot to the next the angles go as w does, and stay outside. C2, and
                 never beyond the angles at the knots
    s            path parameter, q(s);  omega' = T da/ds, alpha' its derivative: for a motion s(t) the angular velocity
                 is omega' ds/dt, its rate omega' d2s/dt2 + alpha' (ds/dt)^2
    T            columns e_x, Rx e_y, Rx Ry e_z
    V            along one axis: what all three angles change at most in total up to there. The rotation between two
                 places in a box is at most what the three V grow across it (angles of successive turns add at most)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import ProfileError
from cabslice.robot.rotation import cross, from_angles, matrix

LEVEL_DEG = 1e-9


@dataclass(frozen=True)
class Turning:
    """Knots rise; an axis with one knot is an axis along which nothing changes."""

    x: Array         # (I,) mm, bed coordinates
    y: Array         # (J,) mm
    z: Array         # (K,) mm
    angles: Array    # (I, J, K, 3) rad

    def __post_init__(self) -> None:
        shape = Shapes("Turning")
        columns = {name: shape.column(name, getattr(self, name), size) for name, size in zip("xyz", "IJK", strict=True)}
        set_columns(self, **columns, angles=shape.column("angles", self.angles, "I J K 3"))
        if any((np.diff(column) <= 0).any() for column in columns.values()):
            raise ValueError("the knots of Turning do not rise")

    def vectors(self, xyz: Array) -> Array:
        """Rotation vectors (K, 3) rad with the nozzle at xyz (K, 3) mm."""
        return from_angles(_terms(self, xyz)[0])

    def matrices(self, xyz: Array) -> Array:
        """R (K, 3, 3)."""
        return matrix(self.vectors(xyz))

    def rates(self, xyz: Array, d1: Array, d2: Array) -> tuple[Array, Array]:
        """omega' and alpha' (K, 3), rad per unit of s, for q' and q'' (K, 3)."""
        angles, slope, bend = _terms(self, xyz)
        first = np.einsum("kca,ka->kc", slope, d1)
        second = np.einsum("kca,ka->kc", slope, d2) + np.einsum("kcab,ka,kb->kc", bend, d1, d1)
        zero = np.zeros(len(angles))
        about_x = matrix(np.stack((angles[:, 0], zero, zero), axis=1))
        about_y = matrix(np.stack((zero, angles[:, 1], zero), axis=1))
        axes = np.stack((np.broadcast_to([1.0, 0.0, 0.0], angles.shape), about_x[:, :, 1],
                         (about_x @ about_y)[:, :, 2]), axis=1)
        omega = np.einsum("kc,kci->ki", first, axes)
        inner, outer = first[:, :1] * axes[:, 0], first[:, :1] * axes[:, 0] + first[:, 1:2] * axes[:, 1]
        alpha = np.einsum("kc,kci->ki", second, axes)
        alpha += cross(inner, first[:, 1:2] * axes[:, 1]) + cross(outer, first[:, 2:] * axes[:, 2])
        return omega, alpha

    def change(self, low: Array, middle: Array, high: Array) -> Array:
        """(K,) rad: at most so far R can be from that at `middle`, anywhere in boxes with corners low, high (K, 3)."""
        total = np.zeros(len(middle))
        for axis in range(3):
            if len(self._knots(axis)) > 1:
                ends = [self._travelled(axis, corner[:, axis]) for corner in (low, middle, high)]
                total += np.maximum(ends[2] - ends[1], ends[1] - ends[0])
        return total

    def _knots(self, axis: int) -> Array:
        return (self.x, self.y, self.z)[axis]

    def _travelled(self, axis: int, place: Array) -> Array:
        """V (K,) rad."""
        cell, w, _, _ = _between(self._knots(axis), place)
        others = tuple(i for i in range(3) if i != axis)
        steps = np.abs(np.diff(self.angles, axis=axis)).sum(axis=3).max(axis=others)
        before = np.concatenate(([0.0], np.cumsum(steps)))
        return np.asarray(before[cell] + w * steps[cell])


def platform_motion(
    turning: Turning | None, nozzle: Array | None, to_pose: Array, xyz: Array, d1: Array, d2: Array
) -> tuple[Array, Array, Array]:
    """Poses, rates and accels (K, 6) of the platform for a motion of the nozzle, xyz and its derivatives (K, 3).

    to_pose (3,) mm: origin of the platform, level, in the machine frame less the nozzle in bed coordinates; nozzle (3,)
    mm in the platform frame. Derivatives are by whatever d1 and d2 are by (angular velocity and its rate).
    """
    poses, rates, accels = np.zeros((3, len(xyz), 6))
    poses[:, :3], rates[:, :3], accels[:, :3] = xyz + to_pose, d1, d2
    if turning is None:
        return poses, rates, accels
    assert nozzle is not None
    poses[:, 3:] = turning.vectors(xyz)
    rates[:, 3:], accels[:, 3:] = omega, alpha = turning.rates(xyz, d1, d2)
    lever = matrix(poses[:, 3:]) @ nozzle
    poses[:, :3] += nozzle - lever
    swing = cross(omega, lever)
    rates[:, :3] -= swing
    accels[:, :3] -= cross(alpha, lever) + cross(omega, swing)
    return poses, rates, accels


def turning_of(printer: Any, home: Array | None) -> Turning | None:
    """From a printer profile (profile.printer.Printer); None where the platform stays level.

    home (3,) mm, bed coordinates: the nozzle with the platform at home. Raises ProfileError where it is turned there,
    or where there is no bed to turn over.
    """
    turn = printer.platform.turn
    if turn is None:
        return None
    knots = [np.array(values, float) for values in (turn.x_mm, turn.y_mm, turn.z_mm)]
    angles = np.radians(np.array(turn.angles_deg, float)).reshape(*map(len, knots), 3)
    if not angles.any():
        return None
    if home is None:
        raise ProfileError(printer.name, ["platform.turn: expected a printer with a nozzle and a bed."])
    turning = Turning(knots[0], knots[1], knots[2], angles)
    worst = float(np.degrees(np.abs(turning.vectors(home[None])).max()))
    if worst > LEVEL_DEG:
        x, y, z = home.tolist()
        raise ProfileError(printer.name, [
            f"platform.turn: expected a level platform at home, where the nozzle is at x {x:g} y {y:g} z {z:g} mm over "
            f"the bed, found {worst:.3g} deg."])
    return turning


def _between(knots: Array, place: Array) -> tuple[Array, Array, Array, Array]:
    """The cell (K,) a place lies in, w there and its two derivatives by the place."""
    if len(knots) < 2:
        return np.zeros(len(place), np.int64), *np.zeros((3, len(place)))
    cell = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
    wide = (knots[1:] - knots[:-1])[cell]
    t = np.clip((place - knots[cell]) / wide, 0.0, 1.0)
    first, second = 30 * (t * (1 - t)) ** 2 / wide, 60 * t * (1 - t) * (1 - 2 * t) / wide**2
    return cell, t**3 * (10 + t * (6 * t - 15)), first, second


def _terms(turning: Turning, xyz: Array) -> tuple[Array, Array, Array]:
    """a (K, 3), its first derivatives (K, 3, 3) and its second ones (K, 3, 3, 3) by q; the angle comes first."""
    cells = [_between(turning._knots(axis), xyz[:, axis]) for axis in range(3)]
    angles, slope, bend = np.zeros((len(xyz), 3)), np.zeros((len(xyz), 3, 3)), np.zeros((len(xyz), 3, 3, 3))
    for corner in np.ndindex(*(1 if n == 1 else 2 for n in turning.angles.shape[:3])):
        at = tuple(cell + step for (cell, *_), step in zip(cells, corner, strict=True))
        value = turning.angles[at]
        share = [(w, w1, w2) if step else (1 - w, -w1, -w2) for (_, w, w1, w2), step in zip(cells, corner, strict=True)]
        angles += np.prod([one[0] for one in share], axis=0)[:, None] * value
        for a in range(3):
            slope[:, :, a] += _product(share, (a,))[:, None] * value
            for b in range(3):
                bend[:, :, a, b] += _product(share, (a, b))[:, None] * value
    return angles, slope, bend


def _product(share: list[tuple[Array, Array, Array]], by: tuple[int, ...]) -> Array:
    """Of the weights along the three axes, differentiated by the places along the axes `by`."""
    return np.asarray(np.prod([share[axis][by.count(axis)] for axis in range(3)], axis=0))
