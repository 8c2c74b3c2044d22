"""platform.pull_n: what tube and hose pull with is held, planned, audited and simulated as the weight is."""

from dataclasses import replace

import numpy as np
import pytest
import robots
from cli_cases import PRINTER, SETS, answered, run, write_box

from cabslice.profile import shelf
from cabslice.robot.model import robot_from_printer
from cabslice.robot.stiffness import deflection, stiffness
from cabslice.robot.tension import nearest_tension
from cabslice.robot.winder import free_cable
from cabslice.robot.wrench import gravity_wrench, required_wrench, wrench_matrix
from cabslice.simulation.sensitivity import shift, standing

PULL = ("-s", "platform.pull_n=[3.0, -2.0, 4.0]", "-s", "platform.pull_n_mm=[120.0, 80.0, -60.0]")


def pulled():
    return robot_from_printer(shelf.load_printer("cabfab-optim", [word for word in PULL if word != "-s"]))


def test_it_is_carried_beside_the_weight():
    robot, poses = pulled(), robots.random_poses(7, 30, turn=0.1)
    plain = replace(robot, pull=np.zeros(6))
    np.testing.assert_allclose(gravity_wrench(robot, poses) - gravity_wrench(plain, poses),
                               np.tile([3.0, -2, 4, 120, 80, -60], (30, 1)), atol=1e-9)
    found = nearest_tension(robot, poses, required_wrench(robot, poses))
    held = np.einsum("kij,kj->ki", wrench_matrix(robot, poses), found.tension) + gravity_wrench(robot, poses)
    assert np.abs(held[found.feasible]).max() < 1e-6


def test_a_hose_that_the_profile_does_not_know_moves_the_nozzle_by_the_compliance():
    robot, poses = replace(pulled(), pull=np.zeros(6)), np.array([[0.0, 0, -250, 0, 0, 0]])
    at = standing(robot, poses)
    small = 1e-2 * pulled().pull
    tension = nearest_tension(robot, poses, required_wrench(robot, poses)).tension
    line = free_cable(robot, at.angles, np.zeros_like(at.angles)).line
    bent = deflection(robot, poses, stiffness(robot, poses, tension, line=line).total, small[None])
    np.testing.assert_allclose(shift(at, replace(robot, pull=small)), bent, rtol=2e-3, atol=1e-7)


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pulled")
    box = write_box(folder / "box.stl", (4.0, 3.0, 0.3))
    for name, more in (("plain", ()), ("pulled", PULL)):
        assert run("plan", box, *PRINTER, *SETS, *more, "-o", folder / f"{name}.plan", "-q") == 0
    return folder


def test_what_is_planned_for_it_stays_on_the_path(capsys, plans):
    """Planned, audited (plan passes) and played: the compiled and the numpy rows know the same load."""
    code, told = answered(capsys, "simulate", plans / "pulled.plan")
    assert code == 0
    assert told["numbers"]["nozzle_error"]["max_mm"] < 3e-3
    off = answered(capsys, "simulate", plans / "plain.plan", *PULL)[1]["numbers"]["nozzle_error"]["rms_mm"]
    assert off > 0.05


def test_rows_of_both_ways_agree():
    from cabslice.robot.usable import usable_tension_max
    from cabslice.timing import kernel
    from cabslice.timing.limits import RESERVE, Limits, Nodes, rows, winder_speed_x, winding_caps

    robot = pulled()
    limits = Limits(5000.0, 150.0, 12.0, 60.0, 1500.0, 5.0, 5e-3)
    poses = np.zeros((4, 6))
    poses[:, :3] = [[0, 0, -250], [80, -60, -200], [-100, 90, -300], [30, 30, -150]]
    d1, d2 = np.zeros((2, 4, 6))
    d1[:, 0], d2[:, 1] = 1.0, 0.3
    nodes = Nodes(poses, d1, d2, np.full(4, 0.03), np.full(4, 5000.0))
    a, b, _ = rows(robot, limits, nodes)
    u, x = np.full(4, 900.0), np.full(4, 9000.0)
    columns = kernel.columns(robot, usable_tension_max(robot), *winding_caps(robot), 5000.0, 1500.0, 1 - RESERVE)
    places = [np.ascontiguousarray(column[:, :3]) for column in (poses, d1, d2)]
    found = kernel.used(*places, nodes.feed, nodes.acceleration, np.zeros(4, bool), u, x, columns)
    by_rows = (a * u[:, None] + b * x[:, None]).max(axis=1)
    np.testing.assert_allclose(found, np.maximum(by_rows, x / winder_speed_x(robot, nodes)), rtol=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_the_audit_knows_it(turn):
    from cabslice.timing.audit_forces import needed

    robot, poses = pulled(), robots.random_poses(7, 5, turn=turn)
    np.testing.assert_allclose(needed(robot, poses, poses, poses, 1e-3), required_wrench(robot, poses), atol=1e-7)
