"""Every format at the command line: export, inspect, convert, and what is refused before any work."""

import importlib.util
import json

import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

from cabslice.motors import formats
from cabslice.motors.names import NAMES

ARROW = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow")
EACH = pytest.mark.parametrize("name", [pytest.param(n, marks=ARROW) if n == "parquet" else n for n in NAMES])
PEAKS = ("peak_motor_speed_rad_s", "max_tension_n", "peak_torque_n_m")


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planned")
    part, plan = write_box(folder / "box.stl"), folder / "box.plan"
    assert run("plan", part, *PRINTER, *SETS, "-o", plan, "-q") == 0
    return plan


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
    assert "block 0 of rows (from row 0, byte 0)" in told["error"]["sentence"]
    side = json.loads((tmp_path / "box.csp.json").read_text())
    (tmp_path / "box.csp.json").unlink()
    assert answered(capsys, "inspect", "box.csp")[0] == 3
    (tmp_path / "box.csp.json").write_text(json.dumps({**side, "rows": 5}))
    code, told = answered(capsys, "inspect", "box.csp")
    assert code == 3
    assert "box.csp.json is damaged" in told["error"]["sentence"]
