"""Rows for the drives: equilibrium, consistency of the columns, the way back to the nozzle, the limits."""

import dataclasses
import itertools
import json
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motors_fakes import Turn, noisy_stream, sample_turn, smooth_stream, whole
from robots import cabfab_optim, hangprinter
from scipy.integrate import quad
from scipy.optimize import linprog

from cabslice.errors import ImpossibleError, UsageError
from cabslice.motors.check import played_lengths, verify_stream, wound_since_home
from cabslice.motors.limits import nozzle_xyz
from cabslice.motors.machine import CREEP
from cabslice.motors.statistics import layers_used, statistics
from cabslice.motors.stream import MotorStream, cut, make_stream, rechunk, row_count
from cabslice.robot import kinematics, winder, wrench
from cabslice.robot.model import NEWTON

PERIOD = 0.002
TURN = Turn(3.0, turns=1.5, radius=80.0, rise=25.0)      # 380 mm/s at its fastest, through layer changes
ROBOT = cabfab_optim()
FRICTION = dataclasses.replace(ROBOT, winders=dataclasses.replace(ROBOT.winders, friction=np.full(8, 150.0)))


def stream_of(turn=TURN, robot=ROBOT, *, period_s=PERIOD, **more):
    return make_stream(turn, robot, period_s=period_s, header={"part": {"name": "turn"}}, sample=sample_turn, **more)


def with_winders(**columns):
    return dataclasses.replace(ROBOT, winders=dataclasses.replace(ROBOT.winders, **columns))


@pytest.fixture(scope="module")
def stream():
    return stream_of()


@pytest.fixture(scope="module")
def rows(stream):
    return whole(stream)


def times(stream, turn=TURN):
    return np.minimum(np.arange(stream.rows) * stream.period_s, turn.duration)


# ---- what the rows say

@pytest.mark.parametrize(("duration", "period", "count"), [(1.0, 0.5, 3), (1.1, 0.5, 4), (0.3, 0.1, 4), (0.0, 0.1, 2)])
def test_the_last_row_is_the_first_at_or_after_the_end(duration, period, count):
    assert row_count(duration, period) == count


def test_the_end_of_the_motion_is_reached_where_no_row_falls_on_it():
    turn = dataclasses.replace(TURN, duration=1.9991)
    stream = stream_of(turn)
    last = list(stream)[-1]
    end = sample_turn(turn, np.array([turn.duration]))
    angle = winder.motor_angles(ROBOT, kinematics.lengths(ROBOT, end.poses), last.tension[-1:])
    np.testing.assert_allclose(last.angle[-1], angle[0], rtol=0, atol=1e-12)
    assert last.filament[-1] == end.filament[0]
    assert not last.velocity[-1].any()


def test_tensions_hold_the_platform_in_the_motion(stream, rows):
    """Equilibrium with the inertia of finite differences of the positions, not of the accelerations handed over."""
    t, step = times(stream)[5:-5], 1e-4
    before, now, after = (sample_turn(TURN, t + shift).poses for shift in (-step, 0, step))
    force = ROBOT.mass * ((before - 2 * now + after)[:, :3] / step**2 + [0, 0, 9806.65]) * NEWTON
    supplied = np.einsum("kij,kj->ki", wrench.wrench_matrix(ROBOT, now), rows.tension[5:-5])
    np.testing.assert_allclose(supplied[:, :3], force, rtol=0, atol=2e-5)
    np.testing.assert_allclose(supplied[:, 3:], 0, rtol=0, atol=1e-9)
    assert (rows.tension >= ROBOT.tension_min).all()
    assert (rows.tension <= ROBOT.tension_max).all()


