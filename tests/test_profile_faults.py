"""Every fault of a profile is told, all at once, with its key, its line, what was expected and what was there."""

from __future__ import annotations

import json
import re

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from profile_cases import CABLES, MOTOR, PLATFORM, SHARED, WINDER, faults_of, printer_toml, write

from cabslice.errors import ProfileError
from cabslice.profile import shelf
from cabslice.profile.keys import keys
from cabslice.profile.toml import dump

PRINT_TABLES = """
[nozzle]
diameter_mm = 0.4
offset_mm = [0, 0, -100]
[bed]
z_mm = -460
size_mm = [400, 400]
"""


def swap(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
    return text.replace(old, new)


def test_the_printer_these_tests_spoil_is_right(tmp_path):
    printer = shelf.load_printer(write(tmp_path, printer_toml(tail=PRINT_TABLES)))
    assert len(printer.cable) == 8
    assert printer.name == "mine"


# one spoiled printer, and the words that must stand in its only fault
SPOILED = {
    "min above max": (printer_toml(shared=swap(SHARED, "min_tension_n = 1.0", "min_tension_n = 100.0")),
                      "cables.min_tension_n", "less than max_tension_n = 100", "found 100"),
    "reference below min": (printer_toml(shared=swap(SHARED, "= 30.0", "= 0.5")),
                            "cables.reference_tension_n", "from min_tension_n = 1 to max_tension_n = 100", "found 0.5"),
    "reference above max": (printer_toml(shared=swap(SHARED, "= 30.0", "= 100.5")),
                            "cables.reference_tension_n", "to max_tension_n = 100", "found 100.5"),
    "tension negative": (printer_toml(shared=swap(SHARED, "min_tension_n = 1.0", "min_tension_n = -1")),
                         "cables.min_tension_n", "a number >= 0", "in N", "found -1"),
    "axis not unit": (printer_toml(pulley="axis = [0, 0, 1.00001]"), "cables.pulley.axis", "a unit vector", "1.00001"),
    "ramp backwards": (printer_toml(winder=swap(WINDER, "ramp_end_deg = 110.0", "ramp_end_deg = 100.0")),
                       "cables.winder.ramp_end_deg", "more than ramp_start_deg = 100", "found 100"),
    "ramp of more than a turn": (printer_toml(winder=swap(WINDER, "ramp_end_deg = 110.0", "ramp_end_deg = 461")),
                                 "cables.winder.ramp_end_deg", "at most one turn", "found 461"),
    "radii not increasing": (printer_toml(winder=WINDER + "radii_mm = [60.0, 61.0, 61.0]"),
                             "cables.winder.radii_mm", "increase", "61.0, 61.0"),
    "radii beyond the layers": (printer_toml(winder=WINDER + "radii_mm = [60, 61, 62, 63, 64, 65]"),
                                "cables.winder.layers", "at least the 6 layers", "found 5"),
    "home beyond the layers": (printer_toml(winder=swap(WINDER, "= 900.0", "= 1540.5")),
                               "cables.winder.home_angle_deg", "at most 1540 for its 5 layers", "found 1540.5"),
    "peak below continuous": (printer_toml(motor=swap(MOTOR, "= 18.0", "= 5.9")),
                              "cables.motor.peak_torque_n_m", "at least continuous_torque_n_m = 6", "found 5.9"),
    "not a body": (printer_toml(platform=swap(PLATFORM, "3000.0", "4000.1")),
                   "platform.inertia_kg_mm2", "at most the sum of the other two", "4000.1 > 4000"),
    "not a body, turned": (printer_toml(platform=PLATFORM + "inertia_products_kg_mm2 = [0, 1500.0, 0]"),
                           "platform.inertia_kg_mm2", "at most the sum of the other two"),
    "gravity upwards": (printer_toml(head="gravity_mm_s2 = -9806.65"), "gravity_mm_s2", ">= 0", "in mm/s^2"),
    "inertia zero": (printer_toml(platform=swap(PLATFORM, "[2000.0, 2000.0", "[0, 3000")),
                     "platform.inertia_kg_mm2", "3 numbers > 0", "found [0, 3000, 3000.0]"),
    "not finite": (printer_toml(platform=swap(PLATFORM, "2.5", "nan")), "platform.mass_kg", "finite", "found nan"),
    "not finite in a list": (printer_toml(platform=PLATFORM + "home_mm = [0, 0, inf]"),
                             "platform.home_mm", "3 numbers, in mm, finite", "found [0, 0, inf]"),
    "a text for a number": (printer_toml(platform=swap(PLATFORM, "2.5", '"2.5"')),
                            "platform.mass_kg", "a number > 0", "in kg", 'found "2.5"'),
    "a truth for a number": (printer_toml(platform=swap(PLATFORM, "2.5", "true")), "platform.mass_kg", "found true"),
    "too few numbers": (printer_toml(cables=[swap(CABLES[0], "500, 500, 500", "500, 500"), *CABLES[1:]]),
                        "cable.1.anchor_mm", "a list of 3 numbers", "found [500, 500]"),
    "no such choice": (printer_toml(winder=WINDER + 'routing = "round"'),
                       "cables.winder.routing", '"open" or "crossed"', 'found "round"'),
    "another schema": (swap(printer_toml(), "schema = 1", "schema = 2"), "schema", "expected 1", "found 2"),
    "missing in all": (printer_toml(shared=swap(SHARED, "clearance_mm = 2.0", "")),
                       "cables.clearance_mm", "missing", "a number >= 0", "in mm"),
    "missing in one": (printer_toml(cables=[*CABLES[:7], "\n".join(CABLES[7].splitlines()[:2])]),
                       "cable.8.attachment_mm", "missing", "3 numbers"),
    "missing table": (swap(printer_toml(), "[cables.motor]\n" + MOTOR, ""),
                      "cables.motor", "missing", "a table with max_speed_rad_s"),
    "a number for a table": (printer_toml(head="stream = 3"), "stream", "expected a table", "found 3"),
    "no tables of cables": (printer_toml(cables=[]) .replace("[platform]", "cable = 8\n[platform]"),
                            "cable", "one [[cable]] block for each cable", "found 8"),
    "zero length": (printer_toml(cables=[swap(CABLES[0], "[60, 40, -25]", "[500, 500, 500]"), *CABLES[1:]]),
                    "cable.1.attachment_mm", "longer than 0 mm", "on the anchor"),
    "inside the pulley": (printer_toml(pulley="groove_radius_mm = 25",
                                       cables=[swap(CABLES[0], "[60, 40, -25]", "[484, 488, -25]"), *CABLES[1:]]),
                          "cables.pulley.groove_radius_mm", "further than the pulley radius 25.5 mm", "found 20 mm"),
    "disc in the pulley": (printer_toml(cables=[CABLES[0] + "winder.centre_mm = [560, 500, 500]\n", *CABLES[1:]]),
                           "cable.1.winder.centre_mm", "full disc (radius 64 mm) clear of its pulley", "60 mm apart"),
    "too few cables": (printer_toml(cables=CABLES[:5]), "cable", "at least 6 cables to hold 6 freedoms", "found 5"),
    "freedom twice": (printer_toml(head='freedoms = ["x", "y", "x"]'), "freedoms", "each freedom once"),
    "bed over the nozzle": (printer_toml(tail=swap(PRINT_TABLES, "-460", "-99.5")),
                            "bed.z_mm", "below the nozzle at home (z = -100 mm)", "found -99.5"),
}


@pytest.mark.parametrize("case", SPOILED)
def test_one_fault_is_told_once_with_key_and_expectation(tmp_path, case):
    text, *words = SPOILED[case]
    faults = faults_of(write(tmp_path, text))
    assert len(faults) == 1, faults
    key, *others = words
    assert faults[0].split(":")[0].split(" (")[0] == key
    for word in others:
        assert word in faults[0]


def test_a_wrench_matrix_of_low_rank_names_the_freedom_the_cables_do_not_hold(tmp_path):
    """All attachments on the z axis: no cable can turn the platform about it."""
    cables = [
        f"[[cable]]\nanchor_mm = [{500 + i}, {(-1) ** i * 500}, {500 - 130 * i}]\n"
        f"attachment_mm = [0, 0, {10 * i + 5}]\n"
        for i in range(8)
    ]
    faults = faults_of(write(tmp_path, printer_toml(cables=cables)))
    assert len(faults) == 1
    assert "wrench matrix of rank 6 at home" in faults[0]
    assert "found rank 5" in faults[0]
    assert faults[0].endswith("rz")
    freedoms = 'freedoms = ["x", "y", "z", "rx", "ry"]'
    assert shelf.load_printer(write(tmp_path, printer_toml(head=freedoms, cables=cables))).freedoms[-1] == "ry"


def test_all_faults_of_a_file_are_told_at_once(tmp_path):
    """Faults of type, bound, spelling, absence and geometry, in three tables and two cables, in one error."""
    cables = [CABLES[0] + "pulley.axis = [0, 0, 2]\n", swap(CABLES[1], "anchor_mm", "ancor_mm"), *CABLES[2:]]
    text = printer_toml(platform=swap(PLATFORM, "2.5", "-2.5").replace("3000.0", "9000.0"), cables=cables,
                        shared=swap(swap(SHARED, "= 100.0", "= 0.5"), "modulus_gpa = 70.0", ""),
                        motor=swap(MOTOR, "= 18.0", "= 5.0"), head="freedms = []")
    faults = faults_of(write(tmp_path, text))
    told = sorted(fault.split(":")[0].split(" (")[0] for fault in faults)
    assert told == sorted([
        "platform.mass_kg", "platform.inertia_kg_mm2", "cable.1.pulley.axis", "cable.2.ancor_mm", "cables.modulus_gpa",
        "cables.min_tension_n", "cables.motor.peak_torque_n_m", "freedms"])
    lines = text.splitlines()
    for fault in faults:
        if "missing" not in fault:
            key = fault.split(":")[0].split(" (")[0].split(".")[-1]
            assert key in lines[int(fault.split("line ")[1].split(")")[0]) - 1], fault


def test_faults_of_material_and_process(tmp_path):
    material = """source = "x"
nozzle_c = [220, 190]
bed_c = [0, 60]
speed_mm_s = [90, 40]
max_flow_mm3_s = 0
density_g_cm3 = 1.2
cables = 3
"""
    told = {fault.split(" (")[0]: fault for fault in faults_of(write(tmp_path, material), "materials")}
    assert told.keys() == {"nozzle_c", "speed_mm_s", "max_flow_mm3_s", "cables"}
    assert "the lowest, then the highest, found 220 before 190" in told["nozzle_c"]
    assert "a number > 0 and <= 5000, in mm^3/s, found 0" in told["max_flow_mm3_s"]
    assert "unknown key" in told["cables"]
    process = 'inherits = "standard-0.4"\nlayer_mm = 0.43\nwalls = 2.5\n[speeds_mm_s]\ntravel = 0\n'
    told = {fault.split(" (")[0]: fault for fault in faults_of(write(tmp_path, process), "processes")}
    assert told.keys() == {"layer_mm", "outer_bead_mm", "walls", "speeds_mm_s.travel"}
    assert "at most nozzle_mm = 0.4, found 0.43" in told["layer_mm"]
    assert "at least layer_mm = 0.43" in told["outer_bead_mm"]
    assert "a whole number" in told["walls"]
    assert "in mm/s" in told["speeds_mm_s.travel"]


@pytest.mark.parametrize(("text", "word"), [
    ("schema = 1\nname = \n", "line 2"), ("a = 1\na = 2\n", "line 2"), ("\x00", "line 1"), ("[platform", "line 1"),
])
def test_a_syntax_error_names_its_line(tmp_path, text, word):
    (fault,) = faults_of(write(tmp_path, text))
    assert fault.startswith("not valid TOML")
    assert word in fault


def test_what_is_not_text_is_refused(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"name = '\xff'")
    (fault,) = faults_of(path)
    assert "not UTF-8" in fault


def test_a_fault_in_a_parent_names_the_parent_and_its_line(tmp_path):
    base = printer_toml(platform=swap(PLATFORM, "2.5", "-2.5"))
    write(tmp_path, base, "base.toml")
    (fault,) = faults_of(write(tmp_path, 'inherits = "base"\n'))
    line = 1 + base.splitlines().index("mass_kg = -2.5")
    assert fault.startswith(f"platform.mass_kg ({tmp_path / 'base.toml'}, line {line}): expected")


def test_a_printer_that_is_to_print_needs_four_tables(tmp_path):
    with pytest.raises(ProfileError) as caught:
        shelf.require_printing(shelf.load_printer(write(tmp_path, printer_toml(tail=PRINT_TABLES))))
    assert [fault.split(":")[0] for fault in caught.value.details["faults"]] == ["[extruder]", "[motion]"]
    shelf.require_printing(shelf.load_printer("cabfab-optim"))


# ---- spelling

LEAVES = {kind: [key.path for key in keys(kind).values() if not key.table] for kind in shelf.SINGULAR}
COMPLETE = {
    "printers": shelf.load_printer("cabfab-optim").model_dump(by_alias=True, exclude_none=True),
    "materials": shelf.load_material("pla").model_dump(by_alias=True, exclude_none=True),
    "processes": shelf.load_process("standard-0.4").model_dump(by_alias=True, exclude_none=True),
}


@st.composite
def misspelt(draw):
    """A kind, the path of a key in it, and the key with one letter left out, put in, replaced, or two swapped."""
    kind = draw(st.sampled_from(sorted(LEAVES)))
    path = draw(st.sampled_from(LEAVES[kind]))
    word = path[-1]
    at = draw(st.integers(0, len(word) - 1))
    letter = draw(st.sampled_from("abcdefghijklmnopqrstuvwxyz_"))
    typo = draw(st.sampled_from([
        word[:at] + word[at + 1:], word[:at] + letter + word[at:], word[:at] + letter + word[at + 1:],
        word[:at] + word[at + 1:at + 2] + word[at] + word[at + 2:],
    ]))
    assume(typo and (*path[:-1], typo) not in keys(kind))
    return kind, path, typo


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(case=misspelt())
def test_a_misspelt_key_is_refused_and_the_right_one_named(tmp_path, case):
    kind, path, typo = case
    values = json.loads(json.dumps(COMPLETE[kind]))
    rows = values["cable"] if path[0] == "cable" else [values]
    for row in rows:
        for part in path[1 if path[0] == "cable" else 0:-1]:
            row = row.setdefault(part, {})
            if isinstance(row, list):
                row.append({})
                row = row[0]
        row[typo] = row.pop(path[-1], 1)
    faults = faults_of(write(tmp_path, dump(values)), kind)
    told = [fault for fault in faults if "unknown key" in fault]
    assert len(told) == len(rows)
    for fault in told:
        hint = fault.split("did you mean ")[1].rstrip("?").split(" or ")
        assert fault.split(" (")[0].endswith(typo)
        assert path[-1] in hint


ODD = st.recursive(
    st.booleans() | st.integers() | st.floats() | st.sampled_from([10**400, -1, 0, 1e308, "x", ""]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["x", "kind"]), inner, max_size=2),
    max_leaves=6)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from(sorted(LEAVES)), data=st.data())
def test_whatever_stands_behind_a_key_it_is_a_value_or_a_fault(tmp_path, kind, data):
    """No value, of whatever type and size, ends in anything but a profile or faults of type, bound or relation."""
    values = json.loads(json.dumps(COMPLETE[kind]))
    path = data.draw(st.sampled_from([key.path for key in keys(kind).values()]))
    table = values
    for part in path[:-1]:
        table = table["cable"][data.draw(st.integers(0, 7))] if part == "cable" else table.setdefault(part, {})
        if isinstance(table, list):
            table.append({})
            table = table[0]
    table[path[-1]] = data.draw(ODD)
    file, faults = write(tmp_path, dump(values)), []
    try:
        assert shelf.profile_hash(shelf.load(kind, file))
    except ProfileError as error:
        faults = error.details["faults"]
    assert all(re.match(r"[\w.]+( \(line \d+\))?: ", fault) for fault in faults), faults


def test_a_key_in_the_wrong_table_is_sent_to_the_right_one(tmp_path):
    (fault,) = faults_of(write(tmp_path, printer_toml(head="max_tension_n = 50")))
    assert fault.endswith("did you mean cables.max_tension_n?")
