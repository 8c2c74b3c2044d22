"""Temperatures, fan, layer times and pauses: where they stand, and that a G-code file keeps them."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toolpath_samples import PLA, block, layer, line, process

from cabslice.errors import ModelError
from cabslice.slicing.layer import Role
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.gcode import read_gcode, write_gcode
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.path import EventKind, Events


def lay(layers, material=None, **keys):
    path = lay_toolpath(layers, process(**keys), PLA.model_copy(update=material or {}), filament_diameter_mm=1.75)
    assert find_faults(path) == ()
    return path


def found(path, kind):
    chosen = path.events.kind == kind
    return list(zip(path.events.index[chosen].tolist(), path.events.value[chosen].tolist(), strict=True))


def first_rows(path):
    return np.flatnonzero(np.diff(path.layer, prepend=-1))


def test_the_first_layer_has_temperatures_of_its_own():
    path = lay(block(3), {"print_nozzle_c": 210.0, "first_nozzle_c": 220.0, "first_bed_c": 60.0, "bed_c": [40, 50]})
    second = int(first_rows(path)[1])
    assert found(path, EventKind.NOZZLE_TEMPERATURE) == [(0, 220.0), (second, 210.0)]
    assert found(path, EventKind.BED_TEMPERATURE) == [(0, 60.0), (second, 45.0)]
    plain = lay(block(3), {"print_bed_c": 48.0})
    assert found(plain, EventKind.BED_TEMPERATURE) == [(0, 48.0)]


@pytest.mark.parametrize("after", [0, 1, 2, 9])
def test_the_fan_starts_after_so_many_layers(after):
    path = lay(block(4), {"fan": 0.6, "fan_after_layers": after})
    begins = first_rows(path).tolist()
    wanted = [(0, 0.6)] if after == 0 else [(0, 0.0), *((row, 0.6) for row in begins[after:after + 1])]
    assert found(path, EventKind.FAN) == wanted


def test_bridges_have_a_fan_of_their_own():
    wall, bridge = line([(0, 0), (9, 0)], Role.INNER_WALL), line([(0, 1), (9, 1)], Role.BRIDGE)
    path = lay([layer([wall]), layer([wall, bridge], 1), layer([wall], 2)], {"fan": 0.3, "bridge_fan": 1.0})
    events = dict(found(path, EventKind.FAN))
    blown = np.zeros(len(path.role))
    for row, value in sorted(events.items()):
        blown[row:] = value
    laid = path.role != Role.TRAVEL
    wanted = np.where(path.layer == 0, 0.0, np.where(path.role == Role.BRIDGE, 1.0, 0.3))
    np.testing.assert_array_equal(blown[laid], wanted[laid])


def test_a_layer_time_is_asked_at_the_first_row_of_every_layer():
    path = lay(block(3), {"min_layer_s": 8.0, "min_speed_mm_s": 12.0})
    assert found(path, EventKind.MIN_LAYER_TIME) == [(row, 8.0) for row in first_rows(path).tolist()]
    assert found(path, EventKind.MIN_PRINT_SPEED) == [(0, 12.0)]
    assert not found(lay(block(3)), EventKind.MIN_LAYER_TIME)


@pytest.mark.parametrize("hop", [0.0, 0.4])
def test_a_pause_waits_at_rest_drawn_back_and_lifted_before_its_layer(hop):
    keys = {"pause_layers": [2], "filament_change_layers": [1], "retraction": {"hop_mm": hop}}
    path = lay([layer([line([(0, 0), (9, 0)])], index) for index in range(4)], **keys)
    for kind, number in ((EventKind.PAUSE, 2), (EventKind.FILAMENT_CHANGE, 1)):
        (row, _), = found(path, kind)
        assert row in path.starts
        assert row >= first_rows(path)[number]
        laid = path.role[:row] != Role.TRAVEL
        assert path.layer[:row][laid].max() == number - 1
        assert path.role[row] == Role.TRAVEL
        assert path.filament[:row][~laid].sum() == pytest.approx(-1.2)     # drawn back, not yet primed
        assert path.xyz[row - 1, 2] == pytest.approx(path.xyz[:row][laid][-1, 2] + hop + (0.2 if hop else 0))
    file = io.BytesIO()
    write_gcode(path, file, printer_name="made-up", material=PLA, process=process())
    again = read_gcode(file.getvalue().decode()).toolpath
    np.testing.assert_array_equal(again.events.kind, path.events.kind)
    np.testing.assert_array_equal(again.events.index, path.events.index)
    np.testing.assert_array_equal(again.starts, path.starts)


def test_a_pause_before_a_layer_that_is_not_there_is_refused():
    with pytest.raises(ModelError, match=r"pause_layers: there is no layer 7 .* 0 to 2"):
        lay(block(3), pause_layers=[7])


def test_a_rest_within_a_piece_is_a_fault():
    path = lay([layer([line([(0, 0), (9, 0), (9, 9)])])])
    broken = replace(path, events=Events([2], [EventKind.PAUSE], [0.0]))
    assert any("a rest within a piece" in fault for fault in find_faults(broken))


def test_the_command_line_stops_before_layers_of_parts_and_of_gcode(tmp_path):
    from click.testing import CliRunner

    from cabslice import store
    from cabslice.cli.main import cli

    cube = Path(__file__).parents[1] / "samples" / "cube.stl"
    make = ["-p", "cabfab-optim", "-q", "-s", "layer_mm=0.3", "-s", "infill=0.05", "--pause-at", "3,7"]
    run(cli, CliRunner(), "slice", str(cube), *make, "-o", str(tmp_path / "a.path"))
    path = store.load(tmp_path / "a.path")[1].toolpath
    assert [int(path.layer[row]) for row, _ in found(path, EventKind.PAUSE)] == [3, 7]
    run(cli, CliRunner(), "slice", str(cube), *make[:-2], "-o", str(tmp_path / "b.gcode"))
    stop = ["-p", "cabfab-optim", "-q", "--filament-change-at", "5", "-o", str(tmp_path / "c.path")]
    run(cli, CliRunner(), "slice", str(tmp_path / "b.gcode"), *stop)
    again = store.load(tmp_path / "c.path")[1].toolpath
    (row, _), = found(again, EventKind.FILAMENT_CHANGE)
    assert again.layer[row - 1:row + 1].tolist() == [4, 5]
    assert find_faults(again) == ()


def run(cli, runner, *arguments):
    result = runner.invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
