"""Finding profiles, laying parents under them and options over them, and knowing them again."""

from __future__ import annotations

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profile_cases import CABLES, SHARED, faults_of, printer_toml, write

from cabslice.errors import ProfileError, UsageError
from cabslice.profile import shelf
from cabslice.profile.reader import Sheet, merge
from cabslice.profile.toml import dump, line_of, literal

MATERIAL = 'source = "x"\nnozzle_c = [190, 220]\nbed_c = [0, 55]\nspeed_mm_s = [40, 90]\nmax_flow_mm3_s = 10\n'


@pytest.fixture
def places(tmp_path, monkeypatch):
    """An empty working folder, two folders of CABSLICE_PROFILES and a user folder."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("CABSLICE_PROFILES", os.pathsep.join([str(tmp_path / "one"), str(tmp_path / "two")]))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("CABSLICE_PRINTER", raising=False)
    return tmp_path


def material(folder, name, density):
    return write(folder, MATERIAL + f"density_g_cm3 = {density}\n", f"materials/{name}.toml")


def test_the_first_folder_of_the_search_path_wins(places):
    """pla is in all five places; taken away from the front, the next one is found each time."""
    order = [places / "here/profiles", places / "one", places / "two", places / "config/cabslice/profiles"]
    files = [material(folder, "pla", 2 + index) for index, folder in enumerate(order)]
    for index, file in enumerate(files):
        assert shelf.load_material("pla").density_g_cm3 == 2 + index
        assert shelf.find("materials", "pla").resolve() == file.resolve()
        file.unlink()
    assert shelf.load_material("pla").density_g_cm3 == 1.24


def test_the_users_folder_is_in_the_home_folder_without_xdg(places, monkeypatch):
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setenv("HOME", str(places / "home"))
    material(places / "home/.config/cabslice/profiles", "mud", 1.5)
    assert "mud" in shelf.names("materials")
    assert shelf.load_material("mud").density_g_cm3 == 1.5


def test_a_reference_with_a_separator_or_a_suffix_is_a_file(places):
    material(places / "here", "mud", 1.5)
    assert shelf.load_material("materials/mud.toml").density_g_cm3 == 1.5
    assert "mud" not in shelf.names("materials")
    (fault,) = faults_of("mud.toml", "materials")
    assert "there is no such file" in fault


def test_an_unknown_name_lists_names_like_it(places):
    (fault,) = faults_of("cabfab-optm")
    assert "no printer of this name; did you mean cabfab-optim" in fault
    (fault,) = faults_of("zzzz", "processes")
    assert all(name in fault for name in shelf.names("processes"))


def test_the_name_is_the_files_and_is_not_inherited(places):
    write(places / "one", 'inherits = "pla"\n', "materials/green.toml")
    green = shelf.load_material("green")
    assert (green.name, green.description) == ("green", "")
    assert green.density_g_cm3 == shelf.load_material("pla").density_g_cm3


def test_a_profile_may_inherit_the_one_of_its_own_name_further_down(places):
    write(places / "here/profiles", 'inherits = "pla"\nfan = 0.25\n', "materials/pla.toml")
    write(places / "two", 'inherits = "pla"\nmax_flow_mm3_s = 3\n', "materials/pla.toml")
    pla = shelf.load_material("pla")
    assert (pla.fan, pla.max_flow_mm3_s, pla.density_g_cm3) == (0.25, 3.0, 1.24)


def test_a_circle_and_a_missing_parent_are_named(places):
    for name, parent in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "plaa"), ("e", "./none.toml")):
        write(places / "one", f'inherits = "{parent}"\n', f"materials/{name}.toml")
    (fault,) = faults_of("a", "materials")
    assert "circle: a -> b -> c -> a" in fault
    (fault,) = faults_of("d", "materials")
    assert 'inherits = "plaa"' in fault
    assert "did you mean pla" in fault
    (fault,) = faults_of("e", "materials")
    assert "none.toml" in fault
    write(places / "one", "inherits = 3\n", "materials/a.toml")
    (fault,) = faults_of("a", "materials")
    assert "expected the name or the file of a material profile, found 3" in fault


def test_a_parent_may_be_a_file_beside_its_child(places):
    write(places, printer_toml(), "machines/base.toml")
    path = write(places, 'inherits = "../machines/base.toml"\n[platform]\nmass_kg = 3\n', "other/child.toml")
    assert shelf.load_printer(path).platform.mass_kg == 3
    assert shelf.load_printer(path).platform.inertia_kg_mm2 == [2000.0, 2000.0, 3000.0]


def test_cables_merge_by_position_and_the_nearest_file_wins(tmp_path):
    """A child's [cables] covers all its parent said of any cable; its own [[cable]] covers that."""
    write(tmp_path, printer_toml(cables=[CABLES[0] + "max_tension_n = 70\n", *CABLES[1:]]), "base.toml")
    blocks = ["[[cable]]\n"] * 8
    blocks[2] = "[[cable]]\nmax_tension_n = 60\nwinder.layers = 7\n"
    child = 'inherits = "base"\n[cables]\nmax_tension_n = 80\n[cables.winder]\nlayers = 6\n' + "".join(blocks)
    base, printer = shelf.load_printer(tmp_path / "base.toml"), shelf.load_printer(write(tmp_path, child))
    assert [cable.max_tension_n for cable in base.cable] == [70, *[100] * 7]
    assert [cable.max_tension_n for cable in printer.cable] == [80, 80, 60, *[80] * 5]
    assert [cable.winder.layers for cable in printer.cable] == [6, 6, 7, *[6] * 5]
    assert [cable.anchor_mm for cable in printer.cable] == [cable.anchor_mm for cable in base.cable]
    assert [cable.winder.centre_mm for cable in printer.cable] == [cable.winder.centre_mm for cable in base.cable]


