"""Workspaces: measures against linear programmes, maps against single poses, cylinders against sampled cables."""

import time
from dataclasses import replace

import numpy as np
import pytest
from robots import cabfab_init_x, cabfab_optim, cable_robot, hangprinter, random_poses, random_robot
from scipy.optimize import linprog

from cabslice.robot import workspace
from cabslice.robot.clearance import segment_distance
from cabslice.robot.kinematics import cables
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import required_wrench, wrench_matrix


def test_closure_is_what_the_linear_programme_says():
    """t >= 1 with W t = 0, unbounded above: that and full rank is wrench closure."""
    robot = cabfab_init_x()
    poses = random_poses(1, 200, reach=450.0, turn=0.1)
    measure = workspace.closure(robot, poses)
    wrench = wrench_matrix(robot, poses, lines=cables(robot, poses, refuse=False))
    scale = np.array([1, 1, 1, 0.02, 0.02, 0.02])[:, None]
    closed = [linprog(np.ones(8), A_eq=w * scale, b_eq=np.zeros(6), bounds=(1, None)).status == 0 for w in wrench]
    clear = np.abs(measure) > 1e-6
    assert (clear | (measure == 0)).all()
    assert ((measure > 0) == closed)[clear].all()
    assert 20 < np.sum(closed) < 180


def test_a_suspended_robot_has_no_wrench_closure():
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    anchors = np.vstack((np.c_[corners * 1000, np.full(4, 1000)], np.c_[corners * 900, np.full(4, 1100)]))
    attachments = np.vstack((np.c_[corners * 80, np.full(4, 40)], np.c_[corners * [40, 90], np.full(4, -40)]))
    robot = cable_robot(anchors, attachments)
    assert (workspace.closure(robot, random_poses(2, 50)) <= 0).all()


def test_a_map_is_its_measure_at_each_node():
    robot = cabfab_optim()
    grid = workspace.frame_grid(robot, count=7, turn=np.array([0.0, 0.02, 0.0]))
    for name, measure in workspace.MEASURES.items():
        found = workspace.survey(robot, grid, measure, threshold=1.0)
        assert found.value.shape == found.inside.shape == (7, 7, 7)
        i, j, k = 2, 4, 1
        pose = np.array([[grid.x[i], grid.y[j], grid.z[k], 0, 0.02, 0]])
        np.testing.assert_allclose(found.value[i, j, k], measure(robot, pose)[0], rtol=1e-12, err_msg=name)
        assert found.fraction == np.count_nonzero(found.inside) / 343


def test_feasible_nodes_are_those_with_tensions():
    robot = cabfab_init_x()
    poses = random_poses(4, 500, reach=330.0, turn=0.05)
    margin = workspace.feasible_margin(robot, poses)
    held = nearest_tension(robot, poses, required_wrench(robot, poses))
    assert ((margin >= 0) == held.feasible).all()
    mode, stiff = workspace.first_mode(robot, poses), workspace.nozzle_stiffness(robot, poses)
    assert (np.isfinite(mode) == held.feasible).all()
    assert (np.isfinite(stiff) == held.feasible).all()
    assert (stiff[held.feasible] > 0).all()


def test_poses_that_no_cable_reaches_are_outside():
    robot = cabfab_init_x(pulley_radius=25.27)
    on_axis = np.zeros((1, 6))
    on_axis[0, :3] = robot.anchors[0] - robot.attachments[0] + [3, 3, -200]
    for measure in workspace.MEASURES.values():
        assert not measure(robot, on_axis)[0] >= 0


def test_grids_cover_the_frame_with_its_faces():
    robot = cabfab_init_x()
    grid = workspace.frame_grid(robot, step=20.0)
    assert grid.shape == (51, 51, 51)
    assert (grid.x[0], grid.x[-1]) == (-500.0, 500.0)
    poses = grid.poses()
    assert len(poses) == 51**3
    np.testing.assert_array_equal(poses[51 * 51 + 2 * 51 + 3], [-480, -460, -440, 0, 0, 0])
    np.testing.assert_array_equal(grid.poses(slice(100, 200)), poses[100:200])
    flat = workspace.frame_grid(hangprinter(), count=3)
    assert flat.shape == (3, 3, 3)
    with pytest.raises(ValueError, match="either count or step"):
        workspace.frame_grid(robot, count=3, step=20.0)


