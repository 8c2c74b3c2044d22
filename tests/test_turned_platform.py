"""A platform that is turned while it prints: bounds that hold, and a chain that is right from pose to motors."""

from dataclasses import replace

import numpy as np
import pytest
from feasibility_cases import box_loop, frame_robot, part_contacts, sampled_distance, stacked, toolpath_of
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice import pipeline, store
from cabslice.errors import ProfileError
from cabslice.feasibility import judges
from cabslice.feasibility.bodies import body_of, cables_and, swept_bodies
from cabslice.feasibility.check import check, grown
from cabslice.feasibility.exits import ends_of, hung_boxes, lines_at
from cabslice.feasibility.obstacles import laying
from cabslice.motors.check import played_lengths
from cabslice.profile import shelf
from cabslice.robot.forward import forward
from cabslice.robot.model import nozzle_places, nozzle_poses, robot_from_printer
from cabslice.robot.rotation import matrix, vector
from cabslice.robot.turning import Turning
from cabslice.timing.audit import audit
from cabslice.timing.trajectory import sample

SEEDS = st.integers(0, 2**32 - 1)
JUDGES = {
    "pulleys": judges.pulleys,
    "ends": lambda robot: judges.ends_over_bed(robot, grown(robot)),
    "pairs": judges.cable_pairs,
    "tensions": judges.tensions,
}


def turning(rng, degrees=8.0):
    knots = [-150.0, 0.0, 150.0], [-150.0, 150.0], [0.0, 100.0, 180.0, 300.0]
    return Turning(*map(np.array, knots), np.radians(rng.uniform(-degrees, degrees, (3, 2, 4, 3))))


def constant(robot, degrees):
    """The same robot turned everywhere; and a level robot whose platform has that shape."""
    field = Turning(np.zeros(1), np.zeros(1), np.zeros(1), np.radians(np.reshape(degrees, (1, 1, 1, 3))))
    turn = field.matrices(np.zeros((1, 3)))[0]
    shape = replace(
        robot, attachments=robot.attachments @ turn.T, nozzle=turn @ robot.nozzle,
        centre_of_mass=turn @ robot.centre_of_mass, inertia=turn @ robot.inertia @ turn.T,
        bodies=tuple((name, corners @ turn.T) for name, corners in robot.bodies))
    return replace(robot, turning=field), shape


# ---- the field

@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_rates_are_those_of_the_matrices_and_the_bound_on_changes_holds(seed):
    rng = np.random.default_rng(seed)
    field, curve, h = turning(rng), rng.normal(size=(3, 3)) * [[100.0], [60.0], [20.0]], 1e-4
    s, start = np.linspace(-1, 1, 31), np.array([0.0, 0.0, 150.0])

    def along(t):
        return start + np.stack((t, t**2, t**3), axis=1) @ curve

    d1 = np.stack((np.ones_like(s), 2 * s, 3 * s**2), axis=1) @ curve
    d2 = np.stack((np.zeros_like(s), np.full_like(s, 2.0), 6 * s), axis=1) @ curve
    omega, alpha = field.rates(along(s), d1, d2)
    before, now, after = (field.matrices(along(s + t)) for t in (-h, 0.0, h))
    spun = vector(after @ before.swapaxes(1, 2)) / (2 * h)
    np.testing.assert_allclose(omega, spun, atol=1e-5 * (1 + np.abs(omega).max()))
    bend = vector(after @ now.swapaxes(1, 2)) - vector(now @ before.swapaxes(1, 2))
    near = np.abs(along(s)[:, None, 2] - field.z).min(axis=1) > 0.1           # the third derivative jumps at knots
    np.testing.assert_allclose(alpha[near], bend[near] / h**2, atol=1e-3 * (1 + np.abs(alpha).max()))
    middle, half = rng.uniform(-200, 350, (50, 3)), rng.uniform(0, 60, (50, 3))
    limit = field.change(middle - half, middle, middle + half)
    for _ in range(30):
        other = field.matrices(middle + rng.uniform(-1, 1, (50, 3)) * half)
        moved = np.linalg.norm(vector(other @ field.matrices(middle).swapaxes(1, 2)), axis=1)
        assert (moved <= limit + 1e-12).all()


