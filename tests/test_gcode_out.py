"""G-code as printers and viewers want it: flavours, thumbnails, progress, weight and cost; read back the same."""

import base64
import io
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from test_gcode import assert_same
from toolpath_samples import PLA, block, process

from cabslice.cli.main import main
from cabslice.slicing.layer import Role
from cabslice.toolpath.gcode import read_gcode, write_gcode
from cabslice.toolpath.gcode_flavor import FLAVORS
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.thumbnail import picture, png

CUBE = Path(__file__).parents[1] / "samples" / "cube.stl"
RICH = PLA.model_copy(update={
    "pressure_advance_s": 0.045, "price_per_kg": 25.0, "min_layer_s": 6.0, "first_nozzle_c": 215,
})


def lay():
    return lay_toolpath(
        block(5), process(pause_layers=[2], filament_change_layers=[3]), RICH, filament_diameter_mm=1.75, source="block"
    )


def two_objects():
    layers = block(3)
    again = [type(one)(one.index + 3, one.z_mm, one.height_mm, one.outline, one.beads) for one in layers]
    return lay_toolpath([*layers, *again], process(), RICH, filament_diameter_mm=1.75, source="blocks")


def written(path, flavor="marlin", **keys):
    file = io.BytesIO()
    write_gcode(path, file, printer_name="made-up", material=RICH, process=process(), flavor=flavor, **keys)
    return file.getvalue().decode()


@pytest.mark.parametrize("flavor", FLAVORS)
@pytest.mark.parametrize("make", [lay, two_objects])
def test_every_flavour_read_back_is_the_toolpath(flavor, make):
    path = make()
    reading = read_gcode(written(path, flavor, bed_mm=(400.0, 300.0)))
    assert reading.warnings == ()
    assert_same(path, reading.toolpath)


@pytest.mark.parametrize(("flavor", "words"), [
    ("marlin", ["M900 K0.045", "M601 ; pause", "M106 S153", "M486 T2"]),
    ("klipper", ["SET_PRESSURE_ADVANCE ADVANCE=0.045", "PAUSE", "EXCLUDE_OBJECT_START NAME=object_1"]),
    ("reprapfirmware", ["M572 D0 S0.045", "M226 ; pause", "M106 P0 S0.6", "M486 S1"]),
])
def test_each_firmware_gets_its_own_words(flavor, words):
    lines = set((written(lay(), flavor) + written(two_objects(), flavor)).splitlines())
    assert set(words) <= lines
    assert {"M104 S0 ; heating off", "M600 ; change the filament"} <= lines
    assert not any(line.startswith("M84") for line in lines)       # a cable robot must not let go


def test_thumbnails_are_pictures_of_the_part():
    text = written(lay())
    for width, height in ((32, 32), (220, 124)):
        found = re.search(rf"; thumbnail begin {width}x{height} (\d+)\n(.*?); thumbnail end", text, re.S)
        body = found[2].replace("; ", "").replace("\n", "")
        assert len(body) == int(found[1])
        data = base64.b64decode(body)
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        assert struct.unpack(">II", data[16:24]) == (width, height)
        size = struct.unpack(">I", data[33:37])[0]
        lines = np.frombuffer(zlib.decompress(data[41:41 + size]), np.uint8).reshape(height, 1 + 4 * width)
        image = lines[:, 1:].reshape(height, width, 4)
        np.testing.assert_array_equal(image, picture(lay(), width, height))
        assert 0.05 < (image[..., 3] > 0).mean() < 0.95
        assert image[image[..., 3] > 0][:, :3].min() > 0
    assert png(picture(lay(), 32, 32)) == png(picture(lay(), 32, 32))


def test_progress_rises_to_the_end_and_time_falls():
    told = [(int(p), int(r)) for p, r in re.findall(r"^M73 P(\d+) R(\d+)$", written(lay()), re.M)]
    percents, minutes = zip(*told, strict=True)
    assert percents[0] == 0
    assert percents[-1] == 99
    assert list(percents) == sorted(set(percents))
    assert list(minutes) == sorted(minutes, reverse=True)


def test_the_end_tells_filament_weight_cost_and_bed():
    path = lay()
    text = written(path, bed_mm=(400.0, 300.0))
    laid = path.filament[path.role != Role.TRAVEL].sum()
    grams = laid * path.filament_area_mm2 * 1.24e-3
    assert float(re.search(r"; filament used \[g\] = (.*)", text)[1]) == pytest.approx(grams, abs=0.005)
    assert float(re.search(r"; filament cost = (.*)", text)[1]) == pytest.approx(grams * 0.025, abs=0.005)
    assert "; bed_shape = -200x-150,200x-150,200x150,-200x150" in text
    assert re.search(r"; estimated printing time \(normal mode\) = (\d+[dhms] ?)+\n", text)


def test_the_command_line_chooses_flavour_and_counts_the_cost(tmp_path, capsys):
    ask = ["slice", str(CUBE), "-p", "cabfab-optim", "-s", "infill=0.05", "-s", "layer_mm=0.3", "-s", "price_per_kg=30"]
    assert main([*ask, "-o", str(tmp_path / "a.gcode"), "--flavor", "klipper", "--pause-at", "4"]) == 0
    assert re.search(r"^cost +0\.\d\d$", capsys.readouterr().out, re.M)
    text = (tmp_path / "a.gcode").read_text()
    assert "\nPAUSE\n" in text
    assert "; gcode_flavor = klipper" in text