def test_linear_programming_agrees_that_the_tensions_may_be_moved_no_nearer(stream, rows):
    """On one row in a hundred: an LP finds the motion feasible, and the planned tensions are optimal (KKT) there."""
    picked = np.random.default_rng(3).integers(0, stream.rows, stream.rows // 100)
    samples = sample_turn(TURN, times(stream)[picked])
    required = wrench.required_wrench(ROBOT, samples.poses, samples.rates, samples.accels)
    matrices = wrench.wrench_matrix(ROBOT, samples.poses)
    bounds = list(zip(ROBOT.tension_min, ROBOT.tension_max, strict=True))
    for matrix, needed, tension in zip(matrices, required, rows.tension[picked], strict=True):
        away = tension - ROBOT.tension_reference
        found = linprog(away, A_eq=matrix, b_eq=needed, bounds=bounds)
        assert found.status == 0
        assert found.fun >= away @ tension - 1e-6       # the variational inequality of a projection


def test_velocity_is_the_derivative_of_the_angle(stream, rows):
    """Integrating the velocity over any stretch gives the angle back: exactly as sums, closely as a rate."""
    angle, velocity = rows.angle, rows.velocity
    inner = np.cumsum(velocity[1:-1], axis=0) * PERIOD
    np.testing.assert_allclose(inner, (angle[2:] + angle[1:-1] - angle[1] - angle[0]) / 2, rtol=0, atol=1e-11)
    simpson = PERIOD / 3 * (velocity[:-2] + 4 * velocity[1:-1] + velocity[2:])[1:-1]
    np.testing.assert_allclose((angle[2:] - angle[:-2])[1:-1], simpson, rtol=0, atol=1e-5)      # kinks at ramps
    assert not velocity[[0, -1]].any()
    samples = sample_turn(TURN, times(stream)[1:-1])
    rates = kinematics.length_rates(ROBOT, samples.poses, samples.rates)
    cable = -velocity[1:-1] * winder.radius(ROBOT.winders, angle[1:-1])
    assert np.abs(cable - rates).max() < 0.01 * np.abs(rates).max()      # the cable stretches a little on top


def test_torque_balances_tension_inertia_and_friction():
    """Power: what the motors give is what the cables take, what the rotors store and what friction eats."""
    rows, winders = whole(stream_of(robot=FRICTION)), FRICTION.winders
    inner, v = slice(1, -1), rows.velocity
    stored = 0.5 * winders.inertia * NEWTON * (np.diff(rows.angle, axis=0) / PERIOD) ** 2      # N mm, between rows
    given = rows.torque[inner] * v[inner]
    taken = winder.radius(winders, rows.angle[inner]) * rows.tension[inner] * v[inner]
    eaten = 150.0 * np.abs(v[inner]) * np.minimum(np.abs(v[inner]) / CREEP, 1)
    np.testing.assert_allclose(given, taken + np.diff(stored, axis=0) / PERIOD + eaten, rtol=0, atol=1e-6)
    assert eaten.max() > 100
    frictionless = whole(stream_of())
    moving = np.abs(v) > CREEP
    np.testing.assert_allclose((rows.torque - frictionless.torque)[moving], 150 * np.sign(v[moving]), atol=1e-9)


@pytest.mark.parametrize("block_rows", [1, 7, 700, 10_000])
def test_block_borders_and_threads_do_not_show(rows, block_rows):
    if block_rows == 1:      # slow: the motion cut short
        short = dataclasses.replace(TURN, duration=0.05, turns=0.001, rise=0.0)
        wanted, found = whole(stream_of(short)), whole(stream_of(short, block_rows=1, jobs=2))
    else:
        wanted, found = rows, whole(stream_of(block_rows=block_rows, jobs=2))
    close = {"angle": 1e-12, "velocity": 1e-9, "torque": 1e-3, "tension": 1e-10, "filament": 1e-12}
    for name, scale in close.items():
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=0, atol=scale, err_msg=name)
    np.testing.assert_array_equal(found.move, wanted.move)


def test_threads_give_the_same_bits(rows):
    again = whole(stream_of(jobs=3, block_rows=256))
    alone = whole(stream_of(block_rows=256))
    for name in vars(alone):
        np.testing.assert_array_equal(getattr(again, name), getattr(alone, name))


@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=8), size=st.integers(1, 60))
def test_rechunking_keeps_every_row(sizes, size):
    block = next(iter(noisy_stream(sum(sizes), cables=2, move=True)))
    ends = np.cumsum([0, *sizes])
    parts = list(rechunk((cut(block, a, b) for a, b in itertools.pairwise(ends)), size))
    assert [part.row for part in parts] == list(range(0, ends[-1], size))
    assert {len(part) for part in parts[:-1]} <= {size}
    found = whole(parts)
    for name in vars(found):
        np.testing.assert_array_equal(getattr(found, name), getattr(block, name))


def test_the_header_is_json_and_says_where_to_start(stream, rows):
    header = json.loads(json.dumps(dict(stream.header)))
    assert header["part"] == {"name": "turn"}
    assert header["rows"] == len(rows.angle) == stream.rows
    assert header["start_angles_rad"] == pytest.approx(rows.angle[0], abs=1e-12)
    assert header["start_tensions_n"] == pytest.approx(rows.tension[0], abs=1e-12)
    assert header["start_pose"][:3] == [80.0, 0.0, -250.0]


