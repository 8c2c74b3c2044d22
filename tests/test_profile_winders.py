"""Winders of every kind in a profile: what each needs, what cannot be, and the robot they make."""

import numpy as np
import pytest
from profile_cases import MOTOR, WINDER, faults_of, printer_toml, write

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


# ---- one kind or another

@pytest.mark.parametrize("text", [SPIRAL, DRUM, SPOOL], ids=["spiral", "drum", "spool"])
def test_a_child_may_have_another_kind_of_winder(tmp_path, text):
    """What the parent said of its own kind goes, as if the child had said it all alone."""
    write(tmp_path, printer_toml(), "parent.toml")
    own = f'inherits = "parent"\n[cables.winder]\n{text}'
    alone = shelf.load_printer(write(tmp_path, printer_toml(winder=text), "alone.toml"))
    made = shelf.load_printer(write(tmp_path, own))
    kept = {"centre_mm"}                   # a spool may have it, so the parent's stays
    assert made.cable[0].winder.model_dump(exclude=kept) == alone.cable[0].winder.model_dump(exclude=kept)
    back = f'inherits = "mine"\n[cables.winder]\nkind = "radial"\ngear_ratio = 1\nmechanical_advantage = 1\n{WINDER}'
    parent = shelf.load_printer(tmp_path / "parent.toml")
    assert shelf.load_printer(write(tmp_path, back, "back.toml")).cable == parent.cable


def test_a_key_of_another_kind_is_named_with_its_kind(tmp_path):
    faults = faults_of(write(tmp_path, printer_toml(winder=WINDER + "pitch_mm = 1\nlines_per_spool = 2\n")))
    assert [fault.split(" (")[0] for fault in faults] == ["cables.winder.pitch_mm", "cables.winder.lines_per_spool"]
    assert faults[0].endswith('a winder of kind "radial" has no such key; it belongs to kind drum')
    faults = faults_of("cabfab-optim", sets=("cables.winder.pitch_mm=1",))
    assert "(--set)" in faults[0]


def test_a_gear_turns_the_layers_slower(tmp_path):
    """Angles are the motor's: with a gear of 3 a ramp may take 3 x 360 deg, and a layer comes every 3 turns."""
    geared = WINDER.replace("ramp_end_deg = 110.0", "ramp_end_deg = 900.0") + "gear_ratio = 3\n"
    made = robot(tmp_path, geared)
    np.testing.assert_allclose(made.winders.span[:, 1], np.radians(100 + 4 * 3 * 360))
    (fault,) = faults_of(write(tmp_path, printer_toml(winder=geared.replace("900.0\n", "1181.0\n", 1))))
    assert "a ramp of at most one turn, up to 1180" in fault
    (fault, *_) = faults_of(write(tmp_path, printer_toml(winder=WINDER + "gear_ratio = 0\n")))
    assert "a number > 0" in fault


def test_a_line_from_spool_to_anchor_stretches_with_the_strands(tmp_path):
    """Constant line: nothing changes at one tension; more tension takes in the stretch of the line too."""
    plain, long = robot(tmp_path, SPOOL), robot(tmp_path, SPOOL + "line_mm = 1500.0\n")
    poses = np.random.default_rng(3).uniform(-150, 150, (20, 6)) * [1, 1, 1, 0, 0, 0]
    cable, tension = lengths(plain, poses), np.full((20, 8), 30.0)
    angle = winder.motor_angles(long, cable, tension)
    np.testing.assert_allclose(angle, winder.motor_angles(plain, cable, tension), rtol=0, atol=1e-9)
    pulled = winder.motor_angles(long, cable, tension + 20)
    taken = winder.wound(long.winders, pulled) - winder.wound(long.winders, angle)
    strain = 20 / long.axial_stiffness
    np.testing.assert_allclose(taken, strain * (2 * cable + 1500), rtol=2e-3)


def test_a_full_drum_keeps_clear_of_its_pulley(tmp_path):
    """A spiral is judged by its radius at the fullest: 60 mm and 20 turns of 1 mm."""
    near = SPIRAL.replace("centre_mm = [0, 0, 900]", "centre_mm = [500, 500, 578]")
    (fault,) = faults_of(write(tmp_path, printer_toml(winder=near)))
    assert "full disc (radius 80 mm) clear of its pulley" in fault
    shelf.load_printer(write(tmp_path, printer_toml(winder=near.replace("578", "582"))))


def test_winder_and_motor_go_together(tmp_path):
    text = printer_toml().replace("[cables.winder]\n" + WINDER, "")
    (fault,) = faults_of(write(tmp_path, text))
    assert fault.startswith("cables.winder: missing; expected a table with first_radius_mm")
    still = text.replace("[cables.motor]\n", "").replace(MOTOR, "")
    made = robot_from_printer(shelf.load_printer(write(tmp_path, still)))
    assert made.winders is None
    faults = faults_of(write(tmp_path, still + f"[cable.winder]\n{WINDER}\n[cable.motor]\n{MOTOR}"))
    assert [fault.split(":")[0] for fault in faults] == [f"cable.{index}.winder" for index in range(1, 8)]
