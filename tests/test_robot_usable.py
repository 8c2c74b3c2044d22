"""What cables and motors can do together."""

from dataclasses import replace

import numpy as np
import pytest
from robots import cabfab_optim

from cabslice.errors import ImpossibleError
from cabslice.robot.kinematics import lengths
from cabslice.robot.tension import nearest_tension
from cabslice.robot.usable import take_up, usable, usable_tension_max
from cabslice.robot.winder import motor_angles, transmission_bounds
from cabslice.robot.wrench import required_wrench

ROBOT = cabfab_optim()


def test_no_tension_is_used_that_its_motor_does_not_hold_for_ever():
    most = usable_tension_max(ROBOT)
    lever = transmission_bounds(ROBOT.winders)[1]
    np.testing.assert_allclose(most, np.minimum(ROBOT.tension_max, 0.95 * 6000 / lever))
    assert (most < ROBOT.tension_max).all()
    drawn = usable(ROBOT)
    np.testing.assert_array_equal(usable_tension_max(drawn), drawn.tension_max)


def test_a_motor_too_weak_is_named_with_the_key_to_change():
    weak = replace(ROBOT, winders=replace(ROBOT.winders, continuous_torque=np.full(8, 10.0)))
    with pytest.raises(ImpossibleError, match=r"cable \d: .*continuous_torque_n_m of motor"):
        usable(weak)


def test_take_up_is_what_the_motors_wind_for_the_stretch_of_an_acceleration():
    """Against the exact inverse of the winders, in the direction that asks most and in none more."""
    rng = np.random.default_rng(0)
    poses = np.zeros((5, 6))
    poses[:, :3] = rng.uniform(-120, 120, (5, 3)) - [0, 0, 200]
    swing, most, step = take_up(ROBOT, poses), np.zeros((5, 8)), 10.0
    for turn in np.linspace(0, np.pi, 181):
        accels = np.zeros((5, 6))
        accels[:, :2] = step * np.array([np.cos(turn), np.sin(turn)])
        tension = [nearest_tension(ROBOT, poses, required_wrench(ROBOT, poses, 0 * poses, a)).tension
                   for a in (accels, -accels)]
        wound = [motor_angles(ROBOT, lengths(ROBOT, poses), t) for t in tension]
        radius = 61.5
        most = np.maximum(most, np.abs(wound[0] - wound[1]) * radius / (2 * step))
    np.testing.assert_allclose(most, swing, rtol=0.03)
