"""Tension distributions by name: each against its own definition, all against linear programmes for feasibility."""

import numpy as np
import pytest
from field_robots import cogiro, ipanema_3
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim
from scipy.linalg import null_space
from scipy.spatial import ConvexHull, HalfspaceIntersection

from cabslice.robot import reach
from cabslice.robot.distributions import METHODS, distribute, distribution
from cabslice.robot.polytope import barycentre
from cabslice.robot.tension import nearest
from cabslice.robot.wrench import required_wrench, wrench_matrix

LOW, HIGH, LEVEL = np.full(8, 1.0), np.full(8, 100.0), np.full(8, 25.0)
EXACT = ("nearest", "least-norm", "barycentre", "puncture", "qp", "lp")
SPREAD = {"cabfab-init-x": (cabfab_init_x, [300, 300, 300], 0.05),
          "cabfab-optim": (cabfab_optim, [300, 300, 300], 0.05),
          "ipanema-3": (ipanema_3, [6000, 4000, 1500], 0.1), "cogiro": (cogiro, [5500, 4000, 2000], 0.1)}


def some_poses(name, count, seed=1):
    build, spread, turn = SPREAD[name]
    rng = np.random.default_rng(seed)
    return build(), rng.uniform(-1, 1, (count, 6)) * [*spread, turn, turn, turn]


def random_case(rng, count, cables, spread=60.0):
    wrench = rng.normal(size=(count, 6, cables))
    wrench[:, 3:] *= 60.0
    return wrench, np.einsum("kij,kj->ki", wrench, rng.uniform(50 - spread, 50 + spread, (count, cables)))


@pytest.mark.parametrize("name", list(SPREAD))
def test_exact_methods_solve_every_pose_that_the_linear_programme_solves(name):
    robot, poses = some_poses(name, 150)
    required = required_wrench(robot, poses)
    by_lp = distribute(robot, poses, required, method="lp").feasible
    assert by_lp.sum() > 50
    for method in EXACT:
        found = distribute(robot, poses, required, method=method)
        assert (found.feasible == by_lp).all(), method
        assert ((found.margin > 0) == by_lp).all()
        assert_balances(robot, poses, required, found)
    normals, offsets = reach.facets(robot, poses)
    assert ((np.einsum("kfi,ki->kf", normals, required) <= offsets).all(axis=1) == by_lp).all()


def assert_balances(robot, poses, required, found):
    supplied = np.einsum("kij,kj->ki", wrench_matrix(robot, poses), found.tension)[found.feasible]
    size = np.nanmax(found.tension) * np.array([1, 1, 1, 1e3, 1e3, 1e3])
    assert (np.abs(supplied - required[found.feasible]) < 1e-9 * size).all()
    held = found.tension[found.feasible]
    slip = 1e-6 * (robot.tension_max - robot.tension_min)
    assert ((held >= robot.tension_min - slip) & (held <= robot.tension_max + slip)).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SPREAD))
def test_coverage_of_five_thousand_feasible_poses(name, capsys, request):
    if "slow" not in request.config.getoption("-m"):
        pytest.skip("20,000 linear programmes: run with `pytest -m slow`")
    robot, poses = some_poses(name, 12000, seed=2)
    required = required_wrench(robot, poses)
    by_lp = distribute(robot, poses, required, method="lp").feasible
    assert (reach.pose_margins(robot, poses, required) > 0).tolist() == by_lp.tolist()
    kept = np.flatnonzero(by_lp)[:5000]
    assert len(kept) == 5000
    poses, required = poses[kept], required[kept]
    batched = [method for method in METHODS if method not in ("lp", "qp", "slack")]
    share = {method: distribute(robot, poses, required, method=method).feasible.mean() for method in batched}
    with capsys.disabled():
        print(f"\n{name}: " + ", ".join(f"{method} {100 * value:.2f} %" for method, value in share.items()))
    for method in EXACT[:4]:
        assert share[method] == 1.0, method
    assert share["closed-form"] <= share["improved-closed-form"]


