"""The plan against analytic answers, against toppra, and judged by the audit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_optim
from timing_cases import FEED, MATERIAL, PRINTER, PROCESS, polyline, print_like, toolpath

from cabslice.errors import ImpossibleError
from cabslice.timing import recursion
from cabslice.timing import retime as planner
from cabslice.timing.audit import audit
from cabslice.timing.limits import Nodes, limits_of, rows
from cabslice.timing.retime import plan
from cabslice.timing.rules import CompiledRules, array_rules
from cabslice.timing.trajectory import sample, slowed
from cabslice.toolpath.path import EventKind, Events

ROBOT = cabfab_optim()


def planned(toolpath, **options):
    return plan(toolpath, ROBOT, PRINTER, MATERIAL, PROCESS, **options)


def judged(trajectory, toolpath, **options):
    return audit(trajectory, toolpath, ROBOT, PRINTER, MATERIAL, PROCESS, **options)


def test_a_double_integrator_is_driven_bang_bang():
    """|u| <= A on a straight line from rest to rest: x = 2 A min(s, L - s), capped."""
    s = np.linspace(0, 10, 401)
    a = np.tile([1 / 5000, -1 / 5000], (401, 1))
    x = recursion.retime(a, np.zeros_like(a), np.full(401, 3e4), np.append(np.diff(s), 0), np.array([0, 401]))
    np.testing.assert_allclose(x, np.minimum(3e4, 2 * 5000 * np.minimum(s, 10 - s)), rtol=1e-9, atol=1e-9)


def test_the_compiled_engine_gives_the_answer_of_toppra():
    """Two ways through the rows, two recursions: equal at every node of every block."""
    compared = 0
    for seed in range(3):
        toolpath = polyline(seed, 25)
        for window in (0.0, 10.0):
            printer = smoothed(window)
            compiled, reference = (planner.task_for(toolpath, ROBOT, printer, MATERIAL, PROCESS, engine)
                                   for engine in ("compiled", "toppra"))
            for block in planner.blocks_of(compiled.grid, np.arange(len(compiled.grid.intervals) - 1)):
                ours, theirs = (_solved(task, block) for task in (compiled, reference))
                np.testing.assert_allclose(ours, theirs, atol=1e-5 * theirs.max())
                compared += len(ours)
    assert compared > 500


def smoothed(window_ms):
    return replace_in(PRINTER, motion=replace_in(PRINTER.motion, smoothing_ms=window_ms))


def replace_in(space, **changes):
    return SimpleNamespace(**{**vars(space), **changes})


def _solved(task, block):
    places = planner.nodes_at(task, block.move, block.sigma)
    ones = np.ones(len(block.step))
    return task.rules.solve(places, ones, planner._tops(task, block), block.step, block.offsets)[0]


def test_compiled_rules_are_the_array_rules():
    rng = np.random.default_rng(4)
    poses, d1, d2 = np.zeros((3, 400, 6))
    poses[:, :3] = rng.uniform(-150, 150, (400, 3)) - [0, 0, 150]
    d1[:, :3], d2[:, :3] = rng.normal(size=(2, 400, 3))
    nodes = Nodes(poses, d1, d2, rng.uniform(0, 0.1, 400), rng.uniform(1e3, 1e5, 400))
    limits = limits_of(PRINTER, MATERIAL)
    u, x = rng.uniform(-3e4, 3e4, 400), rng.uniform(0, 2e4, 400)
    compiled, arrays = CompiledRules(ROBOT, limits), array_rules(ROBOT, limits, recursion.retime)
    np.testing.assert_allclose(compiled.used(nodes, u, x), arrays.used(nodes, u, x), rtol=1e-9)


def test_leaving_out_what_cannot_bind_changes_nothing():
    """With a cap on acceleration most places are quiet: there the motion is the one with all rows."""
    capped = replace_in(PRINTER, motion=replace_in(PRINTER.motion, max_acceleration_mm_s2=5000.0))
    toolpath = print_like(2)
    quick = planner.task_for(toolpath, ROBOT, capped, MATERIAL, PROCESS, "compiled")
    careful = planner.task_for(toolpath, ROBOT, capped, MATERIAL, PROCESS, "compiled")
    careful.rules.quiet = lambda positions: np.zeros(len(positions), np.bool_)
    (block,) = planner.blocks_of(quick.grid, np.arange(len(quick.grid.intervals) - 1))
    assert quick.rules.quiet(planner.nodes_at(quick, block.move, block.sigma).poses[:, :3]).all()
    np.testing.assert_allclose(planner._plan_block(quick, block), planner._plan_block(careful, block), rtol=1e-9)


def test_rows_of_a_long_piece_made_in_parts_change_nothing(monkeypatch):
    toolpath = print_like(2)
    task = planner.task_for(toolpath, ROBOT, PRINTER, MATERIAL, PROCESS, "compiled")
    block = planner.block_of(task.grid, np.arange(len(toolpath.starts) - 1))
    task.rules.quiet = lambda positions: np.zeros(len(positions), np.bool_)
    ones = np.ones(len(block.step))
    whole = planner._solved(task, block, ones)
    for kept in (2, 7):
        monkeypatch.setattr("cabslice.timing.kernel.KEPT", kept)
        np.testing.assert_array_equal(planner._solved(task, block, ones), whole)


def test_pieces_planned_apart_are_those_planned_together(monkeypatch):
    toolpath, together = print_like(2), planned(print_like(2))
    assert len(toolpath.starts) > 3
    monkeypatch.setattr(planner, "BLOCK_NODES", 1)
    apart = planned(toolpath)
    for name in ("time", "s", "x", "move", "pieces"):
        np.testing.assert_array_equal(getattr(apart, name), getattr(together, name))


def test_toppra_as_engine_plans_the_same_motion():
    toolpath = polyline(5, 12)
    ours, theirs = planned(toolpath), planned(toolpath, engine="toppra")
    assert theirs.duration == pytest.approx(ours.duration, rel=1e-5)


def test_rest_has_slack_one_in_every_row():
    """Rows are scaled so that u = x = 0 is inside by exactly 1, and hold where a tension exists (LP)."""
    from scipy.optimize import linprog

    from cabslice.robot.wrench import required_wrench, wrench_matrix
    rng = np.random.default_rng(2)
    poses = np.zeros((6, 6))
    poses[:, :3] = rng.uniform(-150, 150, (6, 3)) - [0, 0, 150]
    d1, d2 = np.zeros((2, 6, 6))
    d1[:, :3], d2[:, :3] = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    free = replace(ROBOT, winders=None)
    limits = limits_of(PRINTER, MATERIAL)
    a, b, _ = rows(free, limits, Nodes(poses, d1, d2, np.zeros(6), np.full(6, np.inf)))
    agreed = 0
    for k in range(6):
        for u, x in zip(rng.uniform(-6e4, 6e4, 25), rng.uniform(0, 6e4, 25), strict=True):
            worst = (a[k] * u + b[k] * x).max()
            need = required_wrench(free, poses[[k]], d1[[k]] * 0, d1[[k]] * u + d2[[k]] * x)[0]
            answer = linprog(np.zeros(8), A_eq=wrench_matrix(free, poses[[k]])[0], b_eq=need,
                             bounds=list(zip(free.tension_min, free.tension_max, strict=True)))
            if worst <= 1.0:
                assert answer.status == 0
            if worst > 1 / (1 - 0.031):
                assert answer.status == 2
                agreed += 1
    assert agreed > 20


@pytest.mark.parametrize("seed", [0, 1])
def test_the_audit_passes_what_was_planned_and_the_motion_is_fast(seed):
    toolpath = print_like(seed)
    trajectory = planned(toolpath)
    verdict = judged(trajectory, toolpath, step_s=5e-4)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    assert verdict.margins["feature_speed_share"] > 0.95
    assert verdict.margins["motor_speed_share"] > 0.5          # no cap on acceleration: what the motors take up counts
    free = replace(ROBOT, winders=None)
    trajectory = plan(toolpath, free, PRINTER, MATERIAL, PROCESS)
    assert audit(trajectory, toolpath, free, PRINTER, MATERIAL, PROCESS, step_s=5e-4).ok
    accels = sample(trajectory, np.linspace(0, trajectory.duration, 20_000)).accels
    assert np.linalg.norm(accels, axis=1).max() > 2e4          # many times what a safe-everywhere acceleration allows


def test_stretch_that_the_motors_cannot_take_up_is_seen_and_cured_by_slowing():
    """Accelerations that cables and tensions bear, ramped in a millisecond: the motors would have to jump."""
    toolpath = print_like(0)
    hasty = replace(plan(toolpath, replace(ROBOT, winders=None), PRINTER, MATERIAL, PROCESS), window=1e-3)
    verdict = judged(hasty, toolpath)
    found = {finding.code: finding for finding in verdict.findings}
    assert {"motor-speed"} <= set(found) <= {"motor-speed", "motor-torque", "tension", "feature-speed", "speed"}
    assert found["motor-speed"].limit == ROBOT.winders.max_speed[0]
    assert "motor" in found["motor-speed"].sentence
    assert planner.plan(toolpath, ROBOT, PRINTER, MATERIAL, PROCESS).duration < 1.5 * hasty.duration


def test_motor_speeds_of_the_audit_are_those_of_the_motor_file():
    from cabslice.motors.stream import make_stream

    toolpath = print_like(0, turns=2)
    trajectory = planned(toolpath)
    blocks = list(make_stream(trajectory, ROBOT, period_s=2.5e-4, header={}))
    fastest = max(np.abs(block.velocity / ROBOT.winders.max_speed).max() for block in blocks)
    margins = judged(trajectory, toolpath, step_s=2.5e-4).margins
    assert margins["motor_speed_share"] == pytest.approx(fastest, rel=1e-2)
    heat = np.sqrt(sum((block.torque**2).sum(axis=0) for block in blocks) / sum(map(len, blocks)))
    assert margins["motor_heat_share"] == pytest.approx((heat / ROBOT.winders.continuous_torque).max(), rel=3e-3)
    slower = make_stream(trajectory, ROBOT, period_s=2e-3, header={})
    torque = max(np.abs(block.torque / ROBOT.winders.peak_torque).max() for block in slower)
    assert 0.95 * torque < judged(trajectory, toolpath).margins["motor_torque_share"] < 3 * torque


@given(st.integers(0, 10_000), st.integers(2, 30))
@settings(max_examples=15, deadline=None)
def test_no_random_path_breaks_a_limit_or_stops_inside_a_piece(seed, count):
    toolpath = polyline(seed, count)
    trajectory = planned(toolpath)
    verdict = judged(trajectory, toolpath, step_s=5e-4)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    ends = np.concatenate((trajectory.pieces[:-1], trajectory.pieces[1:] - 1))
    inner = np.setdiff1d(np.arange(len(trajectory.x)), ends)
    assert (trajectory.x[inner] > 1.0).all()
    assert (trajectory.x[ends] == 0).all()


def test_accelerations_are_the_finite_differences_of_the_positions():
    toolpath = print_like(1)
    trajectory = planned(toolpath)
    step = 2e-5
    times = np.random.default_rng(0).uniform(0.01, trajectory.duration - 0.01, 3000)
    low, here, high = (sample(trajectory, times + shift) for shift in (-step, 0, step))
    accel = (high.poses - 2 * here.poses + low.poses) / step**2
    around = np.stack((low.accels, here.accels, high.accels))
    inside = ((accel >= around.min(axis=0) - 30) & (accel <= around.max(axis=0) + 30)).all(axis=1)
    assert inside.mean() > 0.97          # the rest straddle a node, where the acceleration may step twice
    np.testing.assert_allclose((high.poses - low.poses) / (2 * step), here.rates, atol=1.0)


def test_threads_do_not_change_a_bit():
    toolpath = print_like(0)
    one, two = planned(toolpath), planned(toolpath, jobs=2)
    np.testing.assert_array_equal(one.time, two.time)


@pytest.mark.parametrize(("change", "code"), [
    (lambda t: replace(t, time=t.time * 0.9), "feature-speed"),
    (lambda t: replace(t, time=t.time / 3, x=t.x * 9, window=t.window / 3), "tension"),
    (lambda t: replace(t, to_pose=t.to_pose + np.array([420.0, 0, 0])), "tension"),
])
def test_the_audit_sees_a_spoilt_motion(change, code):
    toolpath = print_like(0)
    verdict = judged(change(planned(toolpath)), toolpath, step_s=5e-4)
    assert code in {finding.code for finding in verdict.findings}
    assert all("layer 0" in finding.sentence for finding in verdict.findings)


def test_a_path_the_platform_cannot_rest_on_is_refused_with_the_place():
    toolpath = polyline(points=[[0, 0, 1], [10, 0, 1], [900, 0, 1]], pieces=1)
    with pytest.raises(ImpossibleError, match=r"layer 0: no cable tensions .* nozzle near"):
        planned(toolpath)


def test_what_the_audit_still_finds_is_cured_by_slowing_that_piece_alone(monkeypatch):
    """A planner that looks away from its own middle places breaks limits; the proof slows the pieces concerned."""
    from cabslice.timing import proof

    hasty = planned(print_like(0))
    factor = np.where(np.arange(len(hasty.pieces) - 1) == 0, 0.8, 1.0)        # the first piece too fast
    monkeypatch.setattr(proof, "plan", lambda *args, **options: slowed(hasty, factor))
    toolpath = print_like(0)
    assert not judged(slowed(hasty, factor), toolpath).ok
    cured, verdict = proof.plan_proven(toolpath, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok
    assert judged(cured, toolpath, step_s=1e-3).ok
    spans = [np.diff(motion.time[[motion.pieces[1], motion.pieces[2] - 1]])[0] for motion in (hasty, cured)]
    assert spans[0] == pytest.approx(spans[1], abs=1e-9)


def test_the_audit_weighs_the_platform_in_the_gravity_of_the_robot():
    toolpath = print_like(0)
    trajectory = planned(toolpath)
    heavy = replace(ROBOT, gravity=np.array([0.0, 0.0, -3e5]))
    verdict = audit(trajectory, toolpath, heavy, PRINTER, MATERIAL, PROCESS)
    assert "tension" in {found.code for found in verdict.findings}


def test_the_audit_sees_speed_on_facets_shorter_than_its_step():
    """Moves too short for a whole difference to lie in one of them are judged by the fastest around."""
    angle = np.linspace(0, 2 * np.pi, 4001)
    circle = np.stack((40 * np.cos(angle), 40 * np.sin(angle), np.full(4001, 1.0)), axis=1)
    fast = polyline(points=circle, pieces=1, speed=100.0)
    slow = polyline(points=circle, pieces=1, speed=20.0)
    assert judged(planned(slow), slow).ok
    assert "feature-speed" in {found.code for found in judged(planned(fast), slow).findings}


def test_the_audit_sees_a_missing_pause_and_a_piece_begun_half_way():
    toolpath = print_like(0)
    paused = replace(toolpath, events=Events(toolpath.starts[[1]], [EventKind.DWELL], [5.0]))
    assert judged(planned(paused), paused).ok
    assert planned(paused).duration == pytest.approx(planned(toolpath).duration + 5.0)
    assert "dwell" in {found.code for found in judged(planned(toolpath), paused).findings}
    whole = planned(toolpath)
    cut = replace(whole, s=np.where(np.arange(len(whole.s)) == 0, 0.05, whole.s))
    assert "missed" in {found.code for found in judged(cut, toolpath).findings}


def test_a_motor_too_weak_for_the_least_tension_is_named():
    winders = replace(ROBOT.winders, continuous_torque=np.full(8, 10.0))
    with pytest.raises(ImpossibleError, match=r"cable \d: its motor cannot hold"):
        plan(print_like(0), replace(ROBOT, winders=winders), PRINTER, MATERIAL, PROCESS)


@pytest.mark.parametrize("step", [1e-12, 1e-9, 1e-6, 9e-4, 2e-3])
def test_vertices_that_are_one_do_not_slow_the_piece(step):
    """A corner, its end and its middle given many times, some hair apart: as fast as without."""
    plain = polyline(points=[[0, 0, 1], [20, 0, 1], [20, 20, 1]], pieces=1)
    hair = np.array([step, 0, 0])
    steps = [(0, 0, 0), (8, 0, 0), (8, 0, 1), (8, 0, 2), (8, 0, 3), (20, 0, 0), (20, 0, -1), (20, 0, 1), (20, 20, 0),
             (20, 20, 1)]
    points = [np.array([x, y, 1.0]) + k * hair for x, y, k in steps]
    doubled = polyline(points=points, pieces=1)
    trajectory = planned(doubled)
    verdict = judged(trajectory, doubled)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    assert trajectory.duration == pytest.approx(planned(plain).duration, rel=1e-3 if step < 1e-3 else 0.3)


@pytest.mark.parametrize(("move", "filament"), [(0.0, 1e-300), (0.0, -1e-12), (0.0, 0.0), (1e-12, 0.0), (1e-12, 0.8),
                                                (1e-7, 1e-9), (1e-300, 1e-300), (5e-4, 1e-4)])
def test_a_piece_of_next_to_nothing_takes_next_to_no_time(move, filament):
    points = np.array([[0, 0, 1], [20, 0, 1], [20 + move, 0, 1], [20 + move, 20, 1]])
    path = toolpath(points, np.array([0, 0.5, filament, 0.5]), np.array([1, 2, 3, 4]))
    trajectory = planned(path)
    verdict = judged(trajectory, path)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    rest = planned(toolpath(points[[0, 1, 3]], np.array([0, 0.5, 0.5]), np.array([1, 2, 3]))).duration
    assert rest < trajectory.duration < rest + 0.02 + 2 * np.sqrt(abs(filament) / 1500) + abs(filament) / 60


def layered(seconds, least_speed, *, layers=4, side=10.0):
    """Squares on each other, with a travel between two of them: about half a second each."""
    square = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    points = [np.array([x + 0.5 * k, y, 0.2 * (k + 1)]) for k in range(layers) for x, y in square]
    bead = np.array([FEED * side if k % 5 else 0.0 for k in range(5 * layers)])
    starts = np.array([1, 5, *(row for k in range(1, layers) for row in (5 * k + 1, 5 * k + 5))])
    path = replace(toolpath(np.array(points), bead, np.unique(starts)), layer=np.repeat(np.arange(layers), 5))
    rows = np.flatnonzero(np.diff(path.layer, prepend=-1))
    events = Events(np.append(0, rows), [EventKind.MIN_PRINT_SPEED, *[EventKind.MIN_LAYER_TIME] * layers],
                    [least_speed, *[seconds] * layers])
    return replace(path, events=events)


@pytest.mark.parametrize(("seconds", "least_speed"), [(0.3, 10.0), (1.5, 10.0), (9.0, 10.0), (3.0, 500.0)])
def test_a_layer_takes_the_time_asked_for_it_slowed_and_then_waited(seconds, least_speed):
    path = layered(seconds, least_speed)
    plain, trajectory = planned(replace(path, events=Events.none())), planned(path)
    verdict = judged(trajectory, path)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    begins = [trajectory.time[trajectory.pieces[np.searchsorted(path.starts, row)]] for row in (1, 5, 10, 15)]
    spans = np.diff(begins)
    assert (spans >= seconds - 1e-6).all()
    own = np.diff([plain.time[plain.pieces[np.searchsorted(path.starts, row)]] for row in (1, 5, 10, 15)])
    np.testing.assert_allclose(spans, np.maximum(own, seconds), atol=1e-6)
    beads = np.flatnonzero((path.filament > 0)[trajectory.move[:-1]])
    ratio = np.sqrt(plain.x[beads] / np.maximum(trajectory.x[beads], 1e-12))[plain.x[beads] > 1]
    assert ratio.max() <= max(1.0, 100.0 / least_speed) + 1e-9         # no bead below the least speed
    if seconds == 1.5:
        assert ratio.min() > 1.5


def test_the_audit_sees_a_layer_that_is_over_too_soon():
    path = layered(3.0, 10.0)
    hasty = planned(replace(path, events=Events.none()))
    assert "layer-time" in {finding.code for finding in judged(hasty, path).findings}
