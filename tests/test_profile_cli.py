"""cabslice profile: what it prints, what it writes, how it ends."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from profile_cases import CABLES, SHARED, printer_toml, write

from cabslice.cli.main import main
from cabslice.profile import shelf
from cabslice.profile.compare import differences
from cabslice.profile.keys import KINDS, keys
from cabslice.profile.shown import show, starter
from cabslice.profile.toml import dump, literal

ALL = [(kind, name) for kind in KINDS for name in shelf.names(kind)]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("CABSLICE_PRINTER", raising=False)
    return tmp_path


def run(capsys, *arguments):
    """Exit code, stdout, stderr."""
    code = main(["profile", *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def answer(capsys, *arguments):
    """The one JSON object of --json."""
    code, out, _ = run(capsys, *arguments, "--json")
    content = json.loads(out)
    assert content["ok"] == (code == 0)
    return code, content


def test_list_has_every_profile_with_its_file(here, capsys):
    _, content = answer(capsys, "list")
    for kind in KINDS:
        assert [one["name"] for one in content[kind]] == shelf.names(kind)
        for one in content[kind]:
            assert tomllib.loads(Path(one["file"]).read_text())["description"] == one["description"]
    code, out, err = run(capsys, "list", "printer")
    assert (code, err) == (0, "")
    assert [line.split()[1] for line in out.splitlines()[1:]] == shelf.names("printers")
    assert "\x1b" not in out               # no colours, no frames, when not a terminal


@pytest.mark.parametrize(("kind", "name"), ALL)
def test_check_says_what_a_right_profile_is(here, capsys, kind, name):
    code, out, _ = run(capsys, "check", name)
    assert code == 0
    assert out.startswith(f"{shelf.SINGULAR[kind].capitalize()} {name} is right: ")
    _, content = answer(capsys, "check", name)
    assert content["sentence"] == out.strip()
    assert content["sha256"] == shelf.profile_hash(shelf.load(kind, name))


def test_check_tells_every_fault_and_ends_with_3(here, capsys):
    path = write(here, printer_toml(shared=SHARED.replace("= 30.0", "= 300.0"), cables=CABLES[:4]))
    code, out, err = run(capsys, "check", "mine.toml")
    assert (code, out) == (3, "")
    assert len(err.splitlines()) == 2
    assert "cables.reference_tension_n (line " in err
    assert "at least 6 cables" in err
    code, content = answer(capsys, "check", path)
    assert code == content["error"]["exit_code"] == 3
    assert len(content["error"]["faults"]) == 2
    assert run(capsys, "check", "cabfab-optm")[0] == 3
    assert run(capsys, "check", "none.toml")[0] == 3


def test_a_file_is_told_by_its_keys_or_its_parent(here, capsys):
    for parent, kind, body in (("cabfab-optim", "printer", "[platform]\nmass_kg = 3"), ("pla", "material", "fan = 0.5"),
                               ("fine-0.6", "process", "walls = 3"), ("tpu", "material", "")):
        write(here, f'inherits = "{parent}"\n{body}\n')
        assert answer(capsys, "check", "mine.toml")[1]["kind"] == kind
    write(here, 'description = "nothing"\n')
    code, _, err = run(capsys, "check", "mine.toml")
    assert code == 2
    assert "--kind" in err
    assert run(capsys, "check", "mine.toml", "--kind", "process")[0] == 3


@pytest.mark.parametrize(("kind", "name"), ALL)
def test_what_is_shown_is_a_profile_of_the_same_meaning(here, capsys, kind, name):
    """The shown text, saved, loads without parents to the very same values."""
    code, out, _ = run(capsys, "show", name)
    assert code == 0
    assert "inherits" not in tomllib.loads(out)
    alone = shelf.load(kind, write(here, out))
    assert alone == shelf.load(kind, name)


def test_what_is_shown_says_which_file_gave_each_value(here, capsys):
    sets = ["-s", "cables.clearance_mm=3", "-s", "cable.2.winder.layers=7"]
    code, content = answer(capsys, "show", "cabfab-optim-measured", *sets)
    assert code == 0
    chain = ["cabfab-init", "cabfab-optim", "cabfab-optim-measured"]
    assert [file.rpartition("/")[2] for file in content["files"]] == [f"{name}.toml" for name in chain]
    files = dict(zip(chain, content["files"], strict=True))
    for key, origin in (
        ("platform.mass_kg", files["cabfab-optim"]), ("nozzle.offset_mm", files["cabfab-init"]),
        ("cable.3.anchor_mm", files["cabfab-optim-measured"]), ("cable.3.attachment_mm", files["cabfab-optim"]),
        ("cable.3.pulley.axis", files["cabfab-init"]), ("cables.motor.inertia_kg_mm2", files["cabfab-init"]),
        ("cables.clearance_mm", "--set"), ("cable.2.winder.layers", "--set"), ("bed.centre_mm", "default"),
        ("cable.1.winder.layers", files["cabfab-init"]),
    ):
        assert content["origins"][key] == origin, key
    assert content["values"]["cables"]["clearance_mm"] == 3
    _, out, _ = run(capsys, "show", "cabfab-optim")
    assert "mass_kg = 2.565    # cabfab-optim\n" in out
    assert "modulus_gpa = 69.49    # cabfab-init\n" in out


def test_keys_lists_every_key_of_the_models(here, capsys):
    _, content = answer(capsys, "keys", "printer")
    told = {one["key"]: one for one in content["keys"]}
    assert told["cable.min_tension_n"] == {
        "key": "cable.min_tension_n", "type": "a number", "unit": "N", "bound": ">= 0 and <= 1e+06", "required": True,
        "description": "below it the cable may go slack"}
    assert told["stream.period_ms"]["default"] == 2.0
    assert told["platform.inertia_kg_mm2"]["unit"] == "kg mm^2"
    assert told["extruder.max_flow_mm3_s"]["unit"] == "mm^3/s"
    # every value of a complete profile is one of the keys, and every key has a meaning
    for place in show("printers", "cabfab-optim-measured").origins:
        path = tuple(part for part in place if isinstance(part, str))
        assert (("cable", *path[1:]) if path[0] == "cables" else path) in keys("printers")
    for kind in KINDS:
        assert all(key.description for key in keys(kind).values())
        _, out, _ = run(capsys, "keys", shelf.SINGULAR[kind])
        assert all(key.dotted in out for key in keys(kind).values() if not key.table)


def uncommented(text):
    """A starter file with the "# " in front of every key taken away; the head and tables that are absent stay so."""
    head, mark, rest = text.partition("schema = 1")
    tables = (re.sub(r"(?m)^# ", "", one) if not one.startswith("# [") else one for one in rest.split("\n\n"))
    return head + mark + "\n\n".join(tables)


@pytest.mark.parametrize(("kind", "name"), ALL)
def test_a_starter_is_its_parent_commented_or_not(here, capsys, kind, name):
    """As written it means its parent; with every comment taken away it says the same again, key by key."""
    assert run(capsys, "new", "my-own", "--from", name)[0] == 0
    parent = shelf.load(kind, name).model_dump(exclude={"name", "description"})
    assert shelf.load(kind, "my-own.toml").model_dump(exclude={"name", "description"}) == parent
    text = (here / "my-own.toml").read_text()
    whole = re.sub(r"(?m)^\S+ =    #.*\n", "", uncommented(text))      # keys without a value, as radii_mm
    alone = re.sub(r"(?m)^inherits = .*\n", "", whole)
    assert shelf.load(kind, write(here, alone)).model_dump(exclude={"name", "description"}) == parent
    for key in keys(kind).values():
        assert re.search(rf"(?m)[\s.\[]{re.escape(key.path[-1])}( =|\])", text), key.dotted


def test_a_starter_without_a_parent_asks_for_every_required_key(here, capsys):
    for kind in KINDS:
        text = starter(kind, "my-own")
        wanted = [key.path[-1] for key in keys(kind).values() if key.required and not key.table]
        assert sorted(re.findall(r"(?m)^# (\w+) =    # REQUIRED", text)) == sorted(wanted)
    assert run(capsys, "new", "my-own")[0] == 0
    code, _, err = run(capsys, "check", "my-own.toml", "--kind", "printer")
    assert code == 3
    assert "cables.diameter_mm: missing" in err
    assert "platform.mass_kg: missing" in err


def test_a_filled_starter_is_a_right_profile(here):
    """Every REQUIRED key filled in from a shipped printer, the other seven cables added."""
    shown = show("printers", "cabfab-init").values
    first, *others = shown["cable"]
    lines, table, absent = [], {"source": "me"}, None
    for line in starter("printers", "my-own").splitlines():
        if header := re.match(r"(# )?\[+([\w.]+)\]", line):
            absent, name = header[1], header[2]
            table = first if name == "cable" else within(shown, name) | within(first, name[7:])
        key = None if absent else re.match(r"# (\w+) = +# REQUIRED", line)
        lines.append(f"{key[1]} = {literal(table[key[1]])}" if key else line)
    text = "\n".join(lines + [dump({"cable": [cable]}) for cable in others])
    printer, model = shelf.load_printer(write(here, text)), shelf.load_printer("cabfab-init")
    assert printer.platform == model.platform
    # what is left is what may be left out: pulleys of radius 0, no damping
    left = [one for one in differences(printer, model) if one.key.startswith("cable")]
    assert "cables.pulley.groove_radius_mm" in [one.key for one in left]
    required = {key.dotted for key in keys("printers").values() if key.required}
    assert not {one.key.replace("cables", "cable") for one in left} & required - {"cable.damping.damping_n_s",
                                                                                "cable.damping.frequency_hz"}
    printer = shelf.load_printer(here / "mine.toml", [f"{one.key}={literal(one.second)}" for one in left])
    assert printer.cable == model.cable


def within(values, dotted):
    for part in filter(None, dotted.split(".")):
        values = values.get(part, {})
    return values


def test_new_refuses_to_overwrite_and_odd_names(here, capsys):
    assert run(capsys, "new", "my-own", "--from", "pla")[1].startswith("wrote my-own.toml; next: edit it")
    before = (here / "my-own.toml").read_text()
    code, _, err = run(capsys, "new", "my-own", "--from", "petg")
    assert code == 5
    assert "--overwrite" in err
    assert (here / "my-own.toml").read_text() == before
    assert run(capsys, "new", "my-own", "--from", "petg", "--overwrite")[0] == 0
    assert 'inherits = "petg"' in (here / "my-own.toml").read_text()
    assert run(capsys, "new", "My Own")[0] == 2
    assert run(capsys, "new", "my-own", "--from", "nobody", "--overwrite")[0] == 3
    assert run(capsys, "new", "my-own", "-o", "none/x.toml")[0] == 5
    assert sorted(path.name for path in here.iterdir()) == ["my-own.toml"]


def test_new_writes_where_it_is_told(here, capsysbinary):
    (here / "shop").mkdir()
    assert main(["profile", "new", "my-own", "--from", "pla", "-o", "shop/"]) == 0
    assert main(["profile", "new", "mine-too", "--from", "shop/my-own.toml", "--kind", "material"]) == 0
    assert 'inherits = "shop/my-own.toml"' in (here / "mine-too.toml").read_text()
    assert main(["profile", "new", "deeper", "--from", "mine-too.toml", "-o", "shop"]) == 0
    assert shelf.load_material("shop/deeper.toml").density_g_cm3 == shelf.load_material("pla").density_g_cm3
    capsysbinary.readouterr()
    assert main(["profile", "new", "my-own", "--from", "pla", "-o", "-"]) == 0
    assert capsysbinary.readouterr().out == (here / "shop/my-own.toml").read_bytes()


def test_use_sets_the_default_printer(here, capsys):
    assert run(capsys, "use", "cabfab-optm")[0] == 3
    assert shelf.default_printer() is None
    assert run(capsys, "use", "cabfab-optim")[0] == 0
    assert shelf.default_printer() == "cabfab-optim"
    write(here, printer_toml())
    assert run(capsys, "use", "mine.toml")[0] == 0
    assert shelf.load_printer(shelf.default_printer()).name == "mine"
    assert answer(capsys, "list", "printer")[1]["default_printer"] == str((here / "mine.toml").resolve())


def test_listing_profiles_needs_neither_numpy_nor_pydantic(here):
    code = ("import sys\nfrom cabslice.cli.main import main\nassert main(['profile', 'list', '-q']) == 0\n"
            "assert not {'numpy', 'pydantic'} & set(sys.modules)")
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
