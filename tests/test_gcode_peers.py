"""Files of a real PrusaSlicer read, and their beads laid again by us with less travel."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from toolpath_samples import PLA, process

from cabslice.slicing.layer import Beads, Layer, Polygons, Role
from cabslice.toolpath.checks import find_faults
from cabslice.toolpath.gcode import read_gcode
from cabslice.toolpath.order import lay_toolpath

MODELS = Path(__file__).parents[2] / "shared" / "models"
SETTINGS = (
    "--layer-height", "0.2", "--first-layer-height", "0.2", "--perimeters", "2", "--fill-density", "20%",
    "--fill-pattern", "grid", "--skirts", "1", "--bed-shape", "0x0,250x0,250x210,0x210", "--filament-diameter", "1.75",
)


def missing(what):
    if os.environ.get("CABSLICE_PEERS") == "1":
        pytest.fail(f"CABSLICE_PEERS=1 but {what}")
    pytest.skip(what)


@pytest.fixture(scope="module", params=["relative", "absolute"])
def cube(request, tmp_path_factory):
    slicer, model = shutil.which("prusa-slicer"), MODELS / "xyz_cube.stl"
    if slicer is None:
        missing("prusa-slicer is not installed (Debian: apt install prusa-slicer)")
    if not model.exists():
        missing(f"the model {model.name} is not there")
    target = tmp_path_factory.mktemp("peer") / "cube.gcode"
    extra = ("--use-relative-e-distances",) if request.param == "relative" else ()
    command = [slicer, "--export-gcode", str(model), "-o", str(target), *SETTINGS, *extra]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return target


def test_a_file_of_prusaslicer_is_read(cube):
    """The part stands in the middle of the bed, and the filament is what the file says of itself."""
    reading = read_gcode(cube)
    path = reading.toolpath
    assert find_faults(path) == ()
    shifted, = (said for said in reading.warnings if "left out" not in said)
    assert "x 125 y 105 mm, the middle of the slicer's bed" in shifted
    part = path.xyz[(path.role == Role.OUTER_WALL) & (path.layer == 50), :2]
    np.testing.assert_allclose((part.min(0) + part.max(0)) / 2, 0, atol=0.05)
    np.testing.assert_allclose(part.max(0) - part.min(0), 20 - 0.45, atol=0.5)
    said = next(line for line in cube.read_text().splitlines() if line.startswith("; filament used [mm]"))
    assert path.filament[path.role != Role.TRAVEL].sum() == pytest.approx(float(said.split("=")[1]), rel=2e-3)
    assert path.layer.max() + 1 == 100
    expected = {Role.OUTER_WALL, Role.INNER_WALL, Role.SOLID_INFILL, Role.TOP_SKIN, Role.SPARSE_INFILL, Role.SKIRT}
    assert expected <= set(path.role)


def layers_of(path):
    """The beads of a path as unordered layers, each line its own, all in one island."""
    laid = path.role != Role.TRAVEL
    like_before = (np.diff(path.role, prepend=0) == 0) & (np.diff(path.layer, prepend=0) == 0)
    new = laid & ~(np.append(False, laid[:-1]) & like_before)
    begins = np.flatnonzero(new)
    sizes = np.add.reduceat(laid[begins[0]:].astype(int), begins - begins[0])
    for index in np.unique(path.layer[laid]):
        lines = [(b, s) for b, s in zip(begins, sizes, strict=True) if path.layer[b] == index]
        points = np.concatenate([path.xyz[b - 1:b + s, :2] for b, s in lines])
        starts = np.cumsum([0] + [s + 1 for _, s in lines])
        roles = np.array([path.role[b] for b, _ in lines])
        width = np.concatenate([path.width[[b, *range(b, b + s)]] for b, s in lines])
        zero = np.zeros(len(lines))
        z, height = path.xyz[lines[0][0], 2], path.height[lines[0][0]]
        beads = Beads(points, starts, width, roles, zero, zero)
        yield Layer(int(index), z, height, Polygons(np.empty((0, 2)), np.zeros(1)), beads)


def test_beads_of_prusaslicer_are_laid_with_no_more_travel(cube):
    theirs = read_gcode(cube).toolpath
    ours = lay_toolpath(layers_of(theirs), process({"hop_mm": 0}), PLA, filament_diameter_mm=1.75)
    lengths = [np.bincount(path.role, path.lengths, len(Role)) for path in (ours, theirs)]
    np.testing.assert_allclose(lengths[0][1:], lengths[1][1:], rtol=2e-3, atol=0.1)
    assert lengths[0][Role.TRAVEL] < 1.02 * lengths[1][Role.TRAVEL]


CUBE = Path(__file__).parents[1] / "samples" / "cube.stl"
CURA_DEFINITIONS = [
    Path(os.environ.get("CURA_DEFINITIONS", "")) / "fdmprinter.def.json",
    *(Path(root) / "cura/resources/definitions/fdmprinter.def.json" for root in ("/usr/share", "/usr/local/share")),
]


def made_by(peer, target):
    """The command that slices the sample cube with a program, absolute E, 1.75 mm (CuraEngine: 2.85 mm)."""
    if peer == "CuraEngine":
        definition = next((one for one in CURA_DEFINITIONS if one.exists()), None)
        if definition is None:
            missing("fdmprinter.def.json of Cura is not there (Debian: cura; or set CURA_DEFINITIONS)")
        return ["slice", "-j", str(definition), "-s", "layer_height=0.3", "-e0", "-l", str(CUBE), "-o", str(target)]
    sizes = ["--layer-height", "0.3", "--nozzle-diameter", "0.4", "--filament-diameter", "1.75"]
    export = ["--export-gcode"] if peer == "prusa-slicer" else []
    return [*export, str(CUBE), "-o", str(target), *sizes]


@pytest.mark.parametrize("peer", ["prusa-slicer", "slic3r", "CuraEngine"])
def test_a_file_of_any_slicer_gets_a_verdict(peer, tmp_path, capsys):
    from cabslice.cli.main import main

    target = tmp_path / "cube.gcode"
    command = made_by(peer, target)
    if shutil.which(peer) is None:
        missing(f"{peer} is not installed")
    subprocess.run([peer, *command], check=True, capture_output=True, timeout=300)
    ask = ["check", str(target), "-p", "cabfab-optim"]
    if peer == "CuraEngine":       # its G-code does not say that E is for 2.85 mm
        assert main(ask) == 3
        assert "--gcode-filament-mm" in capsys.readouterr().err
        ask += ["--gcode-filament-mm", "2.85", "--mismatch", "convert"]
    assert main([*ask, "-s", "nozzle.diameter_mm=0.4"]) == 0
    assert "cabfab-optim can make cube.gcode as asked." in capsys.readouterr().out
