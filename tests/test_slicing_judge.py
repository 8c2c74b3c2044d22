"""The judge of pixels on whole parts at full infill, ours and, with CABSLICE_PEERS=1, PrusaSlicer's and CuraEngine's.

The judge itself is held against shapely first.
"""

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_judge import NOTHING, PIXEL, Canvas, Judgement, judge_lines, section, segments
from slicing_kit import bead_volume, process, shape_of

from cabslice.mesh.load import load_mesh
from cabslice.mesh.place import place
from cabslice.slicing.flow import bead_area, bead_spacing
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import slice_part

MODELS = Path(__file__).parents[2] / "shared" / "models"
FINS = Path(__file__).parents[1] / "samples" / "fins.stl"
CURA_DEFINITIONS = [
    Path(os.environ.get("CURA_DEFINITIONS", "")) / "fdmprinter.def.json",
    *(Path(root) / "cura/resources/definitions/fdmprinter.def.json" for root in ("/usr/share", "/usr/local/share")),
]
PRUSA = (
    "--layer-height", "0.2", "--first-layer-height", "0.2", "--perimeters", "2", "--fill-density", "100%",
    "--fill-pattern", "rectilinear", "--skirts", "0", "--bed-shape", "0x0,300x0,300x300,0x300",
)
CURA = (
    "layer_height=0.2", "layer_height_0=0.2", "wall_line_count=2", "top_layers=99999", "bottom_layers=99999",
    "infill_sparse_density=100", "infill_line_distance=0.4", "infill_pattern=lines", "adhesion_type=none",
    "center_object=true", "machine_center_is_zero=true", "machine_width=300", "machine_depth=300",
    "fill_outline_gaps=true", "retraction_enable=false",
)
LINE = "{:<12} {:<8} {:>7} {:>11} {:>11} {:>10}"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")


@dataclass(frozen=True)
class Columns:
    """What is printed of a part: mm^3 laid / mm^3 of its sections, and the judge's areas."""

    volume: float
    judged: Judgement


def model(name):
    return place(load_mesh(MODELS / f"{name}.stl"))


def middle(part, top, height=0.2):
    """The section in the middle of a layer; 1e-6 mm lower, so that not rounding decides about faces in the plane."""
    return section(part.vertices, part.faces, top - height / 2 - 1e-6)


def area_of(edges):
    p, q = edges
    return float((p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]).sum() / 2)


def ours(part, every=1):
    """Every so many layers; the volume is that of all of them."""
    layers = list(slice_part(part, process(), nozzle_mm=0.4))
    cuts = [middle(part, layer.z_mm, layer.height_mm) for layer in layers]
    asked = sum(area_of(cut) * layer.height_mm for cut, layer in zip(cuts, layers, strict=True))
    judged = sum((judge_lines(segments(layer), cut) for cut, layer in list(zip(cuts, layers, strict=True))[::every]),
                 NOTHING)
    return Columns(sum(map(bead_volume, layers)) / asked, judged)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_judge_paints_what_shapely_sees(seed):
    """Capsules with level, upright and no length among them; the winding of overlapping rings."""
    rng = np.random.default_rng(seed)
    p, q = rng.uniform(0, 6, (2, 12, 2))
    q[:2, 1], q[2:4, 0], q[4:6] = p[:2, 1], p[2:4, 0], p[4:6]
    radius = rng.uniform(0.05, 0.6, 12)
    canvas = Canvas((0, 0), (6, 6))
    x, y = np.meshgrid(canvas.x, canvas.y)
    pixels = shapely.points(x, y)
    away = np.min([shapely.distance(shapely.LineString([a, b]), pixels) - r
                   for a, b, r in zip(p, q, radius, strict=True)], axis=0)
    clear = np.abs(away) > 1e-9
    np.testing.assert_array_equal(canvas.capsules(p, q, radius)[clear], (away < 0)[clear])
    loops = [rng.uniform(0, 6, (3, 2)) for _ in range(4)]
    winding = sum(np.where(shapely.contains_xy(shapely.Polygon(loop), x, y), 1, 0)
                  * (1 if shapely.LinearRing(loop).is_ccw else -1) for loop in loops)
    found = canvas.wound(np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops]))
    edge = shapely.union_all([shapely.LinearRing(loop) for loop in loops]).buffer(1e-9)
    clear = ~shapely.contains_xy(edge, x, y)
    np.testing.assert_array_equal(found[clear], (winding > 0)[clear])


