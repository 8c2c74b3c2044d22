"""Cables that run through the platform: against marching along the cable, and against known bodies."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cable_robot, gt_planar, hangprinter, random_poses

from cabslice.robot.body import outward, through
from cabslice.robot.kinematics import cables
from cabslice.robot.rotation import matrix

BOX = 100.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def marched(robot, poses, steps=4000):
    """Whether a point of the cable's first 400 mm lies well inside the hull, by brute force over half-spaces."""
    from scipy.spatial import Delaunay

    hull, lines = Delaunay(robot.attachments), cables(robot, poses)
    back = np.swapaxes(matrix(poses[:, 3:]), 1, 2)
    share = (np.arange(steps) + 0.5) / steps * 400.0
    points = robot.attachments[None, :, None] + share[:, None] * np.einsum("kij,kmj->kmi", back, lines.unit)[:, :, None]
    inside = hull.find_simplex(points.reshape(-1, 3)).reshape(points.shape[:-1]) >= 0
    return inside.sum(axis=2) > 2


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_through_is_what_marching_along_the_cable_finds(seed):
    rng = np.random.default_rng(seed)
    anchors = rng.uniform(-1, 1, (8, 3)) * 1500
    anchors *= 600 / np.minimum(np.linalg.norm(anchors, axis=1), 600)[:, None]
    robot = cable_robot(anchors, BOX)
    poses = random_poses(seed, 20, reach=50.0, turn=0.5)
    sines = outward(robot, poses)
    assert np.isfinite(sines).all()
    sure = np.abs(sines) > 0.05
    np.testing.assert_array_equal(through(robot, poses)[sure], marched(robot, poses)[sure])


def test_crossed_cables_pass_by_and_opposite_ones_go_through():
    robot = cabfab_init_x(pulley_radius=0.0)
    assert not through(robot, robot.home[None]).any()
    swapped = cable_robot(robot.anchors, robot.attachments[[2, 1, 0, 3, 4, 5, 6, 7]])
    np.testing.assert_array_equal(through(swapped, robot.home[None])[0], [1, 0, 1, 0, 0, 0, 0, 0])


def test_where_the_platform_stands_decides():
    """Near an upper corner its own cable leads back over the platform."""
    robot = cabfab_init_x(pulley_radius=0.0)
    poses = np.zeros((2, 6))
    poses[1, :3] = [490, 490, 300]
    np.testing.assert_array_equal(through(robot, poses)[:, 0], [False, True])


def test_a_plate_is_judged_in_its_plane_only():
    robot = gt_planar()
    assert not through(robot, robot.home[None]).any()
    crossed = cable_robot(robot.anchors, robot.attachments[[2, 1, 0, 3]], freedoms=robot.freedoms, home=robot.home)
    np.testing.assert_array_equal(through(crossed, robot.home[None])[0], [1, 0, 1, 0])
    above = robot.anchors + np.array([0, 800, 0])
    lifted = cable_robot(above, crossed.attachments, freedoms=robot.freedoms, home=robot.home)
    assert not through(lifted, robot.home[None]).any()


def test_a_point_has_no_body_and_an_ear_inside_is_not_judged():
    assert np.isnan(outward(hangprinter(), np.zeros((3, 6)))).all()
    anchors = np.vstack((BOX * 10, [[0, 0, 2000]]))
    sines = outward(cable_robot(anchors, np.vstack((BOX, [[0, 0, 50]]))), np.zeros((1, 6)))[0]
    assert np.isnan(sines[8])
    assert sines[:8].min() > 0.5


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_the_sine_is_that_of_the_angle_with_the_face(angle):
    """One cable from a corner, turned in the plane of x and z by an angle over the upper face."""
    out = np.array([-np.cos(angle), 0, np.sin(angle)])
    anchors = BOX * 10
    anchors[7] = BOX[7] + 1000 * out
    sine = outward(cable_robot(anchors, BOX), np.zeros((1, 6)))[0, 7]
    assert abs(sine - np.sin(angle)) < 1e-12
