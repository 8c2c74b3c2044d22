"""Placements: what ranks spots against the search that proves them; what is told to be printable is."""

import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli_cases import answered, run, write_box
from feasibility_cases import box_loop, frame_robot, part_contacts, stacked

from cabslice import advice, pipeline
from cabslice.feasibility.check import grown
from cabslice.optimization.field import field_of
from cabslice.optimization.placement import Standing, measured, room, spots
from cabslice.optimization.solid import solid_of

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


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_a_printable_placement_is_found_wherever_the_exhaustive_search_finds_one(path):
    told, placed = scenario(path)
    assert {finding.code for finding in advice.tried(placed).findings} == set(told["findings"])
    found = advice.arrange([placed], "clearance", turns=TURNS)
    assert (found is not None) is told["placement"]
    if found is None:
        model, walked = advice.model_of(placed), []
        for turn in TURNS:
            half = room(model.solid, model.field, turn, model.border)
            x, y = (np.arange(-side, side + 1e-9, 5.0).tolist() for side in half)
            walked += [measured(model.solid, model.field, turn, a, b, enough=-2.0) for a in x for b in y]
        walked = sorted((spot for spot in walked if spot.gap_mm > -2.0), key=lambda spot: -spot.gap_mm)
        for spot in walked[:6]:
            assert not advice.tried(advice.stood(placed, spot.turn_deg, spot.x, spot.y)).ok
    else:
        assert advice.tried(found).ok


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
