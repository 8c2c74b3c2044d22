"""Tensions nearest to a reference, against a quadratic programme solved by another road (Lawson and Hanson's NNLS)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, hangprinter
from scipy.linalg import null_space
from scipy.optimize import nnls

from cabslice.robot import tension
from cabslice.robot.nullspace import elementary_vectors
from cabslice.robot.polytope import across
from cabslice.robot.wrench import required_wrench, wrench_matrix

INIT_X = cabfab_init_x()


def random_case(rng, count, freedoms, cables, spread=60.0):
    wrench = rng.normal(size=(count, freedoms, cables))
    wrench[:, 3:] *= 60.0
    required = np.einsum("kij,kj->ki", wrench, rng.uniform(50 - spread, 50 + spread, (count, cables)))
    return wrench, required


def by_nnls(wrench, required, lower, upper, reference):
    """min |t - t_r| on the feasible set: least distance programming, Lawson and Hanson 1974, ch. 23."""
    null = null_space(wrench)
    start = reference + np.linalg.pinv(wrench) @ (required - wrench @ reference)
    rows, least = np.concatenate((null, -null)), np.concatenate((lower - start, start - upper))
    weights = nnls(np.vstack((rows.T, least)), np.append(np.zeros(null.shape[1]), 1.0))[0]
    left = np.vstack((rows.T, least)) @ weights - np.append(np.zeros(null.shape[1]), 1.0)
    return start + null @ (-left[:-1] / left[-1])


def kkt_residual(wrench, found, lower, upper, reference):
    """|t - t_r - W^T y - z| for the best multipliers y and z, z signed at the bounds that are touched."""
    scaled = wrench / np.linalg.norm(wrench, axis=1, keepdims=True)
    at_lower, at_upper = np.flatnonzero(found < lower + 1e-7), np.flatnonzero(found > upper - 1e-7)
    unit = np.eye(len(found))
    return nnls(np.hstack((scaled.T, -scaled.T, unit[:, at_lower], -unit[:, at_upper])), found - reference)[1]


@pytest.mark.parametrize(("freedoms", "cables"), [(6, 8), (6, 6), (6, 7), (6, 9), (3, 6), (3, 4), (2, 4), (3, 8)])
def test_the_nearest_tension_is_the_quadratic_programme(freedoms, cables):
    rng = np.random.default_rng(100 * freedoms + cables)
    wrench, required = random_case(rng, 60, freedoms, cables)
    lower, upper, reference = rng.uniform(0, 5, cables), rng.uniform(80, 110, cables), rng.uniform(5, 90, cables)
    found = tension.nearest(wrench, required, lower, upper, reference)
    assert (found.feasible == (found.margin >= 0)).all()
    assert found.feasible.any()
    for k in np.flatnonzero(found.feasible):
        np.testing.assert_allclose(wrench[k] @ found.tension[k], required[k], rtol=0, atol=1e-8)
        assert (found.tension[k] >= lower - 1e-7).all()
        assert (found.tension[k] <= upper + 1e-7).all()
        expected = by_nnls(wrench[k], required[k], lower, upper, reference)
        np.testing.assert_allclose(found.tension[k], expected, rtol=0, atol=1e-6)
        assert kkt_residual(wrench[k], found.tension[k], lower, upper, reference) < 1e-9 * np.abs(reference).sum()
    assert np.isnan(found.tension[~found.feasible]).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.floats(0, 1))
def test_a_polytope_shrunk_to_a_point_is_still_found(seed, redundancy, softness):
    """Supply a wrench on the very boundary of the reach: tensions at the bounds as one facet's mu says."""
    rng = np.random.default_rng(seed)
    wrench, _ = random_case(rng, 1, 6, 6 + redundancy)
    members, weights = elementary_vectors(null_space(wrench[0])[..., None])
    row = rng.integers(len(members))
    exact = rng.uniform(10, 90, 6 + redundancy)
    for p, cable in enumerate(members[row]):
        exact[cable] = 100.0 if weights[p][row, 0] > 0 else 1.0
    bounds = np.full(6 + redundancy, 1.0), np.full(6 + redundancy, 100.0 + softness * 1e-6)
    found = tension.nearest(wrench, wrench @ exact, *bounds, np.full(6 + redundancy, 40.0))
    assert found.feasible.all()
    assert -1e-7 < found.margin[0] < 1e-5
    supplied = wrench[0] @ found.tension[0]
    np.testing.assert_allclose(supplied, wrench[0] @ exact, rtol=0, atol=1e-9 * np.abs(supplied).max())


