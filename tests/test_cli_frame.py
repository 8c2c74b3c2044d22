"""The frame of the command line: which exit code, how many words, and on which stream."""

import io
import json
import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cabslice import errors
from cabslice.cli import main as frame
from cabslice.cli.main import COMMANDS, cli, main
from cabslice.cli.options import Numbers
from cabslice.cli.report import Table, clock
from cabslice.feasibility.findings import Finding

PYTHON = [sys.executable, "-m", "cabslice"]
SLACK = "Layer 3: cable 5 would be slack."
FINDING = Finding("tension", 3, (1.0, 2.0, 3.0), 5, 0.5, 1.0, "N", SLACK, "Shift the part.")
ERRORS = {
    errors.UsageError("no such thing"): 2,
    errors.ModelError("part.stl: is flat", file="part.stl"): 3,
    errors.ProfileError("a.toml", ["mass_kg: missing", "bed: missing"]): 3,
    errors.ProductError("cube.plan is damaged"): 3,
    errors.ImpossibleError("The robot cannot.", [FINDING]): 4,
    errors.OutputError("The disk is full."): 5,
    OSError(28, "No space left on device"): 5,
    KeyboardInterrupt(): 130,
    RuntimeError("not foreseen"): 1,
}


@pytest.fixture(params=ERRORS, ids=lambda error: type(error).__name__)
def failing(request, monkeypatch):
    """A command that fails with each kind of error in turn, and the exit code it should end in."""
    import click

    @click.command("check")
    @click.option("--json", is_flag=True)
    def check(json):
        raise request.param

    monkeypatch.setattr(frame.Commands, "get_command", lambda self, ctx, name: check if name == "check" else None)
    return request.param, ERRORS[request.param]


def test_every_error_has_its_exit_code_and_its_sentence_on_stderr(failing, capsys):
    error, code = failing
    assert main(["check"]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert (getattr(error, "sentence", None) or getattr(error, "strerror", None) or "") in err
    assert ("Traceback" in err) == (code == 1)
    assert ("report" in err) == (code == 1)
    if code == 4:
        assert "Layer 3: cable 5 would be slack. Shift the part." in err


def test_with_json_every_error_is_one_object_on_stdout(failing, capsys):
    error, code = failing
    assert main(["check", "--json"]) == code
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert said["ok"] is False
    assert said["error"]["exit_code"] == code
    assert said["error"]["kind"] == type(error).__name__
    assert said["error"]["sentence"]
    assert ("Traceback" in err) == (code == 1)
    if code == 4:
        assert said["error"]["findings"] == [json.loads(json.dumps(FINDING.as_dict()))]


def test_alone_it_names_the_commands_that_matter(capsys):
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert "cabslice export PART.stl -p PRINTER" in out
    assert not err


def test_help_lists_every_command_and_each_command_has_help(capsys):
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out
    for name in (name for section in COMMANDS.values() for name in section):
        assert f"  {name} " in listed
        assert main([name, "--help"]) == 0
        assert f"Usage: cabslice {name}" in capsys.readouterr().out


@pytest.mark.parametrize("command", [name for section in COMMANDS.values() for name in section])
def test_the_help_of_a_command_imports_no_numpy(command):
    call = f"main([{command!r}, '--help'])"
    code = f"import sys; from cabslice.cli.main import main; sys.exit({call} or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


@pytest.mark.parametrize(("wrong", "meant"), [("exprt", "export"), ("chek", "check"), ("slcie", "slice")])
def test_a_mistyped_command_is_guessed(wrong, meant, capsys):
    assert main([wrong]) == 2
    assert f"Did you mean '{meant}'?" in capsys.readouterr().err


def test_a_wrong_option_is_exit_2_and_with_json_one_object(capsys):
    assert main(["export", "--bogus", "--json"]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["error"]["exit_code"] == 2
    assert not err
    assert main(["export", "--bogus"]) == 2
    assert "--bogus" in capsys.readouterr().err


def test_a_closed_pipe_ends_quietly_in_5():
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run([*PYTHON, "--help"], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (5, b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full")
@pytest.mark.parametrize("words", [["--help"], ["profile", "list", "--json"], ["check", "nothing.stl", "--json"]])
def test_a_full_disk_behind_stdout_is_5_with_a_sentence(words):
    with open("/dev/full", "w") as full:
        ended = subprocess.run([*PYTHON, *words], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 5
    assert "could not be written" in ended.stderr
    assert "Traceback" not in ended.stderr


@given(st.floats(0, 1e6))
def test_a_duration_is_said_to_the_second(seconds):
    words = clock(seconds).split()
    units = {"h": 3600, "min": 60, "s": 1}
    said = sum(float(number) * units[unit] for number, unit in zip(words[::2], words[1::2], strict=True))
    assert abs(said - seconds) <= 0.5


@given(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3))
def test_three_numbers_are_read_with_spaces_or_commas(numbers):
    for separator in (" ", ",", ", "):
        assert Numbers("x", "y", "z").convert(separator.join(map(repr, numbers)), None, None) == tuple(numbers)


@pytest.mark.parametrize("text", ["", "1 2", "1 2 3 4", "1 2 z", "nan 0 0", "inf 0 0"])
def test_what_is_not_three_numbers_is_refused(text, capsys):
    assert main(["export", "part.stl", "--turn", text]) == 2
    assert "x y z" in capsys.readouterr().err


def test_a_table_in_a_pipe_is_plain_text_whatever_its_width():
    out = io.StringIO()
    Table(("name", ">value"), [("long " * 30, "1"), ("b", "22.5")]).print(out)
    head, *rows = out.getvalue().splitlines()
    assert head.split() == ["name", "value"]
    assert len(rows) == 2
    assert rows[0].rstrip().endswith(" 1")
    assert "\x1b" not in out.getvalue()


def test_the_group_itself_answers_help():
    with pytest.raises(SystemExit) as stop:
        cli(["--help"])
    assert not stop.value.code
