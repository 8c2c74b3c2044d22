"""Forward kinematics: poses come back from their lengths, and what cannot come back says so."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim, gt_planar, hangprinter, random_poses, random_robot

from cabslice.robot import rotation
from cabslice.robot.forward import forward
from cabslice.robot.kinematics import jacobian, lengths

SEEDS = st.integers(0, 2**31 - 1)


def gap(found, poses):
    """Largest distance, mm of translation and rad of rotation."""
    turn = rotation.turned(-poses[:, 3:], found.poses[:, 3:])
    return max(np.abs(found.poses[:, :3] - poses[:, :3]).max(), np.abs(turn).max())


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, pulleys=st.booleans())
def test_poses_come_back_from_their_lengths(seed, pulleys):
    robot, poses = random_robot(seed, pulleys=pulleys), random_poses(seed, 30, reach=150, turn=0.5)
    near = poses + random_poses(seed + 1, 30, reach=20, turn=0.05)
    found = forward(robot, lengths(robot, poses), near)
    assert found.converged.all()
    assert found.residual.max() < 1e-8
    assert gap(found, poses) < 1e-7


@pytest.mark.parametrize(
    "robot", [cabfab_init_x(), cabfab_optim(), gt_planar(), hangprinter()], ids=lambda robot: robot.name
)
def test_a_path_is_followed_from_its_first_pose(robot):
    """6, 3 planar and 3 translational freedoms by the row mask alone."""
    t = np.linspace(0, 2 * np.pi, 700)
    zero = np.zeros_like(t)
    circle = np.stack(
        (150 * np.cos(t), 150 * np.sin(t), 60 * np.sin(2 * t), 0.02 * np.sin(t), 0.03 * np.cos(t), zero), axis=1
    )
    # gt-planar is singular at its home: its four cables all point at the platform's centre there
    aside = np.array([500.0, 0, -300, 0, 0.3, 0]) * (robot.name == "gt-planar")
    poses = robot.home + aside + np.where(robot.freedoms, circle, 0.0)
    found = forward(robot, lengths(robot, poses), poses[0] + np.where(robot.freedoms, [3, 3, 3, 0.01, 0, 0], 0))
    assert found.converged.all()
    assert not found.far.any()
    assert gap(found, poses) < 1e-9
    assert np.median(found.iterations) <= 4


def test_a_singular_pose_warns_of_its_branches():
    """gt-planar at home: turned left or right, the cables are equally long to first order."""
    robot = gt_planar()
    pose = np.array([[1500.0, 0, 1500, 0, 0.2, 0]])
    assert forward(robot, lengths(robot, pose), robot.home[None] + [[0, 0, 0, 0, 1e-3, 0]]).far[0]


def test_cold_start_from_the_middle_of_the_frame():
    robot = cabfab_optim()
    poses = random_poses(2, 500, reach=300, turn=0.2)
    found = forward(robot, lengths(robot, poses), np.zeros((500, 6)))
    assert found.converged.all()
    assert gap(found, poses) < 1e-9


def test_disagreeing_lengths_give_the_least_squares_pose_and_its_residual():
    """At the answer the misfit is square to every column of the Jacobian, and no smaller than the best linear fit."""
    robot, poses = cabfab_optim(), random_poses(4, 50, turn=0.1)
    noisy = lengths(robot, poses) + np.random.default_rng(4).normal(scale=0.5, size=(50, 8))
    found = forward(robot, noisy, poses)
    miss = lengths(robot, found.poses) - noisy
    assert found.converged.all()
    np.testing.assert_allclose(found.residual, np.linalg.norm(miss, axis=1), rtol=0, atol=1e-12)
    assert found.residual.min() > 0.01
    slope = jacobian(robot, found.poses) / [1, 1, 1, 100, 100, 100]
    assert np.abs(np.einsum("kmf,km->kf", slope, miss)).max() < 1e-8


def test_a_wrong_assembly_is_never_silent():
    """From starts turned by up to pi: what converges elsewhere with the lengths met carries the branch warning."""
    robot, poses = cabfab_init_x(), np.zeros((400, 6))
    start = random_poses(6, 400, reach=300, turn=1.8)
    found = forward(robot, lengths(robot, poses), start)
    turn = rotation.turned(-poses[:, 3:], found.poses[:, 3:])
    astray = (np.abs(found.poses[:, :3]).max(axis=1) > 1e-6) | (np.abs(turn).max(axis=1) > 1e-6)
    assert astray.any()
    assert (found.far | (found.residual > 1e-6) | ~found.converged)[astray].all()
    close = np.abs(start / [300, 300, 300, 1.8, 1.8, 1.8]).max(axis=1) < 0.3
    assert not astray[close].any()


def test_impossible_lengths_are_reported_not_invented():
    robot = cabfab_optim()
    found = forward(robot, np.full((2, 8), 10.0), np.zeros((2, 6)))
    assert (found.residual > 100).all()
    assert forward(robot, np.zeros((0, 8)), np.zeros(6)).poses.shape == (0, 6)
    assert forward(robot, np.zeros((0, 8)), np.zeros((0, 6))).converged.shape == (0,)


def test_freedoms_the_robot_has_not_stay_as_they_were():
    robot = hangprinter()
    poses = np.array([[100.0, 50, 300, 0.1, 0.2, 0.3]])
    found = forward(robot, lengths(robot, poses), np.array([[90.0, 60, 310, 0.1, 0.2, 0.3]]))
    np.testing.assert_allclose(found.poses, poses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.poses[:, 3:], poses[:, 3:], rtol=0, atol=1e-15)
