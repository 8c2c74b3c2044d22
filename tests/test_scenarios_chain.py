"""From a part to a motor file: by one command or by many, today or again, always the same bytes."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import COARSE, MODELS, PRINTER, SETS, answered, run, write_box

import cabslice
from cabslice import pipeline, store
from cabslice.errors import ImpossibleError
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.motors.formats import binary

PERIOD = ["--period-ms", "5"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One box through the chain in one command, and through it stage by stage."""
    folder = tmp_path_factory.mktemp("chain")
    box = write_box(folder / "box.stl")
    assert run("export", box, *PRINTER, *SETS, *PERIOD, "-o", folder / "direct.stream") == 0
    assert run("slice", box, *PRINTER, *SETS, "-o", folder / "box.layers") == 0
    assert run("slice", folder / "box.layers", "-o", folder / "box.path") == 0
    assert run("plan", folder / "box.path", "-o", folder / "box.plan") == 0
    return folder


@pytest.mark.parametrize("kind", ["layers", "path", "plan"])
def test_export_of_any_earlier_product_gives_the_bytes_of_the_direct_way(made, tmp_path, kind):
    assert run("export", made / f"box.{kind}", *PERIOD, "-o", tmp_path / "late.stream") == 0
    assert (tmp_path / "late.stream").read_bytes() == (made / "direct.stream").read_bytes()


def test_the_same_command_in_another_process_and_with_other_threads_gives_the_same_bytes(made, tmp_path):
    words = ["export", "box.stl", *PRINTER, *SETS, *PERIOD, "-o", str(tmp_path / "again.stream"), "-j", "3"]
    here = {**os.environ, "PYTHONPATH": str(Path(cabslice.__file__).parents[1])}
    subprocess.run([sys.executable, "-m", "cabslice", *words], cwd=made, env=here, check=True, capture_output=True)
    assert (tmp_path / "again.stream").read_bytes() == (made / "direct.stream").read_bytes()
    for kind, source in (("layers", "box.stl"), ("path", "box.stl"), ("plan", "box.stl")):
        machine = [*PRINTER, *SETS] if source.endswith(".stl") else []
        command = "plan" if kind == "plan" else "slice"
        assert run(command, made / source, *machine, "-o", tmp_path / f"again.{kind}") == 0
        assert (tmp_path / f"again.{kind}").read_bytes() == (made / f"box.{kind}").read_bytes()


def test_the_motor_file_names_part_and_profiles_by_hash_and_nothing_of_this_machine(made):
    header = dict(binary.read(made / "direct.stream").header)
    assert header["part"] == {"name": "box.stl", "sha256": hashlib.sha256((made / "box.stl").read_bytes()).hexdigest()}
    assert {kind: len(row["sha256"]) for kind, row in header["profiles"].items()} == dict.fromkeys(
        ("printer", "material", "process"), 64
    )
    assert header["verdict"]["ok"] is True
    assert str(made) not in json.dumps(header)


def test_one_changed_setting_changes_its_hash_alone(made, capsys):
    words = ["slice", made / "box.stl", *PRINTER, *SETS]
    _, one = answered(capsys, *words, "-o", made / "one.path")
    _, two = answered(capsys, *words, "-s", "walls=2", "-o", made / "two.path")
    assert one["profiles"]["process"]["sha256"] != two["profiles"]["process"]["sha256"]
    assert one["profiles"]["printer"] == two["profiles"]["printer"]


def test_a_product_keeps_its_process_but_a_path_may_go_to_another_printer(made, tmp_path, capsys):
    late = ["-o", tmp_path / "late.plan"]
    assert run("plan", made / "box.path", *PRINTER, *late) == 0
    assert (tmp_path / "late.plan").read_bytes() == (made / "box.plan").read_bytes()
    assert run("plan", made / "box.path", "-s", "walls=3", *late, "--overwrite") == 2
    assert "has its own process" in capsys.readouterr().err
    assert run("plan", made / "box.path", "--scale", "2", *late, "--overwrite") == 2
    code, said = answered(capsys, "plan", made / "box.path", "-s", "motion.max_speed_mm_s=15", *late, "--overwrite")
    assert (code, said["numbers"]["peak_nozzle_speed_mm_s"]) == (0, pytest.approx(15, rel=0.02))
    assert run("export", made / "box.plan", "-s", "motion.max_speed_mm_s=15", "-o", tmp_path / "late.stream") == 2
    assert "has its own printer" in capsys.readouterr().err


