"""What a motor file says of the machine it was made for, so that its numbers can be judged without a profile.

Legend
    r        cable wound per motor angle, mm/rad        I, c    inertia (kg mm^2), Coulomb friction (N mm)
    G        gain: nozzle displacement per misfit of the cable lengths, largest entry by entry (mm/mm)
    C        compliance: length a cable gains per tension, loaded length / axial stiffness (mm/N)
    1.05     margin on G and C, which are taken at 256 places of the motion
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ProductError
from cabslice.robot import delta, kinematics, winder
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.model import NEWTON, Robot, WinderColumns, robot_from_printer
from cabslice.robot.rotation import matrix
from cabslice.robot.usable import usable

PLACES, MARGIN = 256, 1.05
CREEP = 1e-3          # rad/s below which friction is faded in
COLUMNS = (
    "radii", "ramp_start", "ramp_end", "home_angle", "crossed", "max_speed", "continuous_torque", "peak_torque",
    "inertia", "friction", "slope", "axial", "gear", "advantage",
)


def machine_header(robot: Machine, poses: Array, start_angle: Array) -> dict[str, Any]:
    """JSON values: winders, home, layers at the start angle (m,) rad, and what misfits cost along poses (K, 6).

    Of a Delta its kind, belt pulleys for winders, and forces for tensions.
    """
    winders = robot.winders
    assert winders is not None
    kind: dict[str, Any] = {}
    if isinstance(robot, Delta):
        kind, (gain, compliance) = {"kind": delta.KIND}, _rail_costs(robot, poses)
        tensions = delta.forces(robot, robot.home[None], *np.zeros((2, 1, 3)))[0]
    else:
        tensions, (gain, compliance) = robot.tension_reference, _costs(robot, poses, start_angle)
    return {
        **kind,
        "winders": winders_json(winders),
        "home": {
            "pose": robot.home.tolist(), "angles_rad": winders.home_angle.tolist(),
            "tensions_n": tensions.tolist(),
            "wound_mm": winder.wound(winders, winders.home_angle[None])[0].tolist(),
        },
        "start_winder_layers": winder.layer(winders, start_angle[None])[0].tolist(),
        "nozzle_gain_mm_mm": gain, "cable_compliance_mm_n": compliance,
    }


def winders_json(winders: WinderColumns) -> dict[str, Any]:
    """The columns that torque and wound cable follow from; no bound is None."""
    span = [[float(x) if np.isfinite(x) else None for x in row] for row in winders.span]
    return {name: getattr(winders, name).tolist() for name in COLUMNS} | {"span": span}


def winders_of(header: Mapping[str, Any]) -> WinderColumns:
    """The winders of a header. KeyError where it does not describe them."""
    given = header["machine"]["winders"]
    columns = {name: np.array(given[name]) for name in COLUMNS}
    low, high = (np.array([row[end] for row in given["span"]], float) for end in (0, 1))
    span = np.stack((np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)), axis=1)
    return WinderColumns(centre=np.full((len(span), 3), np.nan), span=span, **columns)


def robot_of(header: Mapping[str, Any]) -> Robot:
    """The robot a motor file was made for, from the printer profile its header carries whole ("printer").

    Raises ProductError where the header has none, or another one than the hash in "profiles" says.
    """
    from cabslice.profile import shelf
    from cabslice.profile.printer import Printer

    if "printer" not in header:
        raise ProductError("The motor file does not carry the profile of its printer: export it again.")
    try:
        printer = Printer.model_validate(header["printer"])
    except ValueError as error:
        raise ProductError(f"The printer in the motor file is not one of this version ({error}).") from error
    told = header.get("profiles", {}).get("printer", {}).get("sha256")
    if told not in (None, shelf.profile_hash(printer)):
        raise ProductError("The printer in the motor file is not the one its hash names: export it again.")
    return usable(robot_from_printer(printer))


def torque(winders: WinderColumns, angle: Array, velocity: Array, acceleration: Array, tension: Array) -> Array:
    """Feed-forward torque (n, m) N mm: r t + I qdd + c clip(qd / CREEP, -1, 1)."""
    return winder.transmission(winders, angle) * tension + moving(winders, velocity, acceleration)


def tension(winders: WinderColumns, angle: Array, velocity: Array, acceleration: Array, given: Array) -> Array:
    """The tension (n, m) N that a feed-forward torque `given` (n, m) N mm stands for."""
    return (given - moving(winders, velocity, acceleration)) / winder.transmission(winders, angle)


def moving(winders: WinderColumns, velocity: Array, acceleration: Array) -> Array:
    """The torque (n, m) N mm that turns the winder itself."""
    return winders.inertia * acceleration * NEWTON + winders.friction * np.clip(velocity / CREEP, -1, 1)


def _rail_costs(robot: Delta, poses: Array) -> tuple[float, float]:
    """As _costs: its arms do not give."""
    back = np.linalg.inv(delta.jacobian(robot, poses))
    return MARGIN * float(np.linalg.norm(np.abs(back).sum(axis=2), axis=1).max()), 0.0


def _costs(robot: Robot, poses: Array, start_angle: Array) -> tuple[float, float]:
    lines = kinematics.cables(robot, poses, refuse=False)
    known = np.isfinite(lines.length).all(axis=1)
    poses, length = poses[known], lines.length[known]
    if not len(poses):
        return 0.0, 0.0
    slope = kinematics.jacobian(robot, poses)[:, :, robot.freedoms]
    back = np.zeros((len(poses), 6, robot.cables))
    back[:, robot.freedoms] = np.linalg.pinv(slope)
    arm = np.zeros(3) if robot.nozzle is None else robot.nozzle
    lever = matrix(poses[:, 3:]) @ arm
    moved = back[:, :3] + np.cross(back[:, 3:], lever[:, :, None], axis=1)
    gain = np.linalg.norm(np.abs(moved).sum(axis=2), axis=1).max()
    angle = np.broadcast_to(start_angle, length.shape)
    compliance = (winder.loaded_length(robot, length, angle) / robot.axial_stiffness).max()
    return MARGIN * float(gain), MARGIN * float(compliance)
