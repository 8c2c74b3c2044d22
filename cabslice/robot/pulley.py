"""The cable over its swivelling guide pulley: attachment in, exit point, direction and length out.

Legend (Gueners 2021, 3.1.2, after Pott 2012; his 3.10 prints pi - arccos - arcsin for beta: a misprint)
    P      entry point on the swivel axis (robot.anchors)     e_z    swivel axis, the way the cable arrives at P
    B      attachment of the cable on the platform (tip)      e_a    swivel direction: from the axis towards B
    r_p    pulley radius, 0 is an eyelet                      M      pulley centre, P + r_p e_a
    rho, z B in the swivel plane: distance from the axis and height along it
    d      |MB|                                               l      free length, sqrt(d^2 - r_p^2)
    beta   wrap angle from P to A                             A      exit point, M + r_p (-cos beta e_a + sin beta e_z)
    L      length P to B, r_p beta + l                        u      unit vector B -> A;  dL/dB = -u
    v      normal of the swivel plane, e_z x e_a              w      u x v
    H      second derivative of L with B: w w^T / l + v v^T / (l + r_p tan(beta/2))

With r_p = 0 every formula below becomes the point model exactly (A = P), so there is one code path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.model import Robot
from cabslice.robot.pulley_kernel import lead_cables


@dataclass(frozen=True)
class CableLines:
    """Where the m cables run at K poses; lengths in mm, vectors in the machine frame."""

    tip: Array       # (K, m, 3) attachment B
    lever: Array     # (K, m, 3) R c_i, attachment minus platform origin
    exit: Array      # (K, m, 3) A, where the cable leaves its pulley (the anchor itself for an eyelet)
    unit: Array      # (K, m, 3) u, from tip to exit
    free: Array      # (K, m)    l, exit to tip
    wrap: Array      # (K, m)    beta, rad on the guide pulley
    length: Array    # (K, m)    L, entry point to tip
    side: Array      # (K, m, 3) v, normal of the swivel plane
    lateral: Array   # (K, m)    1/mm, curvature of L along v: 1 / (l + r_p tan(beta/2)), 1/l for an eyelet


def lead(robot: Robot, tip: Array, lever: Array, *, refuse: bool = True) -> CableLines:
    """Lead every cable from its pulley to `tip` (K, m, 3) mm; `lever` (K, m, 3) is passed through.

    Raises PoseError where rho <= r_p or d <= r_p (for an eyelet: d = 0), naming cable and pose number; with
    ``refuse=False`` the columns of such cables hold nan instead.  Source: Gueners 2021, 3.1.2; Pott 2012.
    """
    vectors, numbers = np.empty((3, *tip.shape)), np.empty((4, *tip.shape[:2]))
    lead_cables(tip, robot.anchors, robot.pulley_axes, robot.pulley_radii, vectors, numbers)
    if refuse and np.isnan(numbers[0]).any():
        raise _inside_out(robot, tip, numbers[0])
    (exit, unit, side), (free, wrap, length, lateral) = vectors, numbers
    return CableLines(tip, lever, exit, unit, free, wrap, length, side, lateral)


def hessian(lines: CableLines) -> Array:
    """H (K, m, 3, 3) 1/mm, the second derivative of each length with the position of its tip.

    In the swivel plane the cable turns about the exit point (1/l), across it about the swivel axis
    (1/(l + r_p tan(beta/2))): Gueners 2021, annex A, with the pulley.
    """
    u, v = lines.unit, lines.side
    across = np.eye(3) - u[..., :, None] * u[..., None, :]
    more = (lines.lateral - 1 / lines.free)[..., None, None]
    return across / lines.free[..., None, None] + more * (v[..., :, None] * v[..., None, :])


def bend(lines: CableLines, motion: Array) -> Array:
    """motion^T H motion (K, m), mm/s^2 for tip velocities (K, m, 3) mm/s: what turning adds to d2L/dt2."""
    along, aside = (np.einsum("kmi,kmi->km", motion, vector) for vector in (lines.unit, lines.side))
    speed = np.einsum("kmi,kmi->km", motion, motion)
    return (speed - along**2) / lines.free + (lines.lateral - 1 / lines.free) * aside**2


def _inside_out(robot: Robot, tip: Array, free: Array) -> PoseError:
    pose, cable = (int(i) for i in np.argwhere(np.isnan(free))[0])
    arm, axis, radius = tip[pose, cable] - robot.anchors[cable], robot.pulley_axes[cable], robot.pulley_radii[cable]
    height = arm @ axis
    rho = np.linalg.norm(arm - height * axis)
    where, wanted = f"cable {cable + 1} at pose {pose}", "expected more than the pulley radius"
    place = ", ".join(f"{x:.3f}" for x in tip[pose, cable])
    if not np.isfinite(arm).all():
        fault = "expected finite numbers"
    elif radius == 0:
        fault = "it has no length"
    elif rho <= radius:
        fault = f"it is {rho:.3f} mm from the swivel axis, {wanted} {radius:.3f} mm"
    else:
        fault = f"it is {np.hypot(rho - radius, height):.3f} mm from the pulley centre, {wanted} {radius:.3f} mm"
    return PoseError(f"{where}: attachment at ({place}) mm: {fault}", cable=cable + 1, pose=pose)
