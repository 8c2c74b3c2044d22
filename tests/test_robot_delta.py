"""The linear Delta: round trips, differences, virtual work, and the published figures of two machines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cabslice.errors import PoseError
from cabslice.robot import delta as machine
from cabslice.robot.delta import Delta
from cabslice.robot.model import NEWTON, WinderColumns


def delta(arm=1040.0, radius=550.0):
    three = np.full(3, 1.0)
    belts = WinderColumns(
        radii=np.full((3, 1), 6.4), ramp_start=0 * three, ramp_end=three, home_angle=two_turns(), crossed=three < 0,
        max_speed=50 * three, continuous_torque=400 * three, peak_torque=900 * three, inertia=30 * three,
        friction=5 * three, centre=np.full((3, 3), np.nan), span=np.array([[-200.0, 200.0]] * 3))
    angles = np.radians([0, 120, 240])
    return Delta(
        arm=arm, radius=radius, rails=np.stack((np.cos(angles), np.sin(angles)), axis=1),
        travel=np.array([0.0, 3000.0]), arm_angle_max=1.0, winders=belts, mass=0.6, carriage_mass=0.3,
        home=np.array([0, 0, 400.0, 0, 0, 0]))


def two_turns():
    return np.full(3, 4 * np.pi)


def poses_of(xyz):
    return np.hstack((np.atleast_2d(xyz), np.zeros((len(np.atleast_2d(xyz)), 3))))


PLACES = st.tuples(*(st.floats(-150, 150) for _ in range(2)), st.floats(0, 300))


@given(PLACES)
def test_carriages_and_motors_lead_back_to_the_pose(place):
    robot, pose = delta(), poses_of(place)
    q = machine.carriages(robot, pose)
    assert machine.forward(robot, q) == pytest.approx(pose, abs=1e-9)
    assert machine.heights_of(robot, machine.motor_angles(robot, q)) == pytest.approx(q, abs=1e-9)
    ends = np.concatenate((robot.radius * robot.rails, q.T), axis=1)
    assert np.linalg.norm(ends - pose[0, :3], axis=1) == pytest.approx(np.full(3, robot.arm), abs=1e-9)


@given(PLACES, PLACES, PLACES)
def test_rates_are_the_differences_of_the_carriages(place, rate, accel):
    robot, step = delta(), 1e-3
    v, a = np.array([rate]), np.array([accel])
    t = np.array([-1, 0, 1]) * step
    q = machine.carriages(robot, poses_of(place + t[:, None] * v + t[:, None] ** 2 / 2 * a))
    slope = machine.jacobian(robot, poses_of(place))
    assert slope[0] @ v[0] == pytest.approx((q[2] - q[0]) / (2 * step), rel=1e-5, abs=1e-4)
    second = machine.carriage_accelerations(robot, poses_of(place), v, a)[0]
    assert second == pytest.approx((q[2] - 2 * q[1] + q[0]) / step**2, rel=1e-4, abs=1e-3)


@given(PLACES, PLACES, PLACES)
def test_forces_are_those_of_the_arms(place, rate, accel):
    """Newton for the platform, hung on arms that pull along themselves alone, and for each carriage."""
    robot, pose = delta(), poses_of(place)
    v, a = np.array([rate]), 10 * np.array([accel])
    q = machine.carriages(robot, pose)[0]
    arm = (pose[0, :3] - np.column_stack((robot.radius * robot.rails, q))) / robot.arm
    push = np.linalg.solve(arm.T, robot.mass * (a[0] - robot.gravity))
    lifted = machine.carriage_accelerations(robot, pose, v, a)[0] - robot.gravity[2]
    expected = (robot.carriage_mass * lifted + push * arm[:, 2]) * NEWTON
    assert machine.forces(robot, pose, v, a)[0] == pytest.approx(expected, abs=1e-9)


def test_at_rest_the_motors_carry_the_weight():
    robot = delta()
    found = machine.forces(robot, poses_of([[0, 0, 0], [100, -50, 200]]), np.zeros((2, 3)), np.zeros((2, 3)))
    assert found.sum(axis=1) == pytest.approx(np.full(2, (0.6 + 3 * 0.3) * 9.80665))
    assert np.ptp(found[0]) < 1e-12


def test_circle_of_the_published_machine():
    """Diameter 300 mm, R - r = 0.55 m, L = 1.04 m: stroke 190.845 mm; at 120 mm/s the actuators reach 76.338 mm/s."""
    turn = np.radians(np.arange(0, 360, 0.01))
    xy = 150 * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    poses = poses_of(np.column_stack((xy, np.zeros(len(xy)))))
    q = machine.carriages(delta(), poses)
    assert np.ptp(q, axis=0) == pytest.approx(np.full(3, 190.845), abs=1e-3)
    along = np.column_stack((-np.sin(turn), np.cos(turn), np.zeros(len(turn))))
    speed = 120 * np.abs(np.einsum("kmi,ki->km", machine.jacobian(delta(), poses), along))
    assert speed.max(axis=0) == pytest.approx(np.full(3, 76.338), abs=1e-3)


def test_condition_number_of_the_published_machine():
    """L = 800 mm, D = 480 mm: at most 2.459 over a 300 mm cube, in its corners."""
    axis = np.linspace(-150, 150, 31)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    poses = poses_of(np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size))))
    found = np.linalg.cond(machine.jacobian(delta(800.0, 480.0), poses)).reshape(x.shape)
    assert found.max() == pytest.approx(2.459, abs=1e-3)
    assert np.abs(axis[list(np.unravel_index(found.argmax(), found.shape))]).tolist() == [150, 150]


def test_where_an_arm_is_too_short_or_a_rail_ends_it_says_so():
    with pytest.raises(PoseError, match="arm 1 does not reach at pose 1"):
        machine.carriages(delta(), poses_of([[0, 0, 0], [-600, 0, 0]]))
    with pytest.raises(PoseError, match="carriage 1 leaves its rail at sample 0"):
        machine.motor_angles(delta(), np.full((1, 3), 3001.0))
