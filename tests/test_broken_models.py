"""Every broken model ends in a motor file and sentences on what was mended, or in one sentence on why not."""

import pytest
from cli_cases import MODELS, PRINTER, SETS, run

from cabslice.motors.formats import binary

BROKEN = sorted((MODELS / "broken").glob("*.stl"))
TOO_BIG = {"too_large.stl"}             # a good solid, but longer than the machine: the robot says no
NOTHING_TO_MEND = {"busted.stl", "subdivided_cube.stl"}   # closed as they are
UNITS = {"bunny_holes.stl": ["--unit", "m", "--scale", "0.05"]}


@pytest.mark.skipif(not BROKEN, reason="the shared models are not beside this checkout")
def test_the_broken_models_are_here():
    assert len(BROKEN) >= 19


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_a_broken_model_ends_in_a_motor_file_or_in_a_sentence(path, tmp_path, capsys):
    size = UNITS.get(path.name, ["--scale", "0.2"])
    if path.name in TOO_BIG:
        size = []
    target = tmp_path / "out.stream"
    coarse = [*SETS, "-s", "infill=0", "--period-ms", "20"]
    code = run("export", path, *PRINTER, *coarse, *size, "-o", target)
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    assert code in ((4,) if path.name in TOO_BIG else (0, 3))
    assert target.exists() == (code == 0)
    assert list(tmp_path.iterdir()) == [target] * (code == 0)
    if code == 0:
        header = binary.read(target).header
        assert header["numbers"]["filament_mm"] > 1.0
        assert header["rows"] > 50
        assert "print time" in out
        assert (len(err.splitlines()) > 1) == (path.name not in NOTHING_TO_MEND), err
    else:
        assert out == ""
        assert err.strip()


@pytest.mark.skipif(not BROKEN, reason="the shared models are not beside this checkout")
def test_a_part_thinner_than_a_layer_is_refused_not_made_empty(tmp_path, capsys):
    """The bunny in metres read as millimetres is 0.15 mm tall."""
    code = run("export", MODELS / "broken" / "bunny_holes.stl", *PRINTER, "-o", tmp_path / "out.stream")
    assert code == 3
    assert "unit" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
