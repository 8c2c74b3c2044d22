"""Whole slicing: volume is conserved, nothing leaves the outline, nothing wide stays empty, whatever the shape."""

import dataclasses
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_judge import Canvas, segments
from slicing_kit import Mesh, bead_volume, joined, prism, prisms, process, ring_area, shape_of, shapes

from cabslice.errors import ModelError
from cabslice.mesh.load import load_mesh
from cabslice.mesh.place import place
from cabslice.slicing.layer import Role
from cabslice.slicing.slicer import RUN, slice_part

MODELS = Path(__file__).parents[2] / "shared" / "models"
PATTERNS = ("rectilinear", "aligned", "grid", "triangles", "cubic", "honeycomb", "gyroid", "concentric", "lightning")
SAMPLES = Path(__file__).parents[1] / "samples"
needs_models = pytest.mark.skipif(not MODELS.exists(), reason="the shared models are not here")


def model(name):
    return place(load_mesh(MODELS / f"{name}.stl"))


def sample(name):
    return place(load_mesh(SAMPLES / f"{name}.stl"))


def sliced(part, **changes):
    return list(slice_part(part, process(**changes), nozzle_mm=0.4))


def section_volume(layers):
    return sum(ring_area(layer.outline.points, layer.outline.starts) * layer.height_mm for layer in layers)


def roles(layer):
    return {Role(role) for role in layer.beads.role}


def bytes_of(layers):
    return [
        (layer.index, layer.z_mm, layer.height_mm, *[np.asarray(getattr(layer.beads, f.name)).tobytes()
         for f in dataclasses.fields(layer.beads)], layer.outline.points.tobytes()) for layer in layers
    ]


@needs_models
@pytest.mark.parametrize(
    ("name", "most"), [("xyz_cube", 0.005), ("benchy", 0.01), ("overhang", 0.01), ("thinwall", 0.04)]
)
def test_mass_balance_at_full_infill(name, most):
    """Beads hold what the sections do, but for the hollows between the round sides of outer walls."""
    layers = sliced(model(name))
    held, asked = sum(bead_volume(layer) for layer in layers), section_volume(layers)
    assert abs(held / asked - 1) < most, held / asked
    hollow = (1 - np.pi / 4) / 2 * 0.2**2 * sum(
        shape_of(layer.outline.points, layer.outline.starts).length for layer in layers
    )
    assert -0.01 < (held + hollow) / asked - 1 < 0.01        # that, and a little more where infill meets walls


@pytest.mark.parametrize("bead", [0.4, 0.45, 0.6])
def test_fins_are_printed_once(bead):
    """Each fin at least 95 % covered, and no material laid twice."""
    layer = sliced(sample("fins"), bead_mm=bead, outer_bead_mm=bead, first_bead_mm=bead)[30]
    points, starts = layer.outline.points, layer.outline.starts
    canvas = Canvas(points.min(0), points.max(0))
    covered = canvas.beads(segments(layer))
    found = []
    for a, b in pairwise(starts):
        fin = canvas.rings(points[a:b], np.array([0, b - a]))
        assert (fin & covered).sum() / fin.sum() >= 0.95
        found.append(round(float(np.ptp(points[a:b, 1])), 3))
    assert sorted(found) == [0.35, 0.5, 0.8, 1.0]
    assert 0.85 < bead_volume(layer) / (ring_area(points, starts) * layer.height_mm) < 1.02


def islands_hold_their_beads(layer):
    shape = shape_of(layer.outline.points, layer.outline.starts)
    parts = list(getattr(shape, "geoms", [shape]))
    beads = layer.beads
    mine = beads.island[np.repeat(np.arange(len(beads.role)), np.diff(beads.starts))]
    for k in range(max(beads.island, default=-1) + 1):
        inside = beads.points[mine == k]
        assert len(inside) == 0 or any(shapely.contains_xy(part.buffer(0.01), inside).all() for part in parts)


