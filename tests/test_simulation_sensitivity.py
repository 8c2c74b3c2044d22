"""What wrong parameters do to the nozzle: against statics by hand, symmetry, and random robots."""

import numpy as np
import pytest
import robots

from cabslice.robot.kinematics import jacobian
from cabslice.robot.stiffness import deflection, stiffness
from cabslice.robot.tension import nearest_tension
from cabslice.robot.winder import free_cable
from cabslice.robot.wrench import gravity_wrench, required_wrench
from cabslice.simulation import sensitivity as room


@pytest.fixture(scope="module")
def at():
    poses = np.zeros((3, 6))
    poses[:, :3] = [[0, 0, -250], [80, -60, -200], [-100, 90, -300]]
    return room.standing(robots.cabfab_optim(), poses)


@pytest.fixture(scope="module")
def found(at):
    return room.sensitivity(at)


def test_the_robot_of_the_profile_stands_where_it_is_meant_to(at):
    assert np.abs(room.shift(at, at.robot)).max() < 1e-8


def stiff(at):
    robot, poses = at.robot, at.poses
    tension = nearest_tension(robot, poses, required_wrench(robot, poses)).tension
    line = free_cable(robot, at.angles, np.zeros_like(at.angles)).line
    return stiffness(robot, poses, tension, line=line).total, tension


def test_mass_and_zeros_are_loads_on_the_stiffness(at, found):
    whole, _ = stiff(at)
    sag = deflection(at.robot, at.poses, whole, 0.01 * gravity_wrench(at.robot, at.poses))
    np.testing.assert_allclose(found.slope[found.names.index("mass")], sag, rtol=1e-4, atol=1e-9)
    cable = free_cable(at.robot, at.angles, np.zeros_like(at.angles))
    slack = at.robot.axial_stiffness[4] / cable.rest[:, 4]           # N per mm longer, on a cable that pulls
    load = slack[:, None] * jacobian(at.robot, at.poses)[:, 4]
    np.testing.assert_allclose(
        found.slope[found.names.index("zero 5")], deflection(at.robot, at.poses, whole, load), rtol=5e-3, atol=1e-5)


def test_homing_takes_out_what_is_the_same_at_home(found):
    """All anchors moved together: homed at the same place, most of it drops out."""
    for axis in "xyz":
        rows = [i for i, name in enumerate(found.names) if name.startswith("anchor") and name.endswith(axis)]
        assert np.linalg.norm(found.slope[rows].sum(axis=0), axis=1).max() < 0.4


def test_random_robots_spread_as_the_sensitivities_say(at, found):
    sigma = {"anchor": 0.05, "attachment": 0.02, "zero": 0.02, "radius": 0.005, "modulus": 1.0}
    shifts = room.monte_carlo(at, sigma, draws=60, seed=5)
    size = np.array([sigma.get(group, 0.0) * (name != "modulus of all")
                     for group, name in zip(found.groups, found.names, strict=True)])
    linear = np.sqrt(np.einsum("p,pki->ki", size**2, found.slope**2))
    np.testing.assert_allclose(shifts.std(axis=0), linear, rtol=0.45)
    np.testing.assert_array_equal(room.monte_carlo(at, sigma, draws=2, seed=5), shifts[:2])


def test_what_must_be_known_is_what_keeps_the_bound(at, found):
    need = room.needed(found, 0.05)
    assert set(need) == set(room.SMALL)
    one = next(row for row in room.parameters(at.robot) if row.name == need["radius"]["worst"])
    off = room.shift(at, *one.apply(at.robot, need["radius"]["one_alone"]))
    assert np.linalg.norm(off, axis=1).max() == pytest.approx(0.05, rel=0.02)
    assert need["radius"]["standard_deviation_of_all"] < need["radius"]["one_alone"]
