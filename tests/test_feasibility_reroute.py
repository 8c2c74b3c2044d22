"""Travels that would hit are led around what stands: proven by the check, and by distances sampled without it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from click.testing import CliRunner
from feasibility_cases import box_loop, frame_robot, sampled_distance, stacked, toolpath_of

from cabslice import pipeline, store
from cabslice.cli.main import cli
from cabslice.errors import ImpossibleError
from cabslice.feasibility.check import check, grown
from cabslice.feasibility.obstacles import beads_of, forbidden_region, laying, printing_stages
from cabslice.feasibility.reroute import reroute
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.path import EventKind, Events

TOWER, HIGH = (150.0, 150.0), 80
LEFT, RIGHT = (-160.0, 0.0), (-60.0, -120.0)       # on both sides of where a cable meets the tower


def islands(high=HIGH, tower=(10.0, 10.0), places=(LEFT, RIGHT)):
    """A tower, and beside its top a layer of islands with a travel between them."""
    loops = [box_loop(*tower, centre=TOWER)]
    path = stacked([loops] * (high - 1) + [loops + [box_loop(10, centre=place) for place in places]],
                   height=1.0, width=1.0)
    rises = np.flatnonzero(~laying(path))
    return replace(path, events=Events(rises[[1, -1]], np.full(2, EventKind.FAN), np.array([0.5, 1.0])))


@pytest.mark.parametrize("pulley", [0.0, 25.0])
def test_a_travel_is_led_around_and_proven_free_by_sampling(pulley):
    robot, path = frame_robot(pulley=pulley, height=50.0), islands()
    (found,) = check(path, robot).findings
    assert found.travel
    assert "1 travels" in found.sentence
    other = reroute(path, robot, grown(robot))
    assert (other.count, other.left, other.lifted) == (1, 0, 0)
    assert check(other.toolpath, robot).ok
    assert not find_faults(other.toolpath)
    fresh = np.flatnonzero(~(other.toolpath.xyz[:, None] == path.xyz).all(axis=2).any(axis=1))
    beads = np.flatnonzero(laying(other.toolpath))[-120:]
    for row in [*fresh.tolist(), int(fresh[-1]) + 1]:
        assert sampled_distance(robot, other.toolpath, row, 4, beads) > grown(robot)[4] - 1e-6


def test_beads_events_and_pieces_stay_what_they_were():
    robot, path = frame_robot(height=50.0), islands()
    other = reroute(path, robot, grown(robot)).toolpath
    for name in ("xyz", "filament", "width", "layer", "object"):
        assert np.array_equal(getattr(other, name)[laying(other)], getattr(path, name)[laying(path)])
    assert other.events.kind.tolist() == path.events.kind.tolist()
    ends = path.xyz[path.events.index - 1]
    assert np.array_equal(other.xyz[other.events.index - 1], ends)
    again = reroute(path, robot, grown(robot)).toolpath
    assert all(np.array_equal(getattr(other, name), getattr(again, name)) for name in ("xyz", "starts", "speed"))


def test_the_way_is_the_shortest_around_the_forbidden_region():
    """With eyelets the region does not depend on where the nozzle is: a taut string around it is as long."""
    robot, path = frame_robot(height=50.0), islands()
    beads = beads_of(path, printing_stages(path))
    region = shapely.union_all([
        forbidden_region(beads, robot.anchors[i], robot.attachments[i] - robot.nozzle, 80.0, grown(robot)[i])
        for i in range(robot.cables)])
    start, end = np.add(LEFT, -5.0), np.add(RIGHT, -5.0)
    near = shapely.intersection(region, shapely.box(-200, -200, 200, 200))
    hull = shapely.convex_hull(shapely.union_all([near, shapely.linestrings([start, end])]))
    around = [shapely.length(hull) / 2, np.linalg.norm(end - start)]
    other = reroute(path, robot, grown(robot))
    rows = np.flatnonzero((other.toolpath.xyz[:, :2] == start).all(axis=1) & (other.toolpath.xyz[:, 2] == 80.0))
    stop = np.flatnonzero((other.toolpath.xyz[:, :2] == end).all(axis=1))[0]
    way = other.toolpath.xyz[rows[-1]:stop + 1, :2]
    assert not shapely.intersects(region, shapely.linestrings(way))
    length = shapely.length(shapely.linestrings(way))
    assert length < around[1] + other.longer_mm + 1e-6
    tip = near.bounds[2:]
    over = np.linalg.norm(np.subtract(tip, start)) + np.linalg.norm(np.subtract(end, tip))
    assert around[1] < length < over + 4.0


@pytest.mark.parametrize(("half", "lifted", "longest"), [(60.0, 0, 120.0), (199.9, 1, 21.0)])
def test_what_is_printed_already_is_gone_around_or_where_it_closes_the_bed_over(half, lifted, longest):
    """A wall ten layers high, then lines on the bed on both sides of it."""
    robot = frame_robot(height=100.0)
    wall = stacked([[np.array([[0.0, -half], [0.0, half]])]] * 10, height=1.0, width=1.0)
    after = np.array([[-40.0, 0.0, 10.5], [-40.0, 0.0, 1.0], [-40.0, 10.0, 1.0], [40.0, 0.0, 1.0], [40.0, 10.0, 1.0]])
    path = toolpath_of(
        np.vstack((wall.xyz, after)), np.append(wall.filament > 0, [False, False, True, False, True]),
        np.append(wall.layer, [10] * 5), width=1.0, height=1.0)
    (found,) = check(path, robot).findings
    assert found.code == "head-part"
    assert found.travel
    other = reroute(path, robot, grown(robot))
    assert (other.count, other.lifted, other.left) == (1, lifted, 0)
    assert check(other.toolpath, robot).ok
    assert 10.0 < other.longer_mm < longest


def test_a_print_head_as_low_as_its_nozzle_makes_room_for_itself():
    robot = frame_robot(height=100.0)
    hull = np.array([[x, y, z] for x in (-15, 15) for y in (-15, 15) for z in (-98.0, -50.0)])
    robot = replace(robot, bodies=(("print head", hull),))
    wall = stacked([[np.array([[0.0, -40.0], [0.0, 40.0]])]] * 10, height=1.0, width=1.0)
    after = np.array([[-40.0, 0.0, 12.5], [-40.0, 0.0, 1.0], [-40.0, 10.0, 1.0], [40.0, 0.0, 1.0], [40.0, 10.0, 1.0]])
    path = toolpath_of(
        np.vstack((wall.xyz, after)), np.append(wall.filament > 0, [False, False, True, False, True]),
        np.append(wall.layer, [10] * 5), width=1.0, height=1.0)
    other = reroute(path, robot, grown(robot))
    assert check(other.toolpath, robot).ok
    assert np.abs(other.toolpath.xyz[:, 1]).max() > 55.0 or other.lifted


def test_nothing_is_changed_where_nothing_is_in_the_way():
    robot = frame_robot(height=50.0)
    assert reroute(stacked([[box_loop(20)]] * 3), robot, grown(robot)) is None


def test_check_and_plan_take_the_new_way_and_say_so(tmp_path):
    """From a stored path to a plan; and not where it is switched off."""
    sets = ["platform.home_mm=[0,0,-150]"]
    profiles = pipeline.load_profiles("cabfab-optim", None, None, sets)
    path = islands(150, places=((-150.0, 70.0), (-20.0, -30.0)))
    tower = replace(path, xyz=path.xyz + np.where(
        (path.xyz[:, [0]] > 100) & (np.arange(3) < 2), 30.0, 0.0))
    laid = store.Laid(pipeline.origin_of("towers", "0" * 64, profiles), tower)
    store.save(laid, tmp_path / "towers.path")
    ran = CliRunner().invoke(cli, ["check", str(tmp_path / "towers.path"), "--json"])
    answer = json.loads(ran.stdout)
    assert ran.exit_code == 0, answer["sentence"]
    (changed,) = answer["verdict"]["changed"]
    assert changed.startswith("1 travel rerouted around what stands")
    assert changed in CliRunner().invoke(cli, ["check", str(tmp_path / "towers.path")]).stdout
    off = profiles.process.model_copy(update={"reroute_travels": False})
    plain = store.Laid(pipeline.origin_of("towers", "0" * 64, replace(profiles, process=off)), tower)
    with pytest.raises(ImpossibleError):
        pipeline.to_plan(plain)
    assert len(pipeline.freed(laid)[0].toolpath.xyz) > len(pipeline.with_ends(laid).toolpath.xyz)
