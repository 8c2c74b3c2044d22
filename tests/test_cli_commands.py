"""The commands as a user gives them: refusals before any work, one JSON object, nothing half-written."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

PYTHON = [sys.executable, "-m", "cabslice"]


@pytest.fixture
def box(tmp_path, monkeypatch):
    """A part in an empty folder that is the current one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CABSLICE_PRINTER", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "nobody"))
    return write_box(tmp_path / "box.stl")


def left(folder):
    return sorted(path.name for path in folder.iterdir())


def refused(capsys, code, words, *said):
    """The command ends in `code` with all of `said` on stderr, and leaves nothing but the part."""
    assert run(*words) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    for piece in said:
        assert piece in err


def test_without_a_printer_they_are_listed(box, capsys):
    refused(capsys, 2, ["export", box], "cabfab-init", "cabfab-optim", "-p")
    assert left(box.parent) == ["box.stl"]


def test_an_unknown_printer_is_guessed(box, capsys):
    refused(capsys, 3, ["export", box, "-p", "cabfab-optin"], "cabfab-optin", "cabfab-optim")


def test_the_environment_names_the_printer(box, capsys, monkeypatch):
    monkeypatch.setenv("CABSLICE_PRINTER", "cabfab-optim")
    code, said = answered(capsys, "slice", box, *SETS)
    assert (code, said["profiles"]["printer"]["name"]) == (0, "cabfab-optim")


def test_a_broken_profile_says_all_its_faults(box, capsys):
    profile = box.parent / "mine.toml"
    profile.write_text('schema = 1\ninherits = "cabfab-optim"\n[platform]\nmas_kg = 2.0\nmass_kg = -1.0\n')
    refused(capsys, 3, ["export", box, "-p", profile], "mine.toml", "mas_kg", "mass_kg", "expected a number > 0")


@pytest.mark.parametrize(("words", "said"), [
    (["-s", "walls=-1"], "walls"), (["-s", "wals=2"], "walls"), (["-s", "cable.0.mass=1"], "cable"),
])
def test_a_wrong_set_names_the_key(box, capsys, words, said):
    refused(capsys, 3, ["export", box, *PRINTER, *words], said)


def test_a_process_for_another_nozzle_is_refused(box, capsys):
    refused(capsys, 3, ["slice", box, *PRINTER, "-s", "nozzle.diameter_mm=0.8"], "is 0.8, but", "--process")


@pytest.mark.parametrize(("command", "default"), [("slice", "path"), ("plan", "plan"), ("export", "stream")])
def test_an_unknown_suffix_is_exit_2_and_names_the_known_ones(box, capsys, command, default):
    refused(capsys, 2, [command, box, *PRINTER, "-o", "box.xyz"], "box.xyz does not end in", f".{default}")
    refused(capsys, 2, [command, box, *PRINTER, "--format", "xyz"], "'xyz'")


@pytest.mark.parametrize(("command", "suffix"), [("slice", "path"), ("plan", "plan"), ("export", "stream")])
def test_an_existing_output_is_refused_before_any_work(box, capsys, command, suffix):
    there = box.with_suffix(f".{suffix}")
    there.write_text("mine")
    began = time.perf_counter()
    refused(capsys, 5, [command, box, *PRINTER], f"box.{suffix} exists", "--overwrite")
    assert time.perf_counter() - began < 0.5
    assert there.read_text() == "mine"


def test_an_unwritable_output_is_found_before_any_work(box, capsys):
    refused(capsys, 5, ["export", box, *PRINTER, "-o", "/proc/nowhere.stream"], "/proc")
    refused(capsys, 5, ["export", box, *PRINTER, "-o", "missing/box.stream"], "no folder missing")
    (box.parent / "folder").mkdir()
    assert run("slice", box, *PRINTER, *SETS, "-o", "folder/") == 0
    assert left(box.parent / "folder") == ["box.path"]


def test_a_missing_part_is_exit_3(box, capsys):
    for command in ("slice", "check", "plan", "export"):
        refused(capsys, 3, [command, "nothere.stl", *PRINTER], "nothere.stl", "no such file")
    refused(capsys, 3, ["inspect", "nothere.stl"], "nothere.stl")


def test_each_command_answers_with_one_json_object(box, capsys):
    code, part = answered(capsys, "inspect", box)
    assert code == 0
    assert part["numbers"]["size_mm"] == pytest.approx([6.0, 5.0, 1.5])
    assert part["numbers"]["part_mm3"] == pytest.approx(45.0)
    for words in (["slice"], ["check"], ["plan"], ["export", "--period-ms", "5"]):
        code, said = answered(capsys, words[0], box, *PRINTER, *SETS, *words[1:])
        assert (code, said["ok"], said["command"]) == (0, True, words[0]), said
        assert {row["name"] for row in said["profiles"].values()} >= {"cabfab-optim"}
    for suffix in ("path", "plan", "stream"):
        code, said = answered(capsys, "inspect", f"box.{suffix}")
        assert (code, said["kind"], said["numbers"]["layers"]) == (0, suffix, 5)


def test_the_numbers_of_export_are_those_of_inspect(box, capsys):
    _, made = answered(capsys, "export", box, *PRINTER, *SETS, "--period-ms", "5")
    _, seen = answered(capsys, "inspect", "box.stream")
    assert seen["numbers"] == made["numbers"]
    assert len(seen["numbers"]["max_tension_n"]) == 8
    _, csv = answered(capsys, "export", box, *PRINTER, *SETS, "--period-ms", "5", "-o", "box.csv")
    _, seen = answered(capsys, "inspect", "box.csv")
    assert seen["numbers"] == csv["numbers"]
    assert csv["numbers"]["max_tension_n"] == pytest.approx(made["numbers"]["max_tension_n"], abs=1e-3)


