"""Profiles for the tests: a right printer as TOML text, and ways to spoil it."""

from __future__ import annotations

from pathlib import Path

import pytest

from cabslice.errors import ProfileError
from cabslice.profile import shelf

SHARED = """
diameter_mm = 1.0
modulus_gpa = 70.0
min_tension_n = 1.0
max_tension_n = 100.0
reference_tension_n = 30.0
clearance_mm = 2.0
"""
WINDER = """
first_radius_mm = 60.0
layer_step_mm = 1.0
ramp_start_deg = 100.0
ramp_end_deg = 110.0
layers = 5
home_angle_deg = 900.0
centre_mm = [0, 0, 900]
"""
MOTOR = """
max_speed_rad_s = 10.0
continuous_torque_n_m = 6.0
peak_torque_n_m = 18.0
inertia_kg_mm2 = 440.0
"""
SIGNS = [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1), (1, 1, -1), (-1, 1, -1), (-1, -1, -1), (1, -1, -1)]
# attachments that turn with the signs, each set by another angle: the cables hold every freedom
CABLES = [
    f"[[cable]]\nanchor_mm = [{500 * x}, {500 * y}, {500 * z}]\n"
    f"attachment_mm = [{(60 if z > 0 else 40) * x}, {(40 if z > 0 else 60) * y}, {-25 * z}]\n"
    for x, y, z in SIGNS
]
PLATFORM = "mass_kg = 2.5\ninertia_kg_mm2 = [2000.0, 2000.0, 3000.0]\n"


def printer_toml(
    *, head: str = "", platform: str = PLATFORM, shared: str = SHARED, pulley: str = "", winder: str = WINDER,
    motor: str = MOTOR, cables: list[str] = CABLES, tail: str = "",
) -> str:
    return "\n".join([
        'schema = 1\nsource = "a test"', head, "[platform]", platform, "[cables]", shared, "[cables.pulley]", pulley,
        "[cables.winder]", winder, "[cables.motor]", motor, *cables, tail])


def write(folder: Path, text: str, name: str = "mine.toml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(path: Path | str, kind: str = "printers", sets: tuple[str, ...] = ()) -> list[str]:
    with pytest.raises(ProfileError) as caught:
        shelf.load(kind, path, sets)
    assert caught.value.exit_code == 3
    return caught.value.details["faults"]
