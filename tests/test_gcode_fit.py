"""G-code made for another filament or nozzle, or with beads that cannot be, is not taken silently."""

import numpy as np
import pytest
from click.testing import CliRunner

from cabslice.cli.main import cli, main
from cabslice.errors import GcodeError
from cabslice.slicing.flow import bead_area
from cabslice.toolpath.gcode_fit import fitted
from cabslice.toolpath.gcode_read import read_gcode

AREA = np.pi / 4 * 1.75**2


def square(*, settings="", filament=1.75, tags=True, feed=1.0, bead=(0.45, 0.2), layers=3):
    """Some layers of a square of 30 mm; E of beads so wide and high, for this filament, times `feed`."""
    e = 30 * float(bead_area(*bead)) / (np.pi / 4 * filament**2) * feed
    lines = ["M83", "G1 X100 Y100 Z0.2 F6000"]
    for k in range(layers):
        lines += [";LAYER_CHANGE", f"G1 X100 Y100 Z{0.2 * (k + 1):.3f}", ";TYPE:External perimeter"]
        lines += [f";WIDTH:{bead[0]}", f";HEIGHT:{bead[1]}"] if tags else []
        lines += [f"G1 X{x} Y{y} E{e:.5f} F1200" for x, y in ((130, 100), (130, 130), (100, 130), (100, 100))]
    return "\n".join([*lines, settings, ""])


def fit(text, *, mismatch="refuse", filament=1.75, nozzle=0.4, **keys):
    reading = read_gcode(text, origin=(115, 115), usual_filament_mm=filament, **keys)
    return fitted(reading, filament_mm=filament, nozzle_mm=nozzle, mismatch=mismatch)


def said(reading):
    return [sentence for sentence in reading.warnings if "left out" not in sentence]


def volume(reading):
    return reading.toolpath.filament.sum() * reading.toolpath.filament_area_mm2


@pytest.mark.parametrize("tags", [True, False])
def test_what_fits_is_taken_as_it_is(tags):
    reading = fit(square(settings="; filament_diameter = 1.75\n; nozzle_diameter = 0.4", tags=tags))
    assert said(reading) == []
    assert volume(reading) == pytest.approx(12 * 30 * float(bead_area(0.45, 0.2)), rel=1e-4)


@pytest.mark.parametrize("word", [
    "; filament_diameter = 2.85", "; filament_diameter: 2.85", "; filament_diameter = 2.85,2.85",
])
def test_another_filament_is_refused_or_converted_to_the_same_plastic(word):
    text = square(settings=word, filament=2.85)
    with pytest.raises(GcodeError, match=r"made for filament of 2\.85 mm, the printer takes 1\.75 mm.*--mismatch"):
        fit(text)
    made = fit(text, mismatch="convert")
    assert made.toolpath.filament_diameter_mm == 1.75
    assert volume(made) == pytest.approx(12 * 30 * float(bead_area(0.45, 0.2)), rel=1e-4)
    assert "2.85" in " ".join(made.warnings)
    raw = fit(text, mismatch="ignore")
    np.testing.assert_array_equal(raw.toolpath.filament, read_gcode(text).toolpath.filament)
    assert "0.38 times" in " ".join(raw.warnings)


def test_a_file_that_does_not_tell_its_filament_is_known_by_its_beads():
    for tags in (True, False):
        text = square(filament=2.85, tags=tags)
        with pytest.raises(GcodeError, match=r"hold 0\.[34]\d times .* filament of 2\.85 mm .*--gcode-filament-mm"):
            fit(text)
        told = fit(text, filament_diameter_mm=2.85, mismatch="convert")
        assert volume(told) == pytest.approx(12 * 30 * float(bead_area(0.45, 0.2)), rel=1e-4)


def test_another_nozzle_is_refused_or_said():
    text = square(settings="; nozzle_diameter = 0.6\n; filament_diameter = 1.75", bead=(0.6, 0.2))
    with pytest.raises(GcodeError, match=r"nozzle of 0\.6 mm, the printer has 0\.4 mm"):
        fit(text)
    assert "0.6 mm" in fit(text, mismatch="ignore").warnings[-1]
    assert said(fit(text, nozzle=0.6)) == []


def test_a_bead_that_no_nozzle_lays_is_refused_with_its_line():
    lines = square(tags=False).splitlines()
    at = next(k for k, line in enumerate(lines) if " E" in line)
    lines[at] = "G1 X130 Y100 E90 F1200"
    with pytest.raises(GcodeError, match=rf"line {at + 1}: feeds 90 mm of filament over 30 mm, a bead 36\.1 mm wide"):
        fit("\n".join(lines))


def test_the_shift_onto_our_bed_is_said():
    reading = read_gcode(square(settings="; bed_shape = 0x0,250x0,250x210,0x210"))
    assert any("x 125 y 105 mm" in sentence and "--gcode-origin" in sentence for sentence in reading.warnings)
    np.testing.assert_allclose(reading.toolpath.xyz[:, :2].min(0), [-25, -5])
    assert not any("bed" in sentence for sentence in read_gcode(square(), origin=(0, 0)).warnings)


def test_the_command_line_refuses_and_converts(tmp_path, capsys):
    file = tmp_path / "job.gcode"
    file.write_text(square(settings="; filament_diameter = 2.85", filament=2.85))
    ask = ["slice", str(file), "-p", "cabfab-optim", "-o", str(tmp_path / "job.path")]
    assert main(ask) == 3
    assert "made for filament of 2.85 mm" in capsys.readouterr().err
    assert main([*ask, "--mismatch", "convert", "--gcode-origin", "115 115"]) == 0
    assert "E was divided by" in capsys.readouterr().err


def test_settings_that_gcode_has_settled_are_refused(tmp_path, capsys):
    file = tmp_path / "job.gcode"
    file.write_text(square())
    ask = ["check", str(file), "-p", "cabfab-optim"]
    assert main([*ask, "-s", "infill=0.5"]) == 2
    assert "infill" in capsys.readouterr().err
    assert main([*ask, "-s", "corner_mm=0.06"]) == 0
    result = CliRunner().invoke(cli, ["check", "samples/cube.stl", "-p", "cabfab-optim", "--mismatch", "ignore"])
    assert "is no G-code" in str(result.exception)
