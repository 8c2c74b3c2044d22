"""How poses are held: stiffness against finite differences of the pull, preload as a mean, why a pose cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_init_x, cabfab_optim, hangprinter, moved, random_poses
from scipy.optimize import linprog

from cabslice.errors import PoseError
from cabslice.robot import held, stiffness, winder, workspace
from cabslice.robot.distributions import METHODS, distribute
from cabslice.robot.kinematics import lengths
from cabslice.robot.wrench import required_wrench, wrench_matrix


def pull(robot, poses, rest):
    """Wrench of the cables at constant rest length of the whole line: winder, pulley, n strands; from conservation."""
    winders = robot.winders
    line = winder.line_to_pulley(robot, winder.radius(winders, winders.home_angle[None]))
    tension = robot.axial_stiffness * ((line + winders.advantage * lengths(robot, poses)) / rest - 1)
    return np.einsum("kij,kj->ki", wrench_matrix(robot, poses), tension)


def rest_of(robot, poses, tension):
    winders = robot.winders
    line = winder.line_to_pulley(robot, winder.radius(winders, winders.home_angle[None]))
    return (line + winders.advantage * lengths(robot, poses)) / (1 + tension / robot.axial_stiffness)


@pytest.mark.parametrize("robot", [cabfab_init_x(), cabfab_optim(), hangprinter(tension_max=np.full(4, 300.0))],
                         ids=lambda robot: robot.name)
def test_stiffness_is_the_derivative_of_the_pull_at_constant_rest_length(robot):
    turn = 0.02 if robot.freedoms.all() else 0.0
    poses = random_poses(1, 40, reach=150.0, turn=turn) + robot.home
    found = held.hold(robot, poses)
    kept = found.tensions.feasible
    assert kept.sum() > 10
    poses, total = poses[kept], found.stiffness.total[kept]
    rest = rest_of(robot, poses, found.tensions.tension[kept])
    for axis in np.flatnonzero(robot.freedoms):
        step = np.zeros((len(poses), 6))
        step[:, axis] = 1e-2 if axis < 3 else 1e-5
        change = pull(robot, moved(poses, step), rest) - pull(robot, moved(poses, -step), rest)
        column = -change / (2 * step[0, axis])
        np.testing.assert_allclose(total[:, :, axis][:, robot.freedoms], column[:, robot.freedoms],
                                   rtol=1e-5, atol=1e-6 * np.abs(column).max())


def test_the_line_at_home_stands_for_the_line_at_the_pose():
    robot = cabfab_init_x()
    robot = replace(robot, winders=replace(robot.winders, centre=robot.winders.centre + np.array([0, 0, 3.0])))
    poses = random_poses(2, 200, reach=150.0)
    found = held.hold(robot, poses)
    kept = found.tensions.feasible
    length = lengths(robot, poses[kept])
    angle = winder.motor_angles(robot, length, found.tensions.tension[kept])
    exact = stiffness.stiffness(robot, poses[kept], found.tensions.tension[kept],
                                line=winder.loaded_length(robot, length, angle) - length)
    np.testing.assert_allclose(found.stiffness.total[kept], exact.total, rtol=2e-3, atol=1e-3 * exact.total.max())
    point = held.hold(replace(robot, winders=None), poses[kept])
    assert (found.modes_hz[kept][:, 1:] < point.modes_hz[:, 1:]).all()      # longer cables are softer


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), mean=st.floats(5.0, 95.0))
def test_preload_is_the_mean_of_tensions_that_carry_the_weight(seed, mean):
    robot, poses = cabfab_init_x(), random_poses(seed, 40, reach=250.0, turn=0.02)
    found = held.weight_tensions(robot, poses, preload=mean)
    any_level = held.weight_tensions(robot, poses).feasible
    least, most = held.mean_range(robot, poses)
    np.testing.assert_array_equal(found.feasible, any_level & (least <= mean) & (mean <= most))
    tension = found.tension[found.feasible]
    np.testing.assert_allclose(tension.mean(axis=1), mean, atol=1e-5)
    assert (tension >= 1 - 1e-6).all()
    assert (tension <= 100 + 1e-6).all()
    supplied = np.einsum("kij,kj->ki", wrench_matrix(robot, poses[found.feasible]), tension)
    np.testing.assert_allclose(supplied, required_wrench(robot, poses)[found.feasible], atol=1e-6)


def test_preload_lifts_the_first_mode():
    robot, pose = cabfab_init_x(), np.array([[20.0, 10, -100, 0, 0, 0]])
    first = [held.hold(robot, pose, preload=mean).modes_hz[0, 0] for mean in (15.0, 30.0, 60.0, 80.0)]
    assert (np.diff(first) > 0.2).all()


def test_a_distribution_without_a_level_has_no_preload():
    robot, pose = cabfab_init_x(), np.zeros((1, 6))
    with pytest.raises(ValueError, match="expected one of: nearest"):
        held.hold(robot, pose, method="closed-form", preload=30.0)
    assert set(held.LEVELLED) < set(METHODS)


def test_without_preload_tensions_are_those_of_the_distribution():
    robot, poses = cabfab_optim(), random_poses(3, 60, reach=300.0)
    for method in ("nearest", "closed-form", "barycentre", "qp"):
        ours = held.weight_tensions(robot, poses, method=method)
        theirs = distribute(robot, poses, required_wrench(robot, poses), method=method)
        np.testing.assert_array_equal(ours.tension, theirs.tension)


def test_maps_are_single_poses():
    robot, poses = cabfab_init_x(), random_poses(4, 100, reach=330.0)
    found = held.hold(robot, poses)
    pairs = (held.first_mode(), found.modes_hz[:, 0]), (held.nozzle_stiffness(), held.softest(robot, found))
    for measure, single in pairs:
        np.testing.assert_allclose(measure(robot, poses), single, rtol=1e-9)
    assert np.isnan(single).any()
    assert np.isfinite(single).any()


def test_maps_leave_out_what_no_cable_reaches():
    robot = cabfab_init_x()
    inside_pulley = np.zeros((2, 6))
    inside_pulley[0, :3] = robot.anchors[0] - robot.attachments[0] + [3, 3, -200]
    np.testing.assert_array_equal(np.isfinite(held.first_mode(preload=25.0)(robot, inside_pulley)), [False, True])
    with pytest.raises(PoseError, match="cable 1"):
        held.hold(robot, inside_pulley)


def test_why_not_says_what_a_linear_programme_finds():
    """Least widening of the bounds: min d with W t = w, t_min - d <= t <= t_max + d."""
    robot = cabfab_init_x(pulley_radius=0.0)
    scale = np.array([1, 1, 1, 0.02, 0.02, 0.02])
    said = 0
    for pose in random_poses(5, 40, reach=330.0, turn=0.02):
        fault, row = held.why_not(robot, pose), pose[None]
        matrix = np.column_stack((wrench_matrix(robot, row)[0] * scale[:, None], np.zeros(6)))
        wider = np.block([[-np.eye(8), -np.ones((8, 1))], [np.eye(8), -np.ones((8, 1))]])
        answer = linprog(np.eye(9)[8], A_eq=matrix, b_eq=required_wrench(robot, row)[0] * scale, A_ub=wider,
                         b_ub=np.concatenate((-robot.tension_min, robot.tension_max)), bounds=(None, None))
        assert (fault is None) == (answer.fun < 1e-9)
        if fault is not None:
            said += 1
            assert -fault.details["margin_n"] == pytest.approx(answer.fun, rel=1e-6)
            assert f"{answer.fun:.2f} N" in fault.sentence
            tension = np.array(fault.details["tensions_n"])
            for cable in fault.details["cables"]:
                worst = tension[cable - 1]
                assert max(worst - 100, 1 - worst) == pytest.approx(answer.fun, rel=1e-5)
                assert f"cable {cable} at {worst:.2f} N" in fault.sentence
    assert 5 < said < 35


def test_why_not_tells_a_poor_method_and_a_preload_out_of_reach_from_no_tensions():
    robot, poses = cabfab_init_x(), random_poses(6, 300, reach=300.0)
    best, poor = (held.weight_tensions(robot, poses, method=method).feasible for method in ("nearest", "closed-form"))
    missed = poses[np.flatnonzero(best & ~poor)[0]]
    assert "closed-form leaves 1..100 N" in held.why_not(robot, missed, method="closed-form").sentence
    assert held.why_not(robot, missed) is None
    least, most = held.mean_range(robot, missed[None])
    sentence = held.why_not(robot, missed, preload=99.0).sentence
    assert f"{least[0]:.2f} to {most[0]:.2f} N" in sentence
    assert held.why_not(robot, missed, preload=float(least[0] + most[0]) / 2) is None


def test_a_pose_that_is_singular_is_called_so():
    robot = cabfab_init_x(pulley_radius=0.0)
    flat = replace(robot, attachments=np.zeros((8, 3)))
    assert "singular" in held.why_not(flat, np.zeros(6)).sentence


def test_measures_serve_as_masks_of_the_print_space():
    robot = cabfab_optim()
    loose = workspace.print_space(robot, step=100.0)
    stiff = workspace.print_space(robot, step=100.0, mask=held.first_mode(), threshold=13.0)
    assert 0 < stiff.volume < loose.volume
    assert not (stiff.inside & ~loose.inside).any()