def test_the_nozzle_is_where_it_was_asked_to_be():
    rng = np.random.default_rng(5)
    robot = replace(frame_robot(), turning=turning(rng))
    places = rng.uniform([-150, -150, 0], [150, 150, 250], (50, 3))
    poses = nozzle_poses(robot, places)
    np.testing.assert_allclose(nozzle_places(robot, poses), places, atol=1e-9)
    assert np.abs(poses[:, 3:]).max() > 0.05


# ---- the check

@pytest.mark.parametrize("name", JUDGES)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS, pulley=st.sampled_from([0.0, 25.0]), crossed=st.booleans())
def test_what_is_proven_in_a_ball_holds_at_its_places(name, seed, pulley, crossed):
    rng = np.random.default_rng(seed)
    robot = frame_robot(pulley=pulley, crossed=crossed)
    robot = replace(robot, turning=turning(rng, 5.0), centre_of_mass=np.array([5.0, -3.0, 20.0]))
    judge = JUDGES[name](robot)
    places, radii = rng.uniform([-300, -300, 0], [300, 300, 400], (40, 3)), rng.choice([0.2, 2.0, 8.0, 20.0], 40)
    excess, proven = judge(places, radii)
    assert (proven <= excess + 1e-9).all()
    ways = rng.normal(size=(30, 40, 3))
    ways *= radii[:, None] / np.linalg.norm(ways, axis=2, keepdims=True)
    for way in ways:
        assert (judge(places + way, np.zeros(40))[0] >= proven - 1e-9).all()


def test_a_platform_turned_alike_everywhere_is_one_of_another_shape():
    robot = frame_robot(pulley=25.0)
    hull = np.array([[x, y, z] for x in (-20, 20) for y in (-30, 30) for z in (-90.0, -20.0)])
    robot = replace(robot, bodies=(("print head", hull),), centre_of_mass=np.array([1.0, 2.0, 10.0]))
    turned, shape = constant(robot, (3.0, -2.0, 8.0))
    path = stacked([[box_loop(60, 40, centre=(20.0, 10.0))]] * 30, height=1.0)
    one, other = check(path, turned, far=30.0), check(path, shape, far=30.0)
    assert one.ok == other.ok
    assert one.margins.keys() == other.margins.keys()
    for key, value in one.margins.items():
        assert value == pytest.approx(other.margins[key], abs=1e-6), key


@settings(max_examples=8, deadline=None)
@given(seed=SEEDS, pulley=st.sampled_from([0.0, 25.0]))
def test_the_ends_of_cables_stay_as_near_to_their_middle_as_is_said(seed, pulley):
    """Along straight moves of the nozzle, while the platform turns."""
    rng = np.random.default_rng(seed)
    robot = replace(frame_robot(pulley=pulley), turning=turning(rng))
    start = rng.uniform([-150, -150, 0], [150, 150, 250], (60, 3))
    end, cable = start + rng.normal(size=(60, 3)) * rng.choice([1.0, 5.0, 15.0], (60, 1)), rng.integers(0, 8, 60)
    ends, every = ends_of(robot, start, end, cable), np.arange(60)
    low, high = hung_boxes(robot, np.minimum(start, end), np.maximum(start, end))
    for share in np.linspace(0, 1, 21):
        xyz = start + share * (end - start)
        lines = lines_at(robot, xyz)
        tips, exits = (column[every, cable] - robot.bed_origin for column in (lines.tip, lines.exit))
        assert (np.linalg.norm(tips - xyz - ends.hung, axis=1) <= ends.spread + 1e-9).all()
        assert (np.linalg.norm(exits - ends.exits, axis=1) <= ends.drift + 1e-9).all()
        assert (tips - xyz >= low[every, cable] - 1e-9).all()
        assert (tips - xyz <= high[every, cable] + 1e-9).all()


