"""The printer's own lines in G-code files: where they stand, what their placeholders become, what is refused."""

import io

import pytest
from click.testing import CliRunner
from toolpath_samples import PLA, block, process

from cabslice.cli.main import cli
from cabslice.profile.placeholders import PLACEHOLDERS
from cabslice.profile.shelf import load_printer
from cabslice.toolpath.gcode import read_gcode, write_gcode
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.path import EventKind


def written(path, **own):
    file = io.BytesIO()
    write_gcode(path, file, printer_name="made-up", material=PLA, process=process(), **own)
    return file.getvalue().decode()


@pytest.fixture(scope="module")
def path():
    return lay_toolpath(block(), process(), PLA, filament_diameter_mm=1.75)


def test_every_placeholder_becomes_the_figure_of_the_print(path):
    text = written(path, start="\n".join(f"; own {name} {{{name}}}" for name in PLACEHOLDERS))
    own = dict(line[6:].split(" ", 1) for line in text.splitlines() if line.startswith("; own "))
    assert set(own) == set(PLACEHOLDERS)
    beads = path.role != 0
    heat = {kind: path.events.value[path.events.kind == kind][0] for kind in
            (EventKind.NOZZLE_TEMPERATURE, EventKind.BED_TEMPERATURE)}
    assert float(own["first_nozzle_c"]) == heat[EventKind.NOZZLE_TEMPERATURE]
    assert float(own["first_bed_c"]) == heat[EventKind.BED_TEMPERATURE]
    assert (own["layers"], own["height_mm"], own["min_x_mm"], own["max_y_mm"]) == ("4", "0.8", "-15", "15")
    assert float(own["filament_mm"]) == pytest.approx(path.filament[beads].sum(), abs=1e-3)
    assert (own["printer"], own["material"], own["process"]) == ("made-up", PLA.name, process().name)
    assert (own["nozzle_mm"], own["layer_mm"]) == ("0.4", "0.2")


def test_they_stand_before_the_modes_and_after_the_print_and_change_nothing_else(path):
    plain, own = written(path), written(path, start="G28\nMACRO {a b}", end="G0 Z{height_mm}")
    lines = own.splitlines()
    assert lines.index("G28") < lines.index("G90 ; absolute coordinates") < lines.index("M83 ; relative filament")
    assert "MACRO {a b}" in lines                        # braces that hold no name stay
    assert lines.index("G0 Z0.8") > max(k for k, line in enumerate(lines) if line.startswith("G1"))
    left = [line for line in lines if line not in ("G28", "MACRO {a b}", "G0 Z0.8", ";TYPE:Custom")]
    assert left == [line for line in plain.splitlines() if line != ";TYPE:Custom"]


def test_a_file_with_own_lines_is_read_back_as_the_same_path(path):
    text = written(path, start="M17 ; {printer}", end="M300 ; {print_s}")
    again = read_gcode(text, origin=(0, 0), filament_diameter_mm=1.75).toolpath
    assert abs(again.xyz - path.xyz).max() <= 1e-3


def test_the_profile_refuses_a_placeholder_that_there_is_not_and_slice_uses_the_lines(tmp_path):
    run = CliRunner().invoke(cli, ["slice", "samples/cube.stl", "-p", "cabfab-optim", "-s", "layer_mm=0.4", "-s",
                                   "first_layer_mm=0.4", "-s", "gcode.start='M117 {height_mm} of {material}'", "-o",
                                   str(tmp_path / "a.gcode")])
    assert run.exit_code == 0, run.output
    assert "\nM117 20 of pla\n" in (tmp_path / "a.gcode").read_text()
    assert load_printer("cabfab-optim").gcode.start == ""
    run = CliRunner().invoke(cli, ["slice", "samples/cube.stl", "-p", "cabfab-optim", "-s", "gcode.end='{hight_mm}'"])
    told = f"{run.output}{run.exception}"
    assert run.exit_code
    assert "gcode.end" in told
    assert "{hight_mm} is no placeholder; expected one of " in told