@settings(max_examples=40, deadline=None)
@given(shapes(size=14), st.integers(0, 3), st.sampled_from([0.0, 0.15, 1.0]), st.sampled_from(PATTERNS))
def test_any_shape_is_filled_and_nothing_leaves_it(shape, number, infill, pattern):
    """Layer planes of the steps coincide with coplanar faces; spikes, slivers, holes, touching bits."""
    shrunk = shape.buffer(-1.5)
    mesh = prisms(shape, 0.0, 0.5)
    if not shrunk.is_empty:
        smaller = shapely.MultiPolygon([p for p in getattr(shrunk, "geoms", [shrunk]) if p.area > 0.1])
        mesh = joined(mesh, prisms(smaller, 0.5, 1.1)) if not smaller.is_empty else mesh
    try:
        layers = sliced(mesh, walls=number, infill=infill, pattern=pattern, skirt_loops=0)
    except ModelError:
        assert shape.buffer(-0.06).area < 0.05 or (number == 0 and infill == 0)
        return
    for layer in layers:
        beads = layer.beads
        outline = shape_of(layer.outline.points, layer.outline.starts)
        assert outline.area == pytest.approx((shape if layer.z_mm < 0.61 else shrunk).area, rel=0.02, abs=0.1)
        assert (beads.width > 0).all()
        assert (beads.width < 1.1).all()
        assert shapely.contains_xy(outline.buffer(1e-3), beads.points).all()
        if number or infill == 1:
            islands_hold_their_beads(layer)
    if infill == 1 and number:
        held, asked = sum(map(bead_volume, layers)), section_volume(layers)
        hairs = 0.5 * (shape.area - shape.buffer(-0.062).buffer(0.062).area)
        scallop = 0.5 * 0.022 * shape.length
        ends = 0.02 * shapely.get_num_coordinates(shape)
        assert -0.03 * asked - hairs - 1.5 * scallop - ends <= held - asked <= 0.03 * asked + ends


@settings(max_examples=10, deadline=None)
@given(shapes(size=9), st.integers(1, 3))
def test_no_empty_spot_is_wider_than_a_bead(shape, number):
    try:
        layer = sliced(prisms(shape, 0.0, 0.2), walls=number, skirt_loops=0)[0]
    except ModelError:
        assert shape.buffer(-0.06 - 0.0125).is_empty     # 0.3 of the nozzle, and what outlines are simplified by
        return
    points, starts = layer.outline.points, layer.outline.starts
    canvas = Canvas(points.min(0), points.max(0))
    empty = canvas.rings(points, starts) & ~canvas.beads(segments(layer))
    spots = np.argwhere(empty)
    left = shapely.MultiPoint([(canvas.x[j], canvas.y[i]) for i, j in spots]).buffer(0.036) if len(spots) else None
    assert left is None or left.buffer(-0.2).is_empty      # no disc of 0.4 mm fits


@needs_models
def test_same_bytes_every_time():
    part = sample("c-shape")
    assert bytes_of(sliced(part, infill=0.2)) == bytes_of(sliced(part, infill=0.2))


def test_layers_are_streamed(monkeypatch):
    """Memory follows the layer, not their number."""
    monkeypatch.setattr("cabslice.slicing.sections.BLOCK", 200)

    def peak(height):
        mesh = prism(shapely.box(-10, -10, 10, 10), 0, height)
        tracemalloc.start()
        for _layer in slice_part(mesh, process(infill=0.2), nozzle_mm=0.4):
            pass
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(2)
    assert peak(80) < 1.5 * peak(10) + 200_000


def test_progress_counts_every_layer():
    seen = []
    layers = list(slice_part(sample("cube"), process(), nozzle_mm=0.4, progress=lambda *done: seen.append(done)))
    assert seen == [(k + 1, 100) for k in range(100)]
    assert [layer.index for layer in layers] == list(range(100))


def test_skins_of_stairs():
    """A step: its top is skin, the layers under it are solid as many as asked, the rest is sparse."""
    step = joined(prism(shapely.box(0, 0, 30, 20), 0, 4), prism(shapely.box(0, 0, 15, 20), 4, 8))
    layers = sliced(step, infill=0.2, top_layers=3, bottom_layers=2)
    right = shapely.box(17, 2, 28, 18)           # inside, on the step's tread
    for layer in layers[:20]:
        middles = [(p + q) / 2 for p, q, _ in segments(layer, {Role.SPARSE_INFILL})]
        sparse = shapely.contains_xy(right, np.array(middles).reshape(-1, 2)).any()
        assert sparse == (2 <= layer.index < 17), layer.index
    assert Role.TOP_SKIN in roles(layers[19])
    assert Role.TOP_SKIN not in roles(layers[18])
    assert Role.TOP_SKIN in roles(layers[39])
    assert Role.SPARSE_INFILL not in roles(layers[38])
    assert not any(Role.BRIDGE in roles(layer) for layer in layers)
    layers = sliced(step, infill=0.2, top_layers=3, bottom_layers=2, bridge_over_infill=True)
    assert [layer.index for layer in layers if Role.BRIDGE in roles(layer)] == [17, 37]     # first over sparse infill


