"""Platform, print head and frame as convex bodies: bounds that hold, against linear programmes and samples."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box
from feasibility_cases import box_loop, frame_robot, part_trees, stacked, toolpath_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from cabslice.errors import ProfileError
from cabslice.feasibility.bodies import body_of, cables_and, least_along, plate, shifted_apart
from cabslice.feasibility.check import check, grown
from cabslice.feasibility.exits import lines_at
from cabslice.feasibility.shapes import Widths, first_met
from cabslice.profile.shelf import load_printer
from cabslice.profile.shown import show
from cabslice.robot.model import robot_from_printer
from cabslice.stl import write_stl

SEEDS = st.integers(0, 2**32 - 1)
HEAD = np.array([[x, y, z] for z, r in ((-98.0, 3.0), (-60.0, 30.0)) for x in (-r, r) for y in (-r, r)])
FLAT = np.array([[x, y, z] for z in (-8.0, 8.0) for x in (-70.0, 70.0) for y in (-20.0, 20.0)])


def overlap(one, other):
    """Do two hulls share a point: a linear programme."""
    n, m = len(one), len(other)
    sums = np.vstack((np.append(np.ones(n), np.zeros(m)), np.append(np.zeros(n), np.ones(m))))
    equal = np.vstack((np.hstack((one.T, -other.T)), sums))
    return linprog(np.zeros(n + m), A_eq=equal, b_eq=[0, 0, 0, 1, 1], bounds=[(0, None)] * (n + m)).status == 0


def hull_distance(one, other):
    """Least distance of two hulls: a quadratic programme."""
    n, m = len(one), len(other)
    start = np.append(np.full(n, 1 / n), np.full(m, 1 / m))
    sums = ({"type": "eq", "fun": lambda w: w[:n].sum() - 1}, {"type": "eq", "fun": lambda w: w[n:].sum() - 1})
    found = minimize(lambda w: ((w[:n] @ one - w[n:] @ other) ** 2).sum(), start, bounds=[(0, 1)] * (n + m),
                     constraints=sums, options={"maxiter": 300, "ftol": 1e-12})
    return float(np.sqrt(found.fun))


@settings(max_examples=8, deadline=None)
@given(SEEDS)
def test_bodies_are_apart_exactly_where_they_share_no_point(seed):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(7, 3)) * 20, rng.normal(size=(8, 3)) * 20
    places = rng.uniform(-60, 60, (12, 3))
    judge = shifted_apart([body_of("a", one)], [body_of("b", other)])
    gap, proven = judge(places, np.full(12, 2.0))
    for place, value in zip(places, gap[:, 0], strict=True):
        assert (value <= 1e-7) == overlap(one + place, other) or abs(value) < 1e-6
        if value > 0:
            assert value <= hull_distance(one + place, other) + 1e-3
    for way in rng.normal(size=(10, 12, 3)):
        step = 2.0 * way / np.linalg.norm(way, axis=1)[:, None]
        assert (judge(places + step, np.zeros(12))[0] >= proven - 1e-9).all()


@settings(max_examples=8, deadline=None)
@given(SEEDS)
def test_the_gap_along_a_cable_is_never_above_its_distance_and_negative_only_where_it_is_inside(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(8, 3)) * 20
    start, end = rng.uniform(-80, 80, (1, 20, 3)), rng.uniform(-80, 80, (1, 20, 3))
    gap = least_along(start, end, body_of("a", corners))[0]
    for i in range(20):
        ends = np.stack((start[0, i], end[0, i]))
        assert gap[i] <= hull_distance(ends, corners) + 1e-3
        assert (gap[i] <= 1e-7) == overlap(ends, corners) or abs(gap[i]) < 1e-6


@pytest.mark.parametrize("moving", [True, False])
def test_what_is_proven_of_cables_and_bodies_holds_around_a_place(moving):
    rng = np.random.default_rng(3)
    robot = replace(frame_robot(pulley=25.0), body_free=20.0)
    body = body_of("a", FLAT + np.array([0, 0, 100] if moving else [300, 250, 20]))
    judge = cables_and(robot, [body], grown(robot), moving=moving)
    places, radii = rng.uniform([-150, -150, 0], [150, 150, 300], (30, 3)), rng.choice([0.5, 5.0, 15.0], 30)
    excess, proven = judge(places, radii)
    assert (proven <= excess).all()
    for way in rng.normal(size=(20, 30, 3)):
        step = radii[:, None] * way / np.linalg.norm(way, axis=1)[:, None]
        assert (judge(places + step, np.zeros(30))[0] >= proven - 1e-9).all()


def small():
    return stacked([[box_loop(30), box_loop(29)]] * 10)


def test_a_cable_through_the_platform_is_found_away_from_home_and_named():
    """A plate on the platform that reaches out below the upper cables: they come down on it only near the edge."""
    robot = frame_robot(pulley=25.0)
    thin = replace(robot, bodies=(("platform", FLAT),), body_free=10.0)
    fine = check(small(), thin)
    assert fine.ok
    assert fine.margins["cable_platform_mm"] > 0
    tall = FLAT * [1.5, 4.0, 1.0] + np.array([0, 0, 30])
    found = check(small(), replace(robot, bodies=(("platform", tall),), body_free=10.0)).findings
    assert found
    assert {f.code for f in found} == {"cable-platform"}
    worst = found[0]
    lines = lines_at(robot, np.array([worst.xyz]))
    body = tall + robot.bed_origin - robot.nozzle + worst.xyz
    ends = np.stack((lines.exit[0, worst.cable - 1], lines.tip[0, worst.cable - 1]))
    assert hull_distance(ends, body) < 2.27


def test_beams_are_judged_against_cables_and_platform():
    robot = replace(frame_robot(pulley=25.0), bodies=(("platform", FLAT),), body_free=20.0)
    post = np.array([[x, y, z] for x in (300, 320) for y in (250, 270) for z in (-50, 300)], float)
    found = check(small(), replace(robot, obstacles=(("obstacle 1", post),))).findings
    assert "cable-frame" in {f.code for f in found}
    near = np.array([[x, y, z] for x in (60, 80) for y in (-5, 5) for z in (80, 300)], float)
    found = check(small(), replace(robot, obstacles=(("obstacle 1", near),))).findings
    assert "platform-frame" in {f.code for f in found}
    far = np.array([[x, y, z] for x in (600, 620) for y in (600, 620) for z in (-50, 300)], float)
    assert check(small(), replace(robot, obstacles=(("obstacle 1", far),))).ok


def test_a_platform_lower_than_the_nozzle_meets_the_bed():
    low = FLAT - [0, 0, 95]
    found = check(small(), replace(frame_robot(), bodies=(("platform", low),), body_free=200.0)).findings
    assert {f.code for f in found} == {"platform-frame", "head-part"}
    assert "bed plate" in found[0].sentence
    assert plate(np.array([10.0, 10.0]), 5.0).corners[:, 2].max() == 0


def one_after_the_other(gap, lift=60.0):
    """A tower of 40 mm, then one beside it, `gap` mm between their walls; the nozzle is lifted between them."""
    tower = stacked([[box_loop(20)]] * 20, width=0.5, height=2.0)
    beside = tower.xyz + np.array([20.0 + gap, 0, 0])
    up = np.array([[*tower.xyz[-1, :2], lift], [*beside[0, :2], lift]])
    xyz = np.vstack((tower.xyz, up, beside))
    laid = np.concatenate((tower.filament > 0, [False, False], tower.filament > 0))
    layer = np.concatenate((tower.layer, [19, 20], tower.layer + 20))
    return toolpath_of(xyz, laid, layer, width=0.5, height=2.0)


def test_a_head_that_comes_to_a_part_printed_before_is_named_with_the_first_layer():
    robot = replace(frame_robot(), bodies=(("print head", HEAD),), body_free=200.0)
    together = check(small(), robot)
    assert together.ok
    found = [f for f in check(one_after_the_other(15.0), robot).findings if f.code == "head-part"]
    assert len(found) == 1
    assert "print head" in found[0].sentence
    # at the height of the tower's top, 38 mm above the tip in its first layer, the head is 27.8 mm wide from its axis
    assert found[0].layer == 20
    assert check(one_after_the_other(60.0), robot).ok
    low = [f for f in check(one_after_the_other(15.0, lift=30.0), frame_robot()).findings if f.code == "head-part"]
    assert [("nozzle tip" in f.sentence, f.layer) for f in low] == [(True, 19)]


def test_a_head_is_as_wide_as_it_is_below_a_height():
    body = body_of("head", HEAD + np.array([0, 0, 100]))       # 6 mm wide at 2 mm above the tip, 60 mm wide at 40 mm
    widths = Widths(body)
    reach = widths.below(np.array([2.0, 21.0, 100.0]))
    assert reach[:, 0] == pytest.approx([3.0, 16.5, 30.0], abs=0.5)
    moves, beads = part_trees(one_after_the_other(60.0), frame_robot())
    assert first_met(moves, beads, widths) is None


def test_shapes_are_profile_keys_and_flat_ones_are_faults(tmp_path, capsys):
    printer = load_printer("cabfab-optim", ["platform.hull_mm=[[0,0,0],[9,0,0],[0,9,0],[0,0,9]]"])
    assert [name for name, _ in robot_from_printer(printer).bodies] == ["platform"]
    part = write_box(tmp_path / "box.stl")
    head = "nozzle.hull_mm=[[-5,-5,-99],[5,-5,-99],[5,5,-99],[-5,5,-99],[0,0,-60]]"
    code, content = answered(capsys, "check", part, *PRINTER, *SETS, "-s", head)
    assert code == 0
    assert "platform_frame_mm" in content["verdict"]["margins"]
    assert not any(s.startswith("Not checked") and "print head" in s for s in content["verdict"]["checked"])
    assert run("check", part, *PRINTER, *SETS, "-s", "nozzle.hull_mm=[[0,0,0],[9,0,0],[0,9,0],[9,9,0]]") == 3


def test_bodies_may_be_stl_files_beside_the_profile(tmp_path, capsys, monkeypatch):
    """The convex hull of a cup is that of its outside; shown and read again it means the same without the files."""
    corner = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-90.0, -60.0)])
    dent = np.array([[[0, 0, -70], [1, 0, -70], [0, 1, -70]]], float)
    faces = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7], [0, 1, 4], [1, 4, 5]])
    triangles = np.concatenate((corner[faces], dent))
    folder = tmp_path / "mine"
    folder.mkdir()
    stl = write_stl(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    (folder / "head.stl").write_bytes(stl)
    text = 'schema = 1\ninherits = "cabfab-optim"\nobstacles_mm = ["head.stl"]\n[nozzle]\nhull_mm = "head.stl"\n'
    (folder / "mine.toml").write_text(text)
    printer = load_printer(folder / "mine.toml")
    assert sorted(printer.nozzle.hull_mm) == sorted(corner.tolist())
    assert printer.obstacles_mm == [printer.nozzle.hull_mm]
    shown = tmp_path / "shown.toml"
    shown.write_text(show("printers", str(folder / "mine.toml")).toml)
    assert load_printer(shown).nozzle == printer.nozzle
    monkeypatch.chdir(folder)
    assert load_printer("cabfab-optim", ["nozzle.hull_mm=head.stl"]).nozzle == printer.nozzle


@pytest.mark.parametrize(("content", "told"), [
    (None, "No such file"), (b"nothing", "not an STL file"), ("flat", "all in one plane"), ("fine", "at most 400"),
])
def test_a_body_that_is_no_stl_is_told_with_its_line(tmp_path, content, told):
    if content is not None:
        points = np.random.default_rng(1).normal(size=(1500, 3))
        points /= np.linalg.norm(points, axis=1)[:, None]
        if content == "flat":
            points[:, 2] = 0
        rows = np.arange(1500).reshape(-1, 3)
        (tmp_path / "b.stl").write_bytes(content if isinstance(content, bytes) else write_stl(points, rows))
    (tmp_path / "mine.toml").write_text('schema = 1\ninherits = "cabfab-optim"\n\n[platform]\nhull_mm = "b.stl"\n')
    with pytest.raises(ProfileError) as caught:
        load_printer(tmp_path / "mine.toml")
    assert told in str(caught.value)
    assert "line 5: platform.hull_mm" in str(caught.value)
    assert "mine.toml" in str(caught.value)
