"""cabslice view, as a user calls it: every product has a page, and what cannot have one is told."""

import json
import re

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

from cabslice import pipeline, store
from cabslice.motors.formats import read
from cabslice.slicing.layer import Role
from cabslice.timing.trajectory import sample
from cabslice.view.packing import unpacked


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A part and everything that comes of it."""
    folder = tmp_path_factory.mktemp("made")
    part = write_box(folder / "box.stl")
    for name in ("box.layers", "box.path", "box.gcode"):
        assert run("slice", part, *PRINTER, *SETS, "-o", folder / name, "-q") == 0
    assert run("plan", folder / "box.path", "-o", folder / "box.plan", "-q") == 0
    assert run("export", folder / "box.plan", "-o", folder / "box.stream", "-q") == 0
    assert run("workspace", *PRINTER, "--step-mm", "125", "-o", folder / "space.npz", "-q") == 0
    assert run("workspace", *PRINTER, "--step-mm", "125", "-o", folder / "space.csv", "-q") == 0
    return folder


def seen(folder, name, capsys, *words):
    """What is in the page that view makes of a file."""
    page = folder / "page.html"
    code, said = answered(capsys, "view", folder / name, "-o", page, "--overwrite", *words)
    assert code == 0, said
    assert said["numbers"]["bytes"] == page.stat().st_size
    return json.loads(re.search(r'id="data">(.*?)</script>', page.read_text(), re.S)[1])


def places(packed):
    return np.stack([unpacked(column) for column in packed], axis=1)


def fields(found):
    return {row["key"]: unpacked(row["values"]) for row in found["moves"]["fields"]}


def test_a_path_has_its_moves(made, capsys):
    path = store.load(made / "box.path")[1].toolpath
    for name in ("box.path", "box.gcode"):
        found = seen(made, name, capsys, *PRINTER)
        assert found["machine"]["name"] == "cabfab-optim"
        laid = path.role != Role.TRAVEL
        shown = places(found["moves"]["xyz"])
        role = unpacked(found["moves"]["role"])
        np.testing.assert_allclose(np.linalg.norm(np.diff(shown, axis=0), axis=1)[role[1:] > 0].sum(),
                                   path.lengths[laid].sum(), rtol=2e-3)
        assert found["moves"]["heights"] == [[k, pytest.approx(0.3 * (k + 1))] for k in range(5)]
        flow = fields(found)["flow_mm3_s"]
        spent = np.diff(unpacked(found["moves"]["time"]), prepend=0.0)
        volume = path.filament[laid].sum() * path.filament_area_mm2
        assert (flow * spent)[role > 0].sum() == pytest.approx(volume, rel=0.02)


def test_a_checked_path_tells_the_air_between_cables_and_part(made, capsys):
    found = seen(made, "box.path", capsys, "--check")
    verdict = answered(capsys, "check", made / "box.path")[1]["verdict"]
    assert fields(found)["clearance_mm"].min() >= verdict["margins"]["cable_part_mm"]
    assert not found["findings"]


def test_the_beads_of_layers_are_all_there(made, capsys):
    found = seen(made, "box.layers", capsys)
    path = store.load(made / "box.path")[1].toolpath
    shown, role = places(found["moves"]["xyz"]), unpacked(found["moves"]["role"])
    length = np.linalg.norm(np.diff(shown, axis=0), axis=1)[role[1:] > 0].sum()
    assert length == pytest.approx(path.lengths[path.role != Role.TRAVEL].sum(), rel=0.02)


def test_a_plan_shows_what_inspect_says(made, capsys):
    found = seen(made, "box.plan", capsys)
    shown = fields(found)
    said = answered(capsys, "inspect", made / "box.plan")[1]["numbers"]
    assert shown["speed_mm_s"].max() == pytest.approx(said["peak_nozzle_speed_mm_s"], rel=1e-3)
    assert shown["acceleration_mm_s2"].max() == pytest.approx(said["peak_nozzle_acceleration_mm_s2"], rel=2e-2)
    stream = read(made / "box.stream")
    rows = [block.tension[max(0, stream.header["lead_rows"] - block.row):] for block in stream]     # of the motion
    # the file holds what stretches the cables (without their damping), for the acceleration that its rows can say
    assert shown["max_tension_n"].max() == pytest.approx(np.concatenate(rows).max(), rel=1e-2)
    assert shown["min_tension_n"][1:].min() == pytest.approx(np.concatenate(rows).min(), rel=1e-2)
    plan = store.load(made / "box.plan")[1]
    assert unpacked(found["moves"]["time"])[-1] == pytest.approx(plan.trajectory.duration, abs=0.02)
    assert shown["motor_rad_s"].max() == pytest.approx(max(said["peak_motor_speed_rad_s"]), rel=1e-2)


def test_the_time_of_a_move_is_when_the_motion_is_there(made, capsys):
    found, plan = seen(made, "box.plan", capsys), store.load(made / "box.plan")[1]
    time, shown = unpacked(found["moves"]["time"]), places(found["moves"]["xyz"])
    nozzle = sample(plan.trajectory, time).poses[:, :3] - plan.trajectory.to_pose
    corner = pipeline.profiles_of(plan.origin).process.corner_mm
    assert np.linalg.norm(nozzle - shown, axis=1).max() < corner + 0.2


def test_a_motor_file_played_back_goes_the_same_way(made, capsys):
    found, plan = seen(made, "box.stream", capsys), seen(made, "box.plan", capsys)
    shown, wanted = places(found["moves"]["xyz"]), places(plan["moves"]["xyz"])
    np.testing.assert_allclose(shown.min(0), wanted.min(0), atol=0.1)
    np.testing.assert_allclose(shown.max(0), wanted.max(0), atol=0.1)
    assert [row[0] for row in found["moves"]["heights"]] == list(range(5))
    said = answered(capsys, "inspect", made / "box.stream")[1]["numbers"]
    played = fields(found)
    assert played["max_tension_n"].max() == pytest.approx(max(said["max_tension_n"]), rel=2e-3)
    assert played["motor_rad_s"].max() == pytest.approx(max(said["peak_motor_speed_rad_s"]), rel=1e-3)


def test_parts_and_workspaces(made, capsys):
    part = seen(made, "box.stl", capsys)
    assert part["mesh"]["faces"]["n"] == 36
    assert part["machine"] is None
    spaces = [seen(made, name, capsys) for name in ("space.npz", "space.csv")]
    assert spaces[0]["machine"]["name"] == "cabfab-optim"
    assert spaces[0]["cells"]["centres"] == spaces[1]["cells"]["centres"]
    centres = places(spaces[0]["cells"]["centres"])
    assert len(centres) == answered(capsys, "workspace", *PRINTER, "--step-mm", "125")[1]["numbers"]["nodes_inside"]


def test_findings_come_from_check_and_from_a_refusal(made, capsys, tmp_path):
    code, verdict = answered(capsys, "check", made / "box.stl", *PRINTER, *SETS, "--at", "900 0")
    assert code == 4
    (tmp_path / "v.json").write_text(json.dumps(verdict))
    told = verdict["verdict"]["findings"]
    (tmp_path / "box.path").write_bytes((made / "box.path").read_bytes())
    for name, words in (("v.json", ()), ("box.path", ("--verdict", tmp_path / "v.json"))):
        found = seen(tmp_path, name, capsys, *words)
        assert [row["sentence"] for row in found["findings"]] == [row["sentence"] for row in told]
    assert len(told) > 0
    assert found["moves"] is not None


@pytest.mark.parametrize(("name", "content", "words", "code", "said"), [
    ("none.plan", None, (), 3, "no such file"), ("x.json", "[]", (), 3, "expected what `cabslice check --json` prints"),
    ("x.json", "{", (), 3, "is not JSON"), ("x.npz", "not", (), 3, "workspace -o"), ("x.stl", "solid", (), 3, "x.stl"),
    ("x.json", '{"verdict": {"findings": [{"code": 1}]}}', (), 3, "a finding is not one"),
])
def test_what_has_no_page_is_told(tmp_path, monkeypatch, capsys, name, content, words, code, said):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / name).write_text(content)
    assert run("view", name, *words) == code
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err
    assert not list(tmp_path.glob("*.html"))


def test_an_existing_page_is_not_replaced_unasked(made, capsys):
    seen(made, "box.stl", capsys)
    assert run("view", made / "box.stl", "-o", made / "page.html") == 5
    assert "--overwrite" in capsys.readouterr().err
