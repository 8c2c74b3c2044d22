"""A linear Delta goes through the whole chain from profile to motor file; what asks for cables says so."""

import contextlib
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import SETS, write_box
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline, print_like

from cabslice.cli.main import main
from cabslice.errors import ImpossibleError, ProfileError
from cabslice.feasibility.rails import check
from cabslice.motors.formats import read
from cabslice.profile import shelf
from cabslice.robot.delta import Delta, forces, forward, heights_of, machine_from_printer
from cabslice.robot.model import robot_from_printer
from cabslice.timing.proof import plan_proven
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

OPTIONS = ("-p", "linear-delta", *SETS)


def made(*sets):
    robot = machine_from_printer(shelf.load_printer("linear-delta", sets))
    assert isinstance(robot, Delta)
    return robot


def run(*words):
    """Exit code, stdout, stderr of a command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    return code, out.getvalue(), err.getvalue()


def rows_of(path):
    stream = read(path)
    blocks = list(stream)
    return stream, *(np.concatenate([getattr(block, name) for block in blocks])
                     for name in ("angle", "velocity", "torque", "tension"))


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    folder = tmp_path_factory.mktemp("delta")
    part = write_box(folder / "box.stl")
    code, out, err = run("export", part, *OPTIONS, "-o", folder / "cube.stream", "--json")
    assert code == 0, err
    return folder / "cube.stream", json.loads(out)


def test_a_motor_file_is_made_and_says_what_was_checked(cube):
    path, answer = cube
    told = " ".join(answer["verdict"]["checked"])
    assert "carriages on their rails" in told
    assert "Not applicable, it has no cables" in told
    assert all(limit in told for limit in ("arm-angle", "stroke", "motor-torque"))
    assert answer["verdict"]["margins"]["stroke_share"] < 1
    assert "slack_cable" not in read(path).header["drive_reaction"]
    assert answer["numbers"]["machine_kind"] == "linear-delta"


def test_angles_lead_the_nozzle_over_the_part(cube):
    """Beads of the file: played back by three spheres, the nozzle lies where the part is, and its rows keep limits."""
    path, _ = cube
    robot, (stream, angle, velocity, torque, force) = made(), rows_of(path)
    winders = robot.winders
    poses = forward(robot, heights_of(robot, angle))
    assert poses[0] == pytest.approx(robot.home, abs=1e-9)
    assert (np.abs(velocity) <= winders.max_speed).all()
    assert (np.abs(torque) <= winders.peak_torque).all()
    assert (np.sqrt((torque**2).mean(axis=0)) <= winders.continuous_torque).all()
    period, inner = stream.period_s, slice(1, -1)
    assert velocity[inner] == pytest.approx((angle[2:] - angle[:-2]) / (2 * period), abs=1e-3)
    accel = (poses[2:, :3] - 2 * poses[1:-1, :3] + poses[:-2, :3]) / period**2
    rates = (poses[2:, :3] - poses[:-2, :3]) / (2 * period)
    at_rest = np.abs(accel).max(axis=1) < 1e-6
    expected = forces(robot, poses[inner], rates, accel)
    assert force[inner][at_rest] == pytest.approx(expected[at_rest], abs=0.05)
    assert np.abs(force[inner] - expected).max() < 0.5
    nozzle = poses[:, :3] + robot.nozzle - robot.bed_origin
    low = nozzle[:, 2] < 1.55
    assert low.mean() > 0.1
    assert np.abs(nozzle[low][:, :2]).max() < 4


def test_inspect_and_start_read_it(cube):
    code, out, _ = run("inspect", cube[0])
    assert code == 0
    assert "force N" in out
    code, out, _ = run("start", cube[0])
    assert code == 0
    assert "every carriage where its motor holds it" in out
    assert "tension the cables" not in out


def test_plan_goes_on_to_the_same_bytes(cube, tmp_path):
    part = write_box(tmp_path / "box.stl")
    code, out, err = run("plan", part, *OPTIONS, "-o", tmp_path / "cube.plan")
    assert code == 0, err
    assert "time by limit" in out
    assert run("export", tmp_path / "cube.plan", "-o", tmp_path / "cube.stream")[0] == 0
    assert (tmp_path / "cube.stream").read_bytes() == cube[0].read_bytes()
    for words in (("plan", part, *OPTIONS, "--compare", "-o", tmp_path / "x.plan"), ("view", tmp_path / "cube.plan"),
                  ("simulate", tmp_path / "cube.plan"), ("workspace", "-p", "linear-delta"),
                  ("stiffness", "-p", "linear-delta"), ("start", "tension", "-p", "linear-delta")):
        code, _, err = run(*words)
        assert code == 3, words
        assert "cables" in err


def test_circle_of_the_published_machine(tmp_path):
    """Diameter 300 mm at 120 mm/s through the chain: stroke 190.8 mm, actuators at most 76.3 mm/s."""
    code, _, err = run("start", "circle", "-p", "linear-delta", "--radius", 150, "--speed", 120, "--height", 20,
                       "-o", tmp_path / "circle.stream")
    assert code == 0, err
    robot, (_, angle, velocity, *_) = made(), rows_of(tmp_path / "circle.stream")
    q = heights_of(robot, angle)
    poses = forward(robot, q)
    round_ = np.abs(np.hypot(poses[:, 0], poses[:, 1]) - 150) < 0.05
    round_ &= np.abs(poses[:, 2] - 60) < 0.01
    assert np.ptp(q[round_], axis=0) == pytest.approx(np.full(3, 190.845), abs=0.1)
    assert np.abs(velocity * 6.366).max(axis=0) == pytest.approx(np.full(3, 76.338), rel=2e-3)


@pytest.mark.parametrize(("setting", "code", "words"), [
    ("delta.max_arm_angle_deg=32.5", "arm-angle", "leans more than its joints allow"),
    ("delta.travel_mm=[950, 1340]", "stroke", "below the end of its rail"),
    ("delta.travel_mm=[780, 1284]", "stroke", "above the end of its rail"),
])
def test_what_it_cannot_reach_is_told(setting, code, words):
    path = replace(polyline(1), xyz=polyline(1).xyz + np.array([100, 60, 0.0]))
    if "1284" in setting:
        path = replace(path, xyz=path.xyz + np.array([0, 0, 345.0]))
    verdict = check(path, made(setting))
    assert {finding.code for finding in verdict.findings} == {code}
    assert words in verdict.findings[0].sentence
    assert verdict.findings[0].cable > 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sets", [
    (), ("delta.max_acceleration_mm_s2=800",), ("delta.motor.continuous_torque_n_m=0.06",),
    ("delta.motor.max_speed_rad_s=6",), ("delta.motor.inertia_kg_mm2=2000", "motion.smoothing_ms=0"),
])
def test_no_limit_is_ever_broken_and_one_is_reached(seed, sets):
    printer = replace_motion(*sets)
    robot, path = made(*(one for one in sets if not one.startswith("motion"))), polyline(seed, count=40, pieces=3)
    trajectory, verdict = plan_proven(path, robot, printer, MATERIAL, PROCESS)
    assert verdict.ok, verdict.findings
    assert max(verdict.margins.values()) <= 1 + 1e-6
    if sets:
        named = {"delta.max_acceleration_mm_s2=800": "carriage_acceleration_share",
                 "delta.motor.max_speed_rad_s=6": "motor_speed_share"}.get(sets[0])
        assert named is None or verdict.margins[named] > 0.85
        assert trajectory.duration > plan(path, made(), PRINTER, MATERIAL, PROCESS).duration


def replace_motion(*sets):
    from types import SimpleNamespace

    smooth = 0.0 if "motion.smoothing_ms=0" in sets else 5.0
    return SimpleNamespace(motion=SimpleNamespace(**{**vars(PRINTER.motion), "smoothing_ms": smooth}),
                           extruder=PRINTER.extruder)


def test_both_engines_say_the_same():
    path = print_like(2, turns=6)
    one, other = (plan(path, made(), PRINTER, MATERIAL, PROCESS, engine=engine) for engine in ("compiled", "toppra"))
    assert one.x == pytest.approx(other.x, rel=1e-5, abs=1e-4)


def test_the_audit_finds_what_the_plan_did_not_keep():
    from cabslice.timing.audit import audit

    path = polyline(3, count=40)
    trajectory = plan(path, made(), PRINTER, MATERIAL, PROCESS)
    weak = made("delta.motor.peak_torque_n_m=0.05", "delta.motor.continuous_torque_n_m=0.05",
                "delta.max_acceleration_mm_s2=500", "delta.motor.max_speed_rad_s=3", "delta.travel_mm=[1000, 1340]")
    found = {finding.code for finding in audit(trajectory, path, weak, PRINTER, MATERIAL, PROCESS).findings}
    assert found >= {"motor-torque", "carriage-acceleration", "motor-speed", "stroke"}


def test_motors_that_do_not_hold_it_are_named():
    with pytest.raises(ImpossibleError, match="the motors do not hold the platform for ever"):
        plan(polyline(0), made("delta.motor.continuous_torque_n_m=0.02"), PRINTER, MATERIAL, PROCESS)


def test_poses_move_as_the_carriages_say():
    """The motion of a plan, sent to the carriages and back."""
    path, robot = polyline(5), made()
    trajectory = plan(path, robot, PRINTER, MATERIAL, PROCESS)
    seen = sample(trajectory, np.linspace(0, trajectory.duration, 500))
    from cabslice.robot.delta import carriages
    assert forward(robot, carriages(robot, seen.poses)) == pytest.approx(seen.poses, abs=1e-8)


@pytest.mark.parametrize(("text", "words"), [
    ("delta.travel_mm=[1340, 780]", "expected the lower height first"),
    ("delta.travel_mm=[780, 1200]", "expected carriage 1 on its rail at home"),
    ("delta.rail_angles_deg=[0, 90, 170]", "expected three rails all around"),
    ("delta.arm_mm=540", "expected arms that reach home"),
    ("kind=cable", "has no such table"),
])
def test_faults_of_a_delta(text, words):
    with pytest.raises(ProfileError, match=words):
        shelf.load_printer("linear-delta", [text])


def test_what_is_about_cables_refuses_it():
    with pytest.raises(ProfileError, match="expected one with cables"):
        robot_from_printer(shelf.load_printer("linear-delta"))
    with pytest.raises(ProfileError, match="cable"):
        shelf.load_printer("cabfab-optim", ["kind=linear-delta"])
