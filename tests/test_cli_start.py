"""Starting, taking up and slowing a print at the command line."""

import numpy as np
import pytest
from cli_cases import PRINTER, answered, planned_box, run

from cabslice.motors import formats
from cabslice.motors.machine import robot_of
from cabslice.robot.forward import forward
from cabslice.robot.winder import pulley_lengths_of


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    return planned_box(tmp_path_factory.mktemp("planned"))


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
    np.testing.assert_allclose(blocks[-1].angle[-1], tensioned, atol=5e-5)     # 3 um of cable: the start of the motion
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


# ---- motions that try a machine

def test_a_jog_turns_one_motor_and_brings_it_back(tmp_path, capsys):
    words = ["start", "jog", *PRINTER, "--cable", 3, "--turn-deg", 45, "--seconds", 2, "-o", tmp_path / "jog.csv"]
    assert answered(capsys, *words)[0] == 0
    stream = formats.read(tmp_path / "jog.csv")
    rows = np.concatenate([block.angle for block in stream])
    home = np.array(stream.header["machine"]["home"]["angles_rad"])
    np.testing.assert_allclose(rows[:, [0, 1, 3, 4, 5, 6, 7]], np.tile(home[[0, 1, 3, 4, 5, 6, 7]], (len(rows), 1)))
    np.testing.assert_allclose(rows[[0, 500, -1], 2] - home[2], [0, np.radians(45), 0], atol=1e-8)
    moving = np.concatenate([block.velocity for block in stream])
    np.testing.assert_allclose(moving[1:-1, 2], (rows[2:, 2] - rows[:-2, 2]) / 0.004, atol=1e-5)
    assert not moving[[0, -1]].any()
    assert not np.concatenate([block.tension for block in stream]).any()
    assert run("start", tmp_path / "jog.csv") == 0
    for wrong, code in ((["--cable", 9], 2), (["--seconds", 0.5, "--turn-deg", 3000], 4), (["--turn-deg", 3600], 4)):
        assert answered(capsys, *words[:4], "--cable", 3, *wrong, "-o", tmp_path / "no.csv")[0] == code
        assert not (tmp_path / "no.csv").exists()


def test_the_tension_trial_holds_still_at_the_reference(tmp_path, capsys):
    code, told = answered(capsys, "start", "tension", *PRINTER, "--seconds", 1, "-o", tmp_path / "t.stream")
    assert code == 0
    stream = formats.read(tmp_path / "t.stream")
    blocks = list(stream)
    tension = np.concatenate([block.tension for block in blocks])
    lead = stream.header["lead_rows"]
    assert (tension[0] < tension[lead]).all()
    np.testing.assert_allclose(tension[lead:], np.tile(tension[lead], (len(tension) - lead, 1)), atol=1e-3)
    assert told["numbers"]["rows"] == lead + 501
    assert robot_of(stream.header).cables == 8


def test_the_nozzle_goes_round_a_circle_and_home(tmp_path, capsys):
    words = ["start", "circle", *PRINTER, "--radius", 40, "--height", 60, "-o", tmp_path / "c.stream"]
    code, told = answered(capsys, *words)
    assert code == 0, told
    stream = formats.read(tmp_path / "c.stream")
    robot = robot_of(stream.header)
    angle, tension = (np.concatenate([getattr(block, name) for block in stream])[stream.header["lead_rows"]::25]
                      for name in ("angle", "tension"))
    poses = forward(robot, pulley_lengths_of(robot, angle, tension), np.array(stream.header["start_pose"])).poses
    nozzle = poses[:, :3] + robot.nozzle - robot.bed_origin
    low = nozzle[np.abs(nozzle[:, 2] - 60) < 1e-3]
    away = np.hypot(low[:, 0], low[:, 1])
    on = np.abs(away - 40) < 0.05
    assert on.sum() > 100
    assert np.ptp(np.arctan2(low[on, 1], low[on, 0])) > 6
    np.testing.assert_allclose(poses[0], robot.home, atol=1e-3)
    np.testing.assert_allclose(stream.header["end_angles_rad"], angle[0], atol=5e-5)
    code, told = answered(capsys, *words[:4], "--radius", 300, "-o", tmp_path / "d.stream")
    assert code == 4
    assert "leaves the bed plate" in told["error"]["findings"][0]["sentence"]


def test_start_says_how_the_bed_lies(planned, tmp_path, capsys):
    run("start", "tension", *PRINTER, "-s", "bed.first_layer_offset_mm=-0.05", "-s", "bed.slope_mm_m=[1, -2]",
        "--seconds", 0.1, "-o", tmp_path / "t.stream", "-q")
    capsys.readouterr()
    assert run("start", tmp_path / "t.stream") == 0
    assert "(first layer offset -0.05 mm), rises 1 and -2 mm/m towards x and y" in capsys.readouterr().out
