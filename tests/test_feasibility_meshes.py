"""Real parts by brute force: what cables are told to be free of, and to cut, against the mesh itself (mesh_judge).

A point is a place of the nozzle on the path, of travels too, and one cable. Each part stands where many are blocked.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mesh_judge import BANDS, DEEP, Judge

from cabslice import pipeline
from cabslice.feasibility.exits import exit_points, lines_at, offsets
from cabslice.feasibility.obstacles import Moves, beads_of, depths, moves_of, printing_stages, section
from cabslice.feasibility.sweep import contacts
from cabslice.feasibility.trees import tree_of_beads, tree_of_moves
from cabslice.robot.model import robot_from_printer

ROOT = Path(__file__).parents[1]
MODELS = ROOT.parent / "shared" / "models"
BARE = ["top_layers=0", "bottom_layers=0", "walls=1", "infill=0.1", "skirt_loops=0", "layer_mm=0.3",
        "first_layer_mm=0.3"]
SAMPLES = 1_000_000  # points a part, lower cables
LAYER = 0.3          # mm
APART = 0.3          # mm: a layer's steps and the rounding of outlines, by which beads and mesh differ
ASKED = 10_000       # places asked one by one whether a cable cuts the part there, where a case asks for no more


@dataclass(frozen=True)
class Case:
    """On cabfab-optim with a platform a fifth as wide, and the nozzle tip so far below it that cables meet the part."""

    file: Path
    scale: float
    tip_mm: float        # where many places are blocked
    free_mm: float       # where few are
    asked: int = ASKED


CASES = {
    "benchy": Case(MODELS / "benchy.stl", 4.5, 30.0, 42.0, 30_000),
    "bunny_flat": Case(MODELS / "bunny_flat.stl", 1.0, 25.0, 32.0, 30_000),
    "c-shape": Case(ROOT / "samples" / "c-shape.stl", 6.0, 40.0, 52.0),
    "arch": Case(ROOT / "samples" / "arch.stl", 8.0, 30.0, 45.0),
    "tower": Case(ROOT / "samples" / "tower.stl", 5.0, 30.0, 45.0),
}


@dataclass(frozen=True)
class Printed:
    """A part's path, its robot with cables as thin as lines, and its mesh."""

    path: object
    robot: object
    stages: object
    beads: object
    judge: Judge

    def blocked(self, moves, grow):
        """(moves, cables): the row of the bead the exact method names where it calls a move blocked, else -1."""
        tree = tree_of_moves(moves, self.robot)
        met = contacts(tree, self.beads, self.robot, np.full(self.robot.cables, grow), stop=10**9, far=0.1)
        assert met.complete
        table = np.full((int(moves.move.max()) + 1, self.robot.cables), -1)
        table[tree.items.move[met.move], met.cable] = met.bead
        return table


def printed(case, tip):
    if not case.file.exists():
        pytest.skip(f"{case.file.name} is not beside the checkout")
    sets = [*BARE, f"nozzle.offset_mm=[0,0,{-tip}]"]
    profiles = pipeline.load_profiles("cabfab-optim", None, "draft-0.4", sets)
    placed = pipeline.read(case.file, profiles, pipeline.Placement(scale=case.scale))
    path = pipeline.to_path(placed).toolpath
    robot = robot_from_printer(profiles.printer)
    robot = replace(robot, attachments=robot.attachments * [0.2, 0.2, 1.0])
    stages = printing_stages(path)
    judge = Judge(placed.part.vertices, placed.part.faces)
    return Printed(path, robot, stages, tree_of_beads(beads_of(path, stages)), judge)


def places_on(part, count):
    """Nozzle places evenly along all moves, with their stage and the row of their move."""
    path = part.path
    length = np.linalg.norm(np.diff(path.xyz, axis=0), axis=1)
    reach = np.cumsum(length)
    at = (np.arange(count) + 0.5) / count * reach[-1]
    row = np.minimum(np.searchsorted(reach, at, side="right"), len(length) - 1)
    share = 1 - (reach[row] - at) / np.where(length[row] > 0, length[row], 1.0)
    xyz = path.xyz[row] + np.clip(share, 0, 1)[:, None] * (path.xyz[row + 1] - path.xyz[row])
    return xyz, part.stages[row + 1], row + 1


