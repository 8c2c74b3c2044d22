"""--orientation free: a box that a level platform cannot print is printed by one that is turned as it goes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from feasibility_cases import box_loop, stacked

from cabslice import pipeline, store
from cabslice.cli.main import cli
from cabslice.errors import UsageError
from cabslice.feasibility import orient
from cabslice.feasibility.check import check, grown
from cabslice.motors.check import verify_stream
from cabslice.robot.turning import Turning
from cabslice.timing.trajectory import sample

EDGE, COARSE, FINE = 219.0, 10.0, 2.0


def tall_box(edge=EDGE):
    """220 mm wide, 218 tall; thick beads as far up as nothing is near."""
    low = stacked([[box_loop(edge)]] * 20, height=COARSE, width=1.0)
    high = stacked([[box_loop(edge)]] * 109, height=FINE, width=1.0)
    above = np.flatnonzero(high.xyz[:, 2] > low.xyz[:, 2].max() + 0.5 * FINE)
    columns = {name: np.concatenate((getattr(low, name), getattr(high, name)[above])) for name in (
        "xyz", "filament", "width", "height", "role", "layer", "object")}
    columns["layer"][len(low.xyz):] -= 80
    columns["speed"] = np.full(len(columns["xyz"]), 140.0)
    return replace(high, **columns, starts=np.array([1, len(columns["xyz"])]))


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    profiles = pipeline.load_profiles("cabfab-optim", None, None, [])
    laid = store.Laid(pipeline.origin_of("box", "0" * 64, profiles), tall_box())
    path = tmp_path_factory.mktemp("free") / "box.path"
    store.save(laid, path)
    return laid, path


@pytest.fixture(scope="module")
def freed(box):
    return pipeline.best_turned(box[0])


def test_level_it_fails_and_turned_alike_everywhere_too(box):
    laid = pipeline.with_ends(box[0])
    robot = pipeline.stages._kept_clear(laid)
    assert {finding.code for finding in check(laid.toolpath, robot).findings} == {"cable-part"}
    for angles in ((0, 0, 5), (0, 0, -5), (5, 0, 0), (-5, 0, 0), (0, 5, 0), (0, -5, 0)):
        field = np.radians(np.array([angles, angles, (0, 0, 0)], float)).reshape(1, 1, 3, 3)
        turned = replace(robot, turning=Turning(np.zeros(1), np.zeros(1), np.array([0.0, 230.0, 360.0]), field))
        assert not check(laid.toolpath, turned).ok


def test_a_field_frees_it_within_its_bounds_and_says_so(freed):
    other, verdict = freed
    assert verdict.ok
    assert verdict.margins["tension_n"] > 0
    (sentence,) = verdict.changed
    assert re.search(r"turned while it prints, by psi -[\d.]+ to [\d.]+, theta", sentence)
    platform = pipeline.profiles_of(other.origin).printer.platform
    angles = np.abs(platform.turn.angles_deg)
    assert 0 < angles[:, :2].max() <= platform.tilt_max_deg
    assert angles[:, 2].max() <= platform.yaw_max_deg
    assert (angles[1::2] == 0).all()                                    # level from home down to over the box
    laid = pipeline.with_ends(other)
    assert check(laid.toolpath, pipeline.stages._kept_clear(laid)).ok


def test_it_is_planned_audited_and_the_motors_hold_the_nozzle_on_it(freed):
    plan, verdict = pipeline.proven(freed[0])
    assert verdict.ok
    assert verdict.margins["turn_share"] < 1.0
    stream = pipeline.to_stream(plan, verdict, period_s=0.008)
    found = verify_stream(stream, pipeline.robot_of(plan), plan.trajectory, every=20)
    assert found.ok
    assert found.margins["nozzle_error_mm"] < 1e-4
    times = np.linspace(0, plan.trajectory.duration, 3000)
    turned = sample(plan.trajectory, times)
    assert np.degrees(np.abs(turned.poses[:, 3:]).max()) > 2.0
    assert np.abs(turned.poses[[0, -1], 3:]).max() == 0.0


@pytest.mark.slow
def test_the_commands_ask_for_it(box, tmp_path):
    run = CliRunner().invoke
    assert run(cli, ["check", str(box[1]), "--no-try"]).exit_code == 4
    free = run(cli, ["check", str(box[1]), "--orientation", "free", "--json"])
    assert free.exit_code == 0
    assert "turned while it prints" in json.loads(free.stdout)["verdict"]["changed"][0]
    plan = run(cli, ["plan", str(box[1]), "--orientation", "free", "-o", str(tmp_path / "box.plan")])
    assert plan.exit_code == 0
    again = run(cli, ["check", str(tmp_path / "box.plan"), "--json"])
    assert json.loads(again.stdout)["ok"]
    refused = run(cli, ["export", str(tmp_path / "box.plan"), "--orientation", "free"])
    assert isinstance(refused.exception, UsageError)
    assert "made for the platform as it is turned" in str(refused.exception)


def test_where_nothing_is_near_the_platform_stays_level(box):
    laid = box[0]
    small = store.Laid(laid.origin, stacked([[box_loop(20.0)]] * 5, height=1.0, width=1.0))
    other, verdict = pipeline.best_turned(small)
    assert verdict.ok
    assert not verdict.changed
    assert pipeline.profiles_of(other.origin).printer.platform.turn is None


def test_without_room_below_home_or_bounds_there_is_no_turn(box):
    laid = pipeline.with_ends(box[0])
    robot = pipeline.robot_of(laid)
    low = replace(robot, home=robot.home - np.array([0.0, 0, 130, 0, 0, 0]))
    assert orient.best_turning(laid.toolpath, low, grown(low), 5.0, 15.0) is None
    assert orient.best_turning(laid.toolpath, robot, grown(robot), 0.0, 0.0) is None