@pytest.mark.parametrize(("least", "sparse"), [(0, {0, 1}), (60, {0}), (300, set())])
def test_small_insides_are_solid(least, sparse):
    """Two towers, of 200 and 50 mm2 inside their walls; in layers that are all skin nothing changes."""
    boxes = [shapely.box(0, 0, 22, 12), shapely.box(40, 0, 48, 10)]
    layers = sliced(joined(*(prism(box, 0, 6) for box in boxes)), infill=0.2, min_infill_area_mm2=least)
    middles = np.array([(p + q) / 2 for p, q, _ in segments(layers[15], {Role.SPARSE_INFILL})]).reshape(-1, 2)
    assert {k for k, box in enumerate(boxes) if shapely.contains_xy(box, middles).any()} == sparse
    for k, box in enumerate(boxes):
        held = sum(np.hypot(*(q - p)) for p, q, _ in segments(layers[15], {Role.SOLID_INFILL})
                   if shapely.contains_xy(box, *((p + q) / 2)))
        assert (held > 0.5 * box.buffer(-1).area / 0.45) == (k not in sparse)
    assert bytes_of(layers)[0] == bytes_of(sliced(joined(*(prism(box, 0, 6) for box in boxes)), infill=0.2))[0]


@pytest.mark.parametrize("pattern", ["rectilinear", "aligned"])
def test_over_sparse_infill_solid_lines_are_bridges_across_its_lines(pattern):
    """Where a run of layers begins, which must know what lies under it."""
    tower = prism(shapely.box(0, 0, 30, 20), 0, (RUN + 3) * 0.2)
    keys = {"infill": 0.2, "pattern": pattern, "top_layers": 3, "bottom_layers": 2, "infill_angle_deg": 30.0}
    layers, plain = sliced(tower, bridge_over_infill=True, **keys), sliced(tower, **keys)
    below, over = ([q - p for p, q, _ in segments(layer, {role})] for layer, role in
                   ((layers[RUN - 1], Role.SPARSE_INFILL), (layers[RUN], Role.BRIDGE)))
    one, other = (max(some, key=lambda step: float(np.hypot(*step))) for some in (below, over))
    assert abs(np.dot(one, other)) < 1e-6 * np.hypot(*one) * np.hypot(*other)
    assert Role.SOLID_INFILL not in roles(layers[RUN])
    assert [layer.index for layer in layers if Role.BRIDGE in roles(layer)] == [RUN]
    for one, other in zip(layers, plain, strict=True):
        assert bead_volume(one) == pytest.approx(bead_volume(other), rel=1e-3)


def test_bridges_span_the_gap():
    """A table: where its top begins, lines run from leg to leg."""
    legs = [prism(shapely.box(x, 0, x + 5, 12), 0, 3) for x in (0, 25)]
    layers = sliced(joined(*legs, prism(shapely.box(0, 0, 30, 12), 3, 5)), infill=0.2)
    with_bridge = [layer.index for layer in layers if Role.BRIDGE in roles(layer)]
    assert with_bridge == [15]
    spans = [(p, q) for p, q, _ in segments(layers[15], {Role.BRIDGE}) if np.linalg.norm(q - p) > 5]
    assert len(spans) >= 20
    for p, q in spans:
        assert abs(p[1] - q[1]) < 1e-6
        assert min(p[0], q[0]) < 5 < 25 < max(p[0], q[0])


@pytest.mark.parametrize(("infill", "pattern"), [(0.1, "rectilinear"), (0.2, "grid"), (0.5, "rectilinear")])
def test_sparse_infill_holds_its_share(infill, pattern):
    layers = sliced(prism(shapely.box(0, 0, 60, 50), 0, 4), infill=infill, pattern=pattern, walls=2)
    inside = (60 - 2 * 0.857) * (50 - 2 * 0.857) * 0.2
    for layer in layers[6:12]:
        assert bead_volume(layer, {Role.SPARSE_INFILL}) / inside == pytest.approx(infill, rel=0.02)


def test_grid_lines_stack():
    layers = sliced(prism(shapely.box(0, 0, 40, 30), 0, 3), infill=0.2, pattern="grid")
    one, other = (segments(layers[k], {Role.SPARSE_INFILL}) for k in (6, 7))
    assert len(one) == len(other)
    np.testing.assert_array_equal([p for p, *_ in one], [p for p, *_ in other])


def test_few_starts():
    """Linked infill: a solid square layer is one line, and a sparse one a handful."""
    layers = sliced(sample("cube"), infill=0.2, pattern="grid")
    for layer in layers[1:]:
        assert len(layer.beads.role) <= 2 + 6


def test_skirt_goes_around_the_first_layer_only():
    layers = sliced(sample("c-shape"), skirt_loops=2, skirt_gap_mm=3.0, infill=0.0)
    beads = layers[0].beads
    loops = np.flatnonzero(beads.role == Role.SKIRT)
    assert len(loops) == 2
    assert (beads.island[loops] == -1).all()
    assert not any(Role.SKIRT in roles(layer) for layer in layers[1:])
    hull = shapely.MultiPoint(layers[0].outline.points).convex_hull
    for loop, away in zip(loops, (3 + 0.225 + 0.407, 3 + 0.225), strict=True):
        ring = shapely.LinearRing(beads.points[beads.starts[loop] : beads.starts[loop + 1]])
        assert ring.distance(hull) == pytest.approx(away, abs=0.1)
        assert shapely.hausdorff_distance(ring, shapely.LinearRing(hull.exterior)) == pytest.approx(away, abs=0.1)