def test_the_judge_sees_faults():
    """A strip left out is counted as it is large, and so is a bead beside the part."""
    box = np.array([(0, 0), (10, 0), (10, 10), (0, 10)], float)
    edges = box, np.roll(box, -1, axis=0)
    rows = [(np.array([0.25, y]), np.array([9.75, y]), 0.5) for y in np.arange(0.25, 10, 0.5)]
    assert judge_lines(rows, edges).underfill < 0.005            # round ends along two sides
    assert judge_lines(rows[:-2], edges).unfilled == pytest.approx(10 * 0.95, rel=0.03)
    beside = [*rows, (np.array([12.0, 2.0]), np.array([12.0, 7.0]), 0.5)]
    assert judge_lines(beside, edges).far_outside == pytest.approx(5 * 0.5 + np.pi / 4 * 0.25, rel=0.03)
    assert judge_lines(rows, edges).far_outside == 0


LIMITS = [("xyz_cube", 0.005, 0.002), ("benchy", 0.01, 0.002), ("overhang", 0.01, 0.003), ("thinwall", 0.04, 0.003),
          ("bridgetest", 0.03, 0.003)]


@needs_models
@pytest.mark.parametrize(("name", "volume", "underfill"), LIMITS)
def test_parts_are_filled_and_nothing_leaves_them(name, volume, underfill):
    """Every eighth layer; thin walls have more of the hollows beside round edges than of anything else."""
    found = ours(model(name), every=8)
    assert abs(found.volume - 1) <= volume
    assert found.judged.underfill <= underfill
    assert found.judged.far_outside == 0
    assert found.judged.outside / found.judged.section < 0.003


@pytest.mark.slow
@needs_models
@pytest.mark.parametrize("name", ["xyz_cube", "benchy", "overhang", "thinwall", "bridgetest", "featuretype", "counter"])
def test_every_layer_is_filled_and_nothing_leaves_it(name):
    part = model(name)
    layers = slice_part(part, process(), nozzle_mm=0.4)
    judged = [judge_lines(segments(layer), middle(part, layer.z_mm, layer.height_mm))
              for layer in layers if len(layer.beads.role)]
    total = sum(judged, NOTHING)
    assert total.underfill <= 0.005
    assert total.spill <= 0.0005
    assert max(one.far_outside for one in judged) < 0.05


def test_fins_are_covered():
    assert min(covered(lines_of(place(load_mesh(FINS))))) >= 0.95


@needs_models
@pytest.mark.parametrize("bead", [0.4, 0.45, 0.6])
def test_the_arms_of_thinwall_are_printed_once(bead):
    """Four walls of 0.35 to 1 mm: covered, and their volume laid once; round sides hold 0.88 of the thinnest one."""
    part = model("thinwall")
    layers = list(slice_part(part, process(infill=0.2, outer_bead_mm=bead, bead_mm=bead, first_bead_mm=bead),
                             nozzle_mm=0.4))
    arms = [shapely.box(14, -3, 24, 3), shapely.box(-24, -3, -14, 3), shapely.box(-3, 14, 3, 24),
            shapely.box(-3, -24, 3, -14)]
    thick = set()
    for layer in layers[1::4]:
        outline = shape_of(layer.outline.points, layer.outline.starts)
        lines = [(shapely.LineString([p, q]), width) for p, q, width in segments(layer)]
        for arm in arms:
            wall = outline.intersection(arm)
            thick.add(round(wall.area / 10, 1))
            held = sum(line.intersection(arm).length * float(bead_spacing(width, 0.2)) for line, width in lines)
            assert 0.87 < held / wall.area < 1.05
            under = shapely.union_all([line.buffer(width / 2) for line, width in lines if line.intersects(arm)])
            assert wall.intersection(under).area >= 0.95 * wall.area
    assert len(thick) == 4
    assert min(thick) < 0.4


def lines_of(part):
    return segments(list(slice_part(part, process(), nozzle_mm=0.4))[30])


def covered(lines):
    """Share of each fin of the sample, from the thickest, that lies under a bead."""
    part = place(load_mesh(FINS))
    p, q = section(part.vertices, part.faces, 6.1)
    canvas = Canvas(p.min(0), p.max(0))
    solid, under = canvas.wound(p, q), canvas.beads(lines)
    rows = np.flatnonzero(np.diff(np.concatenate(([False], solid.any(1), [False])).astype(int)))
    shares = [(solid[a:b] & under[a:b]).sum() / solid[a:b].sum() for a, b in rows.reshape(-1, 2)]
    thick = [(b - a) * PIXEL for a, b in rows.reshape(-1, 2)]
    assert len(shares) == 4
    return [shares[k] for k in np.argsort(thick)[::-1]]


