"""The shipped robots of the field: their figures as published, the motion they command, and who of them can print."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from cabslice.errors import ProfileError
from cabslice.profile import shelf
from cabslice.robot.body import through
from cabslice.robot.kinematics import length_rates, lengths
from cabslice.robot.model import nozzle_poses, robot_from_printer
from cabslice.robot.stiffness import gravity_stiffness
from cabslice.robot.tension import nearest_tension
from cabslice.robot.winder import angle_of, motor_angles, wound
from cabslice.robot.wrench import gravity_wrench, required_wrench, wrench_matrix

DATA = Path(__file__).parents[2] / "shared" / "data" / "robots.toml"
FIELD = {"caroca": "caroca", "cogiro": "cogiro", "ipanema-3": "ipanema_3", "segesta": "segesta",
         "hangprinter-v4": "hangprinter_v4"}
PRINTING = ["hangprinter-linc", "hangprinter-v4"]
SILENT = ["caroca", "cogiro", "gt-planar", "ipanema-3", "segesta"]


def robot(name):
    return robot_from_printer(shelf.load_printer(name))


@pytest.fixture(scope="module")
def data():
    if not DATA.is_file():
        pytest.skip("shared/data/robots.toml is not beside the checkout")
    return tomllib.loads(DATA.read_text())


@pytest.mark.parametrize("name", FIELD)
def test_geometry_and_mass_are_the_published_ones(data, name):
    given, made = data[FIELD[name]], robot(name)
    np.testing.assert_array_equal(made.anchors, given["anchors_mm"])
    np.testing.assert_array_equal(made.attachments, given.get("attachments_mm", np.zeros((4, 3))))
    assert made.mass == given.get("mass_kg", given.get("mover_mass_kg"))
    if "pulley_radius_mm" in given:
        np.testing.assert_allclose(made.pulley_radii, given["pulley_radius_mm"], rtol=1e-12)
    if "cable_diameter_mm" in given:
        np.testing.assert_array_equal(2 * made.cable_radii, given["cable_diameter_mm"])
    if "inertia_kg_m2" in given:
        np.testing.assert_allclose(made.inertia, np.diag(given["inertia_kg_m2"]) * 1e6, rtol=1e-12)


def test_inertia_of_cogiro_is_the_published_one_about_the_origin(data):
    """Moved back by the parallel axis theorem, to the kg mm^2 that the profile rounds to."""
    given, made = data["cogiro"], robot("cogiro")
    np.testing.assert_array_equal(made.centre_of_mass, given["centre_of_mass_mm"])
    arm = made.centre_of_mass
    about = made.inertia + made.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(about, np.array(given["inertia_about_origin_kg_m2"]) * 1e6, rtol=0, atol=1.0)


def test_lower_lines_of_linc_are_the_published_ones(data):
    given, made = data["hangprinter_linc"], robot("hangprinter-linc")
    np.testing.assert_array_equal(made.anchors[:6], given["anchors_mm"])
    np.testing.assert_array_equal(made.attachments[:6] - made.nozzle, given["attachments_from_nozzle_mm"])
    assert made.bed_origin.tolist() == made.nozzle.tolist() == [0, 0, 0]
    assert not made.cable_radii.any()
    assert not made.clearance.any()


def test_linc_keeps_its_parallel_pairs_and_holds_the_turn():
    """Two pairs of lower lines stay of one length anywhere; all six freedoms are held."""
    made = robot("hangprinter-linc")
    poses = np.zeros((50, 6))
    poses[:, :3] = np.random.default_rng(0).uniform([-400, -400, 0], [400, 400, 1000], (50, 3))
    cable = lengths(made, poses)
    # the third pair is 10 mm off, as published
    np.testing.assert_allclose(cable[:, [0, 2]], cable[:, [1, 3]], rtol=0, atol=0.02)
    needed = required_wrench(made, poses)
    found = nearest_tension(made, poses, needed)
    assert found.feasible.all()
    balance = np.einsum("kij,kj->ki", wrench_matrix(made, poses), found.tension)
    np.testing.assert_allclose(balance, needed, rtol=0, atol=1e-6)


def test_gt_planar_is_that_of_gtdynamics():
    """borglab/GTDynamics: lengths, rates and the wrench of two cables, to 1e-9."""
    made = robot("gt-planar")
    pose = np.array([[1500.0, 0, 1500, 0, 0, 0]])
    np.testing.assert_allclose(lengths(made, pose), 1350 * np.sqrt(2), rtol=1e-12)
    rates = np.array([[0, 0, -1000 * np.sqrt(2), 0, 0, 0]])
    np.testing.assert_allclose(length_rates(made, pose, rates)[0], [-1000, 1000, 1000, -1000], rtol=0, atol=1e-9)
    wrench = wrench_matrix(made, pose, masked=True)[0] @ [1, 0, 0, 1]
    np.testing.assert_allclose(wrench, [0, -np.sqrt(2)], rtol=0, atol=1e-9)
    assert not gravity_wrench(made, pose).any()


def test_gravity_of_the_profile_is_what_the_robot_feels():
    """Half of it: half the weight, and the stiffness of a hanging centre of mass halves with it."""
    moon = robot_from_printer(shelf.load_printer("cogiro", ["gravity_mm_s2=4903.325"]))
    earth, poses = robot("cogiro"), np.array([[100.0, -50, 2000, 0.1, 0.05, -0.1]])
    assert gravity_wrench(earth, poses)[0, 2] == pytest.approx(-91.058 * 9.80665, rel=1e-12)
    for weighed in (gravity_wrench, gravity_stiffness):
        np.testing.assert_allclose(2 * weighed(moon, poses), weighed(earth, poses), rtol=1e-12)


def test_gt_planar_cannot_hold_its_turn_at_any_level_pose(tmp_path):
    """So ry is not among its freedoms: asked to hold it, the profile is refused."""
    with pytest.raises(ProfileError, match="the cables do not hold ry"):
        shelf.load_printer("gt-planar", ['freedoms=["x", "z", "ry"]', "platform.home_mm=[1300, 0, 1100]"])


# ---- the Hangprinter against its firmware

def firmware(xyz):
    """Motor angles (K, 4) rad from the origin: k0 (sqrt(R^2 + l k2) - R), RepRapFirmware's HangprinterKinematics.

    Restated from its config.g; l is how much longer a line is than at the origin, turning out is positive.
    """
    anchors = np.array([[0, -1610.98, -131.53], [1314.22, 1268.14, -121.28], [-1415.73, 707.61, -121.82],
                        [0, 0.01, 2299.83]])
    radius, advantage = np.array([75.546, 75.659, 76.128, 75.192]), np.array([2, 2, 2, 4])
    k2 = -advantage * 0.128181
    k0 = 2 * advantage * (255 / 20) / k2
    longer = np.linalg.norm(xyz[:, None] - anchors, axis=2) - np.linalg.norm(anchors, axis=1)
    return k0 * (np.sqrt(radius**2 + longer * k2) - radius)


def test_motor_angles_of_the_hangprinter_are_its_firmwares():
    """Nozzle anywhere over the bed, lines without load: to 1e-9 rad; the firmware's coordinates are the bed's."""
    made = robot("hangprinter-v4")
    xyz = np.random.default_rng(7).uniform([-700, -700, 0], [700, 700, 1900], (500, 3))
    xyz[0] = 0
    none = np.zeros(4)
    angle = motor_angles(made, lengths(made, nozzle_poses(made, xyz)), np.zeros((500, 4)), home_tension=none)
    np.testing.assert_allclose(angle, -firmware(xyz), rtol=0, atol=1e-9)
    np.testing.assert_allclose(angle_of(made.winders, wound(made.winders, angle)), angle, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", PRINTING)
def test_spools_hold_every_line_over_the_bed(name):
    made = robot(name)
    half, top = made.bed_size / 2, 2000.0
    corners = np.array([[x, y, z] for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (0, top)])
    cable = lengths(made, nozzle_poses(made, corners))
    angle = motor_angles(made, cable, np.broadcast_to(made.tension_reference, cable.shape))
    assert (np.abs(angle) < 0.9 * made.winders.span[:, 1]).all()


# ---- who can print

@pytest.mark.parametrize("name", SILENT)
def test_a_robot_without_a_print_head_says_so(name):
    printer = shelf.load_printer(name)
    with pytest.raises(ProfileError, match=r"\[nozzle\]: missing; expected, because the printer is to print a part"):
        shelf.require_printing(printer)
    assert robot_from_printer(printer).winders is None


@pytest.mark.parametrize("name", PRINTING)
def test_both_hangprinters_print(name):
    shelf.require_printing(shelf.load_printer(name))


@pytest.mark.parametrize("name", [name for name in shelf.names("printers") if name != "linear-delta"])
def test_every_shipped_robot_hangs_at_home(name):
    """Tensions within the bounds carry its weight, and no cable runs through its platform."""
    made = robot(name)
    assert nearest_tension(made, made.home[None], required_wrench(made, made.home[None])).margin[0] > 0
    assert not through(made, made.home[None]).any()


def test_numbers_that_are_not_published_are_marked():
    """What a profile's source does not have stands in `assumed`."""
    for name in [*SILENT, *PRINTING]:
        marked = " ".join(entry.split(":")[0] for entry in shelf.load_printer(name).assumed)
        assert "cables.clearance_mm" in marked
        assert "cables.reference_tension_n" in marked
    for name in PRINTING:
        marked = " ".join(entry.split(":")[0] for entry in shelf.load_printer(name).assumed)
        assert "nozzle.diameter_mm" in marked
        assert "motor" in marked
