"""The swivelling pulley: values of the thesis, the point model as its limit, a taut string, what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cable_robot, random_poses, random_robot

from cabslice.errors import ImpossibleError, PoseError
from cabslice.robot.kinematics import cables, lengths
from cabslice.robot.pulley import hessian, lead

SEEDS = st.integers(0, 2**31 - 1)


def single(radius, tip, axis=(0.0, 0, 1)):
    robot = cable_robot(np.zeros((1, 3)), np.zeros((1, 3)), axes=[axis], pulley_radius=radius)
    return cables(robot, np.array([[*tip, 0, 0, 0]], float))


@pytest.mark.parametrize(("z", "wrap", "length"), [(-500, 138.546, 749.6546), (500, 45.609, 709.1030)])
def test_values_of_the_pulley_model(z, wrap, length):
    """domain.md section 2: r_p = 25, B = (500, 0, +-500)."""
    line = single(25.0, (500, 0, z))
    assert abs(np.degrees(line.wrap[0, 0]) - wrap) < 5e-4
    assert abs(line.free[0, 0] - 689.2024) < 5e-5
    assert abs(line.length[0, 0] - length) < 5e-5
    arccos = np.arccos(z / np.hypot(475, 500)) + np.arcsin(25 / np.hypot(475, 500))
    assert abs(line.wrap[0, 0] - arccos) < 1e-13


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_the_string_is_taut(seed):
    """|AB| is the free length; the cable is tangent to its pulley at A, in the swivel plane."""
    robot = random_robot(seed)
    lines = cables(robot, random_poses(seed, 20))
    np.testing.assert_allclose(np.linalg.norm(lines.exit - lines.tip, axis=2), lines.free, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lines.tip + lines.free[..., None] * lines.unit, lines.exit, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(lines.unit, axis=2), 1, atol=1e-13)
    arm = lines.tip - robot.anchors
    out = arm - np.einsum("kmi,mi->km", arm, robot.pulley_axes)[..., None] * robot.pulley_axes
    centre = robot.anchors + robot.pulley_radii[:, None] * out / np.linalg.norm(out, axis=2, keepdims=True)
    spoke = lines.exit - centre
    np.testing.assert_allclose(
        np.linalg.norm(spoke, axis=2), np.broadcast_to(robot.pulley_radii, lines.free.shape), atol=1e-9
    )
    assert np.abs(np.einsum("kmi,kmi->km", spoke, lines.unit)).max() < 1e-9
    assert np.abs(np.einsum("kmi,kmi->km", lines.side, lines.exit - robot.anchors)).max() < 1e-9
    np.testing.assert_allclose(lines.length, lines.free + robot.pulley_radii * lines.wrap, rtol=0, atol=1e-10)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_the_wrap_is_the_longer_way_no_string_could_save(seed):
    """Summing the wrap as a thousand chords from P to A, over the side the cable arrives on, gives r_p beta."""
    robot = random_robot(seed)
    lines = cables(robot, random_poses(seed, 3))
    part = np.linspace(0, 1, 4001)[:, None, None] * lines.wrap
    e = -np.cross(robot.pulley_axes, lines.side)
    path = robot.anchors + robot.pulley_radii[:, None] * (
        (1 - np.cos(part))[..., None] * e + np.sin(part)[..., None] * robot.pulley_axes
    )
    chords = np.linalg.norm(np.diff(path, axis=0), axis=3).sum(axis=0)
    np.testing.assert_allclose(chords, robot.pulley_radii * lines.wrap, rtol=1e-6)
    np.testing.assert_allclose(path[-1], lines.exit, rtol=0, atol=1e-9)


def test_without_pulleys_it_is_the_point_model_exactly():
    robot, poses = random_robot(3, pulleys=False), random_poses(3, 50)
    lines = cables(robot, poses)
    assert (lines.exit == robot.anchors).all()
    reach = robot.anchors - lines.tip
    np.testing.assert_allclose(lines.length, np.linalg.norm(reach, axis=2), rtol=0, atol=1e-12)
    np.testing.assert_allclose(lines.unit, reach / lines.length[..., None], rtol=0, atol=1e-14)
    above = single(0.0, (0, 0, 300))  # an eyelet has no swivel axis to stand on
    assert above.length == 300
    np.testing.assert_allclose(above.unit, [[[0, 0, -1]]])
    np.testing.assert_allclose(hessian(above)[0, 0], np.diag([1, 1, 0]) / 300, atol=1e-18)


def test_a_vanishing_pulley_tends_to_the_point_model():
    poses, point = random_poses(5, 50), lengths(random_robot(5, pulleys=False), random_poses(5, 50))
    gaps = []
    for radius in (1e-1, 1e-2, 1e-3):
        robot = random_robot(5)
        thin = cable_robot(robot.anchors, robot.attachments, axes=robot.pulley_axes, pulley_radius=radius)
        gaps.append(np.abs(lengths(thin, poses) - point).max())
    np.testing.assert_allclose(np.divide(gaps[:-1], gaps[1:]), 10, rtol=0.01)  # first order in the radius
    assert gaps[-1] < 2e-3


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, pulleys=st.booleans())
def test_gradient_and_hessian_of_the_length(seed, pulleys):
    """dL/dB = -u (virtual work), and the second derivative is that gradient's, both by central differences."""
    robot, step = random_robot(seed, pulleys=pulleys), 1e-3
    tip = cables(robot, random_poses(seed, 10)).tip
    here, zero = lead(robot, tip, tip), np.zeros(3)
    turn = hessian(here)
    for axis in range(3):
        move = zero + step * np.eye(3)[axis]
        ahead, behind = lead(robot, tip + move, tip), lead(robot, tip - move, tip)
        np.testing.assert_allclose(
            (ahead.length - behind.length) / (2 * step), -here.unit[..., axis], rtol=0, atol=2e-9
        )
        np.testing.assert_allclose(-(ahead.unit - behind.unit) / (2 * step), turn[..., axis], rtol=0, atol=2e-9)


def test_lateral_curvature_is_the_one_of_the_papers():
    robot = cabfab_init_x()
    lines = cables(robot, random_poses(1, 30))
    half = np.tan(lines.wrap / 2)
    np.testing.assert_allclose(1 / lines.lateral, lines.free + robot.pulley_radii * half, rtol=1e-12)


@pytest.mark.parametrize(
    ("radius", "tip", "sentence"),
    [
        (25.0, (20, 0, 500), "20.000 mm from the swivel axis, expected more than the pulley radius 25.000 mm"),
        (25.0, (30, 0, 5), "7.071 mm from the pulley centre, expected more than the pulley radius 25.000 mm"),
        (0.0, (0, 0, 0), "it has no length"),
    ],
)
def test_poses_inside_the_pulley_are_refused_with_cable_and_pose(radius, tip, sentence):
    robot = cable_robot([[9e3, 0, 0], [0, 0, 0]], np.zeros((2, 3)), pulley_radius=radius)
    poses = np.array([[500, 0, 0, 0, 0, 0], [*tip, 0, 0, 0]], float)
    with pytest.raises(PoseError, match=f"cable 2 at pose 1: .*{sentence}") as caught:
        cables(robot, poses)
    assert isinstance(caught.value, ImpossibleError)
    assert caught.value.details == {"cable": 2, "pose": 1}
    open_eyes = cables(robot, poses, refuse=False)
    np.testing.assert_array_equal(np.isnan(open_eyes.length), [[False, False], [False, True]])
