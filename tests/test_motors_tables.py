"""What drives are given: every format holds the nozzle on the plan, from its files and the printer alone."""

import hashlib
import importlib.util
import json
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motors_fakes import Turn, sample_turn, smooth_stream, whole
from robots import cabfab_optim, hangprinter

from cabslice.errors import OutputError, UsageError
from cabslice.motors.check import verify_stream
from cabslice.motors.formats import FORMATS, hermite, table, twincat_csv
from cabslice.motors.formats.hermite_kernel import knots
from cabslice.motors.stream import MotorStream, make_stream

ARROW = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow")
EACH = pytest.mark.parametrize("name", [pytest.param(n, marks=ARROW) if n == "parquet" else n for n in FORMATS])
TABLES = pytest.mark.parametrize("name", ["twincat-fifo", "twincat-csv", "halstreamer", "csp", "odrive"])
READING = 1e-6      # mm: forward kinematics and integrated winders find the nozzle to this
TURN = Turn(2.0, turns=1, radius=80.0, rise=20.0)


def turning(robot, turn=TURN, **more):
    header = {"encoder_counts_per_turn": [1 << 20] * robot.cables}
    return make_stream(turn, robot, period_s=0.002, header=header, sample=sample_turn, **more)


def module(name):
    return FORMATS[name]._module()


def written(name, stream, folder):
    path = folder / f"a{FORMATS[name].suffix}"
    FORMATS[name].write(stream, path, overwrite=True)
    return path


def promised(name, path, stream):
    """The largest nozzle error a file may be read back with, mm."""
    if name == "hermite":
        return hermite.bounds(stream.header)["nozzle_read_mm"]
    side = path.with_name(path.name + ".json")
    return json.loads(side.read_bytes())["bounds"]["nozzle_read_mm"] if side.exists() else 0.0


# ---- the way back to the nozzle

@EACH
def test_the_file_alone_holds_the_nozzle_on_the_trajectory(name, tmp_path):
    """Acceptance 3: within 1 um where nothing is quantised, else within the stated bound, which is not far off."""
    robot, stream = cabfab_optim(), turning(cabfab_optim())
    path = written(name, stream, tmp_path)
    bound = promised(name, path, stream)
    assert bound < {"hermite": 0.1, "odrive": 0.02, "csp": 1e-3, "reprap": 0.05, "klipper": 0.05}.get(name, 1e-5)
    verdict = verify_stream(FORMATS[name].read(path), robot, TURN, sample=sample_turn, limit_mm=1.0)
    assert verdict.ok
    assert verdict.margins["nozzle_error_mm"] <= bound + (1e-4 if name in ("stream", "csv") else READING)
    if name in ("csp", "odrive", "hermite", "reprap", "klipper"):
        assert verdict.margins["nozzle_error_mm"] > bound / 40


@TABLES
@given(rows=st.integers(2, 40), cables=st.integers(1, 8), seed=st.integers(0, 99), friction=st.sampled_from([0, 150]))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_columns_come_back_within_what_rounding_costs(name, tmp_path, rows, cables, seed, friction):
    """Columns that are not in the file follow from those that are; also over the borders of blocks."""
    rows = rows + 8180 if seed % 7 == 0 else rows
    stream = smooth_stream(rows, cables=cables, seed=seed, friction=friction)
    found, wanted = whole(FORMATS[name].read(written(name, stream, tmp_path))), whole(stream)
    misses = module(name).misses(stream.header)
    angle = float(np.max(misses["angle"]))
    torque = float(np.max(misses["torque"]))
    speed = min(2, max(np.max(misses.get("velocity", 0)), angle / 0.002) / 1e-3)
    bounds = {"angle": angle, "velocity": max(np.max(misses.get("velocity", 0)), angle / 0.002), "torque": torque,
              "tension": (torque + 440e-3 * 4 * angle / 0.002**2 + friction * speed) / 62.6,
              "filament": 1e-3, "feed": 1.0 if name == "odrive" else 1e-2}
    for column, bound in bounds.items():
        size = np.abs(getattr(wanted, column)).max()
        miss = np.abs(getattr(found, column) - getattr(wanted, column)).max()
        assert miss <= bound * (1 + 1e-9) + 1e-9 * size, column


