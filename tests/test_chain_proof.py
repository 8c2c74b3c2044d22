"""A real print proven by ways of its own: nothing of the winder, pulley, forward kinematics or tension code is used,
only the numbers of the profile and the formulas restated below."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares, linprog

from cabslice import pipeline
from cabslice.motors import formats
from cabslice.robot.model import robot_from_printer
from cabslice.simulation.damping import relaxation
from cabslice.timing.trajectory import sample

CUBE = Path(__file__).parents[1] / "samples" / "cube.stl"
COARSE = ("layer_mm=0.3", "first_layer_mm=0.3", "infill=0.1")
PERIOD = 0.002


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A third-size cube on the measured machine: profiles, plan and the columns of its motor file from the moment on
    in which the cables are tensioned."""
    profiles = pipeline.load_profiles("cabfab-optim-measured", None, None, COARSE)
    plan, verdict = pipeline.to_plan(pipeline.read(CUBE, profiles, pipeline.Placement(scale=0.35)))
    target = tmp_path_factory.mktemp("proof") / "cube.stream"
    pipeline.save_stream(pipeline.to_stream(plan, verdict, period_s=PERIOD), target, "stream")
    blocks = list(formats.read(target))
    names = ("angle", "tension", "filament")
    lead = formats.read(target).header["lead_rows"]
    columns = {name: np.concatenate([getattr(block, name) for block in blocks])[lead:] for name in names}
    return profiles, plan, columns


def radius(winder, angle):
    """Radius at a motor angle: constant on a layer, linear on the ramp to the next (Gueners 2021, 6.2.3)."""
    known = list(winder.radii_mm or [winder.first_radius_mm])
    known += [known[-1] + winder.layer_step_mm * k for k in range(1, winder.layers - len(known) + 1)]
    degrees = np.degrees(angle)
    layer = int(np.floor((degrees - winder.ramp_start_deg) / 360.0))
    if layer < 0:
        return known[0]
    into = (degrees - winder.ramp_start_deg - 360.0 * layer) / (winder.ramp_end_deg - winder.ramp_start_deg)
    return known[layer] + (known[layer + 1] - known[layer]) * min(into, 1.0)


def wound_since_home(winder, angle):
    """Integral of r dtheta by adaptive quadrature, split where the radius bends."""
    home = np.radians(winder.home_angle_deg)
    bends = np.radians([edge + 360.0 * turn for turn in range(winder.layers)
                        for edge in (winder.ramp_start_deg, winder.ramp_end_deg)])
    inside = [bend for bend in bends if min(home, angle) < bend < max(home, angle)]
    return quad(lambda at: radius(winder, at), home, angle, points=inside or None, limit=200, epsabs=1e-10)[0]


def pulley_length(cable, tip):
    """Length from the entry point over the swivelling pulley to the tip (Pott 2012)."""
    r, axis = cable.pulley.groove_radius_mm + cable.diameter_mm / 2, np.array(cable.pulley.axis)
    arm = tip - np.array(cable.anchor_mm)
    z = arm @ axis
    rho = np.linalg.norm(arm - z * axis)
    distance = np.hypot(rho - r, z)
    wrap = np.arccos(z / distance) + np.arcsin(r / distance)
    return r * wrap + np.sqrt(distance**2 - r**2)


def winder_line(cable, r):
    """Common tangent of disc and guide pulley, with what its tilt takes off the pulley (r_p tilt) and lays on the disc.

    In their plane: x towards the disc, y the way the cable arrives; a crossed line has the circles on its two sides.
    """
    rp, axis = cable.pulley.groove_radius_mm + cable.diameter_mm / 2, np.array(cable.pulley.axis)
    offset = np.array(cable.winder.centre_mm) - np.array(cable.anchor_mm)
    height = offset @ axis
    out = np.linalg.norm(offset - height * axis)
    side = -1.0 if cable.winder.routing == "crossed" else 1.0
    apart = np.array([out - side * rp, height])
    reach = r - side * rp
    tangent = np.sqrt(apart @ apart - reach**2)
    tilt = np.arctan2(apart[0], -apart[1]) - np.arctan2(reach, tangent)
    return tangent - (rp - side * r) * tilt


def free_lengths(printer, angle, tension):
    """Loaded lengths entry to platform from motor angles: what is not on the winder nor on the way to the pulley."""
    lengths = np.empty(len(printer.cable))
    home = np.array(printer.platform.home_mm)
    for k, cable in enumerate(printer.cable):
        stiffness = cable.modulus_gpa * 1e3 * np.pi / 4 * cable.diameter_mm**2
        start = np.radians(cable.winder.home_angle_deg)
        at_home = pulley_length(cable, home + np.array(cable.attachment_mm))
        loaded = at_home + winder_line(cable, radius(cable.winder, start))
        rest = loaded / (1 + cable.reference_tension_n / stiffness) - wound_since_home(cable.winder, angle[k])
        lengths[k] = rest * (1 + tension[k] / stiffness) - winder_line(cable, radius(cable.winder, angle[k]))
    return lengths


