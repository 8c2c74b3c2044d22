"""Parts that try a machine (samples/): sharp corners, walls that shake it, and a circle."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run

SAMPLES = Path(__file__).parents[1] / "samples"


def simulated(capsys, folder, name, scale, *more):
    plan = folder / f"{name}.plan"
    if not plan.exists():
        part = SAMPLES / f"{name}.stl"
        assert run("plan", part, *PRINTER, *SETS, "--scale", scale, "-o", plan, "-q") == 0
    code, told = answered(capsys, "simulate", plan, "-o", folder / "beads.csv", "--overwrite", *more)
    assert code == 0
    names, *rows = [line.split(",") for line in (folder / "beads.csv").read_text().splitlines() if line[0] != "#"]
    return told["numbers"], dict(zip(names, np.array(rows, float).T, strict=True))


def test_the_corners_of_the_square_are_rounded_and_nothing_else(capsys, tmp_path):
    numbers, _ = simulated(capsys, tmp_path, "square", 0.25)
    assert 0.02 < numbers["corner_rounding"]["max_mm"] <= 0.05
    assert numbers["corner_rounding"]["rms_mm"] < 0.01
    assert numbers["nozzle_error"]["max_mm"] < 5e-3


@pytest.mark.slow
def test_the_waves_of_the_ringing_tower_shake_a_softer_robot(capsys, tmp_path):
    numbers, beads = simulated(capsys, tmp_path, "ringing", 1.0, "--modulus-factor", 0.95, "--damping", 0.01)
    x, y = beads["x_mm"], beads["y_mm"]
    walls = (np.maximum(np.abs(x), np.abs(y)) > 19.0) & (np.maximum(np.abs(x), np.abs(y)) < 20.0)
    waved = beads["rms_mm"][walls & (np.maximum(x, y) > 19.0)]
    assert np.median(waved) > 0.02
    assert numbers["nozzle_error_beyond_offset"]["max_mm"] > 0.06
    assert simulated(capsys, tmp_path, "ringing", 1.0)[0]["nozzle_error"]["max_mm"] < 5e-3
