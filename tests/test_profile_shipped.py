"""The shipped profiles load, and say what the literature says.

Authorities are restated here, not read from the profiles (G: D. Gueners, PhD thesis, Clermont Auvergne 2021).
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from cabslice.profile import shelf
from cabslice.profile.keys import KINDS, keys
from cabslice.robot.kinematics import cables, lengths
from cabslice.robot.model import nozzle_poses, robot_from_printer
from cabslice.robot.winder import motor_angles
from cabslice.robot.winder_line import line_at

ALL = [(kind, name) for kind in KINDS for name in shelf.names(kind)]
PRINTERS = ["cabfab-init", "cabfab-init-x", "cabfab-init-x-measured", "cabfab-optim", "cabfab-optim-measured"]
FIELD = ["caroca", "cogiro", "gt-planar", "hangprinter-linc", "hangprinter-v4", "ipanema-3", "linear-delta", "segesta"]
MATERIALS = ["abs", "pa12", "pa6", "pc", "pc-ptfe", "peek", "pei", "pet", "petg", "pla", "pom", "ppsu", "tpu"]
SHIPPED = Path(__file__).parents[1] / "profiles"

# G table 4.7, laser tracker
MEASURED_ANCHORS = [
    [499.5230, 501.8502, 501.8484], [-501.0498, 501.7036, 500.8624], [-500.9071, -499.6959, 500.5652],
    [500.8472, -498.8514, 499.7363], [501.0039, 499.3326, -499.6937], [-500.4936, 500.7729, -501.1693],
    [-500.4284, -500.6042, -500.7433], [500.300, -500.1404, -501.0979]]
# G table 4.7, 5.2, annex B; order as the anchors
INIT_X = [
    [44.0528, 44.0528, -25.0], [-44.0528, 44.0528, -25.0], [-44.0528, -44.0528, -25.0], [44.0528, -44.0528, -25.0],
    [47.5969, 40.1974, 25.0], [-47.5969, 40.1974, 25.0], [-47.5969, -40.1974, 25.0], [47.5969, -40.1974, 25.0]]
# G tables 6.3, 6.4
RAMP_START = [136.58, 61.75, 234.92, 242.91, 385.11, 363.99, 206.10, 301.61]
RAMP_END = [145.34, 70.50, 243.68, 251.67, 393.87, 372.75, 214.86, 310.37]
RADII = [
    [60.21, 60.80, 61.29, 61.85, 62.41], [60.26, 60.90, 61.42, 61.98, 62.51], [60.25, 60.81, 61.32, 61.84, 62.42],
    [60.25, 60.84, 61.35, 61.88, 62.46], [60.28, 60.82, 61.38, 61.90, 62.59], [60.25, 60.79, 61.36, 61.87, 62.47],
    [60.26, 60.83, 61.33, 61.84, 62.40], [60.23, 60.79, 61.34, 61.85, 62.48]]
QUADRANTS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]] * 2)
# G table 1.1: nozzle degC, bed degC, mm/s
MATERIAL_TABLE = {
    "pla": ([190, 220], [0, 55], [40, 90]), "abs": ([230, 250], [80, 110], [30, 70]),
    "pet": ([220, 240], [30, 60], [20, 40]), "petg": ([220, 240], [30, 60], [20, 40]),
    "pc": ([250, 270], [80, 80], [30, 90]), "pc-ptfe": ([250, 280], [100, 130], [40, 70]),
    "tpu": ([240, 260], [30, 60], [20, 40]), "pa6": ([220, 280], [100, 130], [40, 70]),
    "pa12": ([240, 270], [80, 120], [40, 80]), "pom": ([190, 205], [120, 120], [30, 30]),
    "ppsu": ([360, 390], [140, 160], [16, 16]), "pei": ([355, 390], [120, 160], [40, 40]),
    "peek": ([360, 400], [120, 120], [20, 40])}


def column(printer, key):
    """A key of every cable; "winder.layers" goes into the table."""
    def value(one):
        for part in key.split("."):
            one = getattr(one, part)
        return one
    return [value(cable) for cable in printer.cable]


def test_what_is_shipped():
    assert shelf.names("printers") == sorted(PRINTERS + FIELD)
    assert shelf.names("materials") == MATERIALS
    assert shelf.names("processes") == sorted(f"{what}-{nozzle}" for what in ("draft", "standard", "fine")
                                              for nozzle in ("0.4", "0.6", "0.8"))


@pytest.mark.parametrize(("kind", "name"), ALL)
def test_every_shipped_profile_loads_and_says_where_it_is_from(kind, name):
    model = shelf.load(kind, name)
    assert model.name == name == shelf.find(kind, name).stem
    assert model.source
    assert model.description
    assert tomllib.loads(shelf.find(kind, name).read_text())["name"] == name


@pytest.mark.parametrize(("kind", "name"), [one for one in ALL if one[0] != "processes"])
def test_what_is_assumed_is_a_key(kind, name):
    """An entry of `assumed` begins with the keys it is about; none may be misspelt."""
    assumed = shelf.load(kind, name).assumed
    assert assumed
    for entry in assumed:
        for key in entry.split(":")[0].split(", "):
            path = tuple(key.split("."))
            assert ("cable", *path[1:]) if path[0] == "cables" else path in keys(kind), entry


@pytest.mark.parametrize("name", PRINTERS)
def test_machine_of_every_cabfab(name):
    """G tables 4.7 (nozzle 100 mm below C), 6.1 (motor), 6.2 (tension), 6.4 (ramps), chapter 4 (steel 0.54 mm)."""
    printer = shelf.load_printer(name)
    assert len(printer.cable) == 8
    expected = {
        "diameter_mm": 0.54, "modulus_gpa": 69.49, "min_tension_n": 1.0, "max_tension_n": 100.0, "clearance_mm": 2.0,
        "reference_tension_n": 30.0, "winder.first_radius_mm": 60.27, "winder.layer_step_mm": 0.54,
        "motor.continuous_torque_n_m": 6.0, "motor.peak_torque_n_m": 18.0, "motor.inertia_kg_mm2": 440.0}
    for key, value in expected.items():
        assert column(printer, key) == [value] * 8, key
    assert column(printer, "winder.ramp_start_deg") == RAMP_START
    assert column(printer, "winder.ramp_end_deg") == RAMP_END
    assert column(printer, "motor.max_speed_rad_s") == pytest.approx([100 * 2 * math.pi / 60] * 8, rel=3e-4)
    assert printer.nozzle.offset_mm == [0, 0, -100]
    assert printer.bed.z_mm == -460
    # stiffness of 1 m of cable, N/m
    area = math.pi / 4 * 0.54**2
    assert 69.49e9 * area * 1e-6 == pytest.approx(15914.75, rel=1e-4)
    shelf.require_printing(printer)


@pytest.mark.parametrize("name", PRINTERS)
def test_platform_of_every_cabfab(name):
    """G table 4.7, 5.2, annex B; Optim also Gueners, Chanal, Bouzgarrou, ICRA 2020."""
    printer = shelf.load_printer(name)
    attachments = np.array(column(printer, "attachment_mm"))
    if "optim" in name:
        assert (printer.platform.mass_kg, printer.platform.inertia_kg_mm2) == (2.565, [2329.2, 2329.2, 3326.1])
        angles = np.radians([29.98] * 4 + [15.87] * 4)
        expected = np.column_stack((100 * np.column_stack((np.cos(angles), np.sin(angles))) * QUADRANTS,
                                    [2.5] * 4 + [-2.5] * 4))
        np.testing.assert_allclose(attachments, expected, atol=5.1e-5)
    else:
        assert (printer.platform.mass_kg, printer.platform.inertia_kg_mm2) == (2.598, [2092.5, 2092.5, 2897.8])
        crossed = np.array(INIT_X) * ([1, 1, 1] if "init-x" in name else [1, 1, -1])
        np.testing.assert_array_equal(attachments, crossed)
        np.testing.assert_allclose(np.hypot(*attachments[:, :2].T), 62.3, atol=1e-3)


def test_frames_nominal_and_measured():
    for name in PRINTERS:
        printer = shelf.load_printer(name)
        anchors = np.array(column(printer, "anchor_mm"))
        if "measured" in name:
            np.testing.assert_array_equal(anchors, MEASURED_ANCHORS)
            assert column(printer, "winder.radii_mm") == RADII
        else:
            np.testing.assert_allclose(np.hypot(*anchors[:, :2].T), 707.1, atol=0.01)
            np.testing.assert_array_equal(np.abs(anchors), 500)
            assert column(printer, "winder.radii_mm") == [None] * 8
        np.testing.assert_array_equal(np.sign(anchors), np.column_stack((QUADRANTS, [1] * 4 + [-1] * 4)))


@pytest.mark.parametrize("name", PRINTERS)
def test_the_cable_lies_along_the_post_at_the_middle_radius(name):
    """Winder centres are chosen so; 61.62 mm is the radius in the middle of layers 0 to 5."""
    robot = robot_from_printer(shelf.load_printer(name))
    line = line_at(robot, np.full((1, 8), 60.27 + 2.5 * 0.54), np.zeros(1))
    np.testing.assert_allclose(line.tilt, 0, atol=1e-5)
    np.testing.assert_allclose(line.tangent, 300, atol=1e-3)


@pytest.mark.parametrize("name", PRINTERS)
def test_the_disc_holds_every_cable_the_platform_can_ask_for(name):
    """Platform anywhere in the frame, clear of the pulleys: angles on the disc (PoseError otherwise), never below 0."""
    robot = robot_from_printer(shelf.load_printer(name))
    reach = 470 - np.abs(robot.attachments).max(axis=0)
    axis = np.linspace(-1, 1, 5)
    poses = np.zeros((125, 6))
    poses[:, :3] = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3) * reach
    angles = motor_angles(robot, lengths(robot, poses), np.full((len(poses), 8), 30.0))
    assert angles.min() >= 0
    home = motor_angles(robot, lengths(robot, robot.home[None]), np.full((1, 8), 30.0))
    np.testing.assert_allclose(home, math.radians(900), rtol=1e-12)


@pytest.mark.parametrize("name", PRINTERS)
def test_no_lower_cable_crosses_the_bed(name):
    """With the nozzle anywhere on the bed, each lower cable passes the bed's plane beside it, with its clearance."""
    printer = shelf.load_printer(name)
    robot = robot_from_printer(printer)
    half = np.array(printer.bed.size_mm) / 2
    axis = np.linspace(-1, 1, 15)
    nozzle = np.zeros((225, 3))
    nozzle[:, :2] = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2) * half
    line = cables(robot, nozzle_poses(robot, nozzle))
    low = slice(4, 8)
    start, run = line.exit[:, low], (line.tip - line.exit)[:, low]
    share = (printer.bed.z_mm - start[..., 2]) / run[..., 2]
    crossing = start + share[..., None] * run
    aside = (robot.cable_radii[low] + robot.clearance[low]) / (run[..., 2] / np.linalg.norm(run, axis=2))
    assert ((np.abs(crossing[..., :2]) - half).max(axis=2) - aside).min() > 0
    assert (start[:, :, 2] < printer.bed.z_mm).all()


