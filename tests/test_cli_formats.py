"""Every format at the command line: export, inspect, convert, and what is refused before any work."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, planned_box, run, write_box

from cabslice.errors import ProductError
from cabslice.motors import formats
from cabslice.motors.check import ASIDE
from cabslice.motors.machine import robot_of
from cabslice.motors.names import NAMES
from cabslice.robot.forward import forward
from cabslice.robot.winder import pulley_lengths_of

ARROW = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow")
EACH = pytest.mark.parametrize("name", [pytest.param(n, marks=ARROW) if n == "parquet" else n for n in NAMES])
PEAKS = ("peak_motor_speed_rad_s", "max_tension_n", "peak_torque_n_m")


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    return planned_box(tmp_path_factory.mktemp("planned"))


@EACH
def test_export_inspect_and_convert_tell_the_same(name, planned, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, made = answered(capsys, "export", planned, "--format", name)
    assert code == 0
    assert made["output"] == f"box{NAMES[name].suffix}"
    code, seen = answered(capsys, "inspect", made["output"])
    assert (code, seen["kind"]) == (0, name)
    assert seen["numbers"] == made["numbers"]
    code, turned = answered(capsys, "convert", made["output"], "again.stream")
    assert code == 0
    for key in PEAKS:
        assert turned["numbers"][key] == pytest.approx(made["numbers"][key], rel=1e-3), key
    assert formats.read("again.stream").header["converted_from"] == [name]
    assert run("convert", "again.stream", "third.csv", "-q") == 0
    assert formats.read("third.csv").header["converted_from"] == [name, "stream"]


def test_convert_refuses_what_it_cannot_do(planned, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, told = answered(capsys, "convert", planned, "a.csv")
    assert code == 2
    assert "is not a motor file" in told["error"]["sentence"]
    assert answered(capsys, "convert", "none.stream", "a.csv")[0] == 3
    run("export", planned, "-q")
    assert answered(capsys, "convert", "box.stream", "a.gcode")[0] == 2
    code, told = answered(capsys, "convert", "box.stream", "box.stream", "--overwrite")
    assert code == 2
    assert "onto itself" in told["error"]["sentence"]
    (tmp_path / "a.csv").write_bytes(b"mine")
    assert answered(capsys, "convert", "box.stream", "a.csv")[0] == 5
    assert (tmp_path / "a.csv").read_bytes() == b"mine"


def test_what_a_format_needs_is_asked_before_any_work(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cabslice.pipeline.to_plan", None)
    part = write_box(tmp_path / "box.stl")
    if importlib.util.find_spec("pyarrow") is None:
        code, told = answered(capsys, "export", part, *PRINTER, "--format", "parquet")
        assert code == 2
        assert "pip install pyarrow" in told["error"]["sentence"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["box.stl"]


def test_a_damaged_drive_file_is_refused_with_the_place(planned, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run("export", planned, "--format", "csp", "-q")
    data = bytearray((tmp_path / "box.csp").read_bytes())
    data[len(data) // 2] ^= 16
    (tmp_path / "box.csp").write_bytes(data)
    code, told = answered(capsys, "inspect", "box.csp")
    assert code == 3
    assert "box.csp is damaged: block 1 of rows (from row 8192, byte " in told["error"]["sentence"]
    side = json.loads((tmp_path / "box.csp.json").read_text())
    (tmp_path / "box.csp.json").unlink()
    assert answered(capsys, "inspect", "box.csp")[0] == 3
    (tmp_path / "box.csp.json").write_text(json.dumps({**side, "rows": 5}))
    code, told = answered(capsys, "inspect", "box.csp")
    assert code == 3
    assert "box.csp.json is damaged" in told["error"]["sentence"]


def test_a_motor_file_is_read_with_nothing_beside_it(planned, tmp_path, monkeypatch, capsys):
    """The printer it was made for, with what -s changed of it, is in the file: another plate moves the drawn nozzle."""
    monkeypatch.chdir(tmp_path)
    part = write_box(tmp_path / "box.stl")
    assert run("export", part, *PRINTER, *SETS, "-s", "platform.mass_kg=2.5", "-q") == 0
    assert run("inspect", "box.stream", "--png", "box.png", "-q") == 0
    header = formats.read("box.stream").header
    robot = robot_of(header)
    assert robot.mass == 2.5
    length = pulley_lengths_of(robot, np.array([header["start_angles_rad"]]), np.array([header["start_tensions_n"]]))
    pose = forward(robot, length, np.array(header["start_pose"]) + ASIDE).poses[0]
    np.testing.assert_allclose(pose, header["start_pose"], rtol=0, atol=1e-6)
    for wrong in ({"printer": {**header["printer"], "colour": "red"}}, {"printer": json.loads(json.dumps(
            header["printer"]).replace("2.5", "2.6"))}):
        with pytest.raises(ProductError, match="printer in the motor file"):
            robot_of({**header, **wrong})
    with pytest.raises(ProductError, match="export it again"):
        robot_of({key: value for key, value in header.items() if key != "printer"})


@pytest.mark.parametrize(("words", "wanted"), [
    (["box.plan", "--png", "box.txt"], "does not end in .png"), (["box.plan", "--scale", 2], "is no mesh"),
    (["box.stream", "--at", "5 5"], "is no mesh"),
])
def test_inspect_refuses_what_it_would_not_heed(planned, tmp_path, monkeypatch, capsys, words, wanted):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.plan").write_bytes(planned.read_bytes())
    assert run("export", "box.plan", "-q") == 0
    code, told = answered(capsys, "inspect", *words)
    assert code == 2
    assert wanted in told["error"]["sentence"]


def test_what_went_to_standard_output_is_not_called_a_dash(planned, tmp_path):
    done = subprocess.run([sys.executable, "-m", "cabslice", "export", planned, "-o", "-"], capture_output=True)
    assert done.returncode == 0
    (tmp_path / "piped.stream").write_bytes(done.stdout)
    assert formats.read(tmp_path / "piped.stream").rows > 0
    assert b"wrote" not in done.stderr
