"""What printer firmware would do, against closed forms and judged by the audit; what the plan's time is spent at."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline, print_like

from cabslice.timing.audit import audit
from cabslice.timing.baseline import compared, firmware, look_ahead, safe_acceleration, unhindered
from cabslice.timing.explain import time_by_limit
from cabslice.timing.limits import limits_of
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

ROBOT = replace(cabfab_optim(), bed_size=np.array([440.0, 440.0]))


def capped(acceleration):
    motion = SimpleNamespace(**{**vars(PRINTER.motion), "max_acceleration_mm_s2": acceleration})
    return SimpleNamespace(motion=motion, extruder=PRINTER.extruder)


def made(toolpath, acceleration=2000.0, **options):
    return firmware(toolpath, ROBOT, capped(acceleration), MATERIAL, PROCESS, **options)


def test_a_straight_line_is_one_trapezoid():
    line = polyline(points=[[0, 0, 1], [30, 40, 1]], pieces=1, speed=100.0)
    assert made(line).trajectory.duration == pytest.approx(50 / 100 + 100 / 2000)
    short = polyline(points=[[0, 0, 1], [0, 1, 1]], pieces=1, speed=100.0)
    assert made(short).trajectory.duration == pytest.approx(2 * np.sqrt(1 / 2000))


def test_a_corner_is_turned_by_junction_deviation():
    """A right angle: v^2 = a d sin 45 / (1 - sin 45), a step of v sqrt 2."""
    bend = polyline(points=[[0, 0, 1], [40, 0, 1], [40, 40, 1]], pieces=1, speed=100.0)
    found = made(bend)
    speed = np.sqrt(2000 * PROCESS.corner_mm * np.sqrt(0.5) / (1 - np.sqrt(0.5)))
    assert found.step == pytest.approx(speed * np.sqrt(2))
    ramps = 100 / 2000 + 2 * (100 - speed) / 2000 + 100 / 2000
    cruise = 80 - 2 * (100**2 / 4000) - 2 * (100**2 - speed**2) / 4000
    assert found.trajectory.duration == pytest.approx(ramps + cruise / 100)


def test_look_ahead_never_asks_for_more_than_its_acceleration():
    rng = np.random.default_rng(1)
    length, most = 10.0 ** rng.uniform(-3, 1, 500), rng.uniform(0, 100, 501)
    most[[0, -1]] = 0.0
    entry, leave = look_ahead(length, most[:-1], most[1:], np.full(500, 3000.0))
    np.testing.assert_allclose(entry[1:], leave[:-1])
    assert (np.abs(leave**2 - entry**2) <= 2 * 3000 * length * (1 + 1e-9)).all()
    assert (entry <= most[:-1] + 1e-12).all()
    bound = (entry == most[:-1]) | np.isclose(np.abs(leave**2 - entry**2), 6000 * length)
    assert (bound | np.append(False, np.isclose(np.abs(leave**2 - entry**2), 6000 * length)[:-1])).all()


def test_the_safe_acceleration_is_borne_everywhere_over_the_bed_and_no_larger_one_is():
    from cabslice.robot.model import nozzle_poses
    from cabslice.robot.tension import nearest_tension
    from cabslice.robot.usable import usable
    from cabslice.robot.wrench import required_wrench

    robot = replace(usable(ROBOT), winders=None)
    most, rng = safe_acceleration(robot, limits_of(PRINTER, MATERIAL)), np.random.default_rng(0)
    xyz = np.array([[x, y, z] for x in (-220, 0, 220) for y in (-220, 0, 220) for z in (0, 220, 440)], float)
    xyz = np.concatenate((xyz, rng.uniform([-220, -220, 0], [220, 220, 440], (60, 3))))
    poses = nozzle_poses(robot, xyz)
    held = {}
    for share in (1.0, 1.04):
        feasible = []
        for turn in np.linspace(0, 2 * np.pi, 73):
            accels = np.zeros((len(poses), 6))
            accels[:, :2] = share * most * np.array([np.cos(turn), np.sin(turn)])
            needed = required_wrench(robot, poses, 0 * accels, accels)
            feasible.append(nearest_tension(robot, poses, needed, margins=False).feasible)
        held[share] = np.all(feasible)
    assert held[1.0]
    assert not held[1.04]


def test_the_safe_acceleration_steps_without_a_motor_running_too_fast_and_a_greater_one_does_not():
    """Straight lines from rest to rest, so short that they turn from a0 to -a0 at the machine's speed."""
    most = safe_acceleration(ROBOT, limits_of(PRINTER, MATERIAL))
    used = []
    for acceleration in (most, 1.3 * most):
        line = 150.0**2 / acceleration
        turns = [line * np.array([np.cos(turn), np.sin(turn), 0.0]) for turn in np.arange(8) * np.pi / 8]
        middles = [np.array([x, y, z]) for x in (-200, 0, 200) for y in (-200, 0, 200) for z in (0.2, 430)]
        points = np.array([middle + end * half for middle in middles for end in turns for half in (-0.5, 0.5)])
        path = polyline(points=points, pieces=len(points) - 1, speed=150.0)
        given = replace(path, filament=np.zeros(len(points))), ROBOT, capped(acceleration), MATERIAL, PROCESS
        verdict = audit(firmware(*given).trajectory, *given)
        used.append(verdict.margins["motor_speed_share"])
        assert verdict.margins["motor_torque_share"] < 1
    assert used[0] <= 1 < used[1]