def test_turn_scale_unit_and_place_are_those_of_the_part(tmp_path, capsys):
    box = write_box(tmp_path / "box.stl")
    placed = ["--turn", "0 0 90", "--at", "20 -10", "--scale", "0.1", "--unit", "cm"]
    _, said = answered(capsys, "inspect", box, *placed)
    assert said["numbers"]["low_mm"] == pytest.approx([17.5, -13.0, 0.0])
    assert said["numbers"]["high_mm"] == pytest.approx([22.5, -7.0, 1.5])
    assert run("slice", box, *PRINTER, *SETS, *placed, "-o", tmp_path / "box.path") == 0
    toolpath = store.load(tmp_path / "box.path")[1].toolpath
    laid = toolpath.xyz[toolpath.filament > 0]
    assert np.all(laid.min(0) >= [17.5, -13.0, 0.0])
    assert np.all(laid.max(0) <= [22.5, -7.0, 1.5 + 1e-9])


def test_the_rows_of_the_stream_are_the_plan_at_the_period(made):
    """Time and filament come through unchanged, after the rows in which the cables are tensioned."""
    plan, stream = store.load(made / "box.plan")[1], binary.read(made / "direct.stream")
    tensioning = pipeline.profiles_of(plan.origin).printer.start.tensioning_s
    assert stream.header["lead_rows"] == round(tensioning / 0.005)
    assert stream.header["duration_s"] == pytest.approx(plan.trajectory.duration + tensioning, abs=1e-9)
    assert stream.rows == int(np.ceil((plan.trajectory.duration + tensioning) / 0.005 - 1e-9)) + 1
    fed = np.concatenate([block.filament for block in stream])
    assert fed[-1] == pytest.approx(plan.toolpath.filament.sum(), abs=1e-3)


def test_no_stream_without_a_verdict_that_let_it_through(made):
    plan, verdict = pipeline.to_plan(store.load(made / "box.plan")[1])
    assert verdict.ok
    assert len(verdict.checked) >= 2
    refused = Verdict(verdict.checked, (Finding("tension", 0, (0.0, 0.0, 0.0), 1, 0.0, 1.0, "N", "Cable 1 is slack."),))
    with pytest.raises(ImpossibleError) as error:
        pipeline.to_stream(plan, refused, period_s=0.005)
    assert error.value.findings == refused.findings


def test_a_plan_that_breaks_a_limit_is_found_out_at_export(made, tmp_path, capsys):
    """A plan made for a stronger printer and relabelled: the audit of what is read sees it, whoever made it."""
    plan = store.load(made / "box.plan")[1]
    weaker = pipeline.load_profiles("cabfab-optim", None, None, ["motion.max_speed_mm_s=15"]).printer
    relabelled = replace(plan.origin, printer=weaker.model_dump_json(by_alias=True))
    store.save(replace(plan, origin=relabelled), tmp_path / "fast.plan")
    code, said = answered(capsys, "export", tmp_path / "fast.plan", "-o", tmp_path / "fast.stream")
    assert (code, said["ok"]) == (4, False)
    assert "15" in said["error"]["findings"][0]["sentence"]
    assert not (tmp_path / "fast.stream").exists()


@pytest.mark.slow
@pytest.mark.parametrize("part", ["xyz_cube.stl", "counter.stl", "benchy.stl"])
def test_real_parts_become_motor_files(part, tmp_path):
    if not (MODELS / part).exists():
        pytest.skip(f"{part} is not here")
    words = ["export", str(MODELS / part), *PRINTER, "-o"]
    for name in ("one.stream", "two.stream"):
        command = [sys.executable, "-m", "cabslice", *words, str(tmp_path / name)]
        subprocess.run(command, check=True, capture_output=True)
    assert (tmp_path / "one.stream").read_bytes() == (tmp_path / "two.stream").read_bytes()


def test_coarse_settings_are_what_the_path_says(made):
    profiles = pipeline.profiles_of(store.load(made / "box.path")[1].origin)
    models = profiles.process, profiles.material
    said = {key: str(next(getattr(one, key) for one in models if hasattr(one, key)))
            for key, _ in (row.split("=") for row in COARSE)}
    assert {key: float(value) for key, value in said.items()} == {
        key: float(value) for key, value in (row.split("=") for row in COARSE)
    }
