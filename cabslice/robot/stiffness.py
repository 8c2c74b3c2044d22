"""How stiffly the platform is held: stiffness matrices, modes, deflections, and preload as a lever on them.

Legend (Gueners 2021, 3.2.2 and annex A)
    ES    axial stiffness, N            l0   rest length, mm         l   loaded length from winder to platform, mm
    k_i   ES/l0, N/mm                   t_i  tension, ES (l/l0 - 1)  W   wrench matrix
    u, c  cable direction, lever R c_i  v    normal of the swivel plane   w  u x v
    l_w, l_v  lengths on which a cable swings in and across the swivel plane: free length, and l + r_p tan(beta/2)
    K     -d(W t)/d(p, rotation vector) at constant l0: left perturbation, moments about the moving platform origin

K_cable = W diag(k) W^T                                   cables stretch
K_lat   = sum t/l_w A_w A_w^T + t/l_v A_v A_v^T           cables swing; A_x = (x ; c x x)
K_force = sum t [[0, 0], [0, (u . c) I - c u^T]]          levers turn (- [u]x[c]x: the thesis prints +, a misprint)
K_grav  = (g . s) I - s g^T, rotations only               the weight g turns on its lever s

Units: forces N, moments N mm, so K is N/mm, N, N mm/rad by blocks. Hz = sqrt(lambda/1e-3)/2 pi with lambda of M^-1 K.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.kinematics import cables
from cabslice.robot.model import NEWTON, Robot
from cabslice.robot.pulley import CableLines
from cabslice.robot.rotation import cross, matrix
from cabslice.robot.tension import Tensions, nearest
from cabslice.robot.wrench import mass_matrix, required_wrench, wrench_matrix

HALVINGS = 40        # of the range of preload: to 1e-10 of it


@dataclass(frozen=True)
class Stiffness:
    """The parts of K, each (K, 6, 6): N/mm, N (mixed blocks), N mm/rad. nan where the tension is."""

    cable: Array
    lateral: Array
    force: Array

    @property
    def total(self) -> Array:
        return self.cable + self.lateral + self.force

    def shares(self) -> tuple[Array, Array, Array]:
        """Shares (K, 6) of cable, lateral and force part in the diagonal of the total."""
        whole = _diagonal(self.total)
        return _diagonal(self.cable) / whole, _diagonal(self.lateral) / whole, _diagonal(self.force) / whole


@dataclass(frozen=True)
class Preload:
    """The reference tension that brings the first mode to a target, at K poses."""

    level: Array         # (K,) N, the same reference for all cables; nan where not reached
    reached: Array       # (K,) bool
    first_hz: Array      # (K,) at that level; where not reached, the nearest that feasible levels give
    tension: Array       # (K, m) N at that level, nan where not reached


def rest_lengths(robot: Robot, loaded: Array, tension: Array) -> Array:
    """Unstretched lengths l0 (K, m) mm of cables that are `loaded` (K, m) mm long under tension (K, m) N.

    l0 = ES l / (t + ES), linear elastic.
    """
    return robot.axial_stiffness * loaded / (tension + robot.axial_stiffness)


def elastic_tensions(robot: Robot, loaded: Array, rest: Array) -> Array:
    """Tension (K, m) N of cables stretched from rest to loaded length, 0 where slack: ES max(0, l/l0 - 1)."""
    return robot.axial_stiffness * np.maximum(0.0, loaded / rest - 1.0)


def cable_stiffness(robot: Robot, loaded: Array, tension: Array) -> Array:
    """k (K, m) N/mm of each whole cable, ES/l0: exact for a linear elastic cable."""
    return (tension + robot.axial_stiffness) / loaded


def stiffness(
    robot: Robot, poses: Array, tension: Array, *, line: Array | float = 0.0, lines: CableLines | None = None
) -> Stiffness:
    """K at poses (K, 6) under tension (K, m) N, in its three parts.

    line (m,) or (K, m) mm is the loaded cable between winder and pulley; it only makes the cables longer, and softer.
    `lines`: what kinematics.cables gave, if at hand. Source: Gueners 2021, 3.2.2, annex A; swivel after Pott 2012.
    Raises PoseError as kinematics.cables.
    """
    lines = lines or cables(robot, poses)
    axial = cable_stiffness(robot, lines.length + line, tension)
    wrench = wrench_matrix(robot, poses, lines=lines)
    aside = _across(lines)
    swing, swivel = (_columns(lines.lever, way) for way in (cross(lines.unit, aside), aside))
    force = np.zeros((len(lines.tip), 6, 6))
    turned = np.swapaxes(tension[..., None] * lines.lever, 1, 2) @ lines.unit
    force[:, 3:, 3:] = np.trace(turned, axis1=1, axis2=2)[:, None, None] * np.eye(3) - turned
    return Stiffness(
        cable=_gram(wrench, axial), force=force,
        lateral=_gram(swing, tension / lines.free) + _gram(swivel, tension * lines.lateral),
    )


def gravity_stiffness(robot: Robot, poses: Array) -> Array:
    """Stiffness (K, 6, 6) N mm/rad of the weight hanging off the platform origin; zero for a centre of mass there."""
    lever = matrix(np.asarray(poses, dtype=float)[:, 3:]) @ robot.centre_of_mass
    weight = NEWTON * robot.mass * robot.gravity
    out = np.zeros((len(lever), 6, 6))
    out[:, 3:, 3:] = (lever @ weight)[:, None, None] * np.eye(3) - lever[:, :, None] * weight
    return out


def modes(robot: Robot, poses: Array, stiff: Array) -> tuple[Array, Array]:
    """Natural frequencies (K, f) Hz, rising, and mode shapes (K, 6, f) of the f freedoms held.

    stiff (K, 6, 6) is any K, as stiffness(...).total + gravity_stiffness(...). Shapes are (mm, rad) at the platform
    origin, of unit modal mass (kg mm^2). An unstable direction comes as a negative frequency, -sqrt(-lambda)/2 pi; nan
    stays nan. Only the symmetric part of K counts: K is symmetric at equilibrium, gravity included.
    """
    held = np.flatnonzero(robot.freedoms)
    lower = np.linalg.cholesky(mass_matrix(robot, poses, masked=True))
    known = np.array(np.isfinite(stiff).all(axis=(1, 2)))
    inner = np.where(known[:, None, None], stiff, 0.0)[:, held[:, None], held]
    inverse = np.linalg.inv(lower)
    inner = inverse @ (inner + inner.swapaxes(1, 2)) / 2 @ inverse.swapaxes(1, 2)
    values, vectors = np.linalg.eigh(inner)
    shapes = np.zeros((len(stiff), 6, len(held)))
    shapes[:, held] = inverse.swapaxes(1, 2) @ vectors
    hertz = np.copysign(np.sqrt(np.abs(values) / NEWTON), values) / (2 * np.pi)
    hertz[~known], shapes[~known] = np.nan, np.nan
    return hertz, shapes


def first_modes(robot: Robot, poses: Array, tension: Array, *, line: Array | float = 0.0) -> Array:
    """The lowest natural frequency (K,) Hz with the whole K and gravity, under tension (K, m) N."""
    whole = stiffness(robot, poses, tension, line=line).total + gravity_stiffness(robot, poses)
    return modes(robot, poses, whole)[0][:, 0]


def deflection(robot: Robot, poses: Array, stiff: Array, wrench: Array, *, point: Array | None = None) -> Array:
    """How far (K, 3) mm a point of the platform moves under a further wrench (K, 6) N, N mm at the platform origin.

    stiff (K, 6, 6) as for modes; point (3,) mm in the platform frame, the nozzle where absent (the origin without one).
    Raises PoseError where K is singular. wrench_of_force gives the wrench of a force that acts elsewhere.
    """
    held, motion = np.flatnonzero(robot.freedoms), np.zeros((len(stiff), 6))
    inner = stiff[:, held[:, None], held]
    try:
        motion[:, held] = np.linalg.solve(inner, np.asarray(wrench, dtype=float)[:, held, None])[..., 0]
    except np.linalg.LinAlgError:
        loose = int(np.linalg.matrix_rank(inner, hermitian=False).argmin())
        raise PoseError(f"pose {loose}: the stiffness matrix is singular, expected a platform held in all freedoms",
                        pose=loose) from None
    return motion[:, :3] + cross(motion[:, 3:], _lever(robot, poses, point))


def point_compliance(robot: Robot, poses: Array, stiff: Array, *, point: Array | None = None) -> Array:
    """Compliance (K, 3, 3) mm/N of a platform point (3,) mm (default: nozzle) against forces that act on it."""
    columns = [deflection(robot, poses, stiff, wrench_of_force(robot, poses, axis, point=point), point=point)
               for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def wrench_of_force(robot: Robot, poses: Array, force: Array, *, point: Array | None = None) -> Array:
    """Wrench (K, 6) at the platform origin of a force (K, 3) N on a point of the platform (3,) mm (default: nozzle)."""
    force = np.broadcast_to(force, (len(poses), 3))
    return np.concatenate((force, cross(_lever(robot, poses, point), force)), axis=1)


def preload_for_mode(robot: Robot, poses: Array, target_hz: float, *, required: Array | None = None) -> Preload:
    """The reference tension at which the nearest feasible tensions bring the first mode to target_hz.

    Halves the range between the highest lower and the lowest upper bound; required (K, 6) is the platform's own weight
    where absent. The first mode rises with the level where preload is what stiffens it; where the ends of the range do
    not enclose the target, reached is False.
    """
    count = len(poses)
    wrench = wrench_matrix(robot, poses, masked=True)
    needed = (required_wrench(robot, poses) if required is None else required)[:, robot.freedoms]

    def at(level: Array) -> tuple[Array, Tensions]:
        reference = np.repeat(level[:, None], robot.cables, axis=1)
        held = nearest(wrench, needed, robot.tension_min, robot.tension_max, reference)
        return first_modes(robot, poses, held.tension), held

    low, high = np.full(count, robot.tension_min.max()), np.full(count, robot.tension_max.min())
    ends = np.stack((at(low)[0], at(high)[0]))
    reached = (ends.min(axis=0) <= target_hz) & (target_hz <= ends.max(axis=0))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = (at(middle)[0] < target_hz) == (ends[0] <= ends[1])
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    first, held = at((low + high) / 2)
    nearer = np.where(np.abs(ends[0] - target_hz) <= np.abs(ends[1] - target_hz), ends[0], ends[1])
    return Preload(
        level=np.where(reached, (low + high) / 2, np.nan), reached=reached, first_hz=np.where(reached, first, nearer),
        tension=np.where(reached[:, None], held.tension, np.nan),
    )


def _across(lines: CableLines) -> Array:
    """v (K, m, 3); any vector across the cable where an eyelet's swivel plane is undefined (cable along the axis)."""
    side = lines.side
    lost = np.einsum("kmi,kmi->km", side, side) < 0.5
    if lost.any():
        unit = lines.unit[lost]
        other = cross(unit, np.eye(3)[np.abs(unit).argmin(axis=1)])
        side = side.copy()
        side[lost] = other / np.linalg.norm(other, axis=1, keepdims=True)
    return side


def _columns(lever: Array, ways: Array) -> Array:
    """Wrenches (K, 6, m) of unit forces along ways (K, m, 3) at levers (K, m, 3)."""
    return np.concatenate((ways, cross(lever, ways)), axis=2).swapaxes(1, 2)


def _gram(columns: Array, weights: Array) -> Array:
    """columns diag(weights) columns^T, (K, 6, 6)."""
    return (columns * weights[:, None]) @ columns.swapaxes(1, 2)


def _diagonal(matrices: Array) -> Array:
    return np.einsum("kii->ki", matrices)


def _lever(robot: Robot, poses: Array, point: Array | None) -> Array:
    if point is None:
        point = np.zeros(3) if robot.nozzle is None else robot.nozzle
    return matrix(np.asarray(poses, dtype=float)[:, 3:]) @ np.asarray(point, dtype=float)
