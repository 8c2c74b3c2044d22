"""Published numbers, with their source lines (G: D. Gueners, PhD thesis, Clermont Auvergne 2021), beside ours."""

from dataclasses import replace

import numpy as np
import pytest
from robots import CUBE, cabfab_init_x, cabfab_optim, gt_planar

from cabslice.robot import stiffness, workspace
from cabslice.robot.kinematics import length_rates, lengths
from cabslice.robot.rotation import from_angles
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import required_wrench, wrench_matrix

# G annexes C and D, Init X, steel cable: pose (mm, psi theta phi deg), diag(K_cable) = total x share (kN/m, N m/deg)
ANNEX_D = [
    ([16.1765, -4.6232, -61.2649, -3.457, 0.258, 1.140], [45.320, 46.172, 61.327, 4.355, 4.830, 0.0374]),
    ([16.0314, -3.0921, -61.7897, -5.135, 0.435, 0.510], [45.349, 46.218, 61.460, 4.333, 4.827, 0.0381]),
    ([13.3688, -13.4034, -342.4017, -0.017, 0.155, -0.544], [53.271, 54.619, 45.832, 3.514, 3.700, 0.0543]),
    ([13.2162, -12.9447, -345.9368, -0.138, -0.728, 0.539], [53.384, 54.731, 45.590, 3.496, 3.668, 0.0539])]
MODES = np.array([3.59, 20.14, np.nan, 25.81, 48.88, 54.61])     # G table 5.4, Init X, means over the print space, Hz
WORKSPACE = {"init": 0.465, "init-x": 0.656, "optim": 0.589}       # G table 5.5, share of 1 m^3
PRINT_SPACE = {"init": 0.038, "init-x": 0.098, "optim": 0.085}    # G table 5.5


def pose_of(authority):
    return np.concatenate((authority[:3], from_angles(np.radians(authority[3:]))))[None]


def cabfab_init(**more):
    """Not crossed: cables from the top of the frame go to the upper points, 62.3 mm at 45 deg (G table 5.2)."""
    signs, bottom = np.sign(CUBE[:4, :2]), np.radians(40.2)
    attachments = np.vstack((np.c_[signs * 62.3 / np.sqrt(2), np.full(4, 25.0)],
                             np.c_[signs * 62.3 * [np.cos(bottom), np.sin(bottom)], np.full(4, -25.0)]))
    return replace(cabfab_init_x(**more), attachments=attachments)


def light(build):
    """The thesis' workspaces: 1.15 kg, 0..100 N, point anchors (settings found by domain.md, section 7)."""
    return build(pulley_radius=0.0, mass=1.15, tension_min=np.zeros(8))


@pytest.mark.parametrize(("pose", "published"), ANNEX_D)
def test_cable_stiffness_of_init_x_is_that_of_annex_d(pose, published):
    robot = cabfab_init_x(pulley_radius=0.0)
    found = stiffness.stiffness(robot, pose_of(pose), np.zeros((1, 8))).cable[0]
    ours = np.diag(found) * [1, 1, 1, *[np.pi / 180 / 1e3] * 3]         # kN/m and N m/deg
    np.testing.assert_allclose(ours[:3], published[:3], rtol=0.02)
    np.testing.assert_allclose(ours[3:], published[3:], rtol=0.03)


@pytest.mark.parametrize(("name", "build"), [("init", cabfab_init), ("init-x", cabfab_init_x)])
def test_workspace_of_table_5_5(name, build):
    robot = light(build)
    found = workspace.survey(robot, workspace.frame_grid(robot, count=51), workspace.feasible_margin)
    assert found.fraction == pytest.approx(WORKSPACE[name], abs=0.025)


@pytest.mark.parametrize(("name", "build"), [("init", cabfab_init), ("init-x", cabfab_init_x), ("optim", cabfab_optim)])
def test_print_space_of_table_5_5_in_order_of_size(name, build):
    """The papers leave its settings open (domain.md, section 7): the order of magnitude is what can be asked."""
    found = workspace.print_space(light(build), step=20.0)
    assert 0.7 < found.volume / 1e9 / PRINT_SPACE[name] < 1.4
    assert found.cylinder_volume < found.volume / 2


def test_mode_means_of_table_5_4():
    """K_cable alone, real mass, over the print space from a bed at -460 mm on a 20 mm grid."""
    robot = cabfab_init_x(pulley_radius=0.0)
    space = workspace.print_space(light(cabfab_init_x), step=20.0)
    nozzle = np.stack(np.meshgrid(space.grid.x, space.grid.y, space.grid.z, indexing="ij"), axis=-1)[space.inside]
    poses = np.concatenate((nozzle - robot.nozzle, np.zeros_like(nozzle)), axis=1)
    cable = stiffness.stiffness(robot, poses, np.zeros((len(poses), 8))).cable
    means = stiffness.modes(robot, poses, cable)[0].mean(axis=0)
    np.testing.assert_allclose(means[[1, 3, 4, 5]], MODES[[1, 3, 4, 5]], rtol=0.06)
    assert means[0] == pytest.approx(MODES[0], rel=0.10)


@pytest.mark.parametrize(("preload", "published"), [(15.0, 8.4), (85.0, 17.6)])
def test_preload_raises_the_first_mode_as_in_5_3_2(preload, published):
    """First annex C pose, full K, bounds widened to 1..130 N; the level whose tensions have that mean."""
    robot, pose = cabfab_init_x(pulley_radius=0.0, tension_max=np.full(8, 130.0)), pose_of(ANNEX_D[0][0])
    low, high = 1.0, 130.0
    for _ in range(50):
        level = (low + high) / 2
        at = replace(robot, tension_reference=np.full(8, level))
        tension = nearest_tension(at, pose, required_wrench(robot, pose)).tension
        low, high = (level, high) if tension.mean() < preload else (low, level)
    assert tension.mean() == pytest.approx(preload, abs=1e-6)
    assert stiffness.first_modes(robot, pose, tension)[0] == pytest.approx(published, rel=0.05)


def test_gt_planar_to_nanometres():
    """borglab/GTDynamics, planar painting robot (data/robots.toml): lengths, rates, wrench at (1500, 1500)."""
    robot, pose = gt_planar(), np.array([[1500.0, 0, 1500, 0, 0, 0]])
    np.testing.assert_allclose(lengths(robot, pose), np.full((1, 4), 1350 * np.sqrt(2)), rtol=0, atol=1e-9)
    rates = length_rates(robot, pose, np.array([[0.0, 0, -1000 * np.sqrt(2), 0, 0, 0]]))
    np.testing.assert_allclose(rates, [[-1000, 1000, 1000, -1000]], rtol=0, atol=1e-9)
    supplied = wrench_matrix(robot, pose) @ np.array([1.0, 0, 0, 1.0])
    np.testing.assert_allclose(supplied[0, [0, 2, 4]], [0, -np.sqrt(2), 0], rtol=0, atol=1e-9)
