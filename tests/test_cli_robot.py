"""cabslice workspace and stiffness as a user gives them: published numbers, refusals, files."""

import csv
import json

import numpy as np
import pytest
from cli_cases import answered, run

from cabslice.cli.asked import DISTRIBUTIONS
from cabslice.profile import shelf
from cabslice.robot.distributions import METHODS
from cabslice.robot.model import robot_from_printer
from cabslice.robot.rotation import from_angles, matrix
from cabslice.robot.wrench import required_wrench, wrench_matrix

PAPER = ["-p", "cabfab-init-x", "--no-pulleys"]
LIGHT = ["--mass-kg", "1.15", "--tension-n", "0:100", "--step-mm", "20"]     # settings of the thesis' workspaces
# G annexes C and D, Init X, steel: pose (mm, deg), diag(K_cable) = total x share (kN/m, N m/deg)
ANNEX_D = {
    "16.1765 -4.6232 -61.2649 -3.457 0.258 1.140": [45.320, 46.172, 61.327, 4.355, 4.830, 0.0374],
    "16.0314 -3.0921 -61.7897 -5.135 0.435 0.510": [45.349, 46.218, 61.460, 4.333, 4.827, 0.0381],
    "13.3688 -13.4034 -342.4017 -0.017 0.155 -0.544": [53.271, 54.619, 45.832, 3.514, 3.700, 0.0543],
    "13.2162 -12.9447 -345.9368 -0.138 -0.728 0.539": [53.384, 54.731, 45.590, 3.496, 3.668, 0.0539],
}
FIRST = next(iter(ANNEX_D))
LEVEL = ["--pose", "0 0 -100 0 0 0"]