@pytest.mark.parametrize("name", MATERIALS)
def test_materials_are_those_of_the_table(name):
    """G table 1.1; petg as pet."""
    material = shelf.load_material(name)
    assert (material.nozzle_c, material.bed_c, material.speed_mm_s) == MATERIAL_TABLE[name]
    assert 0.9 < material.density_g_cm3 < 1.5


def test_processes_suit_their_nozzles():
    for name in shelf.names("processes"):
        process = shelf.load_process(name)
        assert f"{process.nozzle_mm:g}" == name.split("-")[1]
        assert 0.2 * process.nozzle_mm < process.layer_mm < 0.76 * process.nozzle_mm
        assert process.nozzle_mm < process.outer_bead_mm <= process.bead_mm < 1.25 * process.nozzle_mm
        assert process.speeds_mm_s.travel <= shelf.load_printer("cabfab-optim").motion.max_speed_mm_s
    layers = [[shelf.load_process(f"{what}-{nozzle}").layer_mm for what in ("fine", "standard", "draft")]
              for nozzle in ("0.4", "0.6", "0.8")]
    assert (np.diff(layers) > 0).all()
    assert (np.diff(layers, axis=0) > 0).all()


def test_numbers_equal_the_data_of_the_project():
    """The same figures, from the data file the project was given."""
    data = Path(__file__).parents[2] / "shared" / "data" / "cabfab.toml"
    if not data.is_file():
        pytest.skip("shared/data/cabfab.toml is not beside the checkout")
    given = tomllib.loads(data.read_text())
    assert given["frame"]["anchors_mm"] == MEASURED_ANCHORS
    assert given["winder"]["measured_radius_by_layer_mm"] == RADII
    assert (given["winder"]["ramp_start_deg"], given["winder"]["ramp_end_deg"]) == (RAMP_START, RAMP_END)
    assert given["platform"]["init_x"]["attachments_mm"] == INIT_X
