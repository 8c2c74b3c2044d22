"""--accuracy-um: the motion is slowed until the simulated nozzle keeps the bound."""

import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

ASKED = 20.0


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("accurate")
    box = write_box(folder / "box.stl", (9.0, 7.0, 0.6))
    for name, more in (("plain", ()), ("accurate", ("--accuracy-um", ASKED))):
        assert run("plan", box, *PRINTER, *SETS, *more, "-o", folder / f"{name}.plan", "-q") == 0
    return folder


def simulated(capsys, plan, *more):
    code, told = answered(capsys, "simulate", plan, "--reference", *more)
    assert code == 0
    return told["numbers"]


def test_the_simulated_nozzle_keeps_the_bound(capsys, made):
    plain, accurate = (simulated(capsys, made / f"{name}.plan") for name in ("plain", "accurate"))
    assert accurate["nozzle_error"]["max_mm"] < ASKED / 1e3
    assert plain["duration_s"] < accurate["duration_s"] < 1.5 * plain["duration_s"]


@pytest.mark.parametrize("wrong", ["--modulus-factor=0.95", "--mass-factor=1.05"])
def test_a_robot_that_is_not_as_its_profile_says_stays_near(capsys, made, wrong):
    plain, accurate = (simulated(capsys, made / f"{name}.plan", wrong, "--damping", 0.01)[
        "nozzle_error_beyond_offset"]["max_mm"] for name in ("plain", "accurate"))
    assert accurate <= 3 * ASKED / 1e3 < plain


@pytest.mark.slow
def test_what_it_costs_is_told(capsys, tmp_path):
    box = write_box(tmp_path / "box.stl", (9.0, 7.0, 0.6))
    code, told = answered(capsys, "plan", box, *PRINTER, *SETS, "--accuracy-um", ASKED, "-o", tmp_path / "box.plan")
    sentence = next(line for line in told["verdict"]["checked"] if "elastic" in line)
    assert code == 0
    assert "times the time; without the bound" in sentence
    assert told["verdict"]["margins"]["accuracy_wrong_um"] >= 0


@pytest.mark.slow
def test_what_cannot_be_kept_is_refused(capsys, tmp_path):
    box = write_box(tmp_path / "box.stl", (9.0, 7.0, 0.3))
    code, told = answered(capsys, "plan", box, *PRINTER, *SETS, "--accuracy-um", 0.001, "-o", tmp_path / "box.plan")
    assert code == 4
    assert told["error"]["findings"][0]["code"] == "accuracy"
    assert not (tmp_path / "box.plan").exists()