def test_what_is_missing_is_reported_and_nothing_is_clamped():
    rng = np.random.default_rng(8)
    wrench, required = random_case(rng, 200, 6, 8, spread=90.0)
    lower, upper, reference = np.full(8, 1.0), np.full(8, 100.0), np.full(8, 30.0)
    found = tension.least_violation(wrench, required, lower, upper, reference)
    missed = ~found.feasible
    assert 50 < missed.sum() < 200
    violation = np.maximum(lower - found.tension, found.tension - upper).max(axis=1)
    np.testing.assert_allclose(violation[missed], -found.margin[missed], rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", wrench, found.tension), required, rtol=0, atol=1e-6)
    again = tension.nearest(wrench, required, lower, upper, reference)
    assert np.array_equal(found.tension[~missed], again.tension[~missed])
    assert np.isnan(again.tension[missed]).all()


def test_no_poses_no_tensions():
    found = tension.nearest_tension(INIT_X, np.zeros((0, 6)), np.zeros((0, 6)))
    assert found.tension.shape == (0, 8)
    assert len(found) == 0


def test_bounds_and_references_may_differ_from_pose_to_pose():
    rng = np.random.default_rng(9)
    wrench, required = random_case(rng, 30, 6, 8, spread=20.0)
    lower, upper, reference = rng.uniform(0, 5, (30, 8)), rng.uniform(90, 99, (30, 8)), rng.uniform(10, 80, (30, 8))
    together = tension.nearest(wrench, required, lower, upper, reference)
    for k in range(30):
        alone = tension.nearest(wrench[[k]], required[[k]], lower[k], upper[k], reference[k])
        np.testing.assert_allclose(together.tension[[k]], alone.tension, rtol=0, atol=1e-9)
        np.testing.assert_allclose(together.margin[k], alone.margin[0], rtol=0, atol=1e-9)


def test_a_singular_pose_is_not_feasible_and_spoils_no_other():
    poses = np.array([[0.0, 0, 0, 0, 0, 0], [50, 20, -100, 0, 0, 0], [10, 0, 0, 0, 0, 0]])
    wrench = wrench_matrix(INIT_X, poses)
    wrench[1, 4] = 0
    required = required_wrench(INIT_X, poses)
    found = tension.nearest(wrench, required, np.full(8, 1.0), np.full(8, 100.0), np.full(8, 30.0))
    assert found.feasible.tolist() == [True, False, True]
    assert np.isneginf(found.margin[1])
    assert np.isnan(found.tension[1]).all()


def test_along_circles_the_commanded_rest_length_is_continuous():
    """0.5 mm steps on 100 circles; the rest length's step may exceed the smooth geometric one by 10 um."""
    rng = np.random.default_rng(10)
    for _ in range(100):
        radius = rng.uniform(20, 200)
        angle = np.arange(0, 2 * np.pi, 0.5 / radius)
        poses = np.zeros((len(angle), 6))
        poses[:, 0], poses[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
        poses[:, :3] += rng.uniform([-100, -100, -200], [100, 100, 0])
        found = tension.nearest_tension(INIT_X, poses, required_wrench(INIT_X, poses))
        assert found.feasible.all()
        stretch = found.tension * 1000.0 / INIT_X.axial_stiffness            # of a metre of cable
        assert np.abs(np.diff(stretch, axis=0)).max() < 0.010


def test_freedoms_are_a_mask_not_another_road():
    """A point platform on four lines: three force rows, no moments."""
    robot = hangprinter()
    poses = np.zeros((5, 6))
    poses[:, 2] = np.linspace(0, 400, 5)
    required = required_wrench(robot, poses)
    found = tension.nearest_tension(robot, poses, required)
    assert found.feasible.all()
    supplied = np.einsum("kij,kj->ki", wrench_matrix(robot, poses), found.tension)
    np.testing.assert_allclose(supplied[:, :3], required[:, :3], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_across_completes_a_unit_vector_to_a_frame(seed, size):
    normal = np.random.default_rng(seed).normal(size=(size, 4))
    normal /= np.linalg.norm(normal, axis=0)
    frame = np.concatenate((normal[:, None], across(normal)), axis=1).transpose(2, 0, 1)
    np.testing.assert_allclose(frame.swapaxes(1, 2) @ frame, np.broadcast_to(np.eye(size), (4, size, size)), atol=1e-13)


def test_the_shortcut_without_margins_gives_the_same_tensions():
    from robots import cabfab_optim

    from cabslice.robot.tension import nearest, unmeasured
    from cabslice.robot.wrench import required_wrench, wrench_matrix

    robot, rng = cabfab_optim(), np.random.default_rng(11)
    poses, accels = np.zeros((2, 500, 6))
    poses[:, :3] = rng.uniform(-300, 300, (500, 3))
    poses[:, 3:] = rng.uniform(-0.1, 0.1, (500, 3))
    accels[:, :3] = rng.uniform(-4e4, 4e4, (500, 3))
    wrench, required = wrench_matrix(robot, poses), required_wrench(robot, poses, accels * 0, accels)
    bounds = robot.tension_min, robot.tension_max, robot.tension_reference
    slow, fast = nearest(wrench, required, *bounds), unmeasured(wrench, required, *bounds)
    assert 20 < slow.feasible.sum() < 480
    np.testing.assert_array_equal(fast.feasible, slow.feasible)
    np.testing.assert_allclose(fast.tension, slow.tension, atol=1e-9)
    assert np.isnan(fast.margin).all()
