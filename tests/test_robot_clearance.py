"""Distances between cables, against bounded least squares and against what a moving platform can do to them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cable_robot, hangprinter, random_poses, random_robot
from scipy.optimize import lsq_linear

from cabslice.robot import clearance
from cabslice.robot.kinematics import cables


def by_least_squares(start, end, other_start, other_end):
    """min |start + s way - other - t other_way| over 0 <= s, t <= 1."""
    table = np.column_stack((end - start, other_start - other_end))
    return np.sqrt(2 * lsq_linear(table, other_start - start, (0, 1), tol=1e-14, method="bvls").cost)


def test_every_pair_at_every_pose_is_as_near_as_least_squares_says():
    robot, poses = random_robot(1), random_poses(1, 12)
    lines, found = cables(robot, poses), clearance.closest(robot, poses)
    assert found.distance.shape == (12, 28)
    for k in range(12):
        for p, (i, j) in enumerate(found.pairs):
            expected = by_least_squares(lines.exit[k, i], lines.tip[k, i], lines.exit[k, j], lines.tip[k, j])
            np.testing.assert_allclose(found.distance[k, p], expected, rtol=0, atol=1e-6)
    i, j = found.pairs.T
    at_first = lines.exit[:, i] + found.first[..., None] * (lines.tip - lines.exit)[:, i]
    at_second = lines.exit[:, j] + found.second[..., None] * (lines.tip - lines.exit)[:, j]
    np.testing.assert_allclose(np.linalg.norm(at_first - at_second, axis=2), found.distance, rtol=0, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["skew", "parallel", "touching", "collinear", "point"]))
def test_segments_of_every_kind(seed, kind):
    rng = np.random.default_rng(seed)
    start, end, other_start, other_end = rng.uniform(-10, 10, (4, 3))
    if kind == "parallel":
        other_end = other_start + rng.uniform(-2, 2) * (end - start)
    elif kind == "touching":
        other_start = start + rng.uniform(0, 1) * (end - start)
    elif kind == "collinear":
        other_start, other_end = (start + rng.uniform(-2, 2) * (end - start) for _ in range(2))
    elif kind == "point":
        other_end = other_start.copy()
    got = clearance.segment_distance(start, end, other_start, other_end)
    grid = np.linspace(0, 1, 201)
    points, others = (a + grid[:, None] * (b - a) for a, b in ((start, end), (other_start, other_end)))
    sampled = np.linalg.norm(points[:, None] - others[None], axis=2).min()
    assert got <= sampled + 1e-9
    assert got >= sampled - (np.linalg.norm(end - start) + np.linalg.norm(other_end - other_start)) / 400 - 1e-9
    np.testing.assert_allclose(got, clearance.segment_distance(other_start, other_end, start, end), atol=1e-7)
    if kind == "touching":
        assert got < 1e-7


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_no_distance_outruns_the_platform(seed, pulleys):
    """Lipschitz: |d| for point anchors; times 1 + r_i/l_i + r_j/l_j, at its worst along the way, with pulleys."""
    robot = random_robot(seed % 7, pulleys=pulleys)
    start, shift = random_poses(seed, 20), np.zeros((20, 6))
    shift[:, :3] = np.random.default_rng(seed).uniform(-30, 30, (20, 3))
    before, after = clearance.closest(robot, start), clearance.closest(robot, start + shift)
    along = [clearance.distance_rates(robot, cables(robot, start + share * shift)) for share in np.linspace(0, 1, 7)]
    bound = np.max(along, axis=0) * np.linalg.norm(shift, axis=1)[:, None]
    assert (np.abs(after.distance - before.distance) <= bound * (1 + 1e-3) + 1e-9).all()
    if not pulleys:
        assert np.max(along) == 1.0


def test_the_bound_is_met_where_a_tip_runs_at_an_anchor():
    robot = cable_robot([[0, 0, 1000], [300, 0, 0]], [[0, 0, 0], [5300, 0, 0]])
    poses = np.zeros((2, 6))
    poses[1, 0] = 40.0
    np.testing.assert_allclose(clearance.closest(robot, poses).distance[:, 0], [300.0, 260.0], rtol=0, atol=1e-9)


def test_cables_that_share_an_end_are_left_out():
    robot = hangprinter()
    assert np.isinf(clearance.cable_gaps(robot, np.array([[0.0, 0, 100, 0, 0, 0]]))).all()
    robot = cabfab_init_x()
    assert not clearance.share_an_end(robot).any()
    anchors = robot.anchors.copy()
    anchors[3] = anchors[0]
    shared = clearance.share_an_end(cable_robot(anchors, robot.attachments))
    assert np.flatnonzero(shared).tolist() == [2]          # pairs (0, 1), (0, 2), (0, 3)


def test_gaps_are_between_skins():
    robot = cabfab_init_x()
    poses = random_poses(3, 5, turn=0.0)
    gaps = clearance.cable_gaps(robot, poses)
    np.testing.assert_allclose(gaps, clearance.closest(robot, poses).distance - 2 * 0.27, rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 1025])
def test_blocks_do_not_matter(count):
    robot, poses = random_robot(2), random_poses(4, 1025)[:count]
    whole = clearance.closest(robot, poses)
    assert whole.distance.shape == (count, 28)
    if count:
        last = clearance.closest(robot, poses[-1:])
        np.testing.assert_array_equal(whole.distance[-1], last.distance[0])