@pytest.fixture
def here(tmp_path, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CABSLICE_PRINTER", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("nobody")))
    return tmp_path


def numbers(capsys, *words):
    code, said = answered(capsys, *words)
    assert code == 0, said
    assert said["ok"]
    return said["numbers"]


def refused(capsys, code, *words):
    """The sentence on stderr of a command that ends in `code` and says nothing on stdout."""
    capsys.readouterr()
    assert run(*words) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    return err


# ---- published numbers

def test_stiffness_of_annex_d(here, capsys):
    poses = [word for pose in ANNEX_D for word in ("--pose", pose)]
    found = numbers(capsys, "stiffness", *PAPER, *poses)
    published = np.array(list(ANNEX_D.values()))
    np.testing.assert_allclose(found["k_cable_trans_kn_m"], published[:, :3], rtol=0.02)
    np.testing.assert_allclose(found["k_cable_rot_n_m_deg"], published[:, 3:], rtol=0.03)


@pytest.mark.parametrize(("preload", "published"), [(15, 8.4), (85, 17.6)])
def test_preload_raises_the_first_mode_as_in_5_3_2(here, capsys, preload, published):
    found = numbers(capsys, "stiffness", *PAPER, "--pose", FIRST, "--tension-n", "1:130", "--preload-n", preload)
    assert found["modes_hz"][0] == pytest.approx(published, rel=0.05)
    assert found["mean_tension_n"] == pytest.approx(preload, abs=1e-4)


@pytest.mark.parametrize(("printer", "published"), [("cabfab-init", 0.465), ("cabfab-init-x", 0.656)])
def test_workspace_of_table_5_5(here, capsys, printer, published):
    found = numbers(capsys, "workspace", "-p", printer, "--no-pulleys", *LIGHT)
    assert found["nodes"] == [51, 51, 51]
    assert found["workspace_fraction"] == pytest.approx(published, abs=0.025)
    assert found["largest_cylinder_fraction"] < found["print_space_fraction"] / 2


@pytest.mark.slow
def test_mode_means_of_table_5_4(here, capsys):
    found = numbers(capsys, "stiffness", *PAPER, "--step-mm", "20", "--bed-mm", "-460")
    table = np.array([3.59, 20.14, np.nan, 25.81, 48.88, 54.61])       # G table 5.4, Hz
    ours = np.array(found["modes_k_cable_hz"])
    np.testing.assert_allclose(ours[[1, 3, 4, 5]], table[[1, 3, 4, 5]], rtol=0.06)
    assert found["min_k_rot_n_m_deg"][0] == pytest.approx(2.3, rel=0.15)    # G table 5.3, without preload: k_psi


# ---- what stiffness says

def test_a_pose_beside_sums_done_by_hand(here, capsys):
    """One cable after the other, straight from anchors and attachments, tensions as told."""
    pose = np.array([60.0, -40, -120, 0.5, -0.7, 0.6])
    found = numbers(capsys, "stiffness", *PAPER, "--pose", " ".join(map(str, pose)))
    robot = robot_from_printer(shelf.load_printer("cabfab-init-x"), pulleys=False)
    lever = robot.attachments @ matrix(from_angles(np.radians(pose[3:])))[None][0].T
    arm = robot.anchors - pose[:3] - lever
    length = np.linalg.norm(arm, axis=1)
    unit, tension = arm / length[:, None], np.array(found["tensions_n"])
    columns = np.hstack((unit, np.cross(lever, unit)))
    cable, swing = np.zeros((6, 6)), np.zeros((3, 3))
    for t, l, u, w in zip(tension, length, unit, columns, strict=True):
        cable += (t + robot.axial_stiffness[0]) / l * np.outer(w, w)
        swing += t / l * (np.eye(3) - np.outer(u, u))
    to_degrees = np.pi / 180 / 1e3
    np.testing.assert_allclose(found["k_cable_trans_kn_m"], np.diag(cable)[:3], rtol=1e-9)
    np.testing.assert_allclose(found["k_cable_rot_n_m_deg"], np.diag(cable)[3:] * to_degrees, rtol=1e-9)
    np.testing.assert_allclose(found["k_lat_trans_kn_m"], np.diag(swing), rtol=1e-9)
    np.testing.assert_allclose(columns.T @ tension, [0, 0, 2.598 * 9.80665, 0, 0, 0], atol=1e-6)
    for unit_of in ("trans_kn_m", "rot_n_m_deg"):
        parts = sum(np.array(found[f"{part}{unit_of}"]) for part in ("k_cable_", "k_lat_", "k_force_"))
        np.testing.assert_allclose(found[f"k_{unit_of}"], parts, rtol=1e-12)
    assert found["modes_hz"] == sorted(found["modes_hz"])


def test_several_poses_are_rows_of_single_ones(here, capsys):
    poses = ["0 0 0 0 0 0", "100 -50 -200 0 0 1"]
    words = ["stiffness", "-p", "cabfab-optim"]
    together = numbers(capsys, *words, "--pose", poses[0], "--pose", poses[1])
    for i, pose in enumerate(poses):
        alone = numbers(capsys, *words, "--pose", pose)
        for key, value in alone.items():
            np.testing.assert_allclose(np.array(together[key])[i], value, rtol=1e-9, atol=1e-9, err_msg=key)


def test_pulleys_and_the_line_to_the_winder_make_it_softer(here, capsys):
    bare = numbers(capsys, "stiffness", *PAPER, *LEVEL)
    whole = numbers(capsys, "stiffness", "-p", "cabfab-init-x", *LEVEL)
    ratio = np.array(whole["k_cable_trans_kn_m"]) / bare["k_cable_trans_kn_m"]
    assert (ratio < 0.85).all()
    assert (ratio > 0.6).all()


@pytest.mark.parametrize("method", DISTRIBUTIONS)
def test_every_distribution_balances(here, capsys, method):
    found = numbers(capsys, "stiffness", *PAPER, *LEVEL, "--distribution", method)
    robot = robot_from_printer(shelf.load_printer("cabfab-init-x"), pulleys=False)
    pose = np.array([[0.0, 0, -100, 0, 0, 0]])
    supplied = wrench_matrix(robot, pose)[0] @ found["tensions_n"]
    np.testing.assert_allclose(supplied, required_wrench(robot, pose)[0], atol=1e-4)
    assert min(found["tensions_n"]) >= 1 - 1e-4
    assert max(found["tensions_n"]) <= 100 + 1e-4


def test_the_distributions_offered_are_those_there_are():
    assert list(DISTRIBUTIONS) == list(METHODS)


def test_over_a_grid_mean_and_extremes_are_those_of_the_rows(here, capsys):
    words = ["stiffness", "-p", "cabfab-optim", "--step-mm", "100"]
    found = numbers(capsys, *words, "-o", "rows.npz")
    with np.load("rows.npz") as rows:
        assert len(rows["x_mm"]) == found["nodes"] > 20
        for key in ("modes_hz", "k_trans_kn_m", "tensions_n", "margin_n"):
            np.testing.assert_allclose(found[key], rows[key].mean(axis=0), err_msg=key)
            np.testing.assert_allclose(found[f"min_{key}"], rows[key].min(axis=0), err_msg=key)
        pose = " ".join(f"{rows[axis][7]}" for axis in ("x_mm", "y_mm", "z_mm")) + " 0 0 0"
        single = numbers(capsys, "stiffness", "-p", "cabfab-optim", "--pose", pose)
        np.testing.assert_allclose(single["modes_hz"], rows["modes_hz"][7], rtol=1e-9)
        assert rows["z_mm"].min() == pytest.approx(-360.0)      # nozzle on the bed
    whole = numbers(capsys, *words, "--over", "workspace")
    assert whole["nodes"] > found["nodes"]
    assert whole["held_fraction"] == 1.0


def test_a_poor_distribution_holds_only_some_nodes(here, capsys):
    words = ["stiffness", *PAPER, "--step-mm", "100", "--over", "workspace"]
    found = numbers(capsys, *words, "--distribution", "closed-form")
    assert 0.3 < found["held_fraction"] < 0.9


# ---- what cannot be

def test_a_pose_without_tensions_is_exit_4_and_names_pose_cables_and_newtons(here, capsys):
    words = ["stiffness", *PAPER, *LEVEL, "--pose", "430 430 430 0 0 0"]
    sentence = refused(capsys, 4, *words)
    assert "Pose 430 430 430 mm, 0 0 0 deg" in sentence
    assert "Pose 0 0 -100" not in sentence
    code, said = answered(capsys, *words)
    assert (code, said["ok"], said["error"]["kind"]) == (4, False, "ImpossibleError")
    (row,) = said["error"]["poses"]
    assert row["pose"] == 2
    worst = [row["tensions_n"][cable - 1] for cable in row["cables"]]
    assert np.abs(np.maximum(1 - np.array(worst), np.array(worst) - 100) + row["margin_n"]).max() < 1e-6
    for cable, tension in zip(row["cables"], worst, strict=True):
        assert f"cable {cable} at {tension:.2f} N" in sentence


def test_a_pose_where_a_cable_cannot_run_is_exit_4_and_names_it(here, capsys):
    sentence = refused(capsys, 4, "stiffness", "-p", "cabfab-optim", "--pose", "413.37 450.03 200 0 0 0")
    assert "Pose 413.37 450.03 200 mm" in sentence
    assert "cable 1: attachment at (" in sentence
    assert "swivel axis, expected more than" in sentence
    assert "pose 0" not in sentence


def test_preload_out_of_reach_is_exit_4_with_what_is_in_reach(here, capsys):
    sentence = refused(capsys, 4, "stiffness", *PAPER, *LEVEL, "--preload-n", "99.9")
    least, most = (float(word) for word in sentence.split("can be ")[1].split(" N")[0].split(" to "))
    inside = numbers(capsys, "stiffness", *PAPER, *LEVEL, "--preload-n", most - 0.1)
    assert 1 < least < inside["mean_tension_n"] < 99.9


def test_a_weight_no_cable_can_carry_leaves_no_workspace(here, capsys):
    words = ["workspace", *PAPER, "--mass-kg", "100", "--step-mm", "100"]
    sentence = refused(capsys, 4, *words)
    assert "none of 1331 poses asked about" in sentence
    assert "no tensions within 1..100 N carry 100 kg" in sentence
    assert "cable " in sentence
    refused(capsys, 4, "stiffness", *PAPER, "--mass-kg", "100", "--step-mm", "100")


@pytest.mark.parametrize("pose", ["1 2 3", "a b c d e f", "nan 0 0 0 0 0", "1 2 3 4 5 6 7", "", "1;2;3;4;5;6"])
def test_a_bad_pose_is_exit_2(here, capsys, pose):
    assert "x y z psi theta phi" in refused(capsys, 2, "stiffness", *PAPER, "--pose", pose)


@pytest.mark.parametrize("bounds", ["5", "5:5", "-1:3", "x:y", "1:2:3", "9:1", "nan:3"])
def test_bad_tension_bounds_are_exit_2(here, capsys, bounds):
    assert "min:max" in refused(capsys, 2, "stiffness", *PAPER, *LEVEL, "--tension-n", bounds)


@pytest.mark.parametrize(("words", "said"), [
    (["stiffness", *PAPER, *LEVEL, "--step-mm", "50"], "choose one"),
    (["stiffness", *PAPER, *LEVEL, "--preload-n", "30", "--distribution", "closed-form"], "nearest"),
    (["stiffness", *PAPER, *LEVEL, "--distribution", "nearly"], "closed-form"),
    (["stiffness", *PAPER, *LEVEL, "-o", "x.xlsx"], "npz"),
    (["stiffness", *PAPER, *LEVEL, "-o", "x.csv", "--png", "x.csv"], "x.csv"),
    (["workspace", *PAPER, "--step-mm", "0.5"], "nodes"),
    (["workspace", *PAPER, "--step-mm", "100", "--box-mm", "0 0 0 0 0 100", "--png", "x.png"], "line of nodes"),
    (["workspace"], "cabfab-init-x"),
])
def test_wrong_command_lines_are_exit_2_with_the_remedy(here, capsys, words, said):
    assert said in refused(capsys, 2, *words)
    assert not list(here.iterdir())


# ---- what workspace says

def test_thresholds_and_mass_shrink_the_workspace(here, capsys):
    words = ["workspace", "-p", "cabfab-optim", "--step-mm", "100"]
    plain = numbers(capsys, *words, "--map", "first-mode", "--map", "cable-gap", "--map", "stiffness")
    assert plain["min_first_mode_hz"] < 14 < plain["max_first_mode_hz"]
    assert plain["min_cable_gap_mm"] > 0
    for key, least in {"first_mode_hz": 14, "margin_n": 10, "stiffness_n_mm": 5, "cable_gap_mm": 20}.items():
        fewer = numbers(capsys, *words, f"--min-{key.replace('_', '-')}", least)
        assert 0 < fewer["nodes_inside"] < plain["nodes_inside"], key
        assert fewer[f"min_{key}"] >= least
        assert fewer["print_space_fraction"] <= plain["print_space_fraction"]
    heavy = numbers(capsys, *words, "--mass-kg", "8")
    assert heavy["nodes_inside"] < plain["nodes_inside"]


def test_closure_bed_and_turn(here, capsys):
    words = ["workspace", "-p", "cabfab-optim", "--step-mm", "100"]
    plain = numbers(capsys, *words)
    closed = numbers(capsys, *words, "--kind", "wrench-closure")
    assert closed["workspace_fraction"] != plain["workspace_fraction"]
    assert 0 < closed["mean_closure_share"] <= 0.5
    lower = numbers(capsys, *words, "--bed-mm", "-560")
    assert lower["print_space_fraction"] > plain["print_space_fraction"]
    turned = numbers(capsys, *words, "--turn", "3 0 0")
    assert turned["workspace_fraction"] < plain["workspace_fraction"]
    assert "print_space_fraction" not in turned


def test_the_box_of_a_ceiling_robot_hangs_down_to_its_home(here, capsys):
    words = ["workspace", "-p", "cogiro", "--step-mm", "1000"]
    found = numbers(capsys, *words)
    robot = robot_from_printer(shelf.load_printer("cogiro"))
    assert found["box_mm"][2] == pytest.approx([robot.home[2], robot.anchors[:, 2].max()])
    assert 0.1 < found["workspace_fraction"] < 0.9
    inner = numbers(capsys, *words, "--box-mm", "-3000 -2000 2000 3000 2000 3000")
    assert inner["nodes"] == [7, 5, 2]
    assert inner["workspace_fraction"] == 1.0


def test_a_robot_with_few_freedoms_says_as_many_modes(here, capsys):
    planar = numbers(capsys, "workspace", "-p", "gt-planar", "--step-mm", "300", "--map", "first-mode")
    assert planar["nodes"] == [11, 1, 11]
    hanging = numbers(capsys, "stiffness", "-p", "hangprinter-v4", "--pose", "0 0 1000 0 0 0")
    assert len(hanging["modes_hz"]) == 3
    assert len(hanging["tensions_n"]) == 4
    assert hanging["k_cable_rot_n_m_deg"] == [0.0, 0.0, 0.0]


def test_saved_maps_hold_the_numbers(here, capsys):
    words = ["workspace", "-p", "cabfab-optim", "--step-mm", "50", "--map", "cable-gap"]
    code, said = answered(capsys, *words, "-o", "map.csv")
    assert (code, said["output"]) == (0, "map.csv")
    found = said["numbers"]
    text = (here / "map.csv").read_text()
    head = dict(line[2:].split(": ", 1) for line in text.splitlines() if line.startswith("#"))
    assert json.loads(head["numbers"]) == found
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    inside = np.array([row["inside"] == "1" for row in rows])
    assert len(rows) == np.prod(found["nodes"])
    assert inside.mean() == pytest.approx(found["workspace_fraction"])
    gaps = np.array([float(row["cable_gap_mm"]) for row in rows])
    assert gaps[inside].min() == pytest.approx(found["min_cable_gap_mm"])

    assert run(*words, "-o", "map.npz", "-q") == 0
    with np.load("map.npz") as saved:
        assert json.loads(str(saved["head"]))["numbers"] == found
        np.testing.assert_array_equal(saved["inside"].ravel(), inside)
        margins = np.array([float(row["margin_n"]) for row in rows])
        np.testing.assert_allclose(saved["margin_n"].ravel(), margins, rtol=1e-9, atol=1e-9)
        cell = np.prod([np.diff(saved[f"nozzle_{axis}_mm"]).mean() for axis in "xyz"])
        assert saved["nozzle_in_print_space"].sum() * cell == pytest.approx(found["print_space_mm3"])
        radius, height = found["largest_cylinder_mm"]
        x, y, z = np.meshgrid(*(saved[f"nozzle_{axis}_mm"] for axis in "xyz"), indexing="ij")
        within = (np.hypot(x, y) <= radius) & (z <= -460 + height)
        assert (saved["nozzle_free_radius_mm"][within] >= radius).all()


def test_outputs_follow_the_rules_of_the_house(here, capsys):
    words = ["stiffness", *PAPER, *LEVEL, "-q"]
    assert run(*words, "-o", "a.csv", "--png", "a.png") == 0
    before = {name: (here / name).read_bytes() for name in ("a.csv", "a.png")}
    assert "a.csv exists" in refused(capsys, 5, *words, "-o", "a.csv")
    assert "a.png exists" in refused(capsys, 5, *words, "--png", "a.png")
    assert run(*words, "-o", "a.csv", "--png", "a.png", "--overwrite") == 0
    assert {name: (here / name).read_bytes() for name in before} == before      # same input, same bytes
    capsys.readouterr()
    (here / "folder").mkdir()
    assert run(*words, "-o", "folder/") == 0
    assert run(*words, "--format", "npz", "-o", "folder/") == 0
    assert sorted(path.name for path in (here / "folder").iterdir()) == [
        "cabfab-init-x-stiffness.csv", "cabfab-init-x-stiffness.npz"]
    assert sorted(path.name for path in here.iterdir()) == ["a.csv", "a.png", "folder"]


def test_the_table_goes_to_stdout_and_values_take_its_place(here, capsysbinary):
    assert run("stiffness", *PAPER, *LEVEL) == 0
    out, err = capsysbinary.readouterr()
    assert b"K_cable alone" in out
    assert b"mode 6" in out
    assert err == b""
    assert run("stiffness", *PAPER, *LEVEL, "-o", "-") == 0
    out, err = capsysbinary.readouterr()
    lines = out.decode().splitlines()
    assert lines[-2].startswith("pose_mm_deg_1,")
    assert len(lines[-1].split(",")) == len(lines[-2].split(","))
    assert b"K_cable alone" in err
