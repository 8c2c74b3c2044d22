"""Robots of other programs: read, written, read again; what is wrong in their files is told with its line."""

from __future__ import annotations

import json
import math
import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cabslice.cli.main import main
from cabslice.errors import ProfileError
from cabslice.profile import shelf
from cabslice.profile.caspr import read_pair
from cabslice.profile.keys import keys
from cabslice.profile.reprap import read_config
from cabslice.profile.reprap_lines import write_config
from cabslice.robot.kinematics import lengths
from cabslice.robot.model import robot_from_printer
from cabslice.robot.sound import faults
from cabslice.robot.winder import motor_angles

CONFIG = """; a Hangprinter v4 on a Duet 3
M550 P"Attic Printer"           ; name; not a G-code word: M669 K3
G21
M584 X40.0 Y41.0 Z42.0 U43.0 P4 ; ABCD motors are XYZU here
M669 K6                         ; this is a Hangprinter
M669 P2000.0
M669 S430 T0.1                  ; segments

M669 A0.0:-1610.98:-131.53 B1314.22:1268.14:-121.28 C-1415.73:707.61:-121.82 D-0.00:0.01:2299.83
M666 Q0.128181 R75.546:75.659:76.128:75.192
M208 Z2000.00  ; maximum
M208 S1 Z-10.0 ; minimum
M666 U2:2:2:4
M666 O1:1:1:1
M666 L20:20:20:20
M666 H255:255:255:255
M666 J25:25:25:25
M569 P40.0 S1 ; drives
M201 X10000 Y9000 Z10000 U10000 E1000
M203 X36000 Y36000 Z30000 E3600
M566 X240 Y240 Z1200 E1200
M666 W2.5 S21000.0
m666 I1.0:2.0:3.0:4.0 X70.0:71.0:72.0:140.0 T10.0 Y2916.6:3032.7:2893.0:0.0
M208 X-300 Y-250 S1
M208 X300 Y450
T0
"""


