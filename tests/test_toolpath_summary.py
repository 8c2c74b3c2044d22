"""Rules of a toolpath, each broken on purpose; and its figures against figures by hand."""

from dataclasses import replace

import numpy as np
import pytest
from toolpath_samples import PLA, block, layer, line, process

from cabslice.errors import ProductError
from cabslice.slicing.layer import Role
from cabslice.toolpath.checks import check_toolpath, find_faults
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.path import Events, Toolpath, piece_starts
from cabslice.toolpath.summary import summary

PATH = lay_toolpath(block(3), process(), PLA, filament_diameter_mm=1.75, source="block")
STILL = np.flatnonzero(PATH.filament < 0)
BEAD = np.flatnonzero(PATH.role == Role.OUTER_WALL)
MOVING = np.flatnonzero((PATH.role == Role.TRAVEL) & (PATH.lengths > 0))


def changed(column, row, value):
    copy = getattr(PATH, column).copy()
    copy[row] = value
    return replace(PATH, **{column: copy})


def test_a_laid_path_is_sound():
    assert find_faults(PATH) == ()
    check_toolpath(PATH)


@pytest.mark.parametrize(("path", "sentence", "row"), [
    (changed("role", 0, Role.CUSTOM), "row 0 lays", 0),
    (changed("filament", 0, 1.0), "row 0 lays", 0),
    (replace(PATH, starts=PATH.starts[1:]), "pieces do not run", 0),
    (replace(PATH, starts=PATH.starts[:-1]), "pieces do not run", 0),
    (replace(PATH, starts=np.setdiff1d(PATH.starts, STILL[1])), "shares its piece", STILL[1]),
    (changed("xyz", BEAD[1], PATH.xyz[BEAD[1] - 1]), "shares its piece", BEAD[1]),
    (changed("filament", STILL[0], 0.0), "feeds no filament", STILL[0]),
    (changed("layer", len(PATH.layer) - 1, 0), "the layer falls", len(PATH.layer) - 1),
    (changed("filament", MOVING[0], 0.1), "a travel feeds", MOVING[0]),
    (changed("filament", BEAD[0], -0.1), "a bead draws", BEAD[0]),
    (changed("width", BEAD[0], 0.0), "no width", BEAD[0]),
    (changed("height", BEAD[0], 0.0), "no width or height", BEAD[0]),
    (changed("speed", BEAD[0], 0.0), "no speed", BEAD[0]),
    (changed("role", BEAD[0], 99), "unknown role", BEAD[0]),
    (replace(PATH, events=Events(np.array([len(PATH.xyz)]), np.ones(1), np.ones(1))), "event belongs", 0),
    (replace(PATH, events=Events(np.array([5, 3]), np.ones(2), np.ones(2))), "not in order", 1),
])
def test_each_broken_rule_is_named_with_its_row(path, sentence, row):
    found = [fault for fault in find_faults(path) if sentence in fault]
    assert found, find_faults(path)
    assert found[0].endswith(f"(row {row})")
    with pytest.raises(ProductError, match=r"^block: "):
        check_toolpath(path)


def test_pieces_are_single_rests_and_the_runs_between():
    rests = np.array([1, 0, 0, 1, 1, 0, 1, 0], bool)
    assert piece_starts(rests).tolist() == [1, 3, 4, 5, 6, 7, 8]
    assert piece_starts(np.array([False, False])).tolist() == [1, 2]


def test_figures_by_hand():
    """10 mm of a 0.5 x 0.2 bead, a 3 mm step within the island, 4 mm more; density 2 g/cm^3."""
    layers = [layer([line([(0, 0), (10, 0)], width=0.5), line([(10, 3), (14, 3)], Role.BRIDGE, width=0.5)])]
    path = lay_toolpath(layers, process({"hop_mm": 0}), PLA, filament_diameter_mm=2.0, source="two lines")
    section = (0.5 - 0.2) * 0.2 + np.pi / 4 * 0.04
    found = summary(path, density_g_cm3=2.0)
    expected = {
        "layers": 1, "moves": 5, "pieces": 5, "extruded_mm": 14.0, "travel_mm": 3.0, "volume_mm3": 14 * section,
        "filament_mm": 14 * section / np.pi, "mass_g": 14 * section * 2e-3, "retractions": 1, "retracted_mm": 1.2,
        "filament_diameter_mm": 2.0,
    }
    assert {key: found[key] for key in expected} == pytest.approx(expected)
    assert found["bounds_mm"] == [[0, 0, 0.2], [14, 3, 0.2]]
    assert set(found["roles"]) == {"solid_infill", "bridge"}
    assert found["roles"]["bridge"]["length_mm"] == pytest.approx(4.0)
    assert found["source"] == "two lines"


def test_the_roles_add_up_to_the_whole():
    found = summary(PATH, density_g_cm3=1.24)
    for part, whole in (("length_mm", "extruded_mm"), ("filament_mm",) * 2, ("volume_mm3",) * 2, ("mass_g",) * 2):
        assert sum(role[part] for role in found["roles"].values()) == pytest.approx(found[whole])
    assert "mass_g" not in summary(PATH)


def test_a_path_without_moves():
    nothing = np.zeros(1)
    path = Toolpath(np.zeros((1, 3)), *[nothing] * 7, np.array([1]), Events.none(), 1.75)
    assert find_faults(path) == ()
    found = summary(path)
    assert (found["layers"], found["moves"], found["pieces"], found["bounds_mm"]) == (0, 0, 0, None)