def test_first_layer_is_its_own():
    layers = sliced(sample("cube"), first_layer_mm=0.3, first_bead_mm=0.6)
    assert layers[0].height_mm == layers[0].z_mm == 0.3
    wall = layers[0].beads.width[: layers[0].beads.starts[-1]][layers[0].beads.starts[1]]
    assert wall == 0.6
    assert layers[1].z_mm == pytest.approx(0.5)
    assert layers[1].beads.width[0] == 0.45


@pytest.mark.parametrize("changes", [{"walls": 0}, {"walls": 0, "infill": 0.0}, {"walls": 1, "infill": 0.0},
                                     {"top_layers": 0, "bottom_layers": 0, "infill": 0.0}, {"walls": 40},
                                     {"top_layers": 1000}, {"infill_overlap": 0.0}, {"infill_overlap": 0.5}])
def test_odd_processes(changes):
    layers = sliced(sample("cylinder"), **changes)
    assert len(layers) == 75
    outline = shape_of(layers[40].outline.points, layers[40].outline.starts)
    for layer in (layers[0], layers[40], layers[74]):
        on_part = layer.beads.island[np.repeat(np.arange(len(layer.beads.role)), np.diff(layer.beads.starts))] >= 0
        assert shapely.contains_xy(outline.buffer(1e-6), layer.beads.points[on_part]).all()
    if changes.get("infill", 1) == 1:
        assert bead_volume(layers[40]) == pytest.approx(0.2 * outline.area, rel=0.012)
    if changes == {"top_layers": 0, "bottom_layers": 0, "infill": 0.0}:
        assert roles(layers[0]) == {Role.SKIRT, Role.OUTER_WALL, Role.INNER_WALL}


def test_a_gap_between_bodies_gives_empty_layers():
    layers = sliced(joined(prism(shapely.box(0, 0, 5, 5), 0, 1), prism(shapely.box(0, 0, 5, 5), 2, 3)))
    assert [len(layer.beads.role) > 0 for layer in layers] == [True] * 5 + [False] * 5 + [True] * 5


def test_nothing_to_print_is_said():
    with pytest.raises(ModelError, match=r"0\.12 mm"):
        sliced(prism(shapely.box(0, 0, 0.1, 5), 0, 3))


def test_a_part_lower_than_a_layer_gets_one():
    layers = sliced(prism(shapely.box(0, 0, 5, 5), 0, 0.05))
    assert len(layers) == 1
    assert len(layers[0].beads.role) > 1


@needs_models
@pytest.mark.parametrize("path", sorted(MODELS.glob("broken/*")) if MODELS.exists() else [], ids=lambda path: path.stem)
def test_broken_files_slice_or_are_refused(path):
    try:
        part = place(load_mesh(path, unit="m" if path.stem == "bunny_holes" else "mm"))
    except ModelError:
        return
    layers = sliced(part, layer_mm=0.8, first_layer_mm=0.8, bead_mm=1.0, outer_bead_mm=1.0, infill=0.1)
    assert sum(map(bead_volume, layers)) > 0
    assert layers[-1].z_mm == pytest.approx(part.bounds[1, 2], abs=0.41)


def test_a_mesh_with_two_coats_is_printed_once():
    """Two equal bodies in one place are one: the winding is positive, not odd."""
    box = prism(shapely.box(0, 0, 8, 8), 0, 2)
    one, two = sliced(box), sliced(joined(box, Mesh(box.vertices.copy(), box.faces)))
    assert section_volume(two) == pytest.approx(section_volume(one))


def test_layers_are_the_same_however_many_processes_make_them():
    alone, shared = (
        list(slice_part(sample("tower"), process(infill=0.2), nozzle_mm=0.4, jobs=jobs)) for jobs in (1, 3)
    )
    assert len(alone) > 2 * RUN
    assert bytes_of(alone) == bytes_of(shared)


def test_what_lies_in_the_next_run_of_layers_is_seen():
    """A step in the part just above the end of a run: the layers under it are skin, as if the run had no end."""
    height = 0.2 * RUN
    step = joined(
        prism(shapely.box(0, 0, 20, 20), 0, height), prism(shapely.box(0, 0, 10, 20), height, height + 2)
    )
    layers = sliced(step, infill=0.2, top_layers=3)
    has = {role: [layer.index for layer in layers if role in roles(layer)] for role in Role}
    assert RUN - 1 in has[Role.TOP_SKIN]
    assert {RUN - 2, RUN - 3} <= set(has[Role.SOLID_INFILL])
    assert RUN - 5 not in has[Role.SOLID_INFILL]
