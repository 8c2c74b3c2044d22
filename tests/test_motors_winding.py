"""What is wound is what is not free: cable conserved along a print, and what the usual short cut would cost."""

import numpy as np
import pytest
from timing_cases import MATERIAL, PRINTER, PROCESS, print_like

from cabslice.motors.approach import with_ends
from cabslice.motors.check import wound_since_home
from cabslice.motors.stream import make_stream
from cabslice.profile import shelf
from cabslice.profile.printer import Start
from cabslice.robot import kinematics, winder
from cabslice.robot.model import nozzle_poses, robot_from_printer
from cabslice.robot.winder_line import line_at
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

MEASURED = robot_from_printer(shelf.load_printer("cabfab-optim-measured"))


def on_the_way(robot, angle):
    """Cable (K, m) mm between winder and pulley, with what it wraps."""
    winders = robot.winders
    return line_at(robot, winder.radius(winders, angle), winders.axial * (angle - winders.home_angle)).length


def test_no_cable_is_gained_or_lost_in_a_print():
    """Acceptance 1: rest lengths of free, wrapped and wound cable (by quadrature) add up to the same within 1 um."""
    path = with_ends(print_like(turns=4), MEASURED, Start())
    trajectory = plan(path, MEASURED, PRINTER, MATERIAL, PROCESS)
    stream = make_stream(trajectory, MEASURED, period_s=0.004, header={})
    layers = []
    lowest, highest = np.full(8, np.inf), np.full(8, -np.inf)
    for block in stream:
        times = np.minimum((block.row + np.arange(len(block))) * 0.004, trajectory.duration)
        free = kinematics.cables(MEASURED, sample(trajectory, times).poses).length
        layers.append(winder.layer(MEASURED.winders, block.angle))
        loaded = free + on_the_way(MEASURED, block.angle)
        rest = loaded / (1 + block.tension / MEASURED.axial_stiffness)
        total = rest + wound_since_home(MEASURED.winders, block.angle)
        lowest, highest = np.minimum(lowest, total.min(axis=0)), np.maximum(highest, total.max(axis=0))
    assert (highest - lowest).max() < 1e-3
    assert (np.ptp(np.concatenate(layers), axis=0) > 0).sum() >= 4, "winders that change their layer are among them"


@pytest.mark.parametrize(("radius", "height", "worst"), [(100, 100, 1.02), (150, 100, 1.31), (100, 300, 0.41)])
def test_dividing_the_length_change_by_the_present_radius_is_off_at_layer_changes(radius, height, worst):
    """Gueners 2021 divides; around a circle that is 0.4 to 1.3 mm of cable off at a layer change, exact is 1e-9."""
    winders, turn = MEASURED.winders, np.linspace(0, 2 * np.pi, 4001)
    xyz = np.column_stack((radius * np.cos(turn), radius * np.sin(turn), np.full(len(turn), height)))
    length = kinematics.lengths(MEASURED, nozzle_poses(MEASURED, xyz))
    angle = winder.motor_angles(MEASURED, length, np.tile(MEASURED.tension_reference, (len(turn), 1)))
    wound = winder.wound(winders, angle)
    np.testing.assert_allclose(winder.wound(winders, winder.angle_of(winders, wound)), wound, rtol=0, atol=1e-9)
    divided = angle[0] + (wound - wound[0]) / winder.radius(winders, angle)
    off = np.abs(winder.wound(winders, divided) - wound)
    assert off.max() == pytest.approx(worst, abs=0.03)
    cable = off.max(axis=0).argmax()
    assert np.ptp(winder.layer(winders, angle)[:, cable]) > 0, "the worst cable changes its layer"
