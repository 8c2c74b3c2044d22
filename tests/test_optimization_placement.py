"""Placements: what ranks spots against the search that proves them; what is told to be printable is."""

import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from cli_cases import answered, run, write_box
from feasibility_cases import box_loop, frame_robot, part_contacts, stacked

from cabslice import advice, pipeline
from cabslice.feasibility.check import grown
from cabslice.optimization.field import field_of
from cabslice.optimization.placement import Standing, measured, room, spots
from cabslice.optimization.solid import solid_of
from cabslice.robot.kinematics import cables
from cabslice.robot.model import nozzle_poses

ROOT = Path(__file__).parents[1]
SCENARIOS = sorted((ROOT / "tests" / "scenarios" / "placement").glob("*.toml"))
TURNS = np.arange(0.0, 360.0, 10.0).tolist()
BARE = ["-p", "cabfab-optim", "--process", "draft-0.4", *(word for row in (
    "infill=0", "top_layers=0", "bottom_layers=0", "walls=1", "skirt_loops=0", "layer_mm=0.3", "first_layer_mm=0.3",
) for word in ("-s", row))]


def box_mesh(x, y, z):
    corner = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0, 1)]) * [x, y, z]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corner, np.array([triangle for q in quads for triangle in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])


def test_a_solid_knows_how_far_everything_is_from_its_sections():
    solid = solid_of(*box_mesh(60.0, 40.0, 20.0))
    rows, columns = np.indices(solid.field.shape[1:])
    x, y = solid.low[0] + columns * solid.pixel, solid.low[1] + rows * solid.pixel
    out = np.stack((np.abs(x) - 30, np.abs(y) - 20))
    exact = np.linalg.norm(np.maximum(out, 0), axis=0) + np.minimum(out.max(axis=0), 0)
    inside = exact < 0
    assert np.abs(solid.field[0] - exact).max() < solid.pixel
    assert np.abs(solid.field[-1] - exact)[inside].max() < solid.pixel
    assert solid.slabs * solid.dz == pytest.approx(20.0)


@pytest.mark.parametrize("height", [120.0, 160.0])
def test_the_ranking_gap_is_about_the_proven_clearance(height):
    """A block of 250 mm, against the search through beads; slabs and pixels are 2.5 mm."""
    robot, grow = frame_robot(pulley=25.0), grown(frame_robot(pulley=25.0))
    solid = solid_of(*box_mesh(150.0, 150.0, height))
    found = measured(solid, field_of(robot, grow, solid.slabs, solid.dz), 0.0, 0.0, 0.0)
    path = stacked([[box_loop(149.0)]] * int(height / 4), width=1.0, height=4.0)
    clear = [c for c in np.arange(0.5, 24, 0.5) if not len(part_contacts(path, robot, grow[0] + c, stop=1).move)]
    assert found.gap_mm == pytest.approx(max(clear, default=0.0), abs=3.0)


def test_the_search_finds_what_a_walk_over_all_spots_finds():
    """The same measure at every 10 mm and 30 degrees: no spot of the walk is better than the one that was found."""
    robot = frame_robot(pulley=25.0)
    solid = solid_of(*box_mesh(230.0, 90.0, 130.0), spacing=30.0)
    field = field_of(robot, grown(robot), solid.slabs, solid.dz)
    turns = np.arange(0.0, 180.0, 30.0).tolist()
    best = spots(solid, field, "clearance", turns=turns, finest=5.0)[0]
    walked = []
    for turn in turns:
        half = room(solid, field, turn, 0.0)
        walked += [measured(solid, field, turn, float(x), float(y)) for x in np.arange(-half[0], half[0], 10.0)
                   for y in np.arange(-half[1], half[1], 10.0)]
    assert best.printable
    assert best.score("clearance") >= max(spot.score("clearance") for spot in walked) - 0.5


def test_parts_stand_apart_and_print_past_each_other():
    robot = frame_robot(pulley=25.0)
    solid = solid_of(*box_mesh(60.0, 60.0, 50.0))
    field = field_of(robot, grown(robot), solid.slabs, solid.dz)
    first = spots(solid, field, "clearance", turns=[0.0])[0]
    second = spots(solid, field, "clearance", turns=[0.0], standing=[Standing(solid, first)])[0]
    assert second.printable
    assert max(abs(first.x - second.x), abs(first.y - second.y)) >= 60.0
    on_top = measured(solid, field, 0.0, first.x + 20, first.y, standing=[Standing(solid, first)])
    assert on_top.gap_mm < 0


def scenario(path):
    told = tomllib.loads(path.read_text())
    profiles = pipeline.load_profiles(told["printer"], None, told["process"], told["sets"])
    return told, pipeline.read(ROOT / told["part"], profiles, pipeline.Placement(scale=told["scale"]))


# ---- every 5 mm and 10 degrees, with no help from what ranks placements

def walked(placed):
    """How many placements of a prism there are over the bed, and those (turn, x, y) where no sampled cable touches it.

    A point of a cable within its reach of the prism, below what is laid by then, proves that the print there is
    impossible. The nozzle is tried at places of the outline, at the top first.
    """
    robot, (plan, height) = pipeline.robot_of(placed), plan_of(placed)
    count, unsure = 0, []
    for turn in TURNS:
        outline = shapely.affinity.rotate(plan, turn, origin=(0, 0))
        far = robot.bed_size / 2 - np.abs(np.array(outline.exterior.coords)).max(axis=0)
        if (far < 0).any():
            continue
        x, y = (np.arange(-side, side + 1e-9, 5.0) for side in far)
        middles = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        count += len(middles)
        unsure += [(turn, *place) for place in untouched(robot, outline, height, middles)]
    return count, unsure