def test_right_angles_are_turned_as_klipper_turns_them():
    bend = polyline(points=[[0, 0, 1], [40, 0, 1], [40, 40, 1]], pieces=1, speed=100.0)
    assert made(bend, right_angle_mm_s=5.0).step == pytest.approx(5 * np.sqrt(2))


def test_no_plan_is_faster_than_the_speeds_asked_for():
    line = polyline(points=[[0, 0, 1], [30, 40, 1]], pieces=1, speed=100.0)
    assert unhindered(line, ROBOT, PRINTER, MATERIAL) == pytest.approx(0.5)
    toolpath = print_like(0)
    given = toolpath, ROBOT, capped(4000.0), MATERIAL
    assert unhindered(*given) < plan(*given, PROCESS).duration


def test_the_baseline_is_the_whole_print_and_breaks_what_the_plan_keeps():
    toolpath = print_like(0)
    given = toolpath, ROBOT, capped(4000.0), MATERIAL, PROCESS
    found = firmware(*given)
    end = sample(found.trajectory, np.array([found.trajectory.duration]))
    np.testing.assert_allclose(end.poses[0, :3] - found.trajectory.to_pose, toolpath.xyz[-1], atol=1e-9)
    assert end.filament[0] == pytest.approx(toolpath.filament.sum())
    codes = {finding.code for finding in audit(found.trajectory, *given).findings}
    assert {"acceleration", "motor-speed"} <= codes <= {"acceleration", "motor-speed", "motor-torque", "tension"}
    assert audit(firmware(*given, safe=True).trajectory, *given).ok
    ours = plan(*given).duration
    quick, shipped, safe = compared(ours, *given)
    assert set(quick["broken"]) == codes
    assert quick["broken"]["acceleration"] > 2
    assert set(shipped["broken"]) <= codes
    assert quick["duration_s"] < shipped["duration_s"] < safe["duration_s"]
    assert safe["broken"] == {}
    assert safe["times_ours"] == pytest.approx(safe["duration_s"] / ours)
    assert safe["times_ours"] > 1.15                     # what both plans keep by the same audit


@pytest.mark.parametrize(("speed", "acceleration", "name"), [
    (20.0, 4000.0, "speed asked for"), (150.0, 100.0, "acceleration (motion"),
])
def test_the_active_limit_is_named(speed, acceleration, name):
    line = polyline(points=[[-80, 0, 1], [80, 0, 1]], pieces=1, speed=speed)
    given = line, ROBOT, capped(acceleration), MATERIAL, PROCESS
    shares = time_by_limit(plan(*given), *given)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert next(iter(shares)).startswith(name)
    assert max(shares.values()) > 0.9


def test_plan_says_what_it_is_held_back_by_and_what_firmware_would_take(tmp_path, monkeypatch, capsys):
    from cli_cases import PRINTER as NAMED
    from cli_cases import SETS, answered, run, write_box

    monkeypatch.chdir(tmp_path)
    code, found = answered(capsys, "plan", write_box(tmp_path / "box.stl"), *NAMED, *SETS, "--compare")
    assert code == 0
    assert sum(found["numbers"]["time_share_by_limit"].values()) == pytest.approx(1.0)
    quick, shipped, safe = found["compared"]
    assert quick["broken"]["acceleration"] > 1
    assert shipped["corner_step_mm_s"] < quick["corner_step_mm_s"]
    assert safe["times_ours"] == pytest.approx(safe["duration_s"] / found["numbers"]["duration_s"])
    assert run("plan", "box.stl", *NAMED, *SETS, "--compare", "--overwrite") == 0
    said = capsys.readouterr().out
    assert "time by limit" in said
    assert "x this plan; keeps every limit" in said
    assert "largest share used of motor_speed" in said
