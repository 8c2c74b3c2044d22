"""Cables against beads: the search must agree with sampled poses, and what it discards must be apart."""

import numpy as np
import pytest
from feasibility_cases import (
    LINC_ANCHORS,
    LINC_ATTACHMENTS,
    LINC_EDGE,
    box_loop,
    frame_robot,
    part_contacts,
    part_trees,
    robot_of,
    sampled_distance,
    stacked,
    toolpath_of,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cabslice.feasibility.distance import sweep_gap
from cabslice.feasibility.exits import exit_drift, exit_points, offsets
from cabslice.feasibility.obstacles import (
    BED,
    Obstacles,
    beads_of,
    bed_edges,
    depths,
    forbidden_region,
    printing_stages,
    section,
)
from cabslice.feasibility.sweep import FAR, RESOLUTION, clearances, contacts
from cabslice.feasibility.trees import AXES, Bounds, bounds_of_beads, cable_gap, tree_of_beads

SEEDS = st.integers(0, 2**32 - 1)


def linc_cube(edge, *, width=1e-3):
    """Is a centred cube printable? Layers of 2 mm or less; its outline only, at the middle of the bead."""
    robot = robot_of(LINC_ANCHORS, LINC_ATTACHMENTS)
    count = int(np.ceil(edge / 2))
    path = stacked([[box_loop(edge - width)]] * count, width=width, height=edge / count)
    return part_contacts(path, robot, 0.0, stop=1)


def test_the_linc_cube_is_printable_up_to_its_published_edge_and_not_above():
    assert not len(linc_cube(LINC_EDGE - 0.05).move)
    assert len(linc_cube(LINC_EDGE + 0.05).move)


def test_the_linc_threshold_is_the_published_one_to_its_last_digit():
    free, blocked = 470.0, 472.0
    while blocked - free > 1e-3:
        middle = (free + blocked) / 2
        if len(linc_cube(middle).move):
            blocked = middle
        else:
            free = middle
    assert free == pytest.approx(LINC_EDGE, abs=2e-3)
    assert linc_cube(free).margin < 1e-3


def random_job(seed, *, pulley):
    """A few layers of random lines and travels, one lifted, below cables that cross them low and flat."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    turn, far = rng.uniform(0, 2 * np.pi, count), rng.uniform(80, 200, count)
    anchors = np.stack((far * np.cos(turn), far * np.sin(turn), rng.uniform(-30, 8, count)), axis=1)
    attachments = np.hstack((rng.uniform(-15, 15, (count, 2)), rng.uniform(4, 20, (count, 1))))
    robot = robot_of(anchors, attachments, pulley=pulley)
    points = rng.uniform(-30, 30, (26, 3))
    layer = np.sort(rng.integers(0, 4, 26))
    points[:, 2] = 2.0 * (layer + 1)
    hop = int(rng.integers(4, 25))
    points[hop, 2] += 1.5
    extruding = (rng.random(26) < 0.7) & (np.diff(layer, prepend=-1) == 0)
    extruding[hop:hop + 2] = False
    path = toolpath_of(points, extruding, layer, width=rng.uniform(0.3, 3), height=2.0)
    return robot, path, float(rng.choice([0.0, 0.3, 2.5]))


@settings(max_examples=8, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 12.0]))
@example(50201834, 12.0)        # a bead is cut on a third of a move and missed by little on the rest
def test_hits_are_exactly_the_moves_on_which_sampled_cables_touch(seed, pulley):
    """Both ways: nothing called free is touched in samples, everything called blocked is near enough in samples."""
    robot, path, grow = random_job(seed, pulley=pulley)
    stages = printing_stages(path)
    moves, beads = part_trees(path, robot)
    met = contacts(moves, beads, robot, np.full(robot.cables, grow), stop=10**9)
    assert met.complete
    hits = {(int(moves.items.move[m]), int(c)) for m, c in zip(met.move, met.cable, strict=True)}
    least = np.inf
    for row in range(1, len(path.xyz)):
        laid = [b for b in beads.items.move if stages[b] <= stages[row]]
        for cable in range(robot.cables):
            sampled = sampled_distance(robot, path, row, cable, laid) if laid else np.inf
            least = min(least, sampled)
            if (row, cable) in hits:
                assert sampled <= grow + 3 * RESOLUTION
            else:
                assert sampled > grow - 1e-9
    if hits:
        assert met.margin == 0
    else:
        assert met.margin <= least - grow + 1e-9      # a lower bound ...
        drift = exit_drift(robot, moves.items.start, np.full(len(moves.items), 45.0)).max()
        assert met.margin >= min(least - grow, FAR) - drift - 1.5 - 0.01      # ... short by drift and climb of a move


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_no_pair_is_discarded_that_has_a_sampled_distance_below_the_reach(seed):
    rng = np.random.default_rng(seed)
    size = 40
    centre, spread = rng.uniform(-60, 60, (size, 3)), rng.uniform(0, 25, (size, 3))
    moved = rng.uniform(-1, 1, (size, 6, 3)) * spread[:, None] + centre[:, None]
    turns = np.pi / AXES * np.arange(AXES)
    axes = np.stack((np.cos(turns), np.sin(turns)))
    plan = moved[..., :2] @ axes
    zero = np.zeros(size, int)
    moves = Bounds(plan.min(1), plan.max(1), moved[..., 2].min(1), moved[..., 2].max(1), zero, zero)
    low = rng.uniform(-150, 150, (size, 3))
    high = low + rng.uniform(0, 3, (size, 3))
    offset, reach = rng.uniform(-20, 20, (size, 3)), rng.uniform(0, 6, size)
    first, half, base = rng.uniform(-60, 60, (size, 2)), rng.uniform(0, 2, size), rng.uniform(-40, 40, size)
    last, top = first + rng.normal(0, 20, (size, 2)), base + rng.uniform(0, 9, size)
    beads = Obstacles(first, last, half, base, top, zero, zero)
    proven = np.minimum(cable_gap(moves, low, high, offset, bounds_of_beads(beads), reach), reach)
    share = np.linspace(0, 1, 400)[:, None]
    for i in range(size):
        for nozzle in moved[i]:
            start = low[i] + rng.random(3) * (high[i] - low[i])
            points = start + share * (nozzle + offset[i] - start)
            assert distance_to(points, beads, i) >= proven[i] - 1e-9


def distance_to(points, beads, i):
    way = beads.last[i] - beads.first[i]
    along = np.clip((points[:, :2] - beads.first[i]) @ way / (way @ way), 0, 1)
    plan = np.linalg.norm(points[:, :2] - beads.first[i] - along[:, None] * way, axis=1) - beads.half[i]
    rise = np.maximum(np.maximum(beads.low[i] - points[:, 2], points[:, 2] - beads.top[i]), 0)
    return np.hypot(np.maximum(plan, 0), rise).min()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_distance_of_a_swept_triangle_is_that_of_its_nearest_point(seed):
    """Against a dense grid over the triangle: never above it, and below by no more than the grid is coarse."""
    rng = np.random.default_rng(seed)
    size, zero = 20, np.zeros(20, int)
    exits, tips = rng.uniform(-50, 50, (size, 3)), rng.uniform(-50, 50, (size, 3))
    other = tips + rng.normal(0, 15, (size, 3)) * [1, 1, 0]
    first, base = rng.uniform(-30, 30, (size, 2)), rng.uniform(-30, 20, size)
    beads = Obstacles(first, first + rng.normal(0, 15, (size, 2)), rng.uniform(0, 3, size), base, base + 10, zero, zero)
    gap, _ = sweep_gap(exits, tips, other, beads, np.full(size, 1e3))
    grid = np.linspace(0, 1, 161)
    for i in range(size):
        ends = tips[i] + grid[:, None] * (other[i] - tips[i])
        points = (exits[i] + grid[:, None, None] * (ends - exits[i])).reshape(-1, 3)
        sampled = distance_to(points, beads, i)
        corners = exits[i], tips[i], other[i]
        step = max(np.linalg.norm(a - b) for a in corners for b in corners) / 160
        assert sampled - step <= gap[i] <= sampled + 1e-9


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_exit_points_stay_within_their_drift(seed):
    rng = np.random.default_rng(seed)
    robot = frame_robot(pulley=25.0)
    places, radii = rng.uniform([-250, -250, 0], [250, 250, 500], (30, 3)), rng.uniform(0.01, 60, 30)
    drift, exits = exit_drift(robot, places, radii), exit_points(robot, places)
    ways = rng.normal(size=(50, 30, 3))
    ways *= (radii[:, None] * rng.random((50, 30, 1)) ** (1 / 3)) / np.linalg.norm(ways, axis=2, keepdims=True)
    for way in ways:
        assert (np.linalg.norm(exit_points(robot, places + way) - exits, axis=2) <= drift + 1e-9).all()


# ---- parts of which the answer is known

def cup(walls, *, layers=12, height=5.0):
    """Walls (polylines) of 60 mm; then the nozzle goes down inside to 10 mm. One cable from (300, 0, 0) reaches in."""
    robot = robot_of([[300.0, 0.0, 0.0]], [[0.0, 0.0, 40.0]], radius=0.0)
    path = stacked([walls] * layers, width=1.0, height=height)
    inside = np.array([[0.0, 0.0, 90.0], [0.0, 0.0, 10.0], [-5.0, 0.0, 10.0], [0.0, 0.0, 90.0]])
    return robot, toolpath_of(
        np.vstack((path.xyz, inside)), np.append(path.filament > 0, np.zeros(4)), np.append(path.layer, [layers] * 4),
        width=1.0, height=height,
    )


MOUTH = np.array([[50.0, 10.0], [50.0, 50.0], [-50.0, 50.0], [-50.0, -50.0], [50.0, -50.0], [50.0, -10.0]])


def test_a_cable_may_reach_into_a_c_through_its_mouth_but_not_through_a_closed_wall():
    """With the nozzle at x = 0, z = 10 the cable is 50/6 * 5 = 41.7 mm high where the 60 mm wall stands at x = 50."""
    robot, path = cup([MOUTH])
    met = part_contacts(path, robot, 2.0)
    assert not len(met.move)
    assert 0 < met.margin <= 10 - 0.5 - 2.0        # half the mouth, less half the bead, less the reach of the cable
    robot, path = cup([np.vstack((MOUTH, MOUTH[:1]))])
    met = part_contacts(path, robot, 2.0)
    blocked = set(part_trees(path, robot)[0].items.move[met.move])
    assert blocked == set(range(len(path.xyz) - 3, len(path.xyz)))       # exactly the three moves inside
    assert (met.gap == 0).all()


def test_the_margin_through_a_mouth_is_what_is_left_beside_the_cable():
    """The cable runs in the plane y = 0: the mouth's lips are at y = +-(10 - 0.5) over all its heights."""
    robot, path = cup([MOUTH])
    assert not len(part_contacts(path, robot, 9.0).move)
    assert len(part_contacts(path, robot, 9.6).move)
    assert part_contacts(path, robot, 8.0).margin == pytest.approx(1.5, abs=0.01)


def test_a_hollow_part_is_free_inside_where_a_full_one_is_not():
    """A cable that comes up from the middle of a hollow box meets nothing; infill would be in its way."""
    robot = robot_of([[0.0, 0.0, -20.0]], [[0.0, 0.0, 60.0]])
    wall = box_loop(80.0)
    columns = enumerate(np.arange(-38, 39, 2.0))
    infill = np.array([[x, y] for i, x in columns for y in ((-38, 38) if i % 2 else (38, -38))])
    hollow = part_contacts(stacked([[wall]] * 10, width=1.0, height=2.0), robot, 1.0)
    full = part_contacts(stacked([[wall, infill]] * 10, width=1.0, height=2.0), robot, 1.0)
    assert not len(hollow.move)
    assert len(full.move)


def test_a_bead_stands_in_the_way_only_once_it_is_laid():
    """The same wall and the same move: free before the wall is there, blocked after."""
    robot = robot_of([[100.0, 0.0, -10.0]], [[0.0, 0.0, 10.0]])
    wall, pass_by = [[50, -20, 4], [50, 20, 4]], [[0, -1, 4], [0, 1, 4]]
    lay, move = [False, True], [False, False]
    for first, second, flags, blocked in ((wall, pass_by, lay + move, True), (pass_by, wall, move + lay, False)):
        path = toolpath_of(np.array(first + second, float), flags, [0, 0, 1, 1], width=1.0, height=4.0)
        met = part_contacts(path, robot, 0.0)
        rows = part_trees(path, robot)[0].items.move[met.move]
        start = 2 if blocked else 0
        assert bool(np.isin(rows, [start + 1]).any()) is blocked


def test_objects_printed_one_after_the_other_and_spirals_are_kept_in_order():
    path = stacked([[box_loop(10)]] * 3)
    again = toolpath_of(np.vstack((path.xyz, path.xyz)), np.tile(path.filament > 0, 2), np.tile(path.layer, 2))
    stages = printing_stages(again)
    assert (np.diff(stages) >= 0).all()
    assert stages[len(path.xyz)] > stages[len(path.xyz) - 1]
    turn = np.linspace(0, 6 * np.pi, 121)
    points = np.stack((9 * np.cos(turn), 9 * np.sin(turn), 0.2 + 0.2 * turn / (2 * np.pi)), axis=1)
    spiral = toolpath_of(points, turn > 0, np.zeros(121))
    stages, beads = printing_stages(spiral), beads_of(spiral, printing_stages(spiral))
    assert stages.max() == 2        # three turns
    assert max(np.ptp(beads.top[beads.stage == stage]) for stage in range(3)) <= 0.2 + 1e-9


def test_every_cable_that_enters_the_bed_plate_meets_one_of_its_sides():
    """A cable over the corner of a plate, from below its level: blocked as soon as the plate reaches under it."""
    robot = robot_of([[200.0, 0.0, -50.0]], [[0.0, 0.0, 50.0]])
    path = stacked([[box_loop(2.0)]])
    moves, _ = part_trees(path, robot)
    for half, blocked in ((98.0, False), (102.0, True)):        # it passes z = 0 at x = 100 -+ 0.5
        met = contacts(moves, tree_of_beads(bed_edges(np.array([2 * half, 2 * half]))), robot, np.array([0.5]))
        assert bool(len(met.move)) is blocked
        assert (moves.items.move[met.move] > BED).all()


@settings(max_examples=6, deadline=None)
@given(SEEDS)
def test_the_clearance_of_a_place_is_no_more_than_any_sampled_one(seed):
    """Nor more than what the search of the whole path proves; nothing where a cable touches."""
    robot, path, grow = random_job(seed, pulley=0.0)
    moves, beads = part_trees(path, robot)
    air = clearances(moves, beads, robot, np.full(robot.cables, grow), far=20.0)
    met = contacts(moves, beads, robot, np.full(robot.cables, grow), stop=10**9, far=20.0)
    assert air.min() == pytest.approx(met.margin, abs=1e-9)
    assert not air[met.move].any()
    for k in np.flatnonzero(air > 0)[:4]:
        row, stage = moves.items.move[k], moves.items.stage[k]
        laid = np.unique(beads.items.move[beads.items.stage <= stage])
        least = min(sampled_distance(robot, path, row, cable, laid, rounds=3) for cable in range(robot.cables))
        assert min(least - grow, 20.0) > air[k] - 1e-6


def test_the_sides_of_a_sloping_bed_rise_with_it():
    """A cable over the +x side of the plate, where a level one ends 1 mm below it: it meets what rises by 3 mm."""
    robot = robot_of([[200.0, 0.0, -50.0]], [[0.0, 0.0, 50.0]])
    moves, _ = part_trees(stacked([[box_loop(2.0)]]), robot)
    size, grow = np.array([196.0, 196.0]), np.array([0.5])                # it passes x = 98 at z = 1 +- 0.7
    for slope, blocked in (([0.0, 0.0], False), ([0.03, 0.0], True), ([-0.03, 0.0], False), ([0.0, 0.01], False)):
        sides = bed_edges(size, np.array(slope))
        assert bool(len(contacts(moves, tree_of_beads(sides), robot, grow).move)) is blocked
        ends = np.stack((sides.first, sides.last)) @ slope
        assert (sides.top >= ends.max(axis=0) - 1e-12).all()
        assert (sides.top <= ends.min(axis=0) + 0.03 * 20 + 1e-12).all()


def test_two_searches_give_the_same_columns():
    robot, path, grow = random_job(5, pulley=12.0)
    one, two = part_contacts(path, robot, grow), part_contacts(path, robot, grow)
    for name in ("move", "bead", "cable", "gap"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert one.margin == two.margin


# ---- plan views

@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_the_forbidden_region_holds_every_nozzle_position_that_touches(seed):
    """Affine images of the beads against the search by sweeping: equal but for the cylinders it grows beads by."""
    rng = np.random.default_rng(seed)
    robot, path, _ = random_job(seed, pulley=0.0)
    beads, grow, z = beads_of(path, printing_stages(path)), 0.5, 14.0
    exits, offset = robot.anchors[0], offsets(robot)[0]
    region = forbidden_region(beads, exits, offset, z, grow)
    places = np.hstack((rng.uniform(-60, 60, (300, 2)), np.full((300, 1), z)))
    rows = np.repeat(np.arange(300), len(beads))
    every = beads.take(np.tile(np.arange(len(beads)), 300))
    tips = (places + offset)[rows]
    gap, _ = sweep_gap(np.broadcast_to(exits, tips.shape), tips, tips, every, np.full(len(rows), 50.0))
    gap = gap.reshape(300, -1).min(axis=1)
    inside = depths(region, places[:, :2]) > 0
    assert inside[gap < grow].all()
    assert not inside[gap > 1.5 * grow].any()


def test_depth_counts_infill_as_inside():
    lines = np.array([[x, -20.0, x, 20.0] for x in np.arange(-20, 21, 4.0)])
    zero = np.zeros(len(lines))
    beads = Obstacles(lines[:, :2], lines[:, 2:], zero + 0.2, zero, zero + 0.2, zero.astype(int), zero.astype(int))
    deep = depths(section(beads), np.array([[0.0, 0.0], [2.0, 15.2], [30.0, 0.0]]))
    assert deep == pytest.approx([20.0, 4.8, 0.0], abs=0.25)      # the edge is scalloped between lines