# ---- the way back, by other means

def test_the_stream_played_back_stays_on_the_trajectory(stream):
    verdict = verify_stream(stream, ROBOT, TURN, sample=sample_turn)
    assert verdict.ok
    assert verdict.margins["nozzle_error_mm"] < 1e-6
    assert "1501 rows" in verdict.checked[0]
    used = layers_used(ROBOT.winders, statistics(stream))
    assert (used[:, 1] > used[:, 0]).any(), "the motion should cross a layer change"


def test_a_share_of_the_rows_can_be_played_back(stream):
    verdict = verify_stream(stream_of(block_rows=128), ROBOT, TURN, sample=sample_turn, every=100)
    assert "16 rows" in verdict.checked[0]


@pytest.mark.parametrize("wrong", ["angle", "tension"])
def test_a_wrong_stream_is_found(stream, wrong):
    """0.1 mm of one cable at one row; a tension planned from statics only."""
    def blocks():
        for block in stream:
            column = getattr(block, wrong).copy()
            column[700, 2] += 0.1 / 60 if wrong == "angle" else 5.0
            yield dataclasses.replace(block, **{wrong: column})

    verdict = verify_stream(MotorStream(stream.header, blocks), ROBOT, TURN, sample=sample_turn)
    assert not verdict.ok
    assert verdict.findings[0].value > 0.01
    assert "At 1.400 s" in verdict.findings[0].sentence