@pytest.mark.parametrize(("seed", "pulley"), [(1, 0.0), (2, 25.0)])
def test_what_is_called_free_is_never_met_and_what_is_called_blocked_is(seed, pulley):
    """Moves through a field that turns on the way, beside a tower; a judge that samples poses."""
    rng = np.random.default_rng(seed)
    robot = replace(frame_robot(pulley=pulley, height=50.0, clearance=0.0), turning=turning(rng))
    tower = stacked([[box_loop(10, centre=(150.0, 150.0))]] * 2, height=40.0, width=1.0)
    moves = np.array([-90.0, -40.0, 87.0]) + rng.uniform([-35, -35, -5], [35, 35, 5], (16, 3))
    path = toolpath_of(np.vstack((tower.xyz, moves)), np.append(tower.filament > 0, np.zeros(16, bool)),
                       np.append(tower.layer, np.full(16, 2)), width=1.0, height=40.0)
    met = part_contacts(path, robot, grown(robot))
    rows = np.arange(len(tower.xyz) + 1, len(path.xyz)).tolist()
    blocked = {int(row) for row, cable in zip(_rows(path, robot)[met.move], met.cable, strict=True) if cable == 4}
    assert 0 < len(blocked & set(rows)) < len(rows)
    beads = np.flatnonzero(laying(path))
    for row in rows:
        least = sampled_distance(robot, path, row, 4, beads, grid=33, rounds=4)
        assert least <= grown(robot)[4] + 0.05 if row in blocked else least > grown(robot)[4] - 1e-6


def _rows(path, robot):
    from feasibility_cases import part_trees

    return part_trees(path, robot)[0].items.move


def test_bodies_are_as_large_as_all_the_ways_they_are_turned():
    rng = np.random.default_rng(2)
    hull = np.array([[x, y, z] for x in (-20, 20) for y in (-30, 30) for z in (-90.0, -20.0)])
    robot = replace(frame_robot(pulley=25.0), bodies=(("print head", hull),), turning=turning(rng))
    low, high = np.array([-100.0, -100.0, 0.0]), np.array([100.0, 100.0, 200.0])
    (body,) = swept_bodies(robot, low, high)
    places = rng.uniform(low, high, (200, 3))
    corners = robot.turning.matrices(places) @ (hull - robot.nozzle).T
    assert (np.einsum("fi,kiv->kfv", body.normals, corners) <= body.offsets[:, None] + body.pad).all()
    judge = cables_and(robot, [body_of("head", hull - robot.nozzle)], grown(robot), moving=True)
    radii = np.full(len(places), 5.0)
    _, proven = judge(places, radii)
    for _ in range(20):
        way = rng.normal(size=places.shape)
        there = places + 5.0 * way / np.linalg.norm(way, axis=1, keepdims=True)
        assert (judge(there, np.zeros(len(there)))[0] >= proven - 1e-6).all()


# ---- the chain

TURN = [
    "platform.turn.x_mm=[-20,20]", "platform.turn.z_mm=[0,60,300]",
    "platform.turn.angles_deg=[[0,-4,3],[1,-4,6],[0,0,0],[0,4,3],[-1,4,9],[0,0,0]]",
]
QUICK = ["layer_mm=0.3", "infill=0", "top_layers=0", "bottom_layers=1", "walls=1", "skirt_loops=0"]


@pytest.fixture(scope="module")
def planned():
    profiles = pipeline.load_profiles("cabfab-optim", None, None, [*TURN, *QUICK])
    return pipeline.to_plan(pipeline.read("samples/cube.stl", profiles, pipeline.Placement(scale=0.1)))


def test_the_audit_proves_a_turned_print_and_its_tensions(planned):
    plan, verdict = planned
    assert verdict.ok
    turned = sample(plan.trajectory, np.linspace(0, plan.trajectory.duration, 2000)).poses[:, 3:]
    assert np.degrees(np.abs(turned)).max() > 4.0
    assert verdict.margins["acceleration_share"] <= 1.0
    assert verdict.margins["tension_share"] < 1.0


