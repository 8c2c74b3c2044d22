"""The whole check: proofs that hold around a place, verdicts that are right at both sides of a limit."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from feasibility_cases import box_loop, frame_robot, robot_of, stacked, toolpath_of, until
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from cabslice.errors import InputError, ProfileError
from cabslice.feasibility import judges
from cabslice.feasibility.check import check, grown
from cabslice.feasibility.fits import fits
from cabslice.feasibility.obstacles import Moves
from cabslice.feasibility.survey import WIDTHS, Pieces, cells_of, explore, first_cells, first_failure
from cabslice.feasibility.sweep import FAR
from cabslice.robot.model import nozzle_poses
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import required_wrench, wrench_matrix
from cabslice.slicing.layer import Role

SEEDS = st.integers(0, 2**32 - 1)
JUDGES = {
    "pulleys": judges.pulleys,
    "ends": lambda robot: judges.ends_over_bed(robot, grown(robot)),
    "pairs": judges.cable_pairs,
    "tensions": judges.tensions,
}
MARGINS = {
    "nozzle_bed_mm", "pulley_mm", "tension_n", "tension_printed_n", "cable_cable_mm", "cable_bed_mm",
    "cable_end_bed_mm", "cable_part_mm",
}


@pytest.mark.parametrize("name", JUDGES)
@settings(max_examples=8, deadline=None)
@given(seed=SEEDS, pulley=st.sampled_from([0.0, 25.0]), crossed=st.booleans())
def test_what_is_proven_in_a_ball_holds_at_its_places(name, seed, pulley, crossed):
    rng = np.random.default_rng(seed)
    robot = frame_robot(pulley=pulley, crossed=crossed)
    judge = JUDGES[name](robot)
    places, radii = rng.uniform([-300, -300, 0], [300, 300, 400], (40, 3)), rng.choice([0.2, 2.0, 8.0, 20.0], 40)
    excess, proven = judge(places, radii)
    assert (proven <= excess + 1e-9).all()
    ways = rng.normal(size=(30, 40, 3))
    ways *= radii[:, None] / np.linalg.norm(ways, axis=2, keepdims=True)
    for way in ways:
        assert (judge(places + way, np.zeros(40))[0] >= proven - 1e-9).all()


@pytest.mark.parametrize("name", JUDGES)
def test_proofs_lose_nothing_where_balls_shrink(name):
    robot = frame_robot(pulley=25.0)
    places = np.random.default_rng(1).uniform([-150, -150, 0], [150, 150, 300], (50, 3))
    excess, proven = JUDGES[name](robot)(places, np.full(50, 1e-7))
    used = judges.USED if name == "tensions" else 1.0
    good = np.isfinite(excess) & (excess > 0)
    assert (proven[good] >= used * excess[good] - 1e-4).all()


def test_tension_proofs_reach_across_whole_cells():
    """Else the survey would fall back to judging every millimetre."""
    places = np.random.default_rng(2).uniform([-120, -120, 0], [120, 120, 200], (50, 3))
    _, proven = judges.tensions(frame_robot(pulley=25.0))(places, np.full(50, 14.0))
    assert (proven > 0).mean() > 0.9


def test_cables_that_cross_closely_are_proven_apart_in_whole_cells():
    """They keep their distance wherever the nozzle goes: the direction between them turns with them."""
    places = np.random.default_rng(3).uniform([-100, -100, 0], [100, 100, 200], (50, 3))
    excess, proven = judges.cable_pairs(frame_robot(pulley=25.0, crossed=True))(places, np.full(50, 14.0))
    assert excess.min() < 3.0
    assert (proven.min(axis=1) > 0.5 * excess.min(axis=1)).all()


# ---- the survey

def random_moves(rng, count=60):
    points = rng.uniform(-60, 60, (count + 1, 3))
    return Moves(points[:-1], points[1:], np.zeros(count, int), np.arange(1, count + 1))


def to_a_point(target, limit):
    """Distance to a point: changes by no more than the nozzle moves."""

    def judge(places, radii):
        excess = np.linalg.norm(places - target, axis=1)[:, None] - limit
        return excess, excess - radii[:, None]

    return judge


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_cells_hold_the_whole_path_and_their_place_is_on_it(seed):
    rng = np.random.default_rng(seed)
    moves = random_moves(rng)
    cells = cells_of(Pieces(moves.start, moves.end, np.arange(60)), 8.0)
    lengths = np.linalg.norm(cells.pieces.end - cells.pieces.start, axis=1)
    assert lengths.sum() == pytest.approx(np.linalg.norm(moves.end - moves.start, axis=1).sum())
    cell = np.repeat(np.arange(len(cells.radius)), np.diff(cells.starts))
    for ends in (cells.pieces.start, cells.pieces.end):
        assert (np.linalg.norm(ends - cells.place[cell], axis=1) <= cells.radius[cell] + 1e-9).all()
    start, way = moves.start[cells.move], (moves.end - moves.start)[cells.move]
    share = np.einsum("ki,ki->k", cells.place - start, way) / np.einsum("ki,ki->k", way, way)
    assert np.abs(start + share[:, None] * way - cells.place).max() < 1e-9
    assert ((share > 0) & (share < 1)).all()


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_a_survey_finds_the_least_margin_and_proves_it(seed):
    """Against the exact distance of each move to the point."""
    rng = np.random.default_rng(seed)
    moves, target, limit = random_moves(rng), rng.uniform(-60, 60, 3), float(rng.uniform(1, 25))
    way = moves.end - moves.start
    share = np.clip(np.einsum("ki,ki->k", target - moves.start, way) / np.einsum("ki,ki->k", way, way), 0, 1)
    exact = np.linalg.norm(moves.start + share[:, None] * way - target, axis=1) - limit
    found = explore(first_cells(moves), to_a_point(target, limit), cap=4.0)
    assert found.worst[0] >= exact.min() - 1e-9
    if exact.min() < -0.3:
        assert found.worst[0] < 0
        assert exact[found.move[0]] < 0
        row, excess = first_failure(found.failing, to_a_point(target, limit))
        assert exact[row] < 0
        assert excess[0] < 0
        assert (exact[:row] > -0.5).all()         # nothing before it fails by more than half a stretch can hide
    if exact.min() > 0.1:
        assert found.worst[0] > 0
        assert not len(found.failing.move)
        finest = WIDTHS[-1] * np.sqrt(3)
        assert min(0.8 * min(4.0, exact.min()), exact.min() - finest) - 1e-9 <= found.proven <= exact.min() + 1e-9


# ---- verdicts

@pytest.fixture(scope="module")
def small():
    return stacked([[box_loop(30), box_loop(29)]] * 10)


def test_a_small_part_in_the_middle_is_right_with_all_margins_and_all_checks_named(small):
    verdict = check(small, frame_robot(pulley=25.0))
    assert verdict.ok
    assert set(verdict.margins) == MARGINS
    assert all(margin > 0 for margin in verdict.margins.values())
    assert len(verdict.checked) == 10
    made, not_made = verdict.checked[:8], verdict.checked[8:]
    assert all(any(sign.isdigit() for sign in sentence) for sentence in made)
    assert all(sentence.startswith("Not checked, as the printer profile gives no shape: ") for sentence in not_made)


def test_nothing_to_check_is_an_error_and_never_a_yes(small):
    bare = toolpath_of(small.xyz, np.zeros(len(small.xyz)), small.layer)
    with pytest.raises(InputError, match="none of its 101 moves lays material"):
        check(bare, frame_robot())
    one = toolpath_of(small.xyz[:1], [False], [0])
    with pytest.raises(InputError, match="at least one bead"):
        check(one, frame_robot())
    for missing in ("nozzle", "bed_origin", "bed_size"):
        with pytest.raises(ProfileError, match="it has no"):
            check(small, replace(frame_robot(), **{missing: None}))


def test_the_nozzle_off_the_plate_and_below_it_is_named(small):
    moved = toolpath_of(small.xyz + np.array([190.0, 0, 0]), small.filament > 0, small.layer)
    found = [f for f in check(moved, frame_robot()).findings if f.code == "bed"]
    assert [(f.value, f.limit) for f in found] == [(205.0, 200.0)]
    assert "x 205.00 mm" in found[0].sentence
    sunk = toolpath_of(small.xyz - np.array([0, 0, 0.5]), small.filament > 0, small.layer)
    assert any("below the bed" in f.sentence for f in check(sunk, frame_robot()).findings)


def block(layers, *, size=250.0, height=6.0):
    return stacked([[box_loop(size), box_loop(size - 2)]] * layers, width=2.0, height=height)


def test_the_first_blocked_layer_is_the_first():
    """The same print is right if it ends below that layer, and blocked if it ends with it; value and limit are told."""
    robot, path = frame_robot(pulley=25.0), block(40)
    found = [f for f in check(path, robot).findings if f.code == "cable-part"]
    assert found
    assert found[0].value - found[0].limit == min(f.value - f.limit for f in found)
    first = min(int(f.sentence.split("layers ")[1].split(" ")[0]) for f in found)
    assert check(until(path, first - 1), robot).ok
    again = check(until(path, first), robot)
    assert {f.layer for f in again.findings} == {first}
    assert {f.cable for f in again.findings} <= {5, 6, 7, 8}
    for finding in (*found, *again.findings):
        assert finding.limit == pytest.approx(2.27)
        assert finding.value <= finding.limit
        assert f"cable {finding.cable} " in finding.sentence
        assert f"layer {finding.layer} " in finding.sentence
    assert again.margins["cable_part_mm"] == min(f.value - f.limit for f in again.findings)


def test_a_search_that_stops_says_so():
    verdict = check(block(90, height=3.0), frame_robot())
    assert not verdict.ok
    assert len([s for s in verdict.checked if s.startswith("Cables against the part")]) == 1
    whole = check(block(8), frame_robot())
    assert not any("stopped" in sentence for sentence in whole.checked)


def missing_newtons(robot, xyz):
    """Least nu such that tensions within the bounds widened by nu balance: a linear programme."""
    pose = nozzle_poses(robot, np.array([xyz]))
    w, m = wrench_matrix(robot, pose)[0], robot.cables
    widen = -np.ones((m, 1))
    limits = np.block([[np.eye(m), widen], [-np.eye(m), widen]])
    done = linprog(
        np.append(np.zeros(m), 1), limits, np.concatenate((robot.tension_max, -robot.tension_min)),
        np.hstack((w, np.zeros((6, 1)))), required_wrench(robot, pose)[0], bounds=[(None, None)] * (m + 1),
    )
    return done.fun


def test_where_no_tension_holds_the_platform_the_worst_place_is_told_with_cable_and_newtons():
    """A lifted travel carries the nozzle out of the workspace; against a linear programme."""
    robot = frame_robot(pulley=25.0)
    base = stacked([[box_loop(30)]] * 3)
    away = np.array([[15.0, 15.0, 60.0], [150.0, 150.0, 500.0], [180.0, 180.0, 800.0], [0.0, 0.0, 60.0]])
    path = toolpath_of(
        np.vstack((base.xyz, away)), np.append(base.filament > 0, np.zeros(4)), np.append(base.layer, [2] * 4),
    )
    verdict = check(path, robot)
    found = [f for f in verdict.findings if f.code == "tension"]
    assert len(found) == 1
    finding = found[0]
    missing = missing_newtons(robot, finding.xyz)
    assert missing > 0
    assert abs(finding.value - finding.limit) == pytest.approx(missing, abs=1e-4)
    assert verdict.margins["tension_n"] == pytest.approx(-missing, abs=1e-4)
    assert f"cable {finding.cable}" in finding.sentence
    assert finding.unit == "N"
    share = np.linspace(0, 1, 20)[:, None]
    places = np.concatenate([a + share * (b - a) for a, b in pairwise(away)])
    assert max(missing_newtons(robot, xyz) for xyz in places) <= missing + 1.0


def test_cables_that_meet_are_found_between_the_vertices():
    """With the nozzle at (0, 0, 50), in the middle of a long travel, both cables go through (120, -18, 139)."""
    anchors, attachments = [[400.0, -200.0, 300.0], [300.0, -72.0, 346.0]], [[0.0, 60.0, 20.0], [60.0, 0.0, 20.0]]
    robot = robot_of(anchors, attachments, radius=0.5, clearance=0.5)
    judge = judges.cable_pairs(robot)
    ends = np.array([[-140.0, -140.0, 50.0], [140.0, 140.0, 50.0]])
    moves = Moves(ends[:1], ends[1:], np.zeros(1, int), np.ones(1, int))
    sampled = judge(ends[0] + np.linspace(0, 1, 20001)[:, None] * (ends[1] - ends[0]), np.zeros(20001))[0]
    found = explore(first_cells(moves), judge, cap=3.0)
    assert sampled[[0, -1], 0].min() > 5.0
    assert sampled[:, 0].min() < -1.4
    assert -1.5 <= found.worst[0] < 0
    assert np.abs(found.where[0, :2]).max() < 20


def test_pairs_that_share_an_end_are_left_out_and_that_is_said(small):
    robot = frame_robot()
    joined = replace(robot, attachments=robot.attachments[[0, 0, 2, 3, 4, 5, 6, 7]])
    sentences = [s for s in check(small, joined).checked if "against each other" in s]
    assert len(sentences) == 1
    assert "27 pairs (1 pairs share an end" in sentences[0]


def test_a_bed_too_large_for_the_cables_is_named(small):
    """Cables from pulleys under the plate cannot come up; those from beside it cross its edge."""
    for size, code, margin in ((1200.0, "cable-end", "cable_end_bed_mm"), (800.0, "cable-bed", "cable_bed_mm")):
        verdict = check(small, frame_robot(bed=size))
        assert {f.code for f in verdict.findings} == {code}
        assert {f.cable for f in verdict.findings} == {5, 6, 7, 8}
        assert verdict.margins[margin] < 0


def test_a_cable_that_cannot_leave_its_pulley_is_named_and_the_rest_said_to_be_unchecked():
    robot = frame_robot(pulley=25.0, bed=1100.0)
    path = stacked([[box_loop(30.0, centre=(-405.0, -470.0))]])
    verdict = check(path, robot)
    assert any(f.code == "pulley" and f.cable in (3, 7) for f in verdict.findings)
    assert verdict.checked[-1].startswith("Not checked")
    assert not verdict.ok


def test_progress_reaches_its_total_and_never_falls(small):
    told = []
    check(small, frame_robot(), progress=lambda done, total: told.append(done / total))
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_the_same_path_gives_the_same_verdict():
    robot = frame_robot(pulley=25.0)
    assert check(block(40), robot) == check(block(40), robot)


# ---- what a user is told

def test_a_part_larger_than_the_bed_or_the_frame_is_refused_by_its_box():
    robot = frame_robot(pulley=25.0)
    verdict = fits(np.array([[-300.0, -100, 0], [300, 100, 50]]), robot)
    assert [(f.code, f.value, f.limit) for f in verdict.findings] == [("bed", 300.0, 200.0)]
    assert "66.7 %" in verdict.findings[0].help
    tall = fits(np.array([[-10.0, -10, 0], [10, 10, 1100]]), robot)
    assert [f.code for f in tall.findings] == ["tension"]
    assert tall.findings[0].limit == pytest.approx(960 + 50 - 97.5)      # highest pulley, lowest attachment
    limit = tall.findings[0].limit
    assert missing_newtons(robot, np.array([0.0, 0.0, limit])) > 0
    assert fits(np.array([[-200.0, -200, 0], [200, 200, 900]]), robot).ok


def test_the_feature_that_leaves_the_bed_is_named(small):
    roles = np.where(small.layer == 0, Role.SKIRT, Role.OUTER_WALL)
    wide = small.xyz * np.where(small.layer == 0, 14.0, 1.0)[:, None] * [1, 0, 1] + small.xyz * [0, 1, 0]
    found = check(replace(small, xyz=wide, role=roles), frame_robot()).findings
    assert [f.code for f in found] == ["bed"]
    assert "skirt" in found[0].sentence
    assert "skirt_loops=0" in found[0].help


def test_a_skirt_in_the_way_is_called_a_skirt_and_not_the_part():
    """A tall fence, then a small part, below a platform that hangs low."""
    path = stacked([[box_loop(330.0)]] * 15 + [[box_loop(20.0)]], width=1.0, height=5.0)
    far = np.abs(path.xyz[:, :2]).max(axis=1) > 70
    path = replace(path, role=np.where(far & (path.filament > 0), Role.SKIRT, path.role))
    found = [f for f in check(path, frame_robot(height=5.0)).findings if f.code == "cable-part"]
    assert len(found) == 4
    assert all("the skirt" in f.sentence and "skirt_loops=0" in f.help for f in found)


def test_help_does_not_send_a_centred_part_to_the_middle_and_names_a_weight_that_is_too_much(small):
    heavy = replace(frame_robot(pulley=25.0), mass=60.0)
    found = [f for f in check(small, heavy).findings if f.code == "tension"]
    assert "60 kg" in found[0].help
    assert "middle of the bed" in found[0].help
    assert not any("towards the middle" in f.help for f in found)
    aside = replace(small, xyz=small.xyz + np.array([150.0, 0, 0]))
    weak = replace(frame_robot(pulley=25.0), tension_max=np.full(8, 100.0), tension_min=np.full(8, 28.0))
    helps = [f.help for f in check(aside, weak).findings if f.code == "tension"]
    assert not helps or "middle" in helps[0]


def test_margins_that_were_not_looked_for_further_are_said_to_be_at_least(small):
    verdict = check(small, frame_robot(pulley=25.0))
    assert set(verdict.capped) == {"cable_part_mm", "cable_bed_mm"}
    assert verdict.as_dict()["margins_at_least"] == list(verdict.capped)
    wide = [check(block(layers), frame_robot(pulley=25.0)) for layers in range(20, 34)]
    near = [verdict for verdict in wide if verdict.ok][-1]
    assert 0 < near.margins["cable_part_mm"] < FAR
    assert "cable_part_mm" not in near.capped


def test_the_margin_of_the_tensions_that_are_printed_is_told_beside_the_best_one(small):
    robot = frame_robot(pulley=25.0)
    verdict = check(small, robot)
    poses = nozzle_poses(robot, small.xyz)
    printed = nearest_tension(robot, poses, required_wrench(robot, poses)).tension
    least = np.minimum(printed - robot.tension_min, robot.tension_max - printed).min()
    assert 0 < verdict.margins["tension_printed_n"] <= verdict.margins["tension_n"]
    assert verdict.margins["tension_printed_n"] == pytest.approx(least, abs=1.0)