def test_angles_lead_back_to_the_nozzle_within_a_micrometre(made):
    profiles, plan, columns = made
    printer = profiles.printer
    attachments = np.array([cable.attachment_mm for cable in printer.cable])
    rows = np.random.default_rng(1).choice(len(columns["angle"]), 25, replace=False)
    poses = sample(plan.trajectory, rows * PERIOD).poses
    for row, pose in zip(rows, poses, strict=True):
        wanted = free_lengths(printer, columns["angle"][row], columns["tension"][row])

        def miss(guess, wanted=wanted):
            turn = np.eye(3) + np.cross(np.eye(3), -guess[3:])          # small rotations only
            tips = guess[:3] + attachments @ turn.T
            return [pulley_length(*pair) - length for *pair, length in zip(printer.cable, tips, wanted, strict=True)]

        guess = np.concatenate((pose[:3] + np.array([0.3, -0.2, 0.1]), np.zeros(3)))
        found = least_squares(miss, guess, x_scale=[1, 1, 1, 1e-2, 1e-2, 1e-2], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.abs(found.fun).max() < 1e-4
        nozzle = found.x[:3] + np.array(printer.nozzle.offset_mm) + np.cross(found.x[3:], printer.nozzle.offset_mm)
        assert np.linalg.norm(nozzle - pose[:3] - printer.nozzle.offset_mm) < 1e-3


def test_the_trajectory_stays_within_the_corner_tolerance_of_the_toolpath(made):
    profiles, plan, _ = made
    points = plan.toolpath.xyz
    start, along = points[:-1], np.diff(points, axis=0)
    times = np.random.default_rng(2).uniform(0, plan.trajectory.duration, 3000)
    for place in sample(plan.trajectory, times).poses[:, :3] - plan.trajectory.to_pose:
        share = np.clip(((place - start) * along).sum(1) / np.maximum((along**2).sum(1), 1e-300), 0, 1)
        assert np.linalg.norm(start + share[:, None] * along - place, axis=1).min() <= profiles.process.corner_mm + 1e-9


def test_tensions_exist_for_the_motion_by_another_method_and_accelerations_are_finite_differences(made):
    """LP on a random per cent of the rows, with accelerations from the positions alone."""
    profiles, plan, columns = made
    printer, step = profiles.printer, 5e-4
    rows = np.random.default_rng(3).choice(len(columns["tension"]), len(columns["tension"]) // 100, replace=False)
    low, here, high = (sample(plan.trajectory, rows * PERIOD + shift) for shift in (-step, 0.0, step))
    accels = (high.poses - 2 * here.poses + low.poses)[:, :3] / step**2
    jerk = printer.motion.max_acceleration_mm_s2 * 4 / (printer.motion.smoothing_ms * 1e-3)
    assert np.abs(accels - here.accels[:, :3]).max() <= jerk * step
    # the rows hold what stretches the cables; damping cables pull by relaxation time times rate more
    still = relaxation(printer, robot_from_printer(printer))
    pulls = columns["tension"] + still * np.gradient(columns["tension"], PERIOD, axis=0)
    lowest, highest = ([getattr(cable, name) for cable in printer.cable] for name in ("min_tension_n", "max_tension_n"))
    for pose, accel, planned in zip(here.poses, accels, pulls[rows], strict=True):
        tips = pose[:3] + np.array([cable.attachment_mm for cable in printer.cable])
        pull = np.array([-_gradient(cable, tip) for cable, tip in zip(printer.cable, tips, strict=True)])
        wrench = np.vstack((pull.T, np.cross(tips - pose[:3], pull).T))
        force = printer.platform.mass_kg * (accel + np.array([0, 0, 9806.65])) * 1e-3
        bounds = list(zip(lowest, highest, strict=True))
        answer = linprog(np.zeros(8), A_eq=wrench, b_eq=[*force, 0, 0, 0], bounds=bounds)
        assert answer.status == 0
        assert (planned >= np.array(lowest)).all()
        assert (planned <= np.array(highest)).all()
        slip = wrench @ planned - [*force, 0, 0, 0]
        assert np.abs(slip[:3]).max() <= printer.platform.mass_kg * jerk * step * 1e-3 + 1e-3
        assert np.abs(slip[3:]).max() <= 0.05


def _gradient(cable, tip):
    """Direction from the pulley to the tip: the derivative of the length, by central differences."""
    ahead, behind = ([pulley_length(cable, tip + step * e) for e in np.eye(3)] for step in (1e-4, -1e-4))
    return (np.array(ahead) - behind) / 2e-4


def test_the_filament_of_the_file_is_that_of_the_toolpath(made):
    _, plan, columns = made
    assert columns["filament"][-1] == pytest.approx(plan.toolpath.filament.sum(), abs=1e-4)