def plan_of(placed):
    """Outline of a prism about the middle of its bounds, and its height, mm."""
    vertices = placed.part.vertices
    corners = vertices[placed.part.faces]
    upward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 1e-9
    plan = shapely.union_all(shapely.polygons(corners[upward][:, :, :2])).buffer(0)
    volume = np.einsum("ki,ki", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert plan.area * np.ptp(vertices[:, 2]) == pytest.approx(volume, rel=1e-6), "a prism"
    middle = placed.part.bounds[:, :2].mean(axis=0)
    return shapely.affinity.translate(plan, *-middle), float(vertices[:, 2].max())


def untouched(robot, outline, height, middles):
    """The middles (N, 2) of a prism at which none of some poses brings a point of a cable to it."""
    solid = outline.buffer(float(grown(robot).min()) - 0.1)
    shapely.prepare(solid)
    way = outline.buffer(-0.3, join_style="mitre").exterior
    ends = shapely.get_coordinates(way)[:-1]
    even = shapely.get_coordinates(way.interpolate(np.linspace(0, 1, 48), normalized=True))
    for share, fine in ((1.0, 200), (0.8, 200), (0.5, 200), (1.0, 3000)):
        for spot in (*ends, *even):
            z = share * height
            nozzle = np.column_stack((middles + spot, np.full(len(middles), z)))
            lines = cables(robot, nozzle_poses(robot, nozzle))
            exits, tips = (ends - robot.bed_origin for ends in (lines.exit, lines.tip))
            points = exits + np.linspace(0, 1, fine)[:, None, None, None] * (tips - exits)
            low = (points[..., 2] > 0) & (points[..., 2] < z - 0.7)
            at = points[..., :2] - middles[None, :, None]
            touched = np.zeros(len(middles), bool)
            _, place, _ = np.nonzero(low)
            np.logical_or.at(touched, place, shapely.contains_xy(solid, at[low]))
            middles = middles[~touched]
            if not len(middles):
                return middles
    return middles


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_a_printable_placement_is_found_wherever_the_exhaustive_search_finds_one(path):
    told, placed = scenario(path)
    assert {finding.code for finding in advice.tried(placed).findings} == set(told["findings"])
    found = advice.arrange([placed], "clearance", turns=TURNS)
    assert (found is not None) is told["placement"]
    if found is not None:
        assert advice.tried(found).ok
        middle = found.part.bounds[:, :2].mean(axis=0)
        outline, height = plan_of(found)
        assert len(untouched(pipeline.robot_of(found), outline, height, middle[None])) == 1
        return
    count, unsure = walked(placed)
    print(f"{path.stem}: {count} placements, {count - len(unsure)} touched by sampled cables, {len(unsure)} checked")
    assert count
    for turn, x, y in unsure:
        assert not advice.tried(advice.stood(placed, turn, x, y)).ok, f"printable at {x:g} {y:g}, turned {turn:g} deg"


# ---- a user's view

INIT = [word.replace("optim", "init") for word in BARE]


def test_a_block_that_fails_where_it_stands_is_placed_and_printed_there(tmp_path, capsys):
    part = write_box(tmp_path / "block.stl", (220.0, 220.0, 95.0))
    code, content = answered(capsys, "check", part, *INIT, "--no-try")
    assert code == 4
    assert "tried" not in content
    out = tmp_path / "placed.stl"
    code, content = answered(capsys, "optimize", "placement", part, *INIT, "--turn-step", "45", "-o", out)
    assert code == 0
    assert content["before"]["score"] is None
    assert content["after"]["score"] > 5
    words = [word.strip('"') for word in content["options"].replace('" ', '"|').replace(' "', '|"').split("|")]
    assert answered(capsys, "check", part, *INIT, *words)[0] == 0
    at = " ".join(str(value) for value in content["after"]["placement"]["at_mm"])
    assert answered(capsys, "check", out, *INIT, "--at", at)[0] == 0
    count = struct.unpack("<I", out.read_bytes()[80:84])[0]
    assert count == 12


@pytest.mark.slow
def test_what_would_help_was_tried_and_does(tmp_path, capsys):
    part = write_box(tmp_path / "block.stl", (218.0, 218.0, 219.0))
    code, content = answered(capsys, "check", part, *BARE)
    assert code == 4
    ways = {way["what"]: way for way in content["tried"]}
    assert set(ways) == {"turn", "shift", "turn and shift", "scale", "height", "printer"}
    assert ways["turn"]["found"]
    words = [word.strip('"') for word in ways["turn"]["options"].replace('" ', '"|').replace(' "', '|"').split("|")]
    assert run("check", part, *BARE, "--no-try", *words) == 0
    scale = float(ways["scale"]["options"].split()[1])
    assert 0.95 < scale < 1
    assert run("check", part, *BARE, "--no-try", "--scale", scale) == 0
    assert run("check", part, *BARE, "--no-try", "--scale", min(scale + 0.03, 1.0)) == 4


def test_optimize_refuses_what_it_cannot_place(tmp_path, capsys):
    part = write_box(tmp_path / "wide.stl", (700.0, 20.0, 5.0))
    assert answered(capsys, "optimize", "placement", part, *BARE, "--turn-step", "90")[0] == 4
    assert run("optimize", "placement", part, *BARE, "-o", tmp_path / "x.obj") == 2