def test_closed_form_is_potts_formula():
    rng = np.random.default_rng(3)
    wrench, required = random_case(rng, 50, 8)
    found = distribution("closed-form")(wrench, required, LOW, HIGH, LEVEL)
    middle = (LOW + HIGH) / 2
    expected = middle + np.einsum("kji,ki->kj", np.linalg.pinv(wrench), required - wrench @ middle)
    inside = ((expected >= LOW) & (expected <= HIGH)).all(axis=1)
    assert (found.feasible == inside).all()
    assert 0 < inside.sum() < 50
    np.testing.assert_allclose(found.tension[inside], expected[inside], rtol=0, atol=1e-9)


@pytest.mark.parametrize("cables", [7, 8, 9])
def test_improved_closed_form_is_potts_algorithm(cables):
    rng = np.random.default_rng(4)
    wrench, required = random_case(rng, 80, cables, spread=52.0)
    low, high = np.full(cables, 1.0), np.full(cables, 100.0)
    found = distribution("improved-closed-form")(wrench, required, low, high, low)
    expected = np.array([potts_algorithm(w, r, low, high) for w, r in zip(wrench, required, strict=True)])
    inside = np.isfinite(expected).all(axis=1)
    assert (found.feasible == inside).all()
    assert inside.sum() > 20
    np.testing.assert_allclose(found.tension[inside], expected[inside], rtol=0, atol=1e-7)


def potts_algorithm(wrench, required, low, high):
    """On the matrices, as in the paper: drop the column of the clamped cable and move it to the right side."""
    tension, free = (low + high) / 2, np.ones(len(low), dtype=bool)
    while free.sum() >= len(wrench):
        middle = ((low + high) / 2)[free]
        rest = required - wrench[:, ~free] @ tension[~free]
        tension[free] = middle + np.linalg.pinv(wrench[:, free]) @ (rest - wrench[:, free] @ middle)
        excess = np.where(free, np.maximum(low - tension, tension - high), 0.0)
        if excess.max() <= 1e-9:
            return tension
        worst = excess.argmax()
        tension[worst], free[worst] = np.clip(tension[worst], low[worst], high[worst]), False
    return np.full(len(low), np.nan)


def test_barycentre_is_the_centroid_of_the_polygon():
    """Against qhull: vertices by half-plane intersection, centroid by its triangulation."""
    rng = np.random.default_rng(5)
    wrench, required = random_case(rng, 60, 8, spread=40.0)
    found = distribution("barycentre")(wrench, required, LOW, HIGH, LEVEL)
    for k in np.flatnonzero(found.margin > 0.1):
        null = null_space(wrench[k])
        rows, inner = np.concatenate((null, -null)), found.tension[k]
        planes = np.column_stack((rows, np.concatenate((inner - HIGH, LOW - inner))))
        space = HalfspaceIntersection(planes, interior_point(wrench, required, k, inner, null))
        corners = space.intersections[ConvexHull(space.intersections).vertices]
        one, other = corners, np.roll(corners, -1, axis=0)
        area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        centroid = (area[:, None] * (one + other)).sum(axis=0) / (3 * area.sum())
        np.testing.assert_allclose(centroid, 0, atol=1e-6)