@pytest.fixture
def config(tmp_path):
    def write(text, name="config.g"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def ended(capsys, *arguments):
    code = main(["profile", *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def faults_in(read, *arguments):
    with pytest.raises(ProfileError) as caught:
        read(*arguments)
    assert caught.value.exit_code == 3
    return caught.value.details["faults"]


# ---- config.g

def test_a_config_is_read_word_by_word(config):
    printer = read_config(config(CONFIG)).model
    assert (printer.name, printer.freedoms, printer.platform.mass_kg) == ("attic-printer", ["x", "y", "z"], 2.5)
    given = {
        "anchor_mm": [[0, -1610.98, -131.53], [1314.22, 1268.14, -121.28], [-1415.73, 707.61, -121.82],
                      [0, 0.01, 2299.83]],
        "attachment_mm": [[0, 0, 0]] * 4, "axial_stiffness_n": [21000] * 4, "min_tension_n": [1, 2, 3, 4],
        "max_tension_n": [70, 71, 72, 140], "reference_tension_n": [10] * 4}
    for key, column in given.items():
        assert [getattr(cable, key) for cable in printer.cable] == column, key
    wound = {"kind": ["spool"] * 4, "first_radius_mm": [75.546, 75.659, 76.128, 75.192], "gear_ratio": [12.75] * 4,
             "mechanical_advantage": [2, 2, 2, 4], "lines_per_spool": [1] * 4, "buildup_factor_mm": [0.128181] * 4,
             "line_mm": [2916.6, 3032.7, 2893, 0], "home_angle_deg": [0] * 4}
    for key, column in wound.items():
        assert [getattr(cable.winder, key) for cable in printer.cable] == column, key
    assert (printer.bed.size_mm, printer.bed.centre_mm) == ([600, 700], [0, 100])
    assert (printer.motion.max_speed_mm_s, printer.motion.max_acceleration_mm_s2) == (500, 9000)
    assert (printer.extruder.max_speed_mm_s, printer.extruder.max_jump_mm_s) == (60, 20)


def test_what_was_read_and_what_was_assumed_is_marked(config):
    made = read_config(config(CONFIG))
    lines = made.toml.splitlines()
    for words in ("mass_kg = 2.5    # W, line 22", "buildup_factor_mm = 0.128181    # Q, line 10",
                  "anchor_mm = [1314.22, 1268.14, -121.28]    # B, line 9", "diameter_mm = 1.1    # assumed",
                  "size_mm = [600.0, 700.0]    # M208, line 25", "max_tension_n = 140.0    # X, line 23"):
        assert words in lines, words
    marked = {line.split(" = ")[0] for line in lines if line.endswith("# assumed")}
    told = {key.split(".")[-1] for entry in made.model.assumed for key in entry.split(":")[0].split(", ")}
    assert marked == told - {"assumed"}
    for entry in made.model.assumed:                       # every one is a key
        for key in entry.split(":")[0].split(", "):
            path = tuple(key.split("."))
            assert (("cable", *path[1:]) if path[0] == "cables" else path) in keys("printers"), key
    assert [one.split(" (")[0] for one in made.left_out] == ["M666 J", "M669 P", "M669 S", "M669 T"]
    assert tomllib.loads(made.toml)["schema"] == 1


def test_the_imported_file_is_a_right_profile_that_moves_as_the_firmware(config, tmp_path):
    """Saved and loaded; its motors turn by the firmware's k0 (sqrt(R^2 + l k2) - R)."""
    path = tmp_path / "attic-printer.toml"
    made = read_config(config(CONFIG))
    path.write_text(made.toml)
    printer = shelf.load_printer(path)
    assert printer == made.model
    robot = robot_from_printer(printer)
    assert faults(robot, robot.home) == []
    xyz = np.random.default_rng(2).uniform([-300, -300, 0], [300, 400, 1500], (50, 3))
    cable = lengths(robot, np.hstack((xyz, np.zeros((50, 3)))))
    angle = motor_angles(robot, cable, np.zeros((50, 4)), home_tension=np.zeros(4))
    advantage, radius = np.array([2, 2, 2, 4]), np.array([75.546, 75.659, 76.128, 75.192])
    k2 = -advantage * 0.128181
    longer = cable - np.linalg.norm(robot.anchors, axis=1)
    firmware = 2 * advantage * 12.75 / k2 * (np.sqrt(radius**2 + longer * k2) - radius)
    np.testing.assert_allclose(angle, -firmware, rtol=0, atol=1e-9)


def test_a_bare_config_takes_the_firmwares_ways(config):
    bare = "\n".join(line for line in CONFIG.splitlines() if line.startswith(("M669 K", "M669 A", "M666 Q")))
    made = read_config(config(bare))
    printer = made.model
    assert [cable.winder.mechanical_advantage for cable in printer.cable] == [2, 2, 2, 4]
    assert printer.cable[0].winder.gear_ratio == 12.75
    to_ceiling = math.dist((0, -1610.98, -131.53), (0, 0.01, 2299.83))
    assert printer.cable[0].winder.line_mm == pytest.approx(to_ceiling, abs=1e-3)
    assert printer.cable[3].winder.line_mm == 0
    marked = " ".join(entry.split(":")[0] for entry in printer.assumed)
    for key in ("mass_kg", "axial_stiffness_n", "mechanical_advantage", "gear_ratio", "reference_tension_n",
                "bed.size_mm", "motion.max_speed_mm_s"):
        assert key in marked
    assert printer.name == "config"


def test_older_firmware_has_everything_behind_m669(config):
    """Spools behind M669, and D as a height alone."""
    old = "\n".join(line.replace("M666", "M669") for line in CONFIG.splitlines() if "W2.5" not in line)
    old = old.replace("T10.0", "").replace("D-0.00:0.01:2299.83", "D2309.54")
    printer = read_config(config(old)).model
    assert printer.cable[3].anchor_mm == [0, 0, 2309.54]
    assert [cable.max_tension_n for cable in printer.cable] == [70, 71, 72, 140]
    assert printer.cable[0].winder.gear_ratio == 12.75


def test_five_anchors(config):
    five = (CONFIG.replace("M669 K6 ", "M669 K6 N5 ").replace("D-0.00:0.01:2299.83", "D1000:-900:2300 I0:0:2400")
            .replace(":75.192", ":75.192:75").replace("2:2:2:4", "2:2:2:2:4").replace("1:1:1:1", "1:1:1:1:1")
            .replace("20:20:20:20", "20:20:20:20:20").replace("255:255:255:255", "255:255:255:255:255")
            .replace("m666", ";"))
    printer = read_config(config(five)).model
    assert len(printer.cable) == 5
    assert printer.cable[4].anchor_mm == [0, 0, 2400]


WRONG = {
    "no hangprinter": (CONFIG.replace("M669 K6", "M669 K3"), "line 5: M669 K3 is no Hangprinter, expected K6"),
    "no kinematics": ("G21\n", "there is no M669 K6; expected the config.g of a Hangprinter"),
    "three radii": (CONFIG.replace(":75.192", ""), "line 10: M666 R: expected 4 numbers, found 3"),
    "no number": (CONFIG.replace("U2:2:2:4", "U2:2:2:"), "line 13: M666 U: expected numbers, found 2:2:2:"),
    "half a line": (CONFIG.replace("U2:2:2:4", "U2:2:2:2.5"), "line 13: M666 U: expected whole numbers"),
    "no anchor": (CONFIG.replace(" C-1415.73:707.61:-121.82", ""), "M669 C: missing, expected the place x:y:z"),
    "flat anchor": (CONFIG.replace(":-131.53", ""), "line 9: M669 A: expected 3 numbers, found 2"),
    "no radii": (CONFIG.replace("R75.546:75.659:76.128:75.192", ""), "M666 R: missing, expected the radii of the"),
    "no build-up": (CONFIG.replace("Q0.128181", ""), "M666 Q: missing, expected the build-up factor"),
    "no teeth": (CONFIG.replace("L20:20:20:20", "L0:20:20:20"), "line 15: M666 L: expected teeth above 0"),
    "a hundred anchors": (CONFIG.replace("K6 ", "K6 N100 "), "line 5: M669 N: expected 3 to 9 anchors, found 100"),
    "bed inside out": (CONFIG.replace("M208 X300", "M208 X-400"), "line 25: expected limits that rise"),
    # these the profile's own checks find
    "radius below 0": (CONFIG.replace("R75.546", "R-75.546"), "cable.1.winder.first_radius_mm: expected a number > 0"),
    "anchor at the origin": (CONFIG.replace("A0.0:-1610.98:-131.53", "A0:0:0"), "expected a cable longer than 0 mm"),
    "bounds swapped": (CONFIG.replace("I1.0", "I90.0"), "cable.1.min_tension_n: expected less than max_tension_n = 70"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_in_a_config_is_told_with_its_line(config, case):
    text, words = WRONG[case]
    told = faults_in(read_config, config(text))
    assert any(words in fault for fault in told), told


def test_all_faults_of_a_config_at_once(config):
    text = CONFIG.replace(":75.192", "").replace("U2:2:2:4", "U2:2").replace("W2.5", "W")
    told = faults_in(read_config, config(text))
    assert [fault.split(":")[0] for fault in told] == ["line 10", "line 13", "line 22"]


def test_what_is_no_text_is_refused(tmp_path):
    path = tmp_path / "config.g"
    for content, words in ((b"M669 K6\xff", "byte 7 is not UTF-8"), (b"\0" * 100, "zero byte")):
        path.write_bytes(content)
        (fault,) = faults_in(read_config, path)
        assert words in fault
    (fault,) = faults_in(read_config, tmp_path)
    assert "cannot be read" in fault


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(alphabet='MG0123456789ABCDKQRULHWSX:.;- "\n{}', max_size=200))
def test_any_text_is_a_printer_or_faults(config, text):
    for body in (text, "M669 K6\n" + text, CONFIG + text):
        told = []
        try:
            made = read_config(config(body)).model
        except ProfileError as error:
            told = error.details["faults"]
        assert told or made.cable


# ---- and back

def test_the_shipped_hangprinter_goes_out_and_comes_back(config):
    printer = shelf.load_printer("hangprinter-v4")
    again = read_config(config(write_config(printer)), "hangprinter-v4").model
    assert carried(again) == carried(printer)
    assert again.cable[0].winder.gear_ratio == 255 / 20


def carried(printer):
    """What M669, M666 and M208 carry."""
    cables = [(cable.anchor_mm, cable.attachment_mm, cable.axial_stiffness_n, cable.min_tension_n, cable.max_tension_n,
               cable.reference_tension_n) for cable in printer.cable]
    winders = [(w.kind, w.first_radius_mm, w.buildup_factor_mm, w.lines_per_spool or 1, w.gear_ratio,
                w.mechanical_advantage, w.line_mm, w.home_angle_deg) for w in (cable.winder for cable in printer.cable)]
    return printer.freedoms, printer.platform.mass_kg, cables, winders, printer.bed.size_mm, printer.bed.centre_mm


@st.composite
def machines(draw):
    """Options for hangprinter-v4 that make any Hangprinter of it."""
    number = st.floats(1, 3000).map(lambda x: round(x, draw(st.integers(0, 9))))
    sets = [f"platform.mass_kg={draw(number)}", f"cables.axial_stiffness_n={draw(number) + 1}",
            f"cables.winder.buildup_factor_mm={draw(st.floats(0, 0.15))}",
            f"bed.size_mm=[{draw(number)}, {draw(number)}]",
            f"bed.centre_mm=[{draw(st.integers(-50, 50))}, {draw(st.integers(-50, 50)) / 4}]"]
    signs = [(0.3, -1, -0.2), (1, 1, -0.3), (-1, 0.8, -0.1), (0.1, 0.1, 2)]
    for index, sign in enumerate(signs, 1):
        anchor = [one * (100 + draw(number)) for one in sign]
        low, level, high = sorted(draw(st.lists(st.integers(1, 500), min_size=3, max_size=3, unique=True)))
        spool, motor = draw(st.integers(10, 300)), draw(st.integers(1, 60))
        sets += [f"cable.{index}.anchor_mm={anchor}", f"cable.{index}.min_tension_n={low}",
                 f"cable.{index}.max_tension_n={high}", f"cable.{index}.reference_tension_n={level}",
                 f"cable.{index}.winder.gear_ratio={spool / motor}",
                 f"cable.{index}.winder.first_radius_mm={40 + draw(number) / 2}",
                 f"cable.{index}.winder.lines_per_spool={draw(st.integers(1, 3))}",
                 f"cable.{index}.winder.mechanical_advantage={draw(st.integers(1, 6))}",
                 f"cable.{index}.winder.line_mm={draw(number)}"]
    one_level = draw(st.booleans())
    alike = ["cables.min_tension_n=2", "cables.reference_tension_n=3.5", "cables.max_tension_n=501"]
    return sets + (alike if one_level else []), one_level


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(machine=machines())
def test_import_of_an_export_is_the_machine(config, machine):
    sets, one_level = machine
    printer = shelf.load_printer("hangprinter-v4", [*sets, "cables.winder.angle_range_deg=[-10, 10]"])
    again = read_config(config(write_config(printer))).model
    one, two = carried(printer), carried(again)
    if not one_level:                                       # M666 T is one number for all
        one, two = ((*side[:2], [cable[:5] for cable in side[2]], *side[3:]) for side in (one, two))
    np.testing.assert_allclose(two[4], one[4], rtol=1e-12)  # limits of the bed: sums and differences
    np.testing.assert_allclose(two[5], one[5], atol=1e-9)
    assert two[:4] == one[:4]


def test_an_export_says_where_home_is_not_the_origin_of_the_file(tmp_path):
    """Another encoder zero and another home: the file speaks of home, where its radius is larger by the build-up."""
    sets = ["cables.winder.home_angle_deg=720", "platform.home_mm=[10, 20, 5]", "bed.z_mm=-125"]
    text = write_config(shelf.load_printer("hangprinter-v4", sets))
    assert "M669 A-10.0:-1630.98:-136.53 " in text
    radius = 75.546 + 0.128181 / 2 * 2 * 2 * math.pi / 12.75
    assert f"M666 R{radius!r}:" in text


@pytest.mark.parametrize(("name", "sets", "words"), [
    ("cabfab-optim", [], ["freedoms: expected x, y, z", "groove_radius_mm: expected eyelets", 'expected "spool"']),
    ("hangprinter-v4", ["bed.z_mm=-140"], ["found it 10 mm above"]),
    ("hangprinter-v4", ["cable.2.winder.buildup_factor_mm=0.2"], ["buildup_factor_mm: expected one number"]),
    ("hangprinter-v4", ["cable.2.axial_stiffness_n=3"], ["axial_stiffness_n: expected one number"]),
    ("hangprinter-v4", ["cable.1.winder.gear_ratio=3.14159265358979"], ["a ratio of whole teeth, found 3.14159265"]),
    ("hangprinter-v4", ["cable.1.winder.centre_mm=[0, 900, 0]"], ["centre_mm: expected line_mm"]),
])
def test_what_the_firmware_has_no_words_for_is_refused(name, sets, words):
    told = faults_in(write_config, shelf.load_printer(name, sets))
    assert len(told) >= len(words)
    for word in words:
        assert any(word in fault for fault in told), told


# ---- CASPR

def caspr(folder, printer, *, joint="SPATIAL_EULER_XYZ", start="0 0 2.0 0 0 0", reference="joint", pulley=False):
    """A bodies and a cables file with the figures of a printer, in metres."""
    platform, metres = printer.platform, lambda values: " ".join(repr(one / 1000) for one in values)
    names = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    inertia = "".join(f"<{name}>{value / 1e6!r}</{name}>\n" for name, value in zip(
        names, [*platform.inertia_kg_mm2, *platform.inertia_products_kg_mm2], strict=True))
    bodies = folder / "robot_bodies.xml"
    bodies.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE bodies_system SYSTEM "../../../templates/bodies.dtd">
<bodies_system>
  <!-- <link_rigid num="9"/> is only a comment -->
  <links display_range="-8 8 -6 6 0 6" view_angle="-37 32">
    <link_rigid num="1" name="Platform of CoGiRo">
      <joint type="{joint}" q_initial="{start}"/>
      <physical>
        <mass>{platform.mass_kg}</mass>
        <com_location>{metres(platform.centre_of_mass_mm)}</com_location>
        <inertia ref="com">{inertia}</inertia>
      </physical>
      <parent><num>0</num><location>0.0 0.0 0.0</location></parent>
    </link_rigid>
  </links>
</bodies_system>
""")
    arm = platform.centre_of_mass_mm if reference == "com" else [0.0] * 3
    rows = ""
    for number, cable in enumerate(printer.cable, 1):
        frame = f"<attachment><link>0</link><location>{metres(cable.anchor_mm)}</location></attachment>"
        if pulley:
            frame = (f"<base_rotating_pulley><fixed_location>{metres(cable.anchor_mm)}</fixed_location>"
                     "<pulley_radius>0.045</pulley_radius><cable_entry_vector>0 0 2</cable_entry_vector>"
                     "</base_rotating_pulley>")
        place = [one - two for one, two in zip(cable.attachment_mm, arm, strict=True)]
        rows += f"""<cable_ideal name="cable {number}" attachment_reference="{reference}">
<properties><force_min>{cable.min_tension_n}</force_min><force_max>{cable.max_tension_n}</force_max></properties>
<attachments>
{frame}
<attachment><link>1</link><location>{metres(place)}</location></attachment>
</attachments></cable_ideal>
"""
    cables = folder / "robot_cables.xml"
    cables.write_text(f'<cables default_cable_set="second">\n<cable_set id="first"/>\n<cable_set id="second">\n{rows}'
                      "</cable_set>\n</cables>\n")
    return bodies, cables


@pytest.mark.parametrize("reference", ["joint", "com"])
def test_a_caspr_pair_is_the_robot_it_was_written_from(tmp_path, reference):
    shipped = shelf.load_printer("cogiro")
    bodies, cables = caspr(tmp_path, shipped, reference=reference)
    made = read_pair([cables, bodies])                      # in any order
    one, two = robot_from_printer(shipped), robot_from_printer(made.model)
    for name in ("anchors", "attachments", "inertia", "centre_of_mass", "home", "freedoms", "tension_min",
                 "tension_max"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), rtol=0, atol=1e-6, err_msg=name)
    assert two.mass == one.mass
    assert two.winders is None
    assert made.model.name == "robot"
    assert "Platform of CoGiRo" in made.model.description
    assert any("first" in sentence for sentence in made.left_out)
    assert "cables.axial_stiffness_n: 100000 N where a cable is ideal" in made.model.assumed
    assert faults(two, two.home) == []
    path = tmp_path / "robot.toml"
    path.write_text(made.toml)
    assert shelf.load_printer(path) == made.model


def test_pulleys_springs_and_planar_joints_of_caspr(tmp_path):
    shipped = shelf.load_printer("cogiro")
    bodies, cables = caspr(tmp_path, shipped, pulley=True, start="0.1 -0.2 2 0 0 0.3")
    text = cables.read_text().replace("</force_max>", "</force_max><K>40000</K>", 1)
    cables.write_text(text)
    made = read_pair([bodies, cables]).model
    assert {(cable.pulley.groove_radius_mm, *cable.pulley.axis) for cable in made.cable} == {(45, 0, 0, 1)}
    assert [cable.axial_stiffness_n for cable in made.cable] == [40000, *[100000] * 7]
    assert made.platform.home_mm == [100, -200, 2000]
    flat = shelf.load_printer("gt-planar")
    bodies, cables = caspr(tmp_path, flat, joint="PLANAR_XZ", start="1.5 1.2 0")
    told = faults_in(read_pair, [bodies, cables])
    assert "the cables do not hold ry" in told[0]           # as gt-planar says
    bodies, cables = caspr(tmp_path, flat, joint="P_XZ", start="1.5 1.2")
    made = read_pair([bodies, cables]).model
    assert (made.freedoms, made.platform.home_mm) == (["x", "z"], [1500, 0, 1200])


def test_moments_that_a_planar_file_leaves_out_are_assumed(tmp_path):
    bodies, cables = caspr(tmp_path, shelf.load_printer("gt-planar"), joint="P_XZ", start="1.5 1.5")
    bodies.write_text(bodies.read_text().replace("<Ixx>0.0075", "<Ixx>0").replace("<Izz>0.0075", "<Izz>0.0"))
    made = read_pair([bodies, cables]).model
    assert made.platform.inertia_kg_mm2 == [15000] * 3
    entry = "platform.inertia_kg_mm2: robot_bodies.xml, line 11 has zeros; in their place its largest moment"
    assert entry in made.assumed


def test_inertia_about_the_joint_is_moved(tmp_path):
    """About the joint it is larger by the parallel axis theorem; written so, it comes back as that about the centre."""
    shipped = shelf.load_printer("cogiro")
    robot = robot_from_printer(shipped)
    arm = robot.centre_of_mass
    about = robot.inertia + robot.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    platform = shipped.platform.model_copy(update={
        "inertia_kg_mm2": np.diag(about).tolist(), "inertia_products_kg_mm2": about[[0, 0, 1], [1, 2, 2]].tolist()})
    bodies, cables = caspr(tmp_path, shipped.model_copy(update={"platform": platform}))
    bodies.write_text(bodies.read_text().replace('ref="com"', 'ref="joint"'))
    made = robot_from_printer(read_pair([bodies, cables]).model)
    np.testing.assert_allclose(made.inertia, robot.inertia, rtol=0, atol=1e-5)


CASPR_WRONG = {
    "no mass": ("bodies", "<mass>91.058</mass>", "", "robot_bodies.xml, line 8: <physical> has no <mass>, expected a"),
    "a word": ("bodies", "91.058", "heavy", "robot_bodies.xml, line 9: <mass>: expected a number, found heavy"),
    "joint": ("bodies", "SPATIAL_EULER_XYZ", "R_X", "line 7: joint type 'R_X': expected one of SPATIAL_EULER_XYZ"),
    "start": ("bodies", "0 0 2.0 0 0 0", "0 0", "line 7: q_initial: expected 6 numbers, found 0 0"),
    "two platforms": ("bodies", "</links>", '<link_rigid num="2"/></links>', "expected one <link_rigid>, as there is"),
    "not xml": ("bodies", "</links>", "", "not valid XML"),
    "no set": ("cables", 'default_cable_set="second"', 'default_cable_set="third"',
               "there is no cable set 'third'; there are: first, second"),
    "two numbers": ("cables", "<location>-7.11966 ", "<location>", "<location>: expected 3 numbers"),
    "link": ("cables", "<link>1</link>", "<link>2</link>", "expected <link>1</link>, the platform, found 2"),
    "one end": ("cables", "<attachment><link>0</link>", "<!-- --><nothing/><attachment><link>0</link>", "found 3 ends"),
    "force": ("cables", "<force_min>100.0</force_min>", "<force_min>nan</force_min>", "<force_min>: expected a number"),
    "root": ("cables", "cables", "cable_list", "expected a <bodies_system> and a <cables> file of CASPR, found"),
}


@pytest.mark.parametrize("case", CASPR_WRONG)
def test_what_is_wrong_in_a_caspr_pair_is_told_with_its_line(tmp_path, case):
    which, old, new, words = CASPR_WRONG[case]
    pair = dict(zip(("bodies", "cables"), caspr(tmp_path, shelf.load_printer("cogiro")), strict=True))
    text = pair[which].read_text()
    assert old in text
    pair[which].write_text(text.replace(old, new))
    told = faults_in(read_pair, list(pair.values()))
    assert any(words in fault for fault in told), told


# ---- the commands

def test_import_and_export_on_the_command_line(config, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    config(CONFIG)
    code, out, err = ended(capsys, "import", "config.g")
    assert (code, out.splitlines()[0]) == (0, "wrote attic-printer.toml; 8 entries are assumed")
    assert "left out: M669 P (line 6)" in err
    assert ended(capsys, "import", "config.g")[0] == 5      # it exists
    assert ended(capsys, "check", "attic-printer.toml")[0] == 0
    assert ended(capsys, "export", "attic-printer.toml", "--format", "reprap")[0] == 0
    assert ended(capsys, "import", "attic-printer.g", "--name", "again", "-q")[0] == 0
    assert carried(shelf.load_printer("again.toml"))[2:4] == carried(shelf.load_printer("attic-printer.toml"))[2:4]
    code, out, _ = ended(capsys, "import", "config.g", "--name", "other", "--json")
    content = json.loads(out)
    assert (content["output"], content["name"], len(content["left_out"])) == ("other.toml", "other", 4)
    code, out, _ = ended(capsys, "export", "hangprinter-v4", "--format", "reprap", "-o", "-")
    assert out == write_config(shelf.load_printer("hangprinter-v4"))
    caspr(tmp_path, shelf.load_printer("cogiro"))
    assert ended(capsys, "import", "robot_bodies.xml", "robot_cables.xml", "-o", "mine.toml")[0] == 0
    assert ended(capsys, "check", "mine.toml")[0] == 0
    assert sorted(path.name for path in tmp_path.glob("*.part")) == []


@pytest.mark.parametrize(("arguments", "code", "words"), [
    (["import", "config.g", "more.g"], 3, "more.g: there is no such file"),
    (["import", "config.g", "config.g"], 2, "one config.g of RepRapFirmware, or the bodies and the cables .xml"),
    (["import", "config.g", "--cable-set", "x"], 2, "--cable-set is for CASPR"),
    (["import", "config.g", "--name", "My Printer"], 2, "no profile name"),
    (["import"], 2, "FILE"),
    (["export", "cogiro", "--format", "reprap"], 3, "cogiro: freedoms: expected x, y, z"),
    (["export", "cogiro", "--format", "klipper"], 2, "reprap"),
    (["diff", "cogiro", "pla"], 2, "cogiro is a printer and pla is a material"),
    (["diff", "cogiro", "cogirro"], 3, "did you mean cogiro"),
])
def test_wrong_commands_end_with_a_sentence(config, tmp_path, monkeypatch, capsys, arguments, code, words):
    monkeypatch.chdir(tmp_path)
    config(CONFIG)
    found, out, err = ended(capsys, *arguments)
    assert (found, out) == (code, "")
    assert words in err
    assert [path.name for path in tmp_path.iterdir()] == ["config.g"]


# ---- diff

def told(capsys, *names):
    code, out, _ = ended(capsys, "diff", *names, "--json")
    assert code == 0
    content = json.loads(out)
    return content["same"], {one["key"]: (one["first"], one["second"]) for one in content["differences"]}


@pytest.mark.parametrize("name", shelf.names("printers"))
def test_a_profile_does_not_differ_from_itself(capsys, name):
    assert told(capsys, name, name) == (True, {})
    assert ended(capsys, "diff", name, name)[1] == "no key differs\n"


def test_diff_names_every_key_and_its_values(capsys, tmp_path):
    path = tmp_path / "cabfab-optim.toml"
    path.write_text('inherits = "cabfab-optim"\n[cables]\nmax_tension_n = 80\n[[cable]]\n[[cable]]\nclearance_mm = 3\n'
                    + "[[cable]]\n" * 6 + "[motion]\nmax_speed_mm_s = 90\n")
    same, found = told(capsys, "cabfab-optim", path)
    assert not same
    assert found.pop("description")[1] == ""
    assert found == {"cables.max_tension_n": (100, 80), "cable.2.clearance_mm": (2, 3),
                     "motion.max_speed_mm_s": (150, 90)}
    _, back = told(capsys, path, "cabfab-optim")
    assert back["cables.max_tension_n"] == (80, 100)


def test_differences_laid_over_the_first_make_the_second(capsys, tmp_path):
    """As --set options they turn one profile into the other."""
    _, found = told(capsys, "cabfab-init", "cabfab-optim-measured")
    sets = [f"{key}={json.dumps(value)}" for key, (_, value) in found.items() if value is not None]
    made = shelf.load_printer("cabfab-init", sets)
    assert made == shelf.load_printer("cabfab-optim-measured")


def test_diff_of_other_numbers_of_cables(capsys):
    _, found = told(capsys, "hangprinter-v4", "hangprinter-linc")
    assert found["cable"] == ("4 cables", "9 cables")
    assert found["cables.diameter_mm"] == (1.1, 0)
    assert "cables.anchor_mm" not in found
    assert found["nozzle.offset_mm"] == ([0, 0, -130], [0, 0, 0])
    assert told(capsys, "pla", "petg")[1]["fan"] == (1.0, 0.5)
