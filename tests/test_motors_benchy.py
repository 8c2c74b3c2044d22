"""Acceptance 3 on a real part: every format of benchy's motor file leads back to the planned nozzle."""

import importlib.util

import pytest
from cli_cases import MODELS
from test_motors_tables import promised

from cabslice import pipeline
from cabslice.motors import formats
from cabslice.motors.check import verify_stream
from cabslice.motors.machine import robot_of

EXACT = ("stream", "csv", "twincat-fifo", "twincat-csv", "halstreamer", "parquet")
NAMES = [name for name in formats.FORMATS if name != "parquet" or importlib.util.find_spec("pyarrow")]


@pytest.mark.slow
@pytest.mark.skipif(not (MODELS / "benchy.stl").is_file(), reason="needs ../shared/models/benchy.stl")
def test_every_format_of_benchy_holds_the_nozzle(tmp_path):
    """At 2 ms: file, sidecar and the profile in its header alone; 1 um where nothing is quantised, else as stated."""
    sets = ("layer_mm=0.4", "first_layer_mm=0.4")
    profiles = pipeline.load_profiles("cabfab-optim-measured", None, None, sets)
    plan, verdict = pipeline.to_plan(pipeline.read(MODELS / "benchy.stl", profiles, pipeline.Placement(scale=0.5)))
    stream = pipeline.to_stream(plan, verdict, period_s=0.002)
    whole = tmp_path / "a.stream"
    pipeline.save_stream(stream, whole, "stream")
    for name in NAMES:
        path = tmp_path / f"b{formats.FORMATS[name].suffix}"
        pipeline.save_stream(formats.read(whole), path, name)
        found = formats.FORMATS[name].read(path)
        bound = promised(name, path, found)
        assert name not in EXACT or bound < 1e-3
        checked = verify_stream(found, robot_of(found.header), plan.trajectory, every=97, limit_mm=1.0)
        print(f"{name}: {1e3 * checked.margins['nozzle_error_mm']:.3f} um, bound {1e3 * bound:.3f} um")
        assert checked.ok
        assert checked.margins["nozzle_error_mm"] <= max(bound, 1e-3), name
        for file in formats.FORMATS[name].files(path):
            file.unlink()
