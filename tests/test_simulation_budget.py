"""simulate --budget: causes switched on one by one, and the pictures."""

import json

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

WRONG = ("--modulus-factor", 0.95, "--damping", 0.01, "--drives", "cascade", "-s",
         "cables.winder.first_radius_mm=60.28")


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("budget")
    box = write_box(folder / "box.stl", (4.0, 3.0, 0.6))
    assert run("plan", box, *PRINTER, *SETS, "-o", folder / "box.plan", "-q") == 0
    return folder / "box.plan"


def budget(capsys, plan, *more):
    code, told = answered(capsys, "simulate", plan, "--budget", *more)
    assert code == 0
    return told["numbers"], told["numbers"]["budget"]


def test_every_cause_stands_alone(capsys, plan):
    numbers, found = budget(capsys, plan, *WRONG)
    causes = found["causes"]
    assert causes["total"]["rms_mm"] == pytest.approx(numbers["nozzle_error"]["rms_mm"], rel=1e-6)
    assert {"stretch at rest", "deflection by inertia", "winder radii", "servo lag", "sampling and quantisation",
            "corner rounding"} <= set(causes)
    assert causes["interaction"]["rms_mm"] < 0.1 * causes["total"]["rms_mm"]
    assert set(causes["servo lag"]["features"]) == set(numbers["features"])
    assert {int(layer) for layer in causes["total"]["layers"]} == {row["layer"] for row in numbers["layers"]}
    assert causes["total"]["max_mm"] <= found["sum_of_max_mm"] + 1e-9
    for options, cause in ((WRONG[4:6], "servo lag"), (WRONG[6:], "winder radii")):
        alone = budget(capsys, plan, *options)[1]["causes"]
        assert alone[cause]["rms_mm"] == pytest.approx(causes[cause]["rms_mm"], rel=0.02)


def test_what_is_not_wrong_is_no_cause(capsys, plan):
    causes = budget(capsys, plan)[1]["causes"]
    assert "servo lag" not in causes
    assert "winder radii" not in causes
    left = sum(causes.get(name, {"max_mm": 0.0})["max_mm"] for name in ("stretch at rest", "deflection by inertia"))
    assert left < 1e-4


def test_calibration_is_weighed_by_its_covariance(capsys, plan, tmp_path):
    file, names = tmp_path / "known.json", ["winder 1 radius", "zero 5"]

    def spread(matrix):
        file.write_text(json.dumps({"parameters": names, "covariance": matrix}), encoding="utf-8")
        return budget(capsys, plan, "--covariance", file)[1]["calibration_standard_deviation"]["max_mm"]

    first, both, twice = spread([[1e-4, 0], [0, 0]]), spread([[1e-4, 0], [0, 1e-2]]), spread([[4e-4, 0], [0, 0]])
    assert 0.005 < first < both
    assert twice == pytest.approx(2 * first, rel=1e-9)
    file.write_text(json.dumps({"parameters": ["nothing"], "covariance": [[1]]}), encoding="utf-8")
    assert run("simulate", plan, "--budget", "--covariance", file) == 2
    file.write_text("{", encoding="utf-8")
    assert run("simulate", plan, "--budget", "--covariance", file) == 3


def test_pictures(capsys, plan, tmp_path):
    assert run("simulate", plan, "--png", tmp_path / "map.png", "-q") == 0
    assert run("simulate", plan, "--png", tmp_path / "one.svg", "--layer", 1, "-q") == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert "layer 1" in (tmp_path / "one.svg").read_text()
    assert run("simulate", plan, "--png", tmp_path / "one.svg", "-q") == 5
    assert run("simulate", plan, "--png", tmp_path / "none.svg", "--layer", 999, "-q") == 2


def test_a_ballbar_goes_both_ways(capsys, tmp_path):
    code, told = answered(
        capsys, "simulate", "--circle", 100, "--centre-z", -200, "--time", 6.28, "-p", "cabfab-optim", "--distribution",
        "nearest", "--png", tmp_path / "bar.svg")
    found = told["numbers"]["ballbar"]
    assert code == 0
    assert "clockwise" in (tmp_path / "bar.svg").read_text()
    # at rest the commanded lengths hold the circle; what moves is out by the inertia, alike in both ways
    assert found["circularity_mm"]["at rest"] < 1e-6
    assert found["circularity_mm"]["clockwise"] == pytest.approx(found["circularity_mm"]["counter-clockwise"], rel=0.3)
    assert np.isfinite(found["largest_between_both_ways_mm"])
