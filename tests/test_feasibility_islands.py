"""What is laid in a layer counts once it is laid; islands that are in the way of others are laid after them."""

from dataclasses import replace

import numpy as np
import pytest
from feasibility_cases import box_loop, frame_robot, stacked

from cabslice.feasibility.check import check, grown
from cabslice.feasibility.islands import _topological, reordered
from cabslice.feasibility.obstacles import laying
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.path import EventKind, Events

FAR, NEAR, THIRD = (150.0, 150.0), (-78.0, -9.0), (30.0, -60.0)    # a cable meets FAR with the nozzle at NEAR
LOW = 79


def islands(*order, retracting=False):
    """Layers of something small, and one that is laid at 80 mm with islands in an order."""
    base = [[box_loop(6, centre=THIRD)]] * LOW
    path = stacked([*base, [box_loop(6, centre=place) for place in order]], height=1.0, width=1.0)
    path = replace(path, events=Events(
        [0, int(np.flatnonzero(path.layer == LOW)[0])], [EventKind.FAN, EventKind.FAN], [0.0, 1.0]))
    return drawn_back(path) if retracting else path


def drawn_back(path):
    """Every travel with a retraction before and a prime after it."""
    columns = {name: [] for name in ("xyz", "filament", "width", "height", "speed", "role", "layer", "object")}
    starts, beads = [1], laying(path)
    for row in range(len(path.xyz)):
        own = {name: getattr(path, name)[row] for name in columns}
        rows = [own]
        if row and not beads[row]:
            back = own | {"xyz": path.xyz[row - 1], "filament": -1.0}
            rows = [back, own, own | {"filament": 1.0}]
            starts += [len(columns["xyz"]), len(columns["xyz"]) + 1, len(columns["xyz"]) + 2, len(columns["xyz"]) + 3]
        for one in rows:
            for name, column in columns.items():
                column.append(one[name])
    count = len(columns["xyz"])
    return replace(path, **columns, starts=np.unique([*starts, count]), events=Events.none())


@pytest.mark.parametrize("pulley", [0.0])
def test_an_island_is_free_where_what_blocks_it_is_laid_after_it(pulley):
    robot = frame_robot(pulley=pulley, height=50.0)
    (found,) = check(islands(FAR, NEAR), robot).findings
    assert (found.code, found.layer) == ("cable-part", LOW)
    assert not found.travel
    assert check(islands(NEAR, FAR), robot).ok
    assert check(islands(THIRD, NEAR, FAR), robot).ok


@pytest.mark.parametrize("retracting", [False, True])
def test_islands_are_laid_in_an_order_in_which_none_blocks_a_later_one(retracting):
    robot, path = frame_robot(height=50.0), islands(FAR, NEAR, THIRD, retracting=retracting)
    if retracting:
        assert not find_faults(path)
    other = reordered(path, robot, grown(robot))
    assert other.layers == 1
    assert "1 layer " in other.sentence
    verdict = check(other.toolpath, robot)
    assert verdict.ok or all(finding.travel for finding in verdict.findings)
    assert not find_faults(other.toolpath)
    laid = laying(other.toolpath) & (other.toolpath.layer == LOW)
    wanted = islands(NEAR, FAR, THIRD)
    np.testing.assert_array_equal(other.toolpath.xyz[laid], wanted.xyz[laying(wanted) & (wanted.layer == LOW)])
    assert other.toolpath.filament.sum() == pytest.approx(path.filament.sum())
    assert other.toolpath.filament[laid].sum() == pytest.approx(path.filament[laying(path) & (path.layer == LOW)].sum())
    if retracting:
        same = drawn_back(wanted)
        np.testing.assert_array_equal(other.toolpath.xyz, same.xyz)
        np.testing.assert_array_equal(other.toolpath.filament, same.filament)
        np.testing.assert_array_equal(other.toolpath.starts, same.starts)
    else:
        first = int(other.toolpath.events.index[1])
        assert other.toolpath.layer[first] == LOW
        assert other.toolpath.layer[first - 1] == LOW - 1


def test_what_stands_from_layers_below_is_helped_by_no_order():
    robot = frame_robot(height=50.0)
    tall = stacked([[box_loop(10, centre=FAR)]] * LOW + [[box_loop(6, centre=NEAR), box_loop(10, centre=FAR)]],
                   height=1.0, width=1.0)
    assert not check(tall, robot).ok
    assert reordered(tall, robot, grown(robot)) is None
    assert reordered(islands(NEAR, FAR), robot, grown(robot)) is None


def test_orders_keep_to_the_pairs_and_change_little():
    assert _topological(4, set()) == [0, 1, 2, 3]
    assert _topological(4, {(0, 2)}) == [1, 2, 0, 3]
    assert _topological(3, {(0, 1), (1, 2)}) == [2, 1, 0]
    assert _topological(2, {(0, 1), (1, 0)}) is None
