"""Several parts and copies on one bed: apart, together the same as alone, one after the other only with room for it."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice import pipeline, store
from cabslice.cli.main import main
from cabslice.errors import ImpossibleError
from cabslice.mesh.arrange import rows
from cabslice.robot.model import robot_from_printer
from cabslice.slicing.layer import Role
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.path import EventKind

CUBE = Path(__file__).parents[1] / "samples" / "cube.stl"
QUICK = ("layer_mm=0.3", "first_layer_mm=0.3", "infill=0.05", "walls=1", "top_layers=1", "bottom_layers=1")


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(1, 90), st.floats(1, 90)), min_size=1, max_size=12), st.floats(0, 20))
def test_rectangles_lie_apart_around_the_middle(sizes, gap):
    size = np.array(sizes)
    middle = rows(size, gap, np.array([300.0, 200.0]))
    low, high = middle - size / 2, middle + size / 2
    np.testing.assert_allclose(low.min(0) + high.max(0), 0, atol=1e-9)
    for i in range(len(size)):
        for j in range(i):
            between = np.maximum(low[i] - high[j], low[j] - high[i])
            assert between.max() >= gap - 1e-9
    np.testing.assert_array_equal(middle, rows(size, gap, np.array([300.0, 200.0])))
    assert (high.max(0) - low.min(0) <= size.sum(0) + gap * len(size) + 1e-9).all()


def test_equal_rectangles_fill_a_long_bed_in_long_rows():
    middle = rows(np.full((6, 2), 10.0), 2.0, np.array([90.0, 30.0]))
    assert len(np.unique(middle[:, 1])) == 2


def profiles(*sets):
    return pipeline.load_profiles("cabfab-optim", None, None, (*QUICK, *sets))


def laid(profile, **placement):
    return pipeline.to_path(pipeline.read(CUBE, profile, pipeline.Placement(**placement))).toolpath


def test_copies_are_the_part_as_often_as_asked():
    profile = profiles("skirt_loops=0")
    one, four = laid(profile, scale=0.3), laid(profile, scale=0.3, copies=4, gap_mm=7.0)
    assert find_faults(four) == ()
    used = [path.filament[path.role == Role.OUTER_WALL].sum() for path in (one, four)]
    assert used[1] == pytest.approx(4 * used[0], rel=1e-5)
    wall = four.xyz[four.role == Role.OUTER_WALL][:, :2]
    side = 0.3 * 20 / 2 + 7 / 2                      # from the middle of the bed to that of a copy
    for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        own = wall[(np.sign(wall) == (x, y)).all(1)]
        np.testing.assert_allclose((own.min(0) + own.max(0)) / 2, (x * side, y * side), atol=0.01)


def test_one_after_the_other_goes_over_what_stands():
    profile = profiles("retraction.hop_mm=0")
    path = laid(profile, scale=0.2, copies=3, sequence="objects")
    assert find_faults(path) == ()
    assert np.unique(path.object).tolist() == [0, 1, 2]
    assert (np.diff(path.layer) >= 0).all()
    height = path.xyz[path.role != Role.TRAVEL, 2].max()
    for number in (1, 2):
        begin = int(np.flatnonzero(path.object == number)[0])
        way = path.xyz[begin:int(np.flatnonzero((path.object == number) & (path.role != Role.TRAVEL))[0])]
        across = np.flatnonzero(np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1) > 0)
        assert (way[np.append(across, across + 1), 2] >= height + 2 - 1e-9).all()
    alone = laid(profile, scale=0.2)
    used = [one.filament[one.role == Role.OUTER_WALL].sum() for one in (alone, path)]
    assert used[1] == pytest.approx(3 * used[0], rel=1e-5)
    first = path.layer == path.layer[(path.object == 1) & (path.role != Role.TRAVEL)].min()
    assert path.speed[first & (path.role == Role.OUTER_WALL)].max() <= profile.process.speeds_mm_s.first_layer
    fan = np.zeros(len(path.layer))
    for row, kind, value in zip(path.events.index, path.events.kind, path.events.value, strict=True):
        fan[row:] = value if kind == EventKind.FAN else fan[row:]
    beads = path.role != Role.TRAVEL
    assert (fan[beads & (path.xyz[:, 2] < 0.31)] == 0).all()     # the first layer of every object
    assert (fan[beads & (path.xyz[:, 2] > 0.31)] > 0).all()
    still = laid(profiles("retraction.length_mm=0"), scale=0.2, copies=2, sequence="objects")
    assert still.xyz[:, 2].max() >= height + 2 - 1e-9            # over it also where nothing is drawn back


def test_one_after_the_other_needs_room_for_the_platform():
    profile = profiles()
    with pytest.raises(ImpossibleError, match=r"need .* mm between them: the platform"):
        pipeline.read(CUBE, profile, pipeline.Placement(copies=2, gap_mm=1.0, sequence="objects"))
    tall = pipeline.read(CUBE, profile, pipeline.Placement(scale=8.0, copies=2, sequence="objects")).parts
    robot = robot_from_printer(profile.printer)
    hanging = robot.attachments - robot.nozzle
    radius = np.hypot(*hanging[hanging[:, 2] < 160].T[:2]).max()
    gap = max(tall[1].bounds[0] - tall[0].bounds[1])
    assert gap >= radius


def test_the_command_line_places_several_parts(tmp_path, capsys):
    ask = ["slice", str(CUBE), str(CUBE), "-p", "cabfab-optim", "--scale", "0.3", "--copies", "2", "--json"]
    sets = [word for key in QUICK for word in ("-s", key)]
    assert main([*ask, *sets, "-o", str(tmp_path / "a.path")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["part"] == "4 x cube.stl"
    assert len(answer["placement"]["modifiers"]) == 4
    assert main([*ask, *sets, "-o", str(tmp_path / "b.path")]) == 0
    assert (tmp_path / "a.path").read_bytes() == (tmp_path / "b.path").read_bytes()
    again = [*ask[:2], "nowhere.stl", *ask[3:]]
    assert main([*again, "-o", str(tmp_path / "c.path")]) == 3
    assert "nowhere.stl: there is no such file" in capsys.readouterr().out
    product = store.load(tmp_path / "a.path")[1]
    assert find_faults(product.toolpath) == ()