def test_rays_end_on_the_border():
    robot = cabfab_init_x()
    rng = np.random.default_rng(5)
    ways = rng.normal(size=(30, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = workspace.along_rays(robot, robot.home, ways, workspace.feasible_margin, far=480.0)
    ends = np.zeros((30, 6))
    for share, inside in ((reach - 0.02, True), (reach + 0.02, False)):
        ends[:, :3] = share[:, None] * ways
        stopped = reach < 480.0
        assert ((workspace.feasible_margin(robot, ends) >= 0) == inside)[stopped].all()
    assert stopped.any()
    assert (reach > 50).all()
    outside = workspace.along_rays(robot, [480.0, 480, 480, 0, 0, 0], ways, workspace.feasible_margin, far=50.0)
    assert (outside == 0).all()


@pytest.mark.parametrize("pulleys", [False, True])
def test_the_free_radius_is_the_distance_to_the_axis_of_the_bed(pulleys):
    robot = random_robot(3, pulleys=pulleys, bed_origin=np.array([30.0, -20.0, -460.0]))
    poses = random_poses(6, 30, reach=300.0)
    lines, found = cables(robot, poses), workspace.free_radius(robot, poses)
    share = np.linspace(0, 1, 4001)[:, None, None, None]
    points = lines.exit + share * (lines.tip - lines.exit)
    between = (points[..., 2] >= -460) & (points[..., 2] <= poses[:, 2, None] - 100)
    radius = np.where(between, np.hypot(points[..., 0] - 30, points[..., 1] + 20), np.inf).min(axis=(0, 2))
    assert (np.isinf(found) == np.isinf(radius)).all()
    known = np.isfinite(radius)
    assert (found[known] <= radius[known] + 1e-9).all()
    np.testing.assert_allclose(found[known], radius[known], rtol=0, atol=0.5)
    axis = np.array([30.0, -20.0, -460.0]), np.array([30.0, -20.0, 500.0])
    from_axis = segment_distance(lines.exit, lines.tip, *axis).min(axis=1)
    assert (found >= from_axis - 1e-9)[poses[:, 2] - 100 < 500].all()


def test_the_largest_cylinder_is_free_and_a_larger_one_is_not():
    robot = cabfab_init_x(pulley_radius=0.0)
    found = workspace.print_space(robot, step=40.0)
    bed, apart = -460.0, np.hypot(found.grid.x[:, None], found.grid.y)
    heights = found.grid.z - bed

    def free(radius, height):
        nodes = found.free_radius[apart <= radius][:, heights <= height]
        return (nodes >= radius).all()

    assert free(found.cylinder_radius, found.cylinder_height)
    assert found.cylinder_volume == pytest.approx(np.pi * found.cylinder_radius**2 * found.cylinder_height)
    radii = np.unique(apart)
    best = max(np.pi * r**2 * h for r in radii for h in heights if free(r, h))
    assert found.cylinder_volume == pytest.approx(best)
    assert found.cylinder_volume < found.volume
    x, y, z = np.nonzero(found.inside)
    assert (found.free_radius[x, y, z] >= apart[x, y]).all()
    assert found.volume == pytest.approx(len(x) * 40.0**3)


def test_a_print_space_needs_a_bed_and_a_nozzle():
    with pytest.raises(ValueError, match="nozzle and a bed"):
        workspace.print_space(replace(cabfab_init_x(), nozzle=None))


def test_a_map_of_51_cubed_takes_seconds():
    robot = cabfab_init_x()
    begin = time.process_time()
    workspace.survey(robot, workspace.frame_grid(robot, count=51), workspace.feasible_margin)
    assert time.process_time() - begin < 6.0          # 3 s on a quiet core: benchmarks/robot.py
