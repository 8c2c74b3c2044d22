"""Wrenches: virtual work, Newton-Euler from momentum, energy, the row mask."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, gt_planar, hangprinter, moved, random_poses, random_robot

from cabslice.robot import rotation
from cabslice.robot.kinematics import length_rates, lengths
from cabslice.robot.model import GRAVITY, NEWTON
from cabslice.robot.wrench import gravity_wrench, inertial_wrench, mass_matrix, required_wrench, wrench_matrix

SEEDS = st.integers(0, 2**31 - 1)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, pulleys=st.booleans())
def test_virtual_work(seed, pulleys):
    """The power of the tensions on the platform is the power they spend on shortening, for any motion."""
    robot, poses = random_robot(seed, pulleys=pulleys), random_poses(seed, 20, turn=1.0)
    rng = np.random.default_rng(seed)
    tension, rates = rng.uniform(0, 100, (20, 8)), rng.normal(size=(20, 6)) * [100, 100, 100, 1, 1, 1]
    wrench = np.einsum("kim,km->ki", wrench_matrix(robot, poses), tension)
    h = 1e-5
    shortening = (lengths(robot, moved(poses, -h * rates)) - lengths(robot, moved(poses, h * rates))) / (2 * h)
    scale = np.abs(tension * shortening).sum(axis=1)
    np.testing.assert_allclose(
        (wrench * rates).sum(axis=1) / scale, (tension * shortening).sum(axis=1) / scale, atol=1e-8
    )
    np.testing.assert_allclose(length_rates(robot, poses, rates), -shortening, rtol=0, atol=1e-5)


def test_tension_pulls_towards_the_pulley():
    robot = gt_planar()
    pose, pull = np.array([[1500.0, 0, 1500, 0, 0, 0]]), np.array([1.0, 0, 0, 1])
    np.testing.assert_allclose(wrench_matrix(robot, pose)[0] @ pull, [0, 0, -np.sqrt(2), 0, 0, 0], rtol=0, atol=1e-12)
    assert wrench_matrix(robot, pose, masked=True).shape == (1, 3, 4)
    np.testing.assert_allclose(wrench_matrix(robot, pose, masked=True)[0], wrench_matrix(robot, pose)[0, [0, 2, 4]])
    point = hangprinter()
    assert wrench_matrix(point, np.zeros((2, 6)), masked=True).shape == (2, 3, 4)
    assert required_wrench(point, np.zeros((2, 6)), masked=True).shape == (2, 3)
    assert mass_matrix(point, np.zeros((2, 6)), masked=True).shape == (2, 3, 3)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_inertial_wrench_is_the_rate_of_momentum(seed):
    """Momentum and angular momentum about a fixed point, differentiated along the path; gravity included."""
    robot, poses = random_robot(seed), random_poses(seed, 10)
    rates, accels = np.random.default_rng(seed).normal(size=(2, 10, 6)) * [300, 300, 300, 3, 3, 3]
    h = 2e-5

    def momentum(t):
        here = moved(poses, t * rates + t**2 / 2 * accels)
        turn = rotation.matrix(here[:, 3:])
        phi, dphi = t * rates[:, 3:] + t**2 / 2 * accels[:, 3:], rates[:, 3:] + t * accels[:, 3:]
        omega = dphi + np.cross(phi, dphi) / 2  # of exp(phi), to second order
        lever = turn @ robot.centre_of_mass
        linear = robot.mass * (rates[:, :3] + t * accels[:, :3] + np.cross(omega, lever))
        inertia = turn @ robot.inertia @ turn.swapaxes(1, 2)
        spin = np.einsum("kij,kj->ki", inertia, omega) + np.cross(here[:, :3] - poses[:, :3] + lever, linear)
        return np.hstack((linear, spin))

    numeric = NEWTON * (momentum(h) - momentum(-h)) / (2 * h)
    wrench = inertial_wrench(robot, poses, rates, accels)
    np.testing.assert_allclose(wrench, numeric, rtol=0, atol=1e-6 * np.abs(numeric).max())
    force = NEWTON * robot.mass * GRAVITY
    lever = rotation.matrix(poses[:, 3:]) @ robot.centre_of_mass
    weight = np.hstack((np.tile(force, (10, 1)), np.cross(lever, force)))
    np.testing.assert_allclose(gravity_wrench(robot, poses), weight, rtol=0, atol=1e-12)
    np.testing.assert_allclose(required_wrench(robot, poses, rates, accels), wrench - weight, rtol=0, atol=1e-9)
    np.testing.assert_allclose(required_wrench(robot, poses), -weight, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        required_wrench(robot, poses, accels=accels) + weight,
        NEWTON * np.einsum("kij,kj->ki", mass_matrix(robot, poses), accels),
        rtol=0,
        atol=1e-9,
    )


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_power_of_the_inertial_wrench_is_the_rate_of_kinetic_energy(seed):
    robot, poses = random_robot(seed), random_poses(seed, 10)
    rates, accels = np.random.default_rng(seed).normal(size=(2, 10, 6)) * [300, 300, 300, 3, 3, 3]
    matrices = mass_matrix(robot, poses)
    np.testing.assert_allclose(matrices, matrices.swapaxes(1, 2), atol=1e-9)
    assert np.linalg.eigvalsh(matrices).min() > 0
    h = 1e-6

    def energy(t):
        return 0.5 * np.einsum(
            "ki,kij,kj->k", rates + t * accels, mass_matrix(robot, moved(poses, t * rates)), rates + t * accels
        )

    power = (inertial_wrench(robot, poses, rates, accels) * rates).sum(axis=1)
    numeric = NEWTON * (energy(h) - energy(-h)) / (2 * h)
    np.testing.assert_allclose(power, numeric, rtol=0, atol=1e-6 * np.abs(numeric).max())


def test_weight_of_the_thesis_platform():
    needed = required_wrench(cabfab_init_x(), np.zeros((1, 6)))
    np.testing.assert_allclose(needed, [[0, 0, 2.598 * 9.80665, 0, 0, 0]], rtol=0, atol=1e-12)