def test_a_child_must_have_as_many_cables_as_its_parent_or_none(tmp_path):
    write(tmp_path, printer_toml(), "base.toml")
    faults = faults_of(write(tmp_path, 'inherits = "base"\n' + "[[cable]]\nclearance_mm = -1\n" * 7))
    assert "expected 8 [[cable]] blocks as in the profile it inherits from, found 7" in faults[0]
    assert len(faults) == 8                # and each of the seven clearances


def test_cables_may_be_shared_before_there_are_any(tmp_path):
    write(tmp_path, "[cables]" + SHARED, "steel.toml")
    whole = printer_toml(head='inherits = "steel"', shared="")
    assert shelf.load_printer(write(tmp_path, whole)).cable[7].modulus_gpa == 70


TREE = st.recursive(
    st.integers(-3, 3) | st.lists(st.integers(0, 3), max_size=2),
    lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3), max_leaves=8)
TABLES = st.dictionaries(st.sampled_from("abc"), TREE, max_size=3)


def naive(base, over):
    """Deep merge in the plainest words, to compare with."""
    if not (isinstance(base, dict) and isinstance(over, dict)):
        return over
    return {key: naive(base[key], over[key]) if key in base and key in over else over.get(key, base.get(key))
            for key in [*base, *(key for key in over if key not in base)]}


@settings(max_examples=100, deadline=None)
@given(st.lists(TABLES, min_size=1, max_size=4))
def test_merging_is_a_deep_merge_and_every_value_knows_its_file(tables):
    draft = merge([Sheet(str(index), table) for index, table in enumerate(tables)], cables=False)
    expected = tables[0]
    for table in tables[1:]:
        expected = naive(expected, table)
    values = {key: value for key, value in draft.values.items() if key != "name"}
    assert values == expected
    for place in leaves(values):
        origin = draft.origin(place)
        assert origin is not None
        assert at(tables[int(origin.label)], origin.place) == at(values, place)
        assert origin.place == place


def at(values, place):
    for part in place:
        values = values[part]
    return values


def leaves(values, place=()):
    for key, value in values.items():
        if isinstance(value, dict):
            yield from leaves(value, (*place, key))
        else:
            yield (*place, key)


# ---- options

def test_options_are_laid_over_the_file_and_checked_like_it():
    sets = ["cables.max_tension_n=80", "platform.mass_kg=2", "cable.3.anchor_mm=[-490, -495, 505.5]",
            "defaults.material=petg", "cable.3.max_tension_n=70", "cables.winder.layers=7"]
    printer, plain = shelf.load_printer("cabfab-optim", sets), shelf.load_printer("cabfab-optim")
    assert [cable.max_tension_n for cable in printer.cable] == [80, 80, 70, 80, 80, 80, 80, 80]
    assert [cable.winder.layers for cable in printer.cable] == [7] * 8
    assert printer.platform.mass_kg == 2
    assert printer.cable[2].anchor_mm == [-490, -495, 505.5]
    moved = [one.anchor_mm != two.anchor_mm for one, two in zip(printer.cable, plain.cable, strict=True)]
    assert moved == [index == 2 for index in range(8)]
    assert printer.defaults.material == "petg"
    faults = faults_of("cabfab-optim", sets=(
        "cables.max_tension_n=0", "cable.9.anchor_mm=[1,2,3]", "platform.mass_kg=2 kg", "cables=3",
        "platform.mas_kg=2"))
    for word in ("cable.9.anchor_mm", "N from 1 to 8", 'found "2 kg"', "did you mean mass_kg",
                 "cables.max_tension_n (--set)", "found cables"):
        assert any(word in fault for fault in faults), word


