"""Files a user could send in: a part, a printer, and the verdict that is right (tests/scenarios/*.toml)."""

import re
import tomllib
from pathlib import Path

import pytest

from cabslice import pipeline
from cabslice.feasibility.check import check
from cabslice.robot.model import robot_from_printer

ROOT = Path(__file__).parents[1]
SCENARIOS = sorted((ROOT / "tests" / "scenarios").glob("*.toml"))


def verdict_of(scenario):
    profiles = pipeline.load_profiles(scenario["printer"], None, scenario["process"], scenario["sets"])
    at = scenario.get("at_mm")
    placement = pipeline.Placement(
        scale=scenario.get("scale", 1.0), turn_deg=(0, 0, scenario.get("turn_deg", 0)), at_mm=at and tuple(at)
    )
    laid = pipeline.to_path(pipeline.read(ROOT / scenario["part"], profiles, placement))
    return check(laid.toolpath, robot_from_printer(profiles.printer))


def test_there_are_scenarios_of_both_kinds():
    verdicts = [bool(tomllib.loads(path.read_text())["findings"]) for path in SCENARIOS]
    assert {True, False} == set(verdicts)


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_the_verdict_is_the_expected_one(path):
    scenario = tomllib.loads(path.read_text())
    verdict = verdict_of(scenario)
    assert verdict.ok is (not scenario["findings"])
    assert {f.code for f in verdict.findings} == {expected["code"] for expected in scenario["findings"]}
    for expected in scenario["findings"]:
        found = [f for f in verdict.findings if f.code == expected["code"]]
        assert sorted(f.cable for f in found) == expected["cables"]
        if "free_below_mm" in expected:
            low, high = expected["free_below_mm"]
            assert all(low <= float(re.search(r"Up to (\S+) mm", f.help)[1]) <= high for f in found)
