"""Parts of which the answer is known in closed form, and the thesis' cylinders by brute force."""

import numpy as np
import pytest
from feasibility_cases import LINC_ANCHORS, LINC_ATTACHMENTS, LINC_EDGE, box_loop, part_contacts, robot_of, stacked
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim
from scipy.optimize import brentq

from cabslice.feasibility.distance import sweep_gap
from cabslice.feasibility.exits import lines_at, offsets
from cabslice.feasibility.obstacles import Obstacles
from cabslice.robot.workspace import frame_grid, free_radius

# A cable from A to b = q + d crosses height h at x = (1 - s) A + s (q + d), s = (h - A_z)/(b_z - A_z). With the nozzle
# q anywhere in a convex, centred section S it meets S where (1 - s) A + s d lies in S - s S = (1 + s) S. s grows with h
# and reaches s_top = (z - A_z)/(z + d_z - A_z) below the nozzle's height z, so that the cable is free as long as s_top
# stays below the least such s: z < A_z + s d_z / (1 - s).

def height_at(share, anchor, offset):
    return anchor[2] + share * offset[2] / (1 - share) if share < 1 else np.inf


def entering_disc(anchor, offset, radius):
    """Least s in (0, 1) with |A + s (d - A)| = (1 + s) R: a quadratic."""
    a, w = anchor[:2], offset[:2] - anchor[:2]
    roots = np.roots([w @ w - radius**2, 2 * (a @ w - radius**2), a @ a - radius**2])
    inside = [r.real for r in roots if abs(r.imag) < 1e-12 and 0 < r.real < 1]
    return min(inside, default=np.inf)


def entering_box(anchor, offset, sides):
    """Least s in (0, 1) with |A + s (d - A)| <= (1 + s) sides/2 in x and y: an interval each."""
    first, last = 0.0, 1.0
    for a, d, half in zip(anchor, offset, np.asarray(sides) / 2, strict=False):
        for sign in (1, -1):                       # sign (a + s (d - a)) <= (1 + s) half
            slope, start = sign * (d - a) - half, sign * a - half
            if slope < 0:
                first = max(first, start / -slope)
            elif slope > 0:
                last = min(last, -start / slope)
            elif start > 0:
                return np.inf
    return first if first <= last else np.inf


def free_height(robot, entering):
    return min(height_at(entering(a, d), a, d) for a, d in zip(robot.anchors, offsets(robot), strict=True))


def prism_is_free(robot, outline, height):
    """By the search; one layer, as only the last height decides. The outline: middle of a bead 1e-3 mm wide."""
    return not len(part_contacts(stacked([[outline]], width=1e-3, height=height), robot, 0.0).move)


def circle(radius, count=360):
    """A polygon of the same area, so within 0.02 mm of the circle."""
    turn = 2 * np.pi / count * np.arange(count + 1)
    grown = radius * np.sqrt(2 * np.pi / count / np.sin(2 * np.pi / count))
    return grown * np.stack((np.cos(turn), np.sin(turn)), axis=1)


def test_the_closed_formula_gives_the_published_cube():
    robot = robot_of(LINC_ANCHORS, LINC_ATTACHMENTS)
    edge = brentq(lambda e: free_height(robot, lambda a, d: entering_box(a, d, (e, e))) - e, 100, 900)
    assert edge == pytest.approx(LINC_EDGE, abs=1e-3)


def some_robot(seed):
    """Four cables from low anchors around the part to a platform above the nozzle."""
    rng = np.random.default_rng(seed)
    turn = np.pi / 4 + np.pi / 2 * np.arange(4) + rng.uniform(-0.5, 0.5, 4)
    around, low = np.stack((np.cos(turn), np.sin(turn)), axis=1), rng.uniform(-40, 20, (4, 1))
    anchors = np.hstack((rng.uniform(700, 1500, (4, 1)) * around, low))
    return robot_of(anchors, np.hstack((rng.uniform(50, 200, (4, 1)) * around, rng.uniform(60, 150, (4, 1)))))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(120, 300), st.floats(0.7, 1.4))
