"""Available wrenches: every row, margin and facet against linear programmes that know no null space."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x
from scipy.optimize import linprog

from cabslice.robot import reach
from cabslice.robot.nullspace import balance, elementary_vectors
from cabslice.robot.wrench import wrench_matrix

INIT_X = cabfab_init_x(pulley_radius=0.0)


def level_wrench_matrix(points):
    return wrench_matrix(INIT_X, np.column_stack((points, np.zeros((len(points), 3)))))


def random_wrench_matrix(rng, count, freedoms, cables):
    wrench = rng.normal(size=(count, freedoms, cables))
    wrench[:, 3:] *= 60.0
    return wrench


def lp_margin(wrench, required, lower, upper):
    """max delta: W t = required, t_min + delta <= t <= t_max - delta, by HiGHS; -inf where W t = required fails."""
    cables = wrench.shape[1]
    scale = 1 / np.abs(wrench).max(axis=1)
    rows = np.concatenate((np.eye(cables), -np.eye(cables)))
    answer = linprog(
        np.append(np.zeros(cables), -1.0), np.hstack((rows, np.ones((2 * cables, 1)))), np.append(upper, -lower),
        np.hstack((wrench * scale[:, None], np.zeros((len(wrench), 1)))), required * scale,
        bounds=[(None, None)] * cables + [(None, np.min(upper - lower) / 2)], method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10})
    return -answer.fun if answer.status == 0 else -np.inf


def wrenches(rng, wrench, spread):
    """Required wrenches inside and outside the reach: balance a random tension that may leave the bounds."""
    tension = rng.uniform(50 - spread, 50 + spread, (len(wrench), wrench.shape[2]))
    return np.einsum("kij,kj->ki", wrench, tension)


@pytest.mark.parametrize(("freedoms", "cables"), [(6, 8), (6, 6), (6, 7), (6, 9), (3, 4), (3, 6), (2, 4)])
def test_margins_are_those_of_the_linear_programme(freedoms, cables):
    rng = np.random.default_rng(freedoms * 10 + cables)
    wrench = random_wrench_matrix(rng, 40, freedoms, cables)
    required = wrenches(rng, wrench, 75.0)
    lower, upper = np.full(cables, 1.0), rng.uniform(80, 120, cables)
    expected = [lp_margin(w, r, lower, upper) for w, r in zip(wrench, required, strict=True)]
    got = reach.margins(wrench, required, lower, upper)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    assert 0 < np.count_nonzero(got > 0) < 40 or freedoms < 6


def test_margins_of_the_cube_printer_agree_on_symmetric_poses_too():
    axes = np.meshgrid([-400.0, 0.0, 200.0], [-300.0, 0.0], [-400.0, 0.0, 300.0, 450.0])
    points = np.stack(axes, axis=-1).reshape(-1, 3)
    wrench = level_wrench_matrix(points)
    required = np.broadcast_to([0, 0, 25.48, 0, 0, 0], (len(points), 6))
    lower, upper = np.full(8, 1.0), np.full(8, 100.0)
    expected = [lp_margin(w, r, lower, upper) for w, r in zip(wrench, required, strict=True)]
    np.testing.assert_allclose(reach.margins(wrench, required, lower, upper), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("own_bounds", [False, True])
def test_rows_hold_exactly_where_a_tension_exists(own_bounds):
    rng = np.random.default_rng(3)
    count = 150
    wrench = level_wrench_matrix(rng.uniform(-300, 300, (count, 3)))
    lower, upper = np.full((count, 8), 1.0), np.full((count, 8), 100.0)
    if own_bounds:
        lower, upper = lower + rng.uniform(0, 5, (count, 8)), upper - rng.uniform(0, 20, (count, 8))
    gravity = np.tile([0, 0, 25.5, 0, 0, 0], (count, 1))
    along_u, along_x = rng.normal(size=(2, count, 6))
    along_u[:, 3:] *= 30
    a, b, lo, hi = reach.tension_rows(wrench, gravity, along_u, along_x, lower, upper)
    assert a.shape == b.shape == lo.shape == hi.shape == (56, count)
    u, x = rng.normal(size=(2, count)) * [[25], [40]]
    value = a * u + b * x
    slack = np.minimum(value - lo, hi - value).min(axis=0)
    required = gravity + along_u * u[:, None] + along_x * x[:, None]
    margin = np.array([lp_margin(*pose) for pose in zip(wrench, required, lower, upper, strict=True)])
    clear = np.abs(margin) > 1e-6
    assert (np.sign(slack) == np.sign(margin))[clear].all()
    assert 20 < np.count_nonzero(margin > 0) < count - 20
    said = np.isfinite(hi)
    np.testing.assert_allclose((hi - lo)[said], 2.0, rtol=0, atol=1e-9)


def test_facets_agree_with_the_linear_programme_and_measure_newtons():
    rng = np.random.default_rng(4)
    wrench = level_wrench_matrix(rng.uniform(-350, 350, (120, 3)))
    required = wrenches(rng, wrench, 70.0)
    lower, upper = np.full(8, 1.0), np.full(8, 100.0)
    normals, offsets = reach.available_wrenches(wrench, lower, upper)
    assert normals.shape == (120, 112, 6)
    slack = (offsets - np.einsum("kfi,ki->kf", normals, required)).min(axis=1)
    expected = [lp_margin(w, r, lower, upper) for w, r in zip(wrench, required, strict=True)]
    np.testing.assert_allclose(np.minimum(slack, 49.5), expected, rtol=0, atol=1e-6)


def test_facets_are_the_shifted_hyperplanes_of_gouttefarde_and_krut():
    """Their definition: the normal is orthogonal to five columns of W; the offset sums the outward columns."""
    rng = np.random.default_rng(5)
    wrench = random_wrench_matrix(rng, 1, 6, 8)
    lower, upper = rng.uniform(0, 5, 8), rng.uniform(50, 100, 8)
    normals, offsets = reach.available_wrenches(wrench, lower, upper)
    directions = normals[0] @ wrench[0]
    assert ((np.abs(directions) < 1e-10).sum(axis=1) == 5).all()
    farthest = np.maximum(directions * lower, directions * upper).sum(axis=1)
    np.testing.assert_allclose(offsets[0], farthest, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.abs(directions).sum(axis=1), 1.0, rtol=0, atol=1e-12)
    corners = lower + (upper - lower) * ((np.arange(256)[:, None] >> np.arange(8)) & 1)
    slack = offsets[0] - corners @ wrench[0].T @ normals[0].T
    assert slack.min() > -1e-9                                            # the zonotope lies inside
    np.testing.assert_allclose(slack.min(axis=0), 0.0, rtol=0, atol=1e-9)  # and touches every facet


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(0, 4))
def test_balance_spans_all_solutions(seed, freedoms, redundancy):
    rng = np.random.default_rng(seed)
    wrench = random_wrench_matrix(rng, 5, freedoms, freedoms + redundancy)
    side = rng.normal(size=(5, freedoms))
    state = balance(wrench, side)
    null, particular = state.null.transpose(2, 0, 1), state.particular[:, 0].T
    size = np.abs(particular).max()
    np.testing.assert_allclose(np.einsum("kij,kj->ki", wrench, particular), side, rtol=0, atol=1e-11 * size)
    np.testing.assert_allclose(wrench @ null, 0, atol=1e-11)
    np.testing.assert_allclose(null.swapaxes(1, 2) @ null - np.eye(redundancy), 0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("kmr,km->kr", null, particular), 0, atol=1e-13 * size)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
def test_elementary_vectors_are_orthogonal_to_the_null_space(seed, redundancy):
    rng = np.random.default_rng(seed)
    null = np.linalg.qr(rng.normal(size=(redundancy + 3, redundancy)))[0][..., None]
    members, weights = elementary_vectors(null)
    total = sum(weight * null[members[:, p]].transpose(1, 0, 2) for p, weight in enumerate(weights))
    np.testing.assert_allclose(total, 0, atol=1e-13)
    assert min(np.abs(weight).min() for weight in weights) > 0


def test_singular_poses_admit_nothing_and_poison_nobody():
    rng = np.random.default_rng(6)
    wrench = level_wrench_matrix(rng.uniform(-200, 200, (3, 3)))
    wrench[1, 5] = wrench[1, 3]
    required = np.broadcast_to([0, 0, 25.0, 0, 0, 0], (3, 6))
    lower, upper = np.full(8, 1.0), np.full(8, 100.0)
    assert np.isneginf(reach.margins(wrench, required, lower, upper)).tolist() == [False, True, False]
    a, _, lo, hi = reach.tension_rows(wrench, required, required, required, lower, upper)
    assert (lo[:, 1] > hi[:, 1]).all()
    assert (a[:, 1] == 0).all()
    assert (lo[:, [0, 2]] < hi[:, [0, 2]]).all()
    normals, offsets = reach.available_wrenches(wrench, lower, upper)
    assert (normals[1] == 0).all()
    assert np.isneginf(offsets[1]).all()
    assert np.isfinite(normals).all()


def test_bad_questions_are_refused():
    wrench = np.ones((1, 6, 5))
    with pytest.raises(ValueError, match="5 cables cannot hold 6 freedoms"):
        balance(wrench, np.zeros((1, 6)))
    with pytest.raises(ValueError, match="not below"):
        reach.margins(np.ones((1, 2, 4)), np.zeros((1, 2)), np.full(4, 5.0), np.full(4, 5.0))
    with pytest.raises(ValueError, match="expected 4"):
        reach.margins(np.ones((1, 2, 4)), np.zeros((1, 2)), np.full(3, 1.0), np.full(3, 5.0))
