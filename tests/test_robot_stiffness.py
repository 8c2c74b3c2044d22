"""Stiffness as what it is: minus the derivative of the wrench at constant rest length, by central differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim, cable_robot, hangprinter, random_poses, random_robot
from scipy.linalg import eigh

from cabslice.errors import PoseError
from cabslice.robot import stiffness as room
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import NEWTON
from cabslice.robot.rotation import turned
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import gravity_wrench, mass_matrix, required_wrench, wrench_matrix


def moved(poses, step):
    """Left perturbation of poses by steps (K, 6)."""
    return np.concatenate((poses[:, :3] + step[:, :3], turned(poses[:, 3:], step[:, 3:])), axis=1)


def derivative(function, poses, size=(1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5)):
    columns = []
    for axis in range(6):
        step = np.zeros_like(poses)
        step[:, axis] = size[axis]
        columns.append((function(moved(poses, step)) - function(moved(poses, -step))) / (2 * size[axis]))
    return np.stack(columns, axis=-1)


def assert_blocks_close(got, expected, share):
    scale = np.abs(expected).reshape(len(expected), 2, 3, 2, 3).max(axis=(2, 4), keepdims=True)
    error = np.abs(got - expected).reshape(len(expected), 2, 3, 2, 3) / scale
    assert error.max() < share


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.booleans(), st.booleans())
def test_the_derivative_of_the_wrench_at_constant_rest_length(seed, pulleys, with_line):
    """Also away from equilibrium, where K is not symmetric; soft cables so that all three parts show."""
    robot = random_robot(seed, pulleys=pulleys)
    robot = replace(robot, axial_stiffness=np.full(8, 800.0))
    poses, line = random_poses(seed, 5), np.linspace(300, 900, 8) * with_line
    tension = np.random.default_rng(seed).uniform(20, 300, (5, 8))
    rest = room.rest_lengths(robot, lengths(robot, poses) + line, tension)

    def wrench(at):
        held = room.elastic_tensions(robot, lengths(robot, at) + line, rest)
        return np.einsum("kij,kj->ki", wrench_matrix(robot, at), held)

    found = room.stiffness(robot, poses, tension, line=line)
    assert_blocks_close(found.total, -derivative(wrench, poses), 2e-6)
    for part in (found.cable, found.lateral, found.force):
        assert np.abs(part[:, 3:, 3:]).max() > 1e-3 * np.abs(found.total[:, 3:, 3:]).max()


def test_a_cable_along_its_swivel_axis_has_lateral_stiffness_all_round():
    robot = cable_robot([[0, 0, 1000.0]], [[0, 0, 0.0]], freedoms=np.array([1, 1, 1, 0, 0, 0], bool))
    found = room.stiffness(robot, np.zeros((1, 6)), np.array([[50.0]]))
    np.testing.assert_allclose(found.lateral[0, :3, :3], np.diag([0.05, 0.05, 0.0]), rtol=0, atol=1e-15)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_gravity_stiffness_is_the_derivative_of_the_weights_wrench(seed):
    robot, poses = random_robot(seed), random_poses(seed, 4)
    expected = -derivative(lambda at: gravity_wrench(robot, at), poses)
    np.testing.assert_allclose(room.gravity_stiffness(robot, poses), expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("build", [cabfab_init_x, cabfab_optim])
def test_symmetric_at_equilibrium_and_only_there(build):
    robot, poses, tension = case(build, centre_of_mass=np.array([8.0, -5.0, -30.0]))
    whole = room.stiffness(robot, poses, tension).total + room.gravity_stiffness(robot, poses)
    np.testing.assert_allclose(whole, whole.swapaxes(1, 2), rtol=0, atol=1e-7)
    loose = room.stiffness(robot, poses, tension + np.arange(8.0)).total
    assert np.abs(loose - loose.swapaxes(1, 2)).max() > 1.0


def test_rest_length_and_tension_are_inverses():
    robot, loaded = cabfab_init_x(), np.random.default_rng(1).uniform(300, 1200, (50, 8))
    tension = np.random.default_rng(2).uniform(0, 100, (50, 8))
    rest = room.rest_lengths(robot, loaded, tension)
    np.testing.assert_allclose(room.elastic_tensions(robot, loaded, rest), tension, rtol=0, atol=1e-9)
    np.testing.assert_allclose(room.cable_stiffness(robot, loaded, tension), robot.axial_stiffness / rest, rtol=1e-14)
    assert (room.elastic_tensions(robot, loaded, loaded * 1.01) == 0).all()


def case(build=cabfab_init_x, count=20, **more):
    robot, poses = build(**more), random_poses(3, count, reach=120.0, turn=0.01)
    held = nearest_tension(robot, poses, required_wrench(robot, poses))
    assert held.feasible.all()
    return robot, poses, held.tension


@pytest.mark.parametrize("build", [cabfab_init_x, cabfab_optim])
def test_modes_solve_the_generalised_eigenproblem(build):
    robot, poses, tension = case(build, centre_of_mass=np.array([1.0, -2.0, -15.0]))
    whole = room.stiffness(robot, poses, tension).total + room.gravity_stiffness(robot, poses)
    hertz, shapes = room.modes(robot, poses, whole)
    mass = mass_matrix(robot, poses)
    for k in range(len(poses)):
        expected = np.sqrt(eigh((whole[k] + whole[k].T) / 2, mass[k], eigvals_only=True) / NEWTON) / (2 * np.pi)
        np.testing.assert_allclose(hertz[k], expected, rtol=1e-9)
    np.testing.assert_allclose(shapes.swapaxes(1, 2) @ mass @ shapes - np.eye(6), 0, atol=1e-10)
    modal = np.einsum("kif,kij,kjf->kf", shapes, whole, shapes)
    np.testing.assert_allclose(modal, (2 * np.pi * hertz) ** 2 * NEWTON, rtol=1e-8)


def test_modes_of_a_body_between_two_springs_by_hand():
    """Two cables along x, tension t, length l: k_x = 2 (ES + t)/l, k_y = k_z = 2 t/l."""
    free = np.array([1, 1, 1, 0, 0, 0], bool)
    robot = cable_robot([[1000.0, 0, 0], [-1000.0, 0, 0]], np.zeros((2, 3)), freedoms=free, mass=2.0)
    pose, tension = np.zeros((1, 6)), np.full((1, 2), 40.0)
    hertz, shapes = room.modes(robot, pose, room.stiffness(robot, pose, tension).total)
    stiff = np.array([0.08, 0.08, 2 * (robot.axial_stiffness[0] + 40) / 1000])
    np.testing.assert_allclose(hertz[0], np.sqrt(stiff / 2.0 / NEWTON) / (2 * np.pi), rtol=1e-12)
    assert shapes.shape == (1, 6, 3)
    assert (shapes[:, 3:] == 0).all()
    np.testing.assert_allclose(np.abs(shapes[0, 0, 2]), 1 / np.sqrt(2), rtol=1e-12)


def test_unstable_and_unknown_are_not_passed_off_as_modes():
    robot, poses, tension = case(count=2)
    whole = room.stiffness(robot, poses, tension).total
    whole[1] = np.nan
    hertz, _ = room.modes(robot, poses, whole - np.diag([0, 0, 0, 0, 0, 1e6]))
    assert hertz[0, 0] < 0
    assert np.isnan(hertz[1]).all()


def test_deflection_is_where_the_elastic_platform_settles():
    """Newton steps on the wrench itself, at constant rest length, under a small force on the nozzle."""
    robot, poses, tension = case()
    rest = room.rest_lengths(robot, lengths(robot, poses), tension)
    force = np.random.default_rng(5).normal(size=(len(poses), 3)) * 1e-3
    push = room.wrench_of_force(robot, poses, force)
    stiff = room.stiffness(robot, poses, tension).total + room.gravity_stiffness(robot, poses)

    settled = poses.copy()
    for _ in range(4):
        held = room.elastic_tensions(robot, lengths(robot, settled), rest)
        left = np.einsum("kij,kj->ki", wrench_matrix(robot, settled), held) + gravity_wrench(robot, settled) + push
        settled = moved(settled, np.linalg.solve(stiff, left[..., None])[..., 0])
    nozzle = [room._lever(robot, at, None) + at[:, :3] for at in (poses, settled)]
    got = room.deflection(robot, poses, stiff, push)
    np.testing.assert_allclose(got, nozzle[1] - nozzle[0], rtol=0, atol=1e-4 * np.abs(got).max())
    assert (np.einsum("ki,ki->k", got, force) > 0).all()          # the force does work


def test_a_platform_that_is_not_held_is_refused():
    robot, poses, tension = case(count=3)
    stiff = room.stiffness(robot, poses, tension).total
    stiff[1] = 0.0
    with pytest.raises(PoseError, match="pose 1"):
        room.deflection(robot, poses, stiff, np.zeros((3, 6)))


def first_modes_at(robot, poses, level):
    held = nearest_tension(replace(robot, tension_reference=np.full(8, level)), poses, required_wrench(robot, poses))
    return room.first_modes(robot, poses, held.tension)


def test_preload_brings_the_first_mode_to_its_target():
    robot, poses, _ = case()
    low, high = (first_modes_at(robot, poses, level) for level in (15.0, 60.0))
    assert (low < high).all()
    target = (low.max() + high.min()) / 2
    found = room.preload_for_mode(robot, poses, target)
    assert found.reached.all()
    np.testing.assert_allclose(found.first_hz, target, rtol=1e-6)
    np.testing.assert_allclose(room.first_modes(robot, poses, found.tension), target, rtol=1e-6)
    assert ((found.level > 15) & (found.level < 60)).all()
    never = room.preload_for_mode(robot, poses, 1000.0)
    assert not never.reached.any()
    assert np.isnan(never.level).all()
    assert (never.first_hz < 1000).all()


def test_a_point_platform_has_three_modes():
    robot = hangprinter(tension_max=np.full(4, 60.0))
    poses = np.zeros((3, 6))
    poses[:, 2] = [100.0, 300.0, 500.0]
    held = nearest_tension(robot, poses, required_wrench(robot, poses))
    hertz, _ = room.modes(robot, poses, room.stiffness(robot, poses, held.tension).total)
    assert hertz.shape == (3, 3)
    assert (hertz > 0).all()