@given(rows=st.integers(2, 400), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_cubic_pieces_pass_every_row_within_the_tolerance(tmp_path, rows, seed):
    rows = rows + 8000 if seed % 5 == 0 else rows
    stream = smooth_stream(rows, cables=3, seed=seed)
    found, wanted = whole(FORMATS["hermite"].read(written("hermite", stream, tmp_path))), whole(stream)
    for column, tolerance in hermite.tolerances(stream.header).items():
        miss = np.abs(getattr(found, column) - getattr(wanted, column))
        assert miss.max() <= tolerance * (1 + 1e-9), column
    bounds = hermite.bounds(stream.header)
    assert np.abs(found.velocity - wanted.velocity).max() <= bounds["motor_speed_rad_s"] * (1 + 1e-9)
    assert np.abs(found.torque - wanted.torque).max() <= bounds["torque_n_mm"]


@given(seed=st.integers(0, 999), rows=st.integers(2, 120))
@settings(deadline=None)
def test_no_piece_could_reach_the_next_knot_but_one(seed, rows):
    """Cubics come back as one piece; kinks cost a knot each, and a piece is not cut short for nothing."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows, dtype=float)[:, None]
    cubic = np.polynomial.Polynomial(rng.normal(0, 1, 4) / np.maximum(rows, 2.0) ** np.arange(4))
    np.testing.assert_array_equal(knots(cubic(t), cubic.deriv()(t), np.array([1e-9])), [0, rows - 1])
    kinked = np.abs(t - rows // 2)
    slope = np.where(t < rows // 2, -1.0, 1.0)
    assert len(knots(kinked, slope, np.array([1e-9]))) <= 4


def test_pieces_are_ten_times_smaller_than_rows(tmp_path):
    """Of numbers of 8 bytes; a long smooth motion is a hundred times smaller."""
    stream = turning(cabfab_optim(), Turn(20.0, turns=2, radius=80.0))
    path = written("hermite", stream, tmp_path)
    assert stream.rows * 34 * 8 / path.stat().st_size > 50


def test_other_robots_have_other_numbers_of_axes(tmp_path):
    robot = hangprinter()
    turn = Turn(40.0, turns=1, radius=80.0, centre=(0.0, 0.0, 100.0))
    for name in ("twincat-fifo", "halstreamer", "csp"):
        stream = turning(robot, turn)
        verdict = verify_stream(FORMATS[name].read(written(name, stream, tmp_path)), robot, turn, sample=sample_turn)
        assert verdict.margins["nozzle_error_mm"] < 5e-3, name


# ---- what stands in the files, read by hand from the descriptions

def test_a_fifo_table_is_lreal_rows_by_axes(tmp_path):
    stream = smooth_stream(20, cables=3)
    path, rows = written("twincat-fifo", stream, tmp_path), whole(stream)
    table_ = np.fromfile(path, "<f8").reshape(20, 4)
    np.testing.assert_allclose(table_[:, :3], np.degrees(rows.angle), rtol=1e-15)
    np.testing.assert_array_equal(table_[:, 3], rows.filament)
    torque = np.fromfile(tmp_path / "a.torque.fifo", "<f8").reshape(20, 3)
    np.testing.assert_allclose(torque, rows.torque / 1e3, rtol=1e-15)


def test_a_sidecar_says_axes_hashes_and_the_first_row(tmp_path):
    robot = cabfab_optim()
    stream = turning(robot)
    path = written("csp", stream, tmp_path)
    side = json.loads((tmp_path / "a.csp.json").read_text())
    assert side["format"] == "csp"
    assert side["files"][0]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert side["header"] == dict(stream.header)
    counts = np.fromfile(path, "<i4").reshape(stream.rows, 34)
    for i, axis in enumerate(side["axes"][:8]):
        assert axis["per_rad"] == pytest.approx((1 << 20) / (2 * np.pi))
        assert counts[0, i] == round(axis["first"]), "the first row must equal the present position"
        assert counts[-1, i] == round(axis["last"])
    assert side["columns"][:3] == ["q1_counts", "q2_counts", "q3_counts"]
    assert len(side["columns"]) == counts.shape[1]
    rows = whole(stream)
    np.testing.assert_allclose(counts[:, 9:17], rows.velocity * (1 << 20) / (2 * np.pi), atol=0.5)
    np.testing.assert_allclose(counts[:, 18:26], rows.torque / 6000 * 1000, atol=0.5)
    np.testing.assert_allclose(counts[:, 26:], rows.tension * 1000, atol=0.5)


def test_plc_text_has_names_and_the_accelerations_of_the_angles(tmp_path):
    stream = smooth_stream(20, cables=2)
    lines = written("twincat-csv", stream, tmp_path).read_bytes().split(b"\r\n")
    assert lines[0].startswith(b"q1_deg,qd1_deg_s,qdd1_deg_s2,tau1_n_m,q2_deg")
    assert lines[-1] == b""
    values = np.array([[float(word) for word in line.split(b",")] for line in lines[1:-1]])
    angle = whole(stream).angle[:, 1]
    bend = np.diff(angle, 2) / 0.002**2
    np.testing.assert_allclose(values[1:-1, 6], np.degrees(bend), atol=1e-4)
    assert values.shape == (20, len(twincat_csv.columns(stream.header)))


def test_halstreamer_lines_are_what_its_pins_want(tmp_path):
    path = written("halstreamer", smooth_stream(20, cables=8), tmp_path)
    side = json.loads((tmp_path / "a.hal.json").read_text())
    lines = path.read_text().splitlines()
    assert side["cfg"] == "f" * 18
    assert {len(line.split()) for line in lines} == {18}
    assert len(lines) == 20
    path = written("halstreamer", smooth_stream(20, cables=4), tmp_path)
    assert len(path.read_text().splitlines()[0].split()) == 3 * 4 + 2, "there is room for velocities"
    with pytest.raises(UsageError, match="21 pins, 10 winders need 22"):
        written("halstreamer", smooth_stream(5, cables=10), tmp_path)


def test_odrive_records_are_payloads_of_set_input_pos(tmp_path):
    stream = smooth_stream(5, cables=2)
    data, rows = written("odrive", stream, tmp_path).read_bytes(), whole(stream)
    turns, speed, torque = struct.unpack_from("<fhh", data, 8 * (3 * 2 + 1))
    assert turns == pytest.approx(rows.angle[2, 1] / (2 * np.pi), rel=1e-7)
    assert speed == round(rows.velocity[2, 1] / (2 * np.pi) * 1000)
    assert torque == round(rows.torque[2, 1])
    assert struct.unpack_from("<fhh", data, 8 * (3 * 2 + 2))[0] == pytest.approx(rows.filament[2])


def test_pieces_can_be_evaluated_between_rows():
    knot, value, slope = np.array([0, 10, 30]), np.array([[0.0], [5.0], [5.0]]), np.array([[0.0], [1.0], [0.0]])
    found = hermite.evaluate(knot, value, slope, np.array([0.0, 2.5, 10.0, 20.0, 30.0]))[:, 0]
    np.testing.assert_allclose(found, [0, 0.78125 - 0.46875, 5, 5 + 2.5, 5], atol=1e-12)


# ---- what does not go

def test_counts_need_an_encoder(tmp_path):
    stream = smooth_stream(5)
    header = {key: value for key, value in stream.header.items() if key != "encoder_counts_per_turn"}
    with pytest.raises(UsageError, match="counts_per_turn"):
        written("csp", MotorStream(header, stream.blocks), tmp_path)
    assert not list(tmp_path.iterdir())


def test_numbers_that_do_not_fit_are_refused(tmp_path):
    stream = smooth_stream(5)
    header = {**stream.header, "encoder_counts_per_turn": [1 << 31] * 8}
    with pytest.raises(OutputError, match=r"target position in counts: .* too large"):
        written("csp", MotorStream(header, stream.blocks), tmp_path)
    assert not list(tmp_path.iterdir())


@TABLES
def test_more_than_one_file_does_not_fit_into_a_pipe(name):
    with pytest.raises(UsageError, match="more than one file"):
        FORMATS[name].write(smooth_stream(5), "-")


def test_files_that_exist_are_not_replaced_one_by_one(tmp_path):
    (tmp_path / "a.torque.fifo").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"a\.torque\.fifo exists"):
        FORMATS["twincat-fifo"].write(smooth_stream(5), tmp_path / "a.fifo")
    assert [path.name for path in tmp_path.iterdir()] == ["a.torque.fifo"]


def test_bounds_follow_from_the_machine():
    header = smooth_stream(5).header
    found = table.bounds(header, {"angle": np.full(8, 1e-6), "tension": 0.01})
    assert found["cable_mm"] == pytest.approx(62.6e-6)
    assert found["nozzle_mm"] == pytest.approx(4 * 62.6e-6)
    assert found["nozzle_read_mm"] == pytest.approx(4 * (62.6e-6 + 0.06 * 0.01))