def test_boxes_of_the_height_of_the_closed_formula_are_free_below_their_size_and_blocked_above(seed, side, ratio):
    robot, sides = some_robot(seed), (side, side * ratio)
    height = free_height(robot, lambda a, d: entering_box(a, d, sides))
    if 20 < height < 3000:
        assert prism_is_free(robot, box_loop(*(length - 1e-3 - 0.1 for length in sides)), height)
        assert not prism_is_free(robot, box_loop(*(length - 1e-3 + 0.1 for length in sides)), height)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(80, 200))
def test_cylinders_of_the_height_of_their_envelope_are_free_below_their_radius_and_blocked_above(seed, radius):
    robot = some_robot(seed)
    height = free_height(robot, lambda a, d: entering_disc(a, d, radius))
    if 20 < height < 3000:
        assert prism_is_free(robot, circle(radius - 0.1), height)
        assert not prism_is_free(robot, circle(radius + 0.1), height)


def sampled_radius(exits, tips, top, count=301):
    """Least distance (K,) from the axis met on cables between the bed and `top`: dense points, then denser ones."""
    rise = tips[..., 2] - exits[..., 2]
    share = np.clip(np.stack((0 - exits[..., 2], top[:, None] - exits[..., 2])) / rise, 0, 1)
    low, high = share.min(axis=0), share.max(axis=0)
    meets = (np.minimum(exits[..., 2], tips[..., 2]) <= top[:, None]) & (np.maximum(exits[..., 2], tips[..., 2]) >= 0)
    best = np.full(low.shape, np.inf)
    for _ in range(3):
        s = low + np.linspace(0, 1, count)[:, None, None] * (high - low)
        x, y = (exits[..., i] + s * (tips[..., i] - exits[..., i]) for i in (0, 1))
        away = np.hypot(x, y)
        at = away.argmin(axis=0)
        best = np.minimum(best, away.min(axis=0))
        step = (high - low) / (count - 1)
        here = np.take_along_axis(s, at[None], axis=0)[0]
        low, high = np.maximum(here - step, low), np.minimum(here + step, high)
    return np.where(meets, best, np.inf).min(axis=1)


@pytest.mark.parametrize("machine", [cabfab_init_x, cabfab_optim], ids=["init-x", "optim"])
def test_thesis_cylinders_are_judged_as_brute_force_does_on_every_grid_point(machine):
    """Nozzle 100 mm below C; a cylinder as wide as the nozzle is off the axis, from the bed to the nozzle."""
    robot = machine(bed_origin=np.array([0, 0, -500.0]), bed_size=np.array([1000.0, 1000.0]))
    grid = frame_grid(robot, step=50.0)
    poses = grid.poses()
    xyz = poses[:, :3] + robot.nozzle - robot.bed_origin
    radius = np.hypot(xyz[:, 0], xyz[:, 1])
    rows = np.flatnonzero((xyz[:, 2] > 0) & (radius > 0))
    lines = lines_at(robot, xyz[rows])
    good = np.isfinite(lines.exit).all(axis=(1, 2))
    rows, exits, tips = rows[good], lines.exit[good] - robot.bed_origin, lines.tip[good] - robot.bed_origin
    xyz, radius, count, m = xyz[rows], radius[rows], len(rows), robot.cables
    sampled = np.concatenate([sampled_radius(exits[i:i + 256], tips[i:i + 256], xyz[i:i + 256, 2])
                              for i in range(0, count, 256)])
    zero, owner = np.zeros((count * m, 2)), np.repeat(np.arange(count), m)
    stage = np.zeros(count * m, int)
    cylinders = Obstacles(zero, zero, radius[owner], stage * 0.0, xyz[owner, 2], stage, stage)
    ends = tips.reshape(-1, 3)
    gap, _ = sweep_gap(exits.reshape(-1, 3), ends, ends, cylinders, np.full(count * m, 1.0))
    exact = (gap.reshape(count, m) <= 0).any(axis=1)
    assert np.abs(sampled - radius).min() > 1e-3           # no case so close that samples could not tell
    assert count > 5000
    assert 0.1 < exact.mean() < 0.95
    np.testing.assert_array_equal(exact, sampled < radius)
    np.testing.assert_array_equal(free_radius(robot, poses[rows]) < radius, exact)