# ---- peers

def sliced_by(peer, path, folder):
    """The toolpath of another slicer's G-code of a part; fails where CABSLICE_PEERS=1 and it is missing."""
    from cabslice.toolpath.gcode import read_gcode

    target = folder / f"{peer}-{path.stem}.gcode"
    if peer == "prusa":
        program, command = "prusa-slicer", ["--export-gcode", str(path), "-o", str(target), *PRUSA]
    else:
        definition = next((one for one in CURA_DEFINITIONS if one.exists()), None)
        if definition is None:
            missing("fdmprinter.def.json of Cura is not there (Debian: cura; or set CURA_DEFINITIONS)")
        options = [word for one in CURA for word in ("-s", one)]
        files = ["-e0", "-l", str(path), "-o", str(target)]
        program, command = "CuraEngine", ["slice", "-j", str(definition), *options, *files]
    if shutil.which(program) is None:
        missing(f"{program} is not installed")
    subprocess.run([program, *command], check=True, capture_output=True, timeout=600)
    origin = None if peer == "prusa" else (0.0, 0.0)
    return read_gcode(target, origin=origin, filament_diameter_mm=1.75 if peer == "prusa" else 2.85).toolpath


def missing(what):
    if os.environ.get("CABSLICE_PEERS") == "1":
        pytest.fail(f"CABSLICE_PEERS=1 but {what}")
    pytest.skip(what)


def lines_by_layer(path):
    """{top of the layer in 1e-3 mm: [(p, q, width)]} and the volume laid, mm^3."""
    rows = np.flatnonzero((path.role != Role.TRAVEL) & (path.role != Role.SKIRT) & (path.filament > 0)
                          & (path.lengths > 0))
    volume = float((bead_area(path.width, path.height) * path.lengths)[rows].sum())
    layers = {}
    for row in rows:
        layers.setdefault(round(path.xyz[row, 2] * 1000), []).append(
            (path.xyz[row - 1, :2], path.xyz[row, :2], path.width[row]))
    return layers, volume


def theirs(peer, name, folder, every=4):
    part, path = model(name), sliced_by(peer, MODELS / f"{name}.stl", folder)
    layers, volume = lines_by_layer(path)
    tops = sorted(layers)
    asked = sum(area_of(middle(part, top / 1000)) * 0.2 for top in tops)
    judged = sum((judge_lines(layers[top], middle(part, top / 1000)) for top in tops[::every]), NOTHING)
    return Columns(volume / asked, judged)


def printed(name, who, found):
    judged = found.judged
    print(LINE.format(name, who, f"{found.volume:.4f}", f"{100 * judged.underfill:.2f} %",
                      f"{100 * judged.outside / judged.section:.2f} %", f"{100 * judged.spill:.2f} %"))


@pytest.mark.slow
@needs_models
@pytest.mark.parametrize(("name", "best"), [("xyz_cube", 0.0022), ("benchy", 0.0051), ("overhang", 0.0041)])
def test_the_judge_prefers_us(name, best, tmp_path, capsys):
    """The same columns of all three, every eighth layer. best: the least under-fill known of a peer.

    Some versions fill more by laying too much: then their volume and what lies outside tell.
    """
    rows = {"cabslice": ours(model(name), 8)} | {peer: theirs(peer, name, tmp_path, 8) for peer in ("prusa", "cura")}
    with capsys.disabled():
        print("\n" + LINE.format("part", "slicer", "volume", "under-fill", "outside", "far out"))
        for who, found in rows.items():
            printed(name, who, found)
    mine = rows.pop("cabslice")
    assert mine.judged.underfill <= best
    for found in rows.values():
        assert abs(mine.volume - 1) < abs(found.volume - 1)
        assert mine.judged.outside <= found.judged.outside
        assert mine.judged.far_outside <= found.judged.far_outside


@pytest.mark.slow
@needs_models
def test_the_judge_prefers_our_fins(tmp_path, capsys):
    part = place(load_mesh(FINS))
    rows = {"cabslice": covered(lines_of(part))}
    for peer in ("prusa", "cura"):
        layers, _ = lines_by_layer(sliced_by(peer, FINS, tmp_path))
        rows[peer] = covered(layers.get(6200, []))
    with capsys.disabled():
        print("\nfins of 1.0, 0.8, 0.5, 0.35 mm covered")
        for who, shares in rows.items():
            print(f"{who:<8}", " ".join(f"{share:.3f}" for share in shares))
    assert min(rows["cabslice"]) >= 0.95