def test_options_are_sorted_by_the_profile_that_has_the_key():
    sets = ["layer_mm=0.1", "cables.max_tension_n=80", "density_g_cm3=1", "speeds_mm_s.travel=90",
            "cable.3.winder.layers=7", "name=x", "nozzle.diameter_mm=0.6"]
    printer, material, process = shelf.split_sets(sets)
    assert printer == ["cables.max_tension_n=80", "cable.3.winder.layers=7", "name=x", "nozzle.diameter_mm=0.6"]
    assert material == ["density_g_cm3=1"]
    assert process == ["layer_mm=0.1", "speeds_mm_s.travel=90"]
    with pytest.raises(ProfileError) as caught:
        shelf.split_sets(["layr_mm=0.1", "speeds_mm_s.travl=3", "infill=1", "cable.x.layers=3"])
    faults = caught.value.details["faults"]
    assert [fault.split(":")[0] for fault in faults] == ["layr_mm", "speeds_mm_s.travl", "cable.x.layers"]
    assert "did you mean layer_mm" in faults[0]
    assert "did you mean speeds_mm_s.travel" in faults[1]
    for wrong in ("layer_mm", "=3", "platform..mass_kg=2"):
        with pytest.raises(UsageError):
            shelf.split_sets([wrong])


# ---- identity and defaults

def test_the_hash_knows_values_not_their_writing(tmp_path):
    one = shelf.load_printer(write(tmp_path, printer_toml()))
    two = shelf.load_printer(write(tmp_path, "# other words\n" + printer_toml().replace("gpa = 70.0", "gpa = 7e1")))
    spread = printer_toml(shared="", cables=[cable + SHARED for cable in CABLES])
    assert one == two == shelf.load_printer(write(tmp_path, spread))
    assert shelf.profile_hash(one) == shelf.profile_hash(two)
    other = shelf.load_printer(tmp_path / "mine.toml", ["cable.8.clearance_mm=2.0000001"])
    assert shelf.profile_hash(other) != shelf.profile_hash(one)
    assert len(shelf.profile_hash(one)) == 64


def test_the_default_printer(places, monkeypatch):
    assert shelf.default_printer() is None
    path = shelf.set_default_printer("cabfab-optim")
    assert path == places / "config/cabslice/config.toml"
    assert shelf.default_printer() == "cabfab-optim"
    monkeypatch.setenv("CABSLICE_PRINTER", "cabfab-init")
    assert shelf.default_printer() == "cabfab-init"
    monkeypatch.delenv("CABSLICE_PRINTER")
    path.write_text("prnter = 3\n")
    with pytest.raises(ProfileError, match="prnter: unknown key; did you mean printer"):
        shelf.default_printer()
    path.write_text("printer = 3\n")
    with pytest.raises(ProfileError, match="expected the name or the file of a printer, found 3"):
        shelf.default_printer()


# ---- writing TOML

VALUES = st.recursive(
    st.booleans() | st.integers(-10**9, 10**9) | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3), max_leaves=10)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(st.text(max_size=5), VALUES, max_size=4))
def test_what_is_written_reads_back(values):
    import tomllib

    assert tomllib.loads(dump(values)) == values
    assert tomllib.loads(f"x = {literal(values)}")["x"] == values


def test_the_line_of_a_key():
    lines = ["# a", "top = 1", "[a]", "b = 2", "[a.c]", "d = [1,", "  2]", "[[cable]]", "x.y = 1", "[cable.w]", "z = 3",
             "[[cable]]", "[cable.w]", "z = 4"]
    text = "\n".join(lines)
    for place, written in (
        (("top",), "top = 1"), (("a", "b"), "b = 2"), (("a", "c", "d"), "d = [1,"), (("a", "c", "d", 1), "d = [1,"),
        (("cable", 0, "x", "y"), "x.y = 1"), (("cable", 0, "w", "z"), "z = 3"), (("cable", 1, "w", "z"), "z = 4"),
    ):
        assert lines[line_of(text, place) - 1] == written
    assert line_of(text, ("b",)) is None
