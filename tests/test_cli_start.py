"""Starting, taking up and slowing a print at the command line."""

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

from cabslice.motors import formats


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planned")
    part, plan = write_box(folder / "box.stl"), folder / "box.plan"
    assert run("plan", part, *PRINTER, *SETS, "-o", plan, "-q") == 0
    return plan


def exported(planned, path, capsys, *words):
    code, told = answered(capsys, "export", planned, "-o", path, *words)
    assert code == 0, told
    return formats.read(path)


def test_the_motor_file_begins_and_ends_at_home(planned, tmp_path, capsys):
    stream = exported(planned, tmp_path / "a.stream", capsys)
    header, blocks = stream.header, list(stream)
    assert header["start_pose"] == header["machine"]["home"]["pose"]
    assert blocks[-1].angle[-1] == pytest.approx(header["end_angles_rad"], abs=1e-7)
    tensioned = np.concatenate([block.angle for block in blocks])[header["lead_rows"]]
    np.testing.assert_allclose(blocks[-1].angle[-1], tensioned, atol=1e-7)
    code, told = answered(capsys, "start", tmp_path / "a.stream")
    assert code == 0
    assert told["start"]["zero_angles_rad"] == header["machine"]["home"]["angles_rad"]
    assert told["events_before"]["nozzle_c"] > 150
    assert set(told["drive_reaction"]) == {"underrun", "slack_cable", "speed_override"}


@pytest.mark.parametrize("name", ["stream", "csp", "csv"])
def test_where_a_machine_stands_that_stopped(name, planned, tmp_path, capsys):
    path = tmp_path / "a.file"
    stream = exported(planned, path, capsys, "--format", name)
    layers = stream.header["layers"]
    at = (layers["whole_at_s"][2] + layers["whole_at_s"][3]) / 2
    code, told = answered(capsys, "start", path, "--at", at)
    assert code == 0
    state = told["state"]
    assert (state["whole_layer"], state["from_layer"]) == (layers["layer"][2], layers["layer"][3])
    angle = np.concatenate([block.angle for block in stream])[round(at / stream.period_s)]
    assert state["angles_rad"] == pytest.approx(angle)
    for row, value in zip(state["winders"], angle, strict=True):
        assert row["turn"] == np.floor(value / (2 * np.pi))
    assert run("start", path, "--at", at) == 0
    said = capsys.readouterr().out
    assert f"go on with --from-layer {layers['layer'][3]}" in said
    assert "power loss" in said
    assert answered(capsys, "start", path, "--at", 1e6)[1]["state"]["from_layer"] is None


def test_a_print_taken_up_feeds_the_rest_alone(planned, tmp_path, capsys):
    whole = exported(planned, tmp_path / "a.stream", capsys)
    rest = exported(planned, tmp_path / "b.stream", capsys, "--from-layer", 3)
    assert rest.header["from_layer"] == 3
    assert rest.header["layers"]["layer"] == whole.header["layers"]["layer"][3:]
    assert rest.header["layers"]["z_mm"] == whole.header["layers"]["z_mm"][3:]
    fed = np.concatenate([block.filament for block in whole])
    after = fed[-1] - fed[round(whole.header["layers"]["whole_at_s"][2] / whole.period_s)]
    assert list(rest)[-1].filament[-1] == pytest.approx(after, abs=0.85), "but for a retraction between the layers"
    assert {kind for t, kind in zip(rest.header["events"]["t_s"], rest.header["events"]["kind"], strict=True) if not t
            } == {"nozzle_c", "bed_c", "fan"}
    code, told = answered(capsys, "export", planned, "-o", tmp_path / "c.stream", "--from-layer", 99)
    assert code == 2
    assert "There is no layer 99" in told["error"]["sentence"]


def test_a_dry_run_at_half_the_speed(planned, tmp_path, capsys):
    whole = exported(planned, tmp_path / "a.stream", capsys)
    dry = exported(planned, tmp_path / "b.stream", capsys, "--no-extrude", "--speed", 50)
    assert dry.header["dry_run"]
    assert dry.header["speed_percent"] == 50
    assert not any(block.filament.any() for block in dry)
    lead = whole.header["lead_rows"]
    assert dry.rows - lead == pytest.approx(2 * (whole.rows - lead), abs=2)
    assert not set(dry.header["events"]["kind"]) & {"nozzle_c", "bed_c", "fan", "retract", "prime"}


def test_faster_than_planned_is_audited_and_refused(planned, tmp_path, capsys):
    code, told = answered(capsys, "export", planned, "-o", tmp_path / "a.stream", "--speed", 120)
    assert code == 4
    assert "120 % of its speed" in told["error"]["findings"][0]["help"]
    assert not list(tmp_path.iterdir())


def test_start_wants_a_motor_file(planned, tmp_path, capsys):
    assert answered(capsys, "start", planned)[0] == 3
    assert answered(capsys, "start", tmp_path / "none.stream")[0] == 3


def test_a_killed_export_is_gone_on_with(planned, tmp_path, capsys, monkeypatch):
    """What is left is taken; with other words on the command line it is another job and begins anew."""
    from cabslice.files import Unfinished

    finish = Unfinished.finish
    exported(planned, tmp_path / "wanted.stream", capsys)
    with monkeypatch.context() as patched:
        patched.setattr(Unfinished, "finish", lambda work, parts: (_ for _ in ()).throw(KeyboardInterrupt))
        assert run("export", planned, "-o", tmp_path / "a.stream", "--resume", "-q") == 130
    assert {path.name for path in tmp_path.iterdir()} == {".a.stream.part", ".a.stream.journal", "wanted.stream"}
    steps = []
    monkeypatch.setattr(Unfinished, "step", lambda work, *given: steps.append(given))
    monkeypatch.setattr(Unfinished, "finish", finish)
    exported(planned, tmp_path / "a.stream", capsys, "--resume")
    assert not steps, "all rows were there"
    assert (tmp_path / "a.stream").read_bytes() == (tmp_path / "wanted.stream").read_bytes()