def lower_cables(robot):
    return np.flatnonzero(robot.anchors[:, 2] < robot.anchors[:, 2].mean())


def told_depth(part, xyz, cable, bead):
    """(K,) mm: how far inside of the printed section of that bead's layer the exact method has the cable run."""
    items, robot = part.beads.items, part.robot
    named, deep = items.take(bead), np.zeros(len(bead))
    exits, tips = exit_points(robot, xyz)[np.arange(len(xyz)), cable], xyz + offsets(robot)[cable]
    share = ((named.low + named.top) / 2 - exits[:, 2]) / (tips[:, 2] - exits[:, 2])
    crossing = (exits + np.clip(share, 0, 1)[:, None] * (tips - exits))[:, :2]
    for stage in np.unique(named.stage):
        rows = np.flatnonzero(named.stage == stage)
        deep[rows] = depths(section(items.take(np.flatnonzero(items.stage == stage))), crossing[rows])
    return deep


def least(part, xyz, cable, tops):
    lines = lines_at(part.robot, xyz)
    every = np.arange(len(xyz))
    exits, tips = (ends[every, cable] - part.robot.bed_origin for ends in (lines.exit, lines.tip))
    return part.judge.least(exits, tips, tops)


def found_free(part, samples=SAMPLES):
    """Figures of points on moves that are called free, of which whole moves are proven."""
    robot = part.robot
    grow = float(robot.cable_radii[0] + robot.clearance[0])
    some = lower_cables(robot)
    xyz, _, row = places_on(part, samples // len(some))
    places, cables = np.repeat(np.arange(len(xyz)), len(some)), np.tile(some, len(xyz))
    away, looked = least(part, xyz[places], cables, xyz[places, 2] - LAYER)
    figures = {"points": len(away), "looked_at": looked}
    for keep in (0.0, grow):
        free = part.blocked(moves_of(part.path, part.stages), keep)[row[places], cables] < 0
        figures[keep] = {
            "free": int(free.sum()), "blocked": int((~free).sum()), "least_mm": float(away[free].min()),
            "touched": int((away[free] < keep - APART).sum()),
        }
    return figures


def found_blocked(part, asked):
    """Figures of places that are called blocked with a clearance of 0 for a cable that is a line."""
    xyz, stage, _ = places_on(part, asked)
    table = part.blocked(Moves(xyz, xyz, stage, np.arange(len(xyz))), 0.0)
    place, cable = np.nonzero(table >= 0)
    deep = told_depth(part, xyz[place], cable, table[place, cable]) > DEEP
    figures = {"blocked": len(place)}
    place, cable = place[deep], cable[deep]
    met, _ = least(part, xyz[place], cable, xyz[place, 2] + np.ptp([part.judge.low[2], part.judge.high[2]]) / BANDS)
    return figures | {"deep": len(met), "confirmed": int((met < 0).sum())}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_cables_called_free_touch_no_mesh(name, capsys):
    """A million points a part, against the part below the layer: with the profile's clearance and with none."""
    figures = found_free(printed(CASES[name], CASES[name].free_mm))
    with capsys.disabled():
        print(f"\n{name}: {figures}")
    assert figures["points"] >= SAMPLES - 8
    for keep in [key for key in figures if isinstance(key, float)]:
        assert figures[keep]["free"] > 0.5 * SAMPLES
        assert figures[keep]["touched"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_cables_called_deep_in_a_part_are_in_its_mesh(name, capsys):
    figures = found_blocked(printed(CASES[name], CASES[name].tip_mm), CASES[name].asked)
    with capsys.disabled():
        print(f"\n{name}: {figures}")
    assert figures["deep"] >= 1000
    assert figures["confirmed"] >= 0.95 * figures["deep"]