def test_rates_and_accelerations_of_the_motion_are_those_of_its_poses(planned):
    trajectory, h = planned[0].trajectory, 1e-5
    times = np.linspace(0.2, trajectory.duration - 0.2, 400)
    before, now, after = (sample(trajectory, times + t) for t in (-h, 0.0, h))
    np.testing.assert_allclose((after.poses - before.poses)[:, :3] / (2 * h), now.rates[:, :3], atol=0.5)
    spin = vector(matrix(after.poses[:, 3:]) @ matrix(before.poses[:, 3:]).swapaxes(1, 2)) / (2 * h)
    np.testing.assert_allclose(spin, now.rates[:, 3:], atol=1e-3)
    np.testing.assert_allclose((after.rates - before.rates)[:, 3:] / (2 * h), now.accels[:, 3:], atol=0.5)


def test_motor_angles_bring_the_nozzle_to_the_path_and_the_platform_to_its_turn(planned):
    plan, verdict = planned
    robot, period = pipeline.robot_of(plan), 0.004
    stream = pipeline.to_stream(plan, verdict, period_s=period)
    lead = int(stream.header["lead_rows"])
    off, turn = [], []
    for block in stream:
        rows = np.arange(0, len(block), 50)
        lengths = played_lengths(robot, block.angle[rows], block.tension[rows])
        times = np.clip((block.row + rows - lead) * period, 0.0, plan.trajectory.duration)
        wanted = sample(plan.trajectory, times).poses
        found = forward(robot, lengths, wanted + 0.01 * robot.freedoms).poses
        xyz = nozzle_places(robot, found)
        off.append(np.abs(xyz - nozzle_places(robot, wanted)).max())
        turn.append(np.abs(vector(matrix(found[:, 3:]) @ robot.turning.matrices(xyz).swapaxes(1, 2))).max())
    assert max(off) < 1e-4
    assert max(turn) < 1e-6
    assert np.allclose(stream.header["start_pose"][3:], 0.0)


def test_the_audit_does_not_take_the_planners_word(planned):
    """A motion that is turned otherwise than it was checked, or about another point; weight that pulls elsewhere."""
    plan, verdict = planned
    given, right = pipeline.stages._given(plan), plan.trajectory
    other = replace(right.turning, angles=1.001 * right.turning.angles)
    for wrong, code in (
        (replace(right, turning=None), "turn"), (replace(right, turning=other), "turn"),
        (replace(right, nozzle=right.nozzle + np.array([0.0, 5.0, 0.0])), "path"),
    ):
        assert code in {finding.code for finding in audit(wrong, *given).findings}
    heavy = replace(given[1], centre_of_mass=np.array([80.0, 0.0, 0.0]))
    assert audit(right, given[0], heavy, *given[2:]).margins["tension_share"] > verdict.margins["tension_share"] + 0.01


def test_a_plan_keeps_its_turn_in_its_file(planned, tmp_path):
    plan, _ = planned
    store.save(plan, tmp_path / "a.plan")
    other = store.load(tmp_path / "a.plan")[1]
    times = np.linspace(0, plan.trajectory.duration, 50)
    np.testing.assert_array_equal(sample(other.trajectory, times).poses, sample(plan.trajectory, times).poses)


# ---- profiles

@pytest.mark.parametrize(("sets", "words"), [
    (["platform.turn.z_mm=[0,300]", "platform.turn.angles_deg=[[0,0,1]]"], "angles for 2 knots, found 1"),
    (["platform.turn.z_mm=[9,5]", "platform.turn.angles_deg=[[0,0,1],[0,0,0]]"], "rising"),
    (["platform.turn.z_mm=[0,300]", "platform.turn.angles_deg=[[0,6,1],[0,0,0]]"], "platform.tilt_max_deg = 5"),
    (["platform.turn.z_mm=[0,300]", "platform.turn.angles_deg=[[0,0,20],[0,0,0]]"], "platform.yaw_max_deg = 15"),
])
def test_a_turn_that_cannot_be_is_refused(sets, words):
    with pytest.raises(ProfileError, match=words):
        shelf.load_printer("cabfab-optim", sets)


def test_a_platform_that_is_not_level_at_home_is_refused():
    printer = shelf.load_printer("cabfab-optim", ["platform.turn.angles_deg=[[0,0,8]]"])
    with pytest.raises(ProfileError, match="level platform at home"):
        robot_from_printer(printer)
    level = shelf.load_printer("cabfab-optim", ["platform.turn.angles_deg=[[0,0,0]]"])
    assert robot_from_printer(level).turning is None