@given(seed=st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_gauss_quadrature_of_the_radius_is_what_scipy_integrates(seed):
    winders = ROBOT.winders
    angle = np.random.default_rng(seed).uniform(-5, 26, (3, 8))
    found = wound_since_home(winders, angle)

    def radius(theta, cable):
        return winder.radius(winders, np.full((1, 8), theta))[0, cable]

    for row, cable in ((0, 1), (1, 4), (2, 7)):
        turns = winders.ramp_start[cable] + 2 * np.pi * np.arange(-1, 6)
        ramp = winders.ramp_end[cable] - winders.ramp_start[cable]
        edges = np.sort(np.r_[turns, turns + ramp, 8.0, angle[row, cable]])
        low, high = sorted((8.0, angle[row, cable]))
        edges = edges[(edges >= low) & (edges <= high)]
        area = sum(quad(radius, a, b, args=(cable,))[0] for a, b in itertools.pairwise(edges))
        assert found[row, cable] == pytest.approx(np.sign(angle[row, cable] - 8.0) * area, abs=2e-6)


def test_the_way_back_holds_for_gears_strands_and_growing_spools():
    robot = hangprinter()
    rng = np.random.default_rng(5)
    lengths = kinematics.lengths(robot, np.c_[rng.uniform(-300, 300, (20, 3)), np.zeros((20, 3))])
    tension = rng.uniform(20, 60, lengths.shape)
    angle = winder.motor_angles(robot, lengths, tension)
    np.testing.assert_allclose(played_lengths(robot, angle, tension), lengths, rtol=0, atol=1e-8)


# ---- limits

def refusal(**winder_columns):
    robot = with_winders(**winder_columns)
    with pytest.raises(ImpossibleError) as caught:
        whole(stream_of(robot=robot))
    return caught.value


@pytest.mark.parametrize(("column", "code", "peak"), [
    ("max_speed", "stream-speed", "speed"), ("peak_torque", "stream-torque", "torque"),
])
def test_a_limit_just_below_the_peak_is_refused_at_the_peak(stream, column, code, peak):
    found = getattr(statistics(stream), peak)
    scale = 1e-3 if peak == "torque" else 1.0
    for cable in (1, 6):
        limit = np.full(8, 1e9)
        limit[cable] = found.value[cable] * (1 - 1e-9)
        (finding,) = refusal(**{column: limit}).findings
        assert (finding.code, finding.cable) == (code, cable + 1)
        assert finding.value == pytest.approx(found.value[cable] * scale, rel=1e-12)
        assert f"At {found.row[cable] * PERIOD:.3f} s" in finding.sentence
        pose = sample_turn(TURN, np.array([found.row[cable] * PERIOD])).poses[0]
        assert finding.xyz == pytest.approx(nozzle_xyz(ROBOT, pose))
        limit[cable] = found.value[cable]
        whole(stream_of(robot=with_winders(**{column: limit})))


def test_a_motor_that_would_overheat_is_refused_at_the_end(stream):
    rms = statistics(stream).torque_rms
    limit = np.full(8, 1e9)
    limit[4] = rms[4] * (1 - 1e-9)
    (finding,) = refusal(continuous_torque=limit).findings
    assert (finding.code, finding.cable, finding.unit) == ("stream-torque-rms", 5, "N m")
    limit[4] = rms[4]
    whole(stream_of(robot=with_winders(continuous_torque=limit)))


def test_a_full_winder_is_refused_with_time_and_place(stream):
    found = statistics(stream).angle_max
    span = ROBOT.winders.span.copy()
    assert found.value[4] > ROBOT.winders.home_angle[4] + 0.01
    span[4, 1] = found.value[4] - 0.01
    error = refusal(span=span)
    (finding,) = error.findings
    assert (finding.code, finding.cable) == ("stream-winder", 5)
    assert " winder 5: motor angle" in finding.sentence
    rows = np.flatnonzero(whole(stream).angle[:, 4] > span[4, 1] + 1e-9)
    assert f"At {rows[0] * PERIOD:.3f} s" in finding.sentence
    assert finding.value == pytest.approx(whole(stream).angle[rows[0], 4])
    assert finding.limit == span[4, 1]


def test_a_motion_no_tension_can_hold_is_refused():
    fierce = dataclasses.replace(TURN, duration=0.25)
    with pytest.raises(ImpossibleError, match=r"At 0\.\d+ s .* N are missing") as caught:
        whole(stream_of(fierce, layers=np.arange(100, 111)))
    (finding,) = caught.value.findings
    assert finding.code == "stream-tension"
    assert finding.value < 0
    assert 100 < finding.layer <= 110


def test_a_robot_without_winders_or_a_period_of_nothing_is_a_wrong_call():
    with pytest.raises(UsageError, match="no winders"):
        stream_of(robot=dataclasses.replace(ROBOT, winders=None))
    with pytest.raises(UsageError, match="period"):
        stream_of(period_s=0.0)


# ---- statistics

@given(rows=st.integers(1, 60), cuts=st.integers(1, 20), seed=st.integers(0, 100))
def test_statistics_equal_those_of_the_whole_arrays(rows, cuts, seed):
    stream = noisy_stream(rows, seed=seed)
    found = statistics(MotorStream(stream.header, lambda: rechunk(stream, cuts)))
    data = whole(stream)
    wanted = {
        "speed": np.abs(data.velocity), "torque": np.abs(data.torque), "tension_max": data.tension,
        "angle_max": data.angle, "tension_min": -data.tension, "angle_min": -data.angle,
    }
    for name, values in wanted.items():
        sign = -1 if name.endswith("min") else 1
        np.testing.assert_array_equal(getattr(found, name).value, sign * values.max(axis=0), err_msg=name)
        np.testing.assert_array_equal(getattr(found, name).row, values.argmax(axis=0), err_msg=name)
    if rows > 2:
        bend = np.abs(np.diff(data.angle, 2, axis=0))
        np.testing.assert_allclose(found.acceleration.value, bend.max(axis=0) / PERIOD**2, rtol=1e-12)
        np.testing.assert_array_equal(found.acceleration.row, bend.argmax(axis=0) + 1)
    np.testing.assert_allclose(found.torque_rms, np.sqrt((data.torque**2).mean(axis=0)), rtol=1e-12)
    assert found.rows == rows
    assert found.filament_mm == data.filament[-1] - data.filament[0]


def test_statistics_as_numbers_carry_units():
    stream = smooth_stream(1000)
    numbers = statistics(stream).as_dict()
    assert numbers["peak_torque_n_m"] == pytest.approx(whole(stream).torque.max(axis=0) / 1e3)
    assert numbers["max_tension_n_at_s"][0] == pytest.approx(numbers["max_angle_rad_at_s"][0])
    assert all(key.rsplit("_at_s")[0].endswith(("_s", "_s2", "_n_m", "_n", "_rad", "_mm", "rows")) for key in numbers)


def test_memory_does_not_grow_with_the_length_of_the_print():
    def peak(turns):
        stream = stream_of(Turn(10.0 * turns, turns=turns), period_s=0.005, block_rows=1000)
        tracemalloc.start()
        try:
            statistics(stream)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(1)
    assert peak(12) < 1.1 * peak(3)
