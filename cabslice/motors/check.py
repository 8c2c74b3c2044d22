"""A motor file played back by other means than those that made it: angles in, nozzle out, next to what was planned.

Legend
    theta   motor angle; theta_0 at home        g, n   gear, strands of cable     s   strain, t / (n ES)
    w       cable wound since home, mm: the radius integrated by three-point Gauss over steps of STEP spool radians
            (exact in a layer and on a ramp; 1e-6 mm at most where a step straddles the edge of a ramp)
    L       cable length pulley to platform, mm:  (w_home_rest - w) (1 + s) - line(theta), over n

The way back: theta -> w -> rest length -> L with the planned tensions -> pose by forward kinematics. The closed-form
inverse of the winder that made the angles is not used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ProductError
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.motors.limits import nozzle_xyz, when_where
from cabslice.motors.stream import Block, MotorStream, moving_time, timing_sample
from cabslice.robot.forward import forward
from cabslice.robot.kinematics import lengths as cable_lengths
from cabslice.robot.model import Robot, WinderColumns
from cabslice.robot.rotation import matrix
from cabslice.robot.winder import radius
from cabslice.robot.winder_line import line_at

STEP = 2.0**-10                       # spool rad
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)
ASIDE = np.array([1.0, -1.0, 1.0, 0.01, 0.01, -0.01])   # mm, rad: starts forward kinematics beside the planned pose
LIMIT_MM = 1e-3


def verify_stream(
    stream: MotorStream, robot: Robot, trajectory: Any, *, every: int = 1, limit_mm: float = LIMIT_MM,
    sample: Callable[[Any, Array], Any] | None = None,
) -> Verdict:
    """Whether the angles of every `every`-th row hold the nozzle within limit_mm of the trajectory.

    Forward kinematics starts 1 mm and 0.01 rad beside the planned pose, so it has to find its way. Margins:
    nozzle_error_mm and length_misfit_mm (2-norm over the cables), the largest ones. `sample` as in make_stream.
    Raises ProductError where the stream is for another number of cables.
    """
    if stream.cables != robot.cables:
        raise ProductError(f"The stream moves {stream.cables} cables, {robot.name} has {robot.cables}.")
    worst, misfit, looked, findings = 0.0, 0.0, 0, []
    for block in stream:
        rows = np.arange(-block.row % every, len(block), every)
        if not len(rows):
            continue
        lead = int(stream.header.get("lead_rows", 0))
        times = moving_time(block.row + rows, stream.period_s, lead, trajectory.duration)
        planned = (sample or timing_sample())(trajectory, times).poses
        error, residual = _errors(robot, block, rows, planned)
        at = int(np.argmax(error))
        if error[at] > max(limit_mm, worst):
            findings = [_finding(robot, float(times[at]), planned[at], float(error[at]), limit_mm)]
        worst, misfit, looked = max(worst, float(error[at])), max(misfit, float(residual.max())), looked + len(rows)
    checked = f"motor angles of {looked} rows played back to the nozzle by integrated winders and forward kinematics"
    return Verdict((checked,), tuple(findings), {"nozzle_error_mm": worst, "length_misfit_mm": misfit})


def _errors(robot: Robot, block: Block, rows: Array, planned: Array) -> tuple[Array, Array]:
    """Distance (n,) mm of the nozzle from its plan, and misfit (n,) mm of the lengths."""
    lengths = played_lengths(robot, block.angle[rows], block.tension[rows])
    found = forward(robot, lengths, planned + ASIDE * robot.freedoms)
    nozzle = np.zeros(3) if robot.nozzle is None else robot.nozzle
    error = (found.poses - planned)[:, :3] + (matrix(found.poses[:, 3:]) - matrix(planned[:, 3:])) @ nozzle
    distance = np.linalg.norm(error, axis=1)
    return np.where(np.isfinite(distance) & found.converged, distance, np.inf), found.residual


def _finding(robot: Robot, time_s: float, pose: Array, error: float, limit: float) -> Finding:
    xyz = nozzle_xyz(robot, pose)
    sentence = f"{when_where(time_s, xyz)} the motors hold the nozzle {error:.6g} mm off; {limit:g} mm are allowed."
    remedy = "The motor file is damaged or was made for another machine: export it again."
    return Finding("stream-nozzle", -1, xyz, 0, error, limit, "mm", sentence, remedy)


def played_lengths(robot: Robot, angle: Array, tension: Array) -> Array:
    """Loaded lengths (K, m) mm pulley to platform of motor angles (K, m) rad at tensions (K, m) N, by integration."""
    winders = robot.winders
    assert winders is not None
    strands, home = winders.advantage, winders.home_angle[None]
    loaded = _line(robot, home) + strands * cable_lengths(robot, robot.home[None])
    rest = loaded / _stretch(robot, robot.tension_reference) - wound_since_home(winders, angle)
    return (rest * _stretch(robot, tension) - _line(robot, angle)) / strands


def wound_since_home(winders: WinderColumns, angle: Array) -> Array:
    """Cable (K, m) mm taken in between the home angle and motor angles (K, m) rad, by Gauss quadrature."""
    step = STEP * winders.gear
    cell = np.floor((angle - winders.home_angle) / step).astype(np.int64)
    low, high = min(int(cell.min()), 0), max(int(cell.max()), 0)
    knots = winders.home_angle + np.arange(low, high + 1)[:, None] * step
    table = np.concatenate((np.zeros((1, len(step))), np.cumsum(_gauss(winders, knots[:-1], step), axis=0)))
    start = winders.home_angle + cell * step
    below = np.take_along_axis(table - table[-low], cell - low, axis=0)
    return below + _gauss(winders, start, angle - start)


def _gauss(winders: WinderColumns, start: Array, width: Array) -> Array:
    """Integral of the radius over [start, start + width] of the motor angle, mm of cable."""
    low, high = winders.span.T
    total = np.zeros(np.broadcast_shapes(start.shape, width.shape))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        at = np.clip(start + width * (node + 1) / 2, low, high)
        total += weight / 2 * np.hypot(radius(winders, at), winders.axial)
    return total * width / winders.gear


def _line(robot: Robot, angle: Array) -> Array:
    winders = robot.winders
    assert winders is not None
    return line_at(robot, radius(winders, angle), winders.axial * (angle - winders.home_angle) / winders.gear).length


def _stretch(robot: Robot, tension: Array) -> Array:
    return 1 + tension / robot.axial_stiffness