def test_the_answer_goes_to_stdout_and_the_talk_to_stderr(box, capsys):
    assert run("export", box, *PRINTER, *SETS, "--period-ms", "5") == 0
    out, err = capsys.readouterr()
    for piece in ("cabfab-optim can make box.stl", "print time", "filament", "tension", "torque", "next: cabslice"):
        assert piece in out
    assert err.startswith("printer cabfab-optim, material ")
    assert "process " in err
    assert run("export", box, *PRINTER, *SETS, "--period-ms", "5", "-q", "--overwrite") == 0
    assert capsys.readouterr() == (out, "")


def test_to_stdout_goes_the_file_alone(box, capfdbinary):
    assert run("slice", box, *PRINTER, *SETS) == 0
    assert run("slice", box, *PRINTER, *SETS, "-o", "box.gcode") == 0
    capfdbinary.readouterr()
    for name, words in (("box.path", ["-o", "-"]), ("box.gcode", ["-o", "-", "--format", "gcode"])):
        assert run("slice", box, *PRINTER, *SETS, *words) == 0
        out, err = capfdbinary.readouterr()
        assert out == (box.parent / name).read_bytes()
        assert b"layers" in err
    assert run("slice", box, *PRINTER, *SETS, "-o", "-", "--json") == 2


def test_inspect_draws_a_path_a_plan_and_a_motor_file(box, capsys):
    run("slice", box, *PRINTER, *SETS)
    run("plan", "box.path")
    run("export", "box.plan", "--period-ms", "5")
    for suffix in ("path", "plan", "stream"):
        assert run("inspect", f"box.{suffix}", "--png", f"{suffix}.png") == 0
        assert (box.parent / f"{suffix}.png").read_bytes().startswith(b"\x89PNG")
    refused_before = (box.parent / "path.png").read_bytes()
    assert run("inspect", "box.path", "--png", "path.png") == 5
    assert (box.parent / "path.png").read_bytes() == refused_before
    assert run("inspect", box, "--png", "part.png") == 2


@pytest.mark.parametrize("kind", ["path", "plan", "stream", "csv"])
def test_a_damaged_product_is_exit_3(box, capsys, kind):
    assert run("export" if kind in ("stream", "csv") else {"path": "slice", "plan": "plan"}[kind], box, *PRINTER, *SETS,
               *(["--period-ms", "5"] if kind in ("stream", "csv") else []), "-o", f"box.{kind}") == 0
    path = box.with_suffix(f".{kind}")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    code, said = answered(capsys, "inspect", path)
    assert (code, said["ok"], said["error"]["kind"]) == (3, False, "ProductError")
    assert path.name in said["error"]["sentence"]


def test_a_part_beside_the_bed_is_no_with_findings_and_no_motor_file(box, capsys):
    words = [box, *PRINTER, *SETS, "--at", "900 0"]
    code, said = answered(capsys, "check", *words)
    assert (code, said["ok"]) == (4, False)
    assert said["verdict"]["findings"]
    assert said["verdict"]["checked"]
    assert said["error"]["exit_code"] == 4
    code, said = answered(capsys, "export", *words)
    assert (code, said["ok"]) == (4, False)
    assert said["error"]["findings"]
    assert left(box.parent) == ["box.stl"]
    assert run("check", *words) == 4
    assert "cabfab-optim cannot make box.stl as asked." in capsys.readouterr().out


def test_ctrl_c_is_130_and_leaves_nothing(box):
    """Fine layers and a fine period: work enough to be interrupted in the middle of it."""
    words = ["export", "box.stl", *PRINTER, "--scale", "8", "--period-ms", "0.25"]
    process = subprocess.Popen([*PYTHON, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline().startswith("printer ")
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert "Traceback" not in err
    assert left(box.parent) == ["box.stl"]


def test_a_closed_pipe_in_the_middle_of_a_file_is_5_and_quiet(box):
    read, write = os.pipe()
    words = ["slice", "box.stl", *PRINTER, *SETS, "-o", "-", "-q"]
    process = subprocess.Popen([*PYTHON, *words], stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    os.close(read)
    assert (process.communicate()[1], process.returncode) == (b"", 5)


def test_no_colour_and_no_bar_where_nobody_looks(box):
    environment = os.environ | {"NO_COLOR": "1", "FORCE_COLOR": ""}
    words = ["slice", "box.stl", *PRINTER, *SETS, "--json"]
    ended = subprocess.run([*PYTHON, *words], capture_output=True, text=True, env=environment, check=True)
    assert json.loads(ended.stdout)["ok"]
    assert "\x1b" not in ended.stdout + ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def test_on_a_terminal_each_stage_has_a_bar(box):
    pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")
    ours, theirs = pty.openpty()
    process = subprocess.Popen([*PYTHON, "export", "box.stl", *PRINTER, *SETS], stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    seen = b""
    while piece := _read(ours):
        seen += piece
    assert process.wait() == 0
    for stage in (b"slice", b"check", b"plan", b"audit", b"write"):
        assert stage in seen


def _read(terminal):
    try:
        return os.read(terminal, 4096)
    except OSError:         # the other end has closed
        return b""


def test_verbose_says_the_seconds_of_each_stage(box, capsys):
    assert run("plan", box, *PRINTER, *SETS, "-v") == 0
    err = capsys.readouterr().err
    stages = [line.split()[0] for line in err.splitlines() if line.endswith(" s")]
    assert stages == ["slice", "check", "plan", "audit"]