def interior_point(wrench, required, k, inner, null):
    inset = nearest(wrench[[k]], required[[k]], LOW + 0.05, HIGH - 0.05, LEVEL).tension[0]
    return null.T @ (inset - inner)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_barycentre_counts_twin_edges_once(seed):
    """Cables 1, 2 carry the same rows of N: twin strips. The polygon is a box whose middle is known."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    rows = np.array([[1.0, 0], [1, 0], [0, 1], [0, 1], [-1, 0], [0, 0]]) @ turn
    left, right, down, up = rng.uniform(-9, -1), rng.uniform(1, 9), rng.uniform(-9, -1), rng.uniform(1, 9)
    lower = np.array([left, left, down, down, -right, -1.0]) + 20
    upper = np.array([right, right, up, up, -left, 1.0]) + 20
    offset = rows @ (turn.T @ [3.0, 4.0])
    point = barycentre(rows[..., None], (lower - 20 + offset)[:, None], (upper - 20 + offset)[:, None])[:, 0]
    np.testing.assert_allclose(turn @ point, [3 + (left + right) / 2, 4 + (down + up) / 2], atol=1e-9)


def test_puncture_lies_where_the_line_from_the_barycentre_leaves_the_polygon():
    rng = np.random.default_rng(6)
    wrench, required = random_case(rng, 200, 8, spread=40.0)
    centre = distribution("barycentre")(wrench, required, LOW, HIGH, LEVEL)
    found = distribution("puncture")(wrench, required, LOW, HIGH, LEVEL)
    target = LEVEL + np.einsum("kji,ki->kj", np.linalg.pinv(wrench), required - wrench @ LEVEL)
    ok = found.feasible
    along, whole = (found.tension - centre.tension)[ok], (target - centre.tension)[ok]
    share = np.einsum("kj,kj->k", along, whole) / np.einsum("kj,kj->k", whole, whole)
    np.testing.assert_allclose(along, share[:, None] * whole, atol=1e-8)
    assert ((share > -1e-12) & (share < 1 + 1e-12)).all()
    beyond = centre.tension[ok] + (share + 1e-6)[:, None] * whole
    left = ((beyond < LOW) | (beyond > HIGH)).any(axis=1)
    assert (left | (share > 1 - 1e-9)).all()
    assert left.any()


def test_the_references_agree_with_the_fast_ones():
    rng = np.random.default_rng(7)
    wrench, required = random_case(rng, 40, 8, spread=50.0)
    slow, fast = (distribution(name)(wrench, required, LOW, HIGH, LEVEL) for name in ("qp", "nearest"))
    assert (slow.feasible == fast.feasible).all()
    np.testing.assert_allclose(slow.tension[slow.feasible], fast.tension[slow.feasible], rtol=0, atol=1e-6)
    norm, total = (distribution(name)(wrench, required, LOW, HIGH, LEVEL) for name in ("least-norm", "lp"))
    ok = slow.feasible
    assert ok.sum() > 10
    assert (np.linalg.norm(norm.tension[ok], axis=1) <= np.linalg.norm(total.tension[ok], axis=1) + 1e-9).all()
    assert (total.tension[ok].sum(axis=1) <= norm.tension[ok].sum(axis=1) + 1e-6).all()


@pytest.mark.parametrize("method", ["nearest", "least-norm", "improved-closed-form", "barycentre", "puncture"])
def test_continuous_along_a_circle(method):
    robot = cabfab_init_x(pulley_radius=0.0)
    angle = np.arange(0, 2 * np.pi, 0.5 / 180)
    poses = np.zeros((len(angle), 6))
    poses[:, 0], poses[:, 1], poses[:, 2] = 180 * np.cos(angle), 180 * np.sin(angle), -150
    found = distribute(robot, poses, required_wrench(robot, poses), method=method)
    assert found.feasible.all()
    stretch = np.diff(found.tension, axis=0) * 1000 / robot.axial_stiffness
    assert np.abs(stretch).max() < 0.010


def test_only_two_redundant_cables_have_a_barycentre_here():
    rng = np.random.default_rng(9)
    wrench, required = random_case(rng, 3, 9)
    with pytest.raises(ValueError, match="at most two"):
        distribution("barycentre")(wrench, required, np.full(9, 1.0), np.full(9, 100.0), np.full(9, 20.0))


def test_an_unknown_name_is_answered_with_the_names():
    with pytest.raises(ValueError, match="'newest', expected one of: nearest, least-norm"):
        distribution("newest")
