"""The smoothed path: how near it stays, how smooth it is, and that no filament is lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline

from cabslice.timing.grid import lay_grid
from cabslice.timing.path import deviation, evaluate, smooth
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

CORNER = 0.05


def places(path, starts, per_move=40):
    """Many places on each move of each piece, ends included."""
    moves = np.arange(starts[0], starts[-1])
    share = np.linspace(0, 1, per_move)
    move = np.repeat(moves, per_move)
    return move, np.tile(share, len(moves)) * path.length[move]


@given(st.integers(0, 10_000), st.integers(3, 30))
@settings(max_examples=40, deadline=None)
def test_the_curve_stays_within_the_tolerance_of_every_vertex_and_segment(seed, count):
    toolpath = polyline(seed, count)
    path = smooth(toolpath, CORNER)
    move, sigma = places(path, toolpath.starts)
    curve = evaluate(path, move, sigma).q
    start, along = toolpath.xyz[:-1], np.diff(toolpath.xyz, axis=0)
    share = np.einsum("ksi,si->ks", curve[:, None] - start, along) / np.maximum((along**2).sum(1), 1e-300)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    assert np.linalg.norm(curve[:, None] - nearest, axis=2).min(axis=1).max() <= CORNER + 1e-9
    moves = np.arange(1, len(toolpath.xyz))
    at_vertex = np.linalg.norm(evaluate(path, moves, path.length[1:]).q - toolpath.xyz[1:], axis=1)
    assert at_vertex.max() <= CORNER + 1e-9
    np.testing.assert_allclose(at_vertex, deviation(path)[1:], atol=1e-9)


@given(st.integers(0, 10_000), st.integers(6, 30))
@settings(max_examples=40, deadline=None)
def test_derivatives_are_those_of_the_curve_and_continuous_across_moves(seed, count):
    toolpath = polyline(seed, count)
    path = smooth(toolpath, CORNER)
    rng = np.random.default_rng(seed)
    move = rng.integers(1, len(toolpath.xyz), 200)
    halves = np.stack((path.half[move - 1], path.half[move]))
    room = np.minimum(path.length[move], np.where(halves > 0, halves, np.inf).min(axis=0))
    step = 1e-4 * room
    sigma = np.clip(rng.random(200) * path.length[move], step, path.length[move] - step)
    low, here, high = (evaluate(path, move, sigma + shift) for shift in (-step, 0 * step, step))
    np.testing.assert_allclose((high.q - low.q) / (2 * step)[:, None], here.d1, atol=1e-6)
    error = np.abs((high.d1 - low.d1) / (2 * step)[:, None] - here.d2).max(axis=1)
    assert (error <= 1e-3 / room).all()
    inner = np.setdiff1d(np.arange(1, len(toolpath.xyz) - 1), toolpath.starts - 1)
    before, after = evaluate(path, inner, path.length[inner]), evaluate(path, inner + 1, 0 * path.length[inner + 1])
    np.testing.assert_allclose(before.q, after.q, atol=1e-9)
    np.testing.assert_allclose(before.d1, after.d1, atol=1e-9)
    np.testing.assert_allclose(before.d2, after.d2, atol=1e-6 * (1 + np.abs(after.d2).max()))
    assert np.linalg.norm(here.d1, axis=1).max() <= 1 + 1e-12


def test_filament_is_fed_to_the_last_um_and_in_step_with_the_length():
    toolpath = polyline(3, 40)
    path = smooth(toolpath, CORNER)
    moves = np.arange(1, len(toolpath.xyz))
    fed = np.cumsum(toolpath.filament)[1:]
    np.testing.assert_allclose(evaluate(path, moves, path.length[moves]).filament, fed, atol=1e-12)
    half = evaluate(path, moves, path.length[moves] / 2).filament
    np.testing.assert_allclose(half, fed - toolpath.filament[1:] / 2, atol=1e-12)


def test_an_exact_reversal_turns_back_within_the_tolerance():
    toolpath = polyline(points=[[0, 0, 0], [10, 0, 0], [2, 0, 0]], pieces=1)
    path = smooth(toolpath, CORNER)
    tip = evaluate(path, np.array([1]), path.length[[1]])
    assert tip.q[0, 0] == pytest.approx(10 - CORNER)
    np.testing.assert_allclose(tip.d1, 0, atol=1e-12)


@given(st.integers(0, 10_000), st.integers(2, 40))
@settings(max_examples=40, deadline=None)
def test_the_grid_covers_every_move_without_gap_or_overlap(seed, count):
    toolpath = polyline(seed, count)
    path = smooth(toolpath, CORNER)
    grid = lay_grid(path, toolpath.starts)
    assert (grid.high > grid.low).all()
    for move in range(1, len(toolpath.xyz)):
        inside = grid.move == move
        assert grid.low[inside][0] == 0.0
        assert grid.high[inside][-1] == path.length[move]
        np.testing.assert_array_equal(grid.low[inside][1:], grid.high[inside][:-1])
    assert (np.diff(grid.move) >= 0).all()
    np.testing.assert_array_equal(grid.move[grid.intervals[:-1]], toolpath.starts[:-1])


@pytest.mark.parametrize(("facets", "radius"), [(720, 50.0), (90, 20.0), (48, 10.0)])
def test_facets_of_a_round_wall_are_run_as_the_circle_they_stand_for(facets, radius):
    """At the speed asked for, with at most half as much again as the acceleration of the circle, and never outside."""
    angle = np.linspace(0, 2 * np.pi, facets + 1)
    points = np.stack((radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), 20.0)), axis=1)
    toolpath = polyline(points=points, pieces=1, speed=60.0)
    trajectory = plan(toolpath, cabfab_optim(), PRINTER, MATERIAL, PROCESS)
    times = np.arange(0.1, trajectory.duration - 0.1, 1e-3)
    seen = sample(trajectory, times)
    speed, accel = (np.linalg.norm(column[:, :3], axis=1) for column in (seen.rates, seen.accels))
    assert speed.max() <= 60.0 * (1 + 1e-9)
    assert speed.min() >= 60.0 * np.cos(np.pi / facets) - 0.1            # where the curve cuts a vertex
    assert accel.max() <= 1.51 * 60.0**2 / radius
    away = np.hypot(*(seen.poses[:, :2] - trajectory.to_pose[:2]).T)
    assert np.abs(away - radius).max() <= CORNER + radius * (1 - np.cos(np.pi / facets))
    assert away.max() <= radius + 1e-9
