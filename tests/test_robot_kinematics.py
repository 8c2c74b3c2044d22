"""Lengths, Jacobian and rates against central differences; rotations as left perturbations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim, cable_robot, gt_planar, moved, random_poses, random_robot
from scipy.spatial.transform import Rotation

from cabslice.robot import rotation
from cabslice.robot.kinematics import cables, jacobian, length_accelerations, length_rates, lengths

SEEDS = st.integers(0, 2**31 - 1)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, pulleys=st.booleans())
def test_jacobian_is_the_derivative_of_the_lengths(seed, pulleys):
    robot, poses = random_robot(seed, pulleys=pulleys), random_poses(seed, 10, turn=1.5)
    steps = np.array([1e-3] * 3 + [1e-5] * 3)
    numeric = np.stack(
        [
            (lengths(robot, moved(poses, np.tile(h, (10, 1)))) - lengths(robot, moved(poses, np.tile(-h, (10, 1)))))
            / (2 * h.sum())
            for h in np.diag(steps)
        ],
        axis=2,
    )
    np.testing.assert_allclose(jacobian(robot, poses), numeric, rtol=0, atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, pulleys=st.booleans())
def test_length_rates_and_accelerations_along_a_path(seed, pulleys):
    """Fourth-order differences of L along a screw path whose velocity and acceleration at t = 0 are given."""
    robot, poses = random_robot(seed, pulleys=pulleys), random_poses(seed, 10)
    rng = np.random.default_rng(seed)
    rates, accels = rng.uniform(-1, 1, (2, 10, 6)) * [100, 100, 100, 1, 1, 1]
    h = 2e-3
    at = [lengths(robot, moved(poses, t * rates + t**2 / 2 * accels)) for t in h * np.arange(-2, 3)]
    first = (at[0] - 8 * at[1] + 8 * at[3] - at[4]) / (12 * h)
    second = (-at[0] + 16 * at[1] - 30 * at[2] + 16 * at[3] - at[4]) / (12 * h * h)
    np.testing.assert_allclose(length_rates(robot, poses, rates), first, rtol=0, atol=1e-7)
    np.testing.assert_allclose(length_accelerations(robot, poses, rates, accels), second, rtol=0, atol=3e-5)


def test_accelerations_of_points_are_those_of_the_papers():
    """L'' = -u . q'' + (|q'|^2 - L'^2)/L for point anchors and no turning (domain.md section 8)."""
    robot, poses = cabfab_init_x(pulley_radius=0.0), random_poses(1, 40)
    rates, accels = np.random.default_rng(1).normal(size=(2, 40, 6)) * [100, 100, 100, 0, 0, 0]
    lines = cables(robot, poses)
    rate = length_rates(robot, poses, rates)
    speed = (rates[:, :3] ** 2).sum(axis=1)[:, None]
    paper = -np.einsum("kmi,ki->km", lines.unit, accels[:, :3]) + (speed - rate**2) / lines.length
    np.testing.assert_allclose(length_accelerations(robot, poses, rates, accels), paper, rtol=0, atol=1e-9)


def test_gt_planar_lengths_and_rates():
    """data/robots.toml, GTDynamics: at (1500, 1500) lengths 1909.1883 mm; rate (0, -1414.2136) mm/s."""
    robot = gt_planar()
    pose = np.array([[1500.0, 0, 1500, 0, 0, 0]])
    np.testing.assert_allclose(lengths(robot, pose), 1350 * np.sqrt(2), rtol=0, atol=1e-9)
    down = np.array([[0, 0, -np.sqrt(2) * 1000, 0, 0, 0]])
    np.testing.assert_allclose(length_rates(robot, pose, down), [[-1000, 1000, 1000, -1000]], rtol=0, atol=1e-9)


def test_level_poses_shift_with_the_frame():
    """Moving frame and platform together changes nothing: translation, and a turn of everything about the origin."""
    robot, poses = random_robot(2), random_poses(2, 20)
    turn = np.array([0.3, -0.7, 1.1])
    r = rotation.matrix(turn)
    turned = cable_robot(
        robot.anchors @ r.T, robot.attachments, axes=robot.pulley_axes @ r.T, pulley_radius=robot.pulley_radii
    )
    again = np.hstack((poses[:, :3] @ r.T, rotation.turned(poses[:, 3:], np.tile(turn, (20, 1)))))
    np.testing.assert_allclose(lengths(turned, again), lengths(robot, poses), rtol=0, atol=1e-9)


def test_no_poses_is_no_fault():
    robot = cabfab_optim()
    assert lengths(robot, np.zeros((0, 6))).shape == (0, 8)
    assert jacobian(robot, np.zeros((0, 6))).shape == (0, 8, 6)


# --- rotations --------------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, size=st.sampled_from([0.0, 1e-13, 1e-6, 0.1, 1.0, np.pi - 1e-9, np.pi]))
def test_rotations_agree_with_scipy(seed, size):
    axes = np.random.default_rng(seed).normal(size=(2, 20, 3))
    first, second = size * axes / np.linalg.norm(axes, axis=2, keepdims=True)
    np.testing.assert_allclose(rotation.matrix(first), Rotation.from_rotvec(first).as_matrix(), rtol=0, atol=1e-14)
    both = (Rotation.from_rotvec(second) * Rotation.from_rotvec(first)).as_matrix()
    np.testing.assert_allclose(rotation.matrix(rotation.turned(first, second)), both, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rotation.matrix(rotation.vector(both)), both, rtol=0, atol=1e-14)
    assert np.linalg.norm(rotation.vector(both), axis=1).max() <= np.pi + 1e-12


def test_angles_of_the_papers_and_their_rates():
    angles = np.random.default_rng(0).uniform(-1.4, 1.4, (30, 3))
    np.testing.assert_allclose(
        rotation.matrix(rotation.from_angles(angles)),
        Rotation.from_euler("XYZ", angles).as_matrix(),
        rtol=0,
        atol=1e-14,
    )
    np.testing.assert_allclose(rotation.to_angles(rotation.from_angles(angles)), angles, rtol=0, atol=1e-13)
    rates, h = np.random.default_rng(1).normal(size=(30, 3)), 1e-6
    ahead, behind = rotation.from_angles(angles + h * rates), rotation.from_angles(angles - h * rates)
    omega = rotation.turned(-behind, ahead) / (2 * h)
    np.testing.assert_allclose(
        np.einsum("kij,kj->ki", rotation.angle_rates(rotation.from_angles(angles)), rates), omega, atol=1e-8
    )
    locked = rotation.from_angles(np.array([[0.3, np.pi / 2, 0.2]]))
    np.testing.assert_allclose(
        rotation.matrix(rotation.from_angles(rotation.to_angles(locked))), rotation.matrix(locked), atol=1e-7
    )


@pytest.mark.parametrize("count", [1, 7])
def test_cross_and_skew(count):
    a, b = np.random.default_rng(count).normal(size=(2, count, 3))
    np.testing.assert_allclose(rotation.cross(a, b), np.cross(a, b), rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", rotation.skew(a), b), np.cross(a, b), rtol=0, atol=1e-15)
