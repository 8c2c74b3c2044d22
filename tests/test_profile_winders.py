"""Winders of every kind in a profile: what each needs, what cannot be, and the robot they make."""

import numpy as np
import pytest
from profile_cases import WINDER, faults_of, printer_toml, write

from cabslice.profile import shelf
from cabslice.robot import winder
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import robot_from_printer

COMMON = "first_radius_mm = 60.0\nhome_angle_deg = 900.0\n"
CENTRE = "centre_mm = [0, 0, 900]\n"
RANGE = "angle_range_deg = [-3600.0, 7200.0]\n"
SPIRAL = COMMON + CENTRE + RANGE + 'kind = "spiral"\nradius_per_turn_mm = 1.0\n'
DRUM = COMMON + CENTRE + RANGE + 'kind = "drum"\npitch_mm = 1.5\n'
WIDE = "angle_range_deg = [-36000.0, 72000.0]\n"
SPOOL = COMMON + WIDE + 'kind = "spool"\nbuildup_factor_mm = 0.1\nmechanical_advantage = 2\ngear_ratio = 12.75\n'


def robot(tmp_path, text):
    return robot_from_printer(shelf.load_printer(write(tmp_path, printer_toml(winder=text))))


@pytest.mark.parametrize("text", [WINDER, SPIRAL, DRUM, SPOOL], ids=["radial", "spiral", "drum", "spool"])
def test_each_kind_goes_round_from_length_to_angle_and_back(tmp_path, text):
    made = robot(tmp_path, text)
    poses = np.random.default_rng(1).uniform(-150, 150, (50, 6)) * [1, 1, 1, 0, 0, 0]
    cable, tension = lengths(made, poses), np.full((50, 8), 20.0)
    angle = winder.motor_angles(made, cable, tension)
    np.testing.assert_allclose(winder.pulley_lengths_of(made, angle, tension), cable, rtol=0, atol=1e-9)
    home = winder.motor_angles(made, lengths(made, made.home[None]), made.tension_reference[None])
    np.testing.assert_allclose(home, np.radians(900), rtol=0, atol=1e-12)


def test_strands_share_the_pull(tmp_path):
    """Two strands are twice as stiff, and their winder turns twice as far, gears apart."""
    one, two = robot(tmp_path, SPOOL.replace("advantage = 2", "advantage = 1")), robot(tmp_path, SPOOL)
    np.testing.assert_allclose(two.axial_stiffness, 2 * one.axial_stiffness)
    angle = np.full((1, 8), 1.0)
    ratio = winder.transmission(one.winders, angle) / winder.transmission(two.winders, angle)
    np.testing.assert_allclose(ratio, 2)


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        (SPIRAL.replace("radius_per_turn_mm = 1.0\n", ""), "radius_per_turn_mm", "missing; expected a number > 0"),
        (DRUM.replace("pitch_mm = 1.5\n", ""), "pitch_mm", "missing; expected a number"),
        (DRUM.replace(CENTRE, ""), "centre_mm", "missing; expected a list of 3 numbers"),
        (SPOOL.replace(WIDE, ""), "angle_range_deg", "missing; expected a list of 2 numbers"),
        (WINDER.replace("layers = 5\n", ""), "layers", "missing; expected a whole number"),
        (WINDER.replace("layers = 5", "layer = 5"), "layer", "did you mean layers"),
        (SPIRAL.replace("[-3600.0, 7200.0]", "[7200.0, -3600.0]"), "angle_range_deg", "the lower angle first"),
        (SPIRAL.replace("[-3600.0, 7200.0]", "[-36000.0, 7200.0]"), "angle_range_deg", "found -40 mm"),
        (DRUM.replace("= 900.0", "= 9000.0"), "home_angle_deg", "from -3600 to 7200, found 9000"),
        (SPOOL.replace("spool", "cone"), "kind", 'expected "radial" or "spiral" or "drum" or "spool", found "cone"'),
    ],
)
def test_what_a_winder_cannot_be_is_told_once(tmp_path, text, key, words):
    faults = faults_of(write(tmp_path, printer_toml(winder=text)))
    assert len(faults) == 1, faults
    assert faults[0].split(":")[0].split(" (")[0] == f"cables.winder.{key}"
    assert words in faults[0]
