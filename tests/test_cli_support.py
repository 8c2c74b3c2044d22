"""Support as a user asks for it: from the command line to the path, the check and the G-code."""

import numpy as np
import pytest
import shapely
from cli_cases import PRINTER, SETS, answered, run
from slicing_kit import prism
from support_kit import table, write_stl

from cabslice import store
from cabslice.slicing.layer import Role

ASKED = [*PRINTER, *SETS, "-s", "support.kind=straight"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A table that stands away from the origin, and the left half of the room around it."""
    monkeypatch.chdir(tmp_path)
    part, half = table(3.0, 12.0), prism(shapely.box(-30, -30, 0, 30), 0.0, 30.0)
    for name, mesh in (("table", part), ("left", half)):
        mesh.vertices = mesh.vertices + np.array([40.0, 7.0, 3.0])
        write_stl(tmp_path / f"{name}.stl", mesh)
    return tmp_path


def support_of(path):
    laid = store.load(path)[1].toolpath
    return laid.xyz[np.isin(laid.role, (Role.SUPPORT, Role.SUPPORT_INTERFACE))], laid


def test_a_blocker_lies_where_it_was_drawn_around_the_part(folder, capsys):
    """Turned by half a turn with the part, and set on the bed with it."""
    code, said = answered(capsys, "slice", "table.stl", *ASKED, "--turn", "0 0 180", "--support-blocker", "left.stl")
    assert code == 0
    assert said["placement"]["modifiers"][0].startswith("support blocker left.stl sha256:")
    found, _ = support_of("table.path")
    assert len(found)
    assert found[:, 0].max() < 0.3
    assert found[:, 0].min() < -5


def test_speeds_of_support(folder, capsys):
    sets = ["-s", "speeds_mm_s.support=37", "-s", "speeds_mm_s.support_interface=23"]
    assert answered(capsys, "slice", "table.stl", *ASKED, *sets)[0] == 0
    _, laid = support_of("table.path")
    above = laid.layer > 0
    for role, speed in ((Role.SUPPORT, 37), (Role.SUPPORT_INTERFACE, 23)):
        assert set(laid.speed[above & (laid.role == role)]) == {speed}


def test_gcode_names_support_as_prusaslicer_does(folder, capsys):
    assert run("slice", "table.stl", *ASKED, "-o", "table.gcode", "-q") == 0
    text = (folder / "table.gcode").read_text()
    assert ";TYPE:Support material\n" in text
    assert ";TYPE:Support material interface\n" in text


def test_refusals(folder, capsys):
    assert run("slice", "table.stl", *PRINTER, "--support-blocker", "left.stl") == 2
    assert "support.kind" in capsys.readouterr().err
    assert run("slice", "table.stl", *ASKED, "--support-blocker", "none.stl") == 3
    assert "none.stl" in capsys.readouterr().err
    assert run("slice", "table.stl", *ASKED, "-s", "support.angle_deg=95") == 3
    assert "support.angle_deg" in capsys.readouterr().err
    assert run("slice", "table.stl", *ASKED) == 0
    assert run("check", "table.path", "--support-blocker", "left.stl") == 2
