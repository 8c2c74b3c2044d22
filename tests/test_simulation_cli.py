"""cabslice simulate, as a user sees it."""

import pytest
from cli_cases import answered, run

CIRCLE = ("simulate", "--circle", 100, "--centre-z", -200, "--time", 6.28, "--law", "cubic")


def test_the_circle_of_the_thesis(capsys):
    # Gueners 2021, table 5.6; domain.md section 6
    code, told = answered(capsys, *CIRCLE, "--distribution", "closed-form", "--no-pulleys", "-p", "cabfab-init-x")
    assert (code, told["ok"], told["distribution"], told["pulleys"]) == (0, True, "closed-form", False)
    assert told["numbers"]["max_abs_error_mm"] == pytest.approx([0.0141, 0.0135, 0.0030], rel=0.05)
    assert told["numbers"]["max_abs_error_deg"] == pytest.approx([0.0019, 0.0022, 0.0184], rel=0.05)
    assert told["numbers"]["slack_fraction"] == 0


@pytest.mark.parametrize("printer", ["cabfab-init", "cabfab-optim"])
def test_other_platforms_with_pulleys_winders_and_damping(capsys, printer):
    code, told = answered(capsys, *CIRCLE, "-p", printer, "--damping", "profile")
    error = told["numbers"]["nozzle_error"]
    assert code == 0
    # flat feed-forward knows no damping: what is left is what damping holds back
    assert 1e-4 < error["rms_mm"] <= error["p95_mm"] <= error["max_mm"] < 5e-3
    assert answered(capsys, *CIRCLE, "-p", printer)[1]["numbers"]["nozzle_error"]["max_mm"] < error["max_mm"] / 2


def test_slack_cables_are_told(capsys):
    assert run(*CIRCLE, "--distribution", "none", "--no-pulleys", "-p", "cabfab-init-x") == 0
    said = capsys.readouterr()
    assert "chaotic" in said.err
    assert "1.37" in said.out


def test_what_cannot_be_is_refused(capsys):
    assert run("simulate", "-p", "cabfab-optim") == 2
    assert run("simulate", "--circle", 100, "-p", "cabfab-optim") == 2
    assert run(*CIRCLE, "-p", "cabfab-optim", "--damping", "much") == 2
    code, told = answered(capsys, "simulate", "--circle", 400, "--time", 5, "-p", "cabfab-optim",
                          "--distribution", "closed-form")
    assert code == 4
    assert "closed-form finds no tensions" in told["error"]["sentence"]
