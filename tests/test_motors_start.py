"""Before, after and instead of the print: tensioning, the ways in and out, taking a print up, playing it slower."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motors_fakes import Turn, sample_turn, whole
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, print_like

from cabslice.errors import ImpossibleError, UsageError
from cabslice.feasibility.check import check
from cabslice.motors.approach import MACHINE, from_layer, has_ends, home_point, resumed, with_ends, without_ends
from cabslice.motors.check import verify_stream
from cabslice.motors.events import events_of, layers_of, starts_of
from cabslice.motors.start import Lead, after_power_loss
from cabslice.motors.stream import make_stream
from cabslice.profile import shelf
from cabslice.profile.printer import Start
from cabslice.robot import wrench
from cabslice.robot.model import robot_from_printer
from cabslice.slicing.layer import Role
from cabslice.timing.audit import audit
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import at_share, sample
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.path import EventKind, Events

ROBOT, START = cabfab_optim(), Start()
TURN = Turn(2.0, turns=0.5, radius=60.0)
COLUMNS = ("xyz", "filament", "width", "height", "speed", "role", "layer", "object", "starts")


def layered(layers=4):
    """A path of several layers: walls, retractions and travels, events of every kind."""
    path = print_like(turns=3)
    per = len(path.xyz) - 1
    columns = {name: getattr(path, name) for name in COLUMNS[:-1]}
    stacked = {name: np.concatenate((column[:1], *[column[1:]] * layers)) for name, column in columns.items()}
    still = (stacked["filament"] < 0) | (np.arange(len(stacked["filament"])) == 0)
    stacked["role"] = np.where(still, Role.TRAVEL, stacked["role"])
    stacked["speed"] = np.where(np.arange(len(still)), stacked["speed"], START.speed_mm_s)     # of no account
    layer = np.concatenate(([0], np.repeat(np.arange(layers), per)))
    stacked["xyz"] = stacked["xyz"] + np.c_[np.zeros((len(layer), 2)), 0.3 * layer]
    starts = np.concatenate([*(path.starts[:-1] + k * per for k in range(layers)), [1 + layers * per]])
    kinds = [EventKind.BED_TEMPERATURE, EventKind.NOZZLE_TEMPERATURE, EventKind.FAN, EventKind.FAN, EventKind.DWELL]
    index = [0, 0, 0, 1 + per, 1 + 2 * per]
    events = Events(np.array(index), np.array(kinds), np.array([60.0, 210, 0, 1, 0.5]))
    return dataclasses.replace(path, **{**stacked, "layer": layer}, starts=starts, events=events)


def same(a, b):
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    for name in ("index", "kind", "value"):
        np.testing.assert_array_equal(getattr(a.events, name), getattr(b.events, name), err_msg=name)


# ---- tensioning

def test_the_cables_are_tensioned_before_anything_moves():
    """The platform rests in equilibrium all the while; no tension falls; then the motion is the one without a lead."""
    lead = Lead(1.0, 0.3)
    plain, led = (make_stream(TURN, ROBOT, period_s=0.002, header={}, sample=sample_turn, **more)
                  for more in ({}, {"lead": lead}))
    rows, wanted, first = whole(led), whole(plain), lead.rows(0.002)
    assert first == 500 == led.header["lead_rows"]
    assert led.rows == plain.rows + first
    for name in ("angle", "tension", "filament"):
        np.testing.assert_allclose(getattr(rows, name)[first:], getattr(wanted, name), rtol=0, atol=1e-9)
    still = first - 2      # the last two rows already carry what the acceleration is taken from
    poses = np.repeat(sample_turn(TURN, np.zeros(1)).poses, still, axis=0)
    supplied = np.einsum("kij,kj->ki", wrench.wrench_matrix(ROBOT, poses), rows.tension[:still])
    np.testing.assert_allclose(supplied, wrench.required_wrench(ROBOT, poses), rtol=0, atol=1e-8)
    assert (np.diff(rows.tension[:still], axis=0) > -1e-9).all()
    assert (rows.tension >= ROBOT.tension_min).all()
    assert rows.tension[0].sum() < 0.5 * rows.tension[first].sum()
    assert (np.abs(rows.velocity[:first]) < 0.1).all()
    assert not rows.velocity[0].any()
    assert led.header["start"]["angles_rad"] == pytest.approx(rows.angle[0], abs=1e-12)
    assert led.header["duration_s"] == pytest.approx(plain.header["duration_s"] + 1.0)


def test_the_played_back_nozzle_stays_still_and_then_follows():
    more = {"lead": Lead(0.5, 0.2), "block_rows": 100}
    stream = make_stream(TURN, ROBOT, period_s=0.002, header={}, sample=sample_turn, **more)
    verdict = verify_stream(stream, ROBOT, TURN, sample=sample_turn)
    assert verdict.ok
    assert verdict.margins["nozzle_error_mm"] < 1e-6


@given(seconds=st.floats(0.01, 9), share=st.floats(0.05, 1), period=st.sampled_from([0.001, 0.002, 0.003]))
def test_the_level_rises_smoothly_to_one(seconds, share, period):
    lead = Lead(seconds, share)
    level = lead.level(np.arange(lead.rows(period) + 5), period)
    assert level[0] == pytest.approx(share)
    assert level[lead.rows(period):] == pytest.approx(1)
    assert (np.diff(level) >= 0).all()


def test_nothing_is_fed_in_a_dry_run():
    wet, dry = (whole(make_stream(TURN, ROBOT, period_s=0.002, header={}, sample=sample_turn, extrude=extrude))
                for extrude in (True, False))
    assert wet.filament[-1] > 1
    assert not dry.filament.any()
    assert not dry.feed.any()
    np.testing.assert_array_equal(wet.angle, dry.angle)


# ---- the way in and out

def test_the_ways_in_and_out_begin_and_end_at_home():
    path = layered()
    whole_path = with_ends(path, ROBOT, START)
    assert not find_faults(whole_path)
    np.testing.assert_array_equal(whole_path.xyz[0], home_point(ROBOT))
    np.testing.assert_array_equal(whole_path.xyz[-1], home_point(ROBOT))
    own = whole_path.object == MACHINE
    assert not whole_path.filament[own].any()
    assert (whole_path.speed[own] == START.speed_mm_s).all()
    assert (whole_path.role[own] == Role.TRAVEL).all()
    down = whole_path.xyz[np.flatnonzero(own[: len(path.xyz)])[-1]]
    np.testing.assert_array_equal(down, path.xyz[0])
    over = whole_path.xyz[np.flatnonzero(own[: len(path.xyz)])[-2]]
    np.testing.assert_allclose(over, path.xyz[0] + [0, 0, START.lift_mm])
    assert whole_path.xyz[-2, 2] == pytest.approx(path.xyz[:, 2].max() + START.lift_mm)
    assert with_ends(whole_path, ROBOT, START) is whole_path
    same(without_ends(whole_path, ROBOT), path)


@pytest.mark.parametrize("height", [0.0, 0.5, 2.0])
def test_a_home_on_the_bed_is_left_and_a_part_higher_than_it_is_parked_over(height):
    path = layered()
    low = dataclasses.replace(ROBOT, home=np.array([0, 0, -460 + 100 + height, 0, 0, 0.0]))
    ended = with_ends(path, low, START)
    assert not find_faults(ended)
    own = np.flatnonzero(ended.object == MACHINE)
    inward = ended.xyz[own[own < len(ended.xyz) // 2]]
    first = path.xyz[0, 2]
    np.testing.assert_allclose(inward[:, 2], [height, first + START.lift_mm, first + START.lift_mm, first])
    np.testing.assert_allclose(inward[1, :2], inward[0, :2])
    np.testing.assert_allclose(ended.xyz[-1], path.xyz[-1] + [0, 0, path.xyz[:, 2].max() - path.xyz[-1, 2] + 5.0])


def test_every_layer_follows_the_bed():
    """The nozzle keeps its height over a plate that rises, however the print is taken up; a higher plate lifts all."""
    path, slope = layered(), np.array([-15e-3, -10e-3])
    tilted = dataclasses.replace(ROBOT, bed_slope=slope)
    ended = with_ends(path, tilted, START)
    own = ended.object == MACHINE
    np.testing.assert_allclose(ended.xyz[~own][:, 2] - ended.xyz[~own][:, :2] @ slope, path.xyz[1:, 2], atol=1e-12)
    np.testing.assert_array_equal(ended.xyz[~own][:, :2], path.xyz[1:, :2])
    np.testing.assert_allclose(without_ends(ended, tilted).xyz, path.xyz, atol=1e-12)
    moved, _ = resumed(ended, tilted, START, 2)
    laid = moved.role != Role.TRAVEL
    np.testing.assert_allclose(moved.xyz[laid], ended.xyz[(ended.layer >= 2) & (ended.role != Role.TRAVEL)], atol=1e-12)
    smaller = dataclasses.replace(tilted, bed_size=np.array([440.0, 440.0]))
    assert not check(ended, smaller).findings
    assert {found.code for found in check(ended, tilted).findings} == {"cable-bed"}, "its corner rises into cables"
    assert [found.code for found in check(ended, ROBOT).findings] == ["bed"]
    printer = shelf.load_printer("cabfab-optim", ["bed.first_layer_offset_mm=-0.05", "bed.slope_mm_m=[-15, -10]"])
    robot = robot_from_printer(printer)
    np.testing.assert_allclose(robot.bed_slope, slope)
    assert robot.bed_origin[2] == pytest.approx(printer.bed.z_mm - 0.05)


def with_events(path, *rows):
    events = [*zip(path.events.index, path.events.kind, path.events.value, strict=True), *rows]
    return dataclasses.replace(path, events=Events(*np.array(sorted(events, key=lambda row: row[0]), float).T))


def test_the_ways_belong_to_no_layer_and_what_a_layer_asks_for_begins_with_it():
    path = with_events(layered(), (0, EventKind.MIN_LAYER_TIME, 8.0), (0, EventKind.MIN_PRINT_SPEED, 10.0))
    ended = with_ends(path, ROBOT, START)
    assert not find_faults(ended)
    own = ended.object == MACHINE
    assert set(ended.layer[own]) == {-1, 4}
    assert set(ended.layer[~own]) == set(path.layer)
    for kind in (EventKind.MIN_LAYER_TIME, EventKind.MIN_PRINT_SPEED):
        index = ended.events.index[ended.events.kind == kind]
        np.testing.assert_array_equal(index, np.flatnonzero(ended.layer == 0)[:1])
    assert not find_faults(ended)
    assert (ended.events.index == 0).sum() == (path.events.index == 0).sum() - 2


def test_heaters_and_fan_are_off_on_the_way_home():
    ended = with_ends(layered(), ROBOT, START)
    last = ended.events.index == np.flatnonzero(ended.layer == 4)[0]
    assert {(kind, value) for kind, value in zip(ended.events.kind[last], ended.events.value[last], strict=True)} == {
        (EventKind.NOZZLE_TEMPERATURE, 0), (EventKind.BED_TEMPERATURE, 0), (EventKind.FAN, 0)}
    bare = dataclasses.replace(layered(), events=Events.none())
    assert not len(with_ends(bare, ROBOT, START).events.index)


def test_at_a_pause_there_are_rows_that_stand_still():
    path = layered()
    stop = int(path.starts[len(path.starts) // 2])
    path = with_events(path, (stop, EventKind.PAUSE, 0.0), (stop, EventKind.DWELL, 0.4))
    ended = with_ends(path, ROBOT, START)
    assert not find_faults(ended)
    same(without_ends(ended, ROBOT), path)
    trajectory = plan(ended, ROBOT, PRINTER, MATERIAL, PROCESS)
    told = events_of(trajectory, ended, 0.002)
    row = told["row"][told["kind"].index("pause")]
    near = sample(trajectory, 0.002 * np.arange(row - 100, row + 100))
    assert np.ptp(near.poses, axis=0).max() < 1e-9
    assert not near.rates.any()
    np.testing.assert_allclose(near.poses[0, :3] - trajectory.to_pose, path.xyz[stop - 1], atol=1e-9)


# ---- a print taken up

@given(layer=st.integers(1, 3))
@settings(deadline=None)
def test_taken_up_at_a_layer_the_rest_is_the_same_moves(layer):
    path = layered()
    rest = from_layer(path, layer)
    assert not find_faults(rest)
    first = int(np.flatnonzero(path.layer[1:] >= layer)[0]) + 1
    np.testing.assert_array_equal(rest.xyz, path.xyz[first - 1:])
    np.testing.assert_array_equal(rest.filament[1:], path.filament[first:])
    assert (rest.layer >= layer).all()
    assert rest.starts[0] == 1
    np.testing.assert_array_equal(rest.starts[1:], path.starts[path.starts > first] - first + 1)
    now = {kind: value for i, kind, value in zip(rest.events.index, rest.events.kind, rest.events.value, strict=True)
           if i == 0}
    assert now[EventKind.NOZZLE_TEMPERATURE] == 210
    assert now[EventKind.BED_TEMPERATURE] == 60
    fans = path.events.value[(path.events.kind == EventKind.FAN) & (path.events.index < first)]
    assert now[EventKind.FAN] == fans[-1]
    same(from_layer(without_ends(with_ends(path, ROBOT, START), ROBOT), layer), rest)


@pytest.mark.parametrize("layer", [0, 4, 99])
def test_a_layer_that_is_not_there_is_refused(layer):
    with pytest.raises(UsageError, match=f"no layer {layer} to begin with: expected 1 to 3"):
        from_layer(layered(), layer)


def test_what_is_checked_has_all_that_stands_already():
    path = layered()
    moved, shown = resumed(with_ends(path, ROBOT, START), ROBOT, START, 2)
    assert not find_faults(shown)
    assert has_ends(moved)
    rows = len(moved.xyz)
    np.testing.assert_array_equal(shown.xyz[-rows:], moved.xyz)
    laid = shown.xyz[shown.filament > 0]
    np.testing.assert_array_equal(laid, path.xyz[path.filament > 0])
    np.testing.assert_array_equal(moved.xyz[0], home_point(ROBOT))


def test_home_inside_the_part_is_no_place_to_begin():
    low = dataclasses.replace(ROBOT, home=np.array([0, 0, -359.0, 0, 0, 0]))
    with pytest.raises(ImpossibleError, match="what is printed already asks for"):
        resumed(layered(), low, START, 3)


# ---- events and layers, with times

@pytest.fixture(scope="module")
def planned():
    path = with_ends(layered(), ROBOT, START)
    return path, plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)


def test_a_move_begins_when_the_nozzle_leaves_its_start(planned):
    path, trajectory = planned
    moves = path.starts[:-1]
    times = starts_of(trajectory, moves)
    nozzle = sample(trajectory, times).poses[:, :3] - trajectory.to_pose
    np.testing.assert_allclose(nozzle, path.xyz[moves - 1], atol=1e-6)
    later = sample(trajectory, times + 0.05)
    assert (later.move >= moves).all()
    assert (sample(trajectory, np.maximum(times - 1e-3, 0)).move <= moves).all()


def test_events_stand_at_the_time_of_their_move(planned):
    path, trajectory = planned
    told = events_of(trajectory, path, 0.002, lead_s=5.0)
    kinds = np.array(told["kind"])
    assert told["t_s"] == sorted(told["t_s"])
    assert [told["value"][i] for i in np.flatnonzero(np.array(told["t_s"]) == 0)] == [60.0, 210.0, 0.0]
    assert told["row"] == [int(np.ceil(t / 0.002 - 1e-9)) for t in told["t_s"]]
    fan = np.flatnonzero(kinds == "fan")[1]
    row = int(path.events.index[path.events.kind == EventKind.FAN][1])
    assert told["t_s"][fan] == pytest.approx(5.0 + starts_of(trajectory, np.array([row]))[0], abs=1e-6)
    still = (path.lengths == 0) & (path.filament != 0)
    assert sum(kind in ("retract", "prime") for kind in kinds) == still.sum()
    dwell = told["t_s"][int(np.flatnonzero(kinds == "dwell")[0])] - 5.0
    resting = sample(trajectory, dwell + np.linspace(0.01, 0.49, 20))
    assert np.ptp(resting.poses, axis=0).max() < 1e-9
    dry = events_of(trajectory, path, 0.002, extrude=False)
    assert set(dry["kind"]) == {"dwell"}


def test_a_layer_is_whole_when_its_last_bead_is(planned):
    path, trajectory = planned
    told = layers_of(trajectory, path, lead_s=5.0)
    assert told["layer"] == [0, 1, 2, 3]
    for layer, z, end in zip(told["layer"], told["z_mm"], told["whole_at_s"], strict=True):
        beads = np.flatnonzero((path.layer == layer) & (path.role != Role.TRAVEL))
        found = sample(trajectory, np.array([end - 5.0]))
        assert found.filament[0] == pytest.approx(path.filament[: beads[-1] + 1].sum(), abs=1e-6)
        assert z == pytest.approx(path.xyz[beads[-1], 2])


# ---- slower

def test_half_the_speed_is_the_same_way_in_twice_the_time(planned):
    path, trajectory = planned
    slow = at_share(trajectory, 0.5)
    assert slow.duration == pytest.approx(2 * trajectory.duration)
    times = np.linspace(0, trajectory.duration, 999)
    fast, found = sample(trajectory, times), sample(slow, 2 * times)
    np.testing.assert_allclose(found.poses, fast.poses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(2 * found.rates, fast.rates, rtol=0, atol=1e-6)
    np.testing.assert_allclose(4 * found.accels, fast.accels, rtol=0, atol=1e-2)
    assert audit(slow, path, ROBOT, PRINTER, MATERIAL, PROCESS).ok


def test_turns_and_angle_within_the_turn_are_told_apart():
    rows = after_power_loss({}, np.array([13.0, -1.0]))
    assert [row["turn"] for row in rows] == [2, -1]
    for row, angle in zip(rows, (13.0, -1.0), strict=True):
        assert row["turn"] * 2 * np.pi + row["within_turn_rad"] == pytest.approx(angle)
