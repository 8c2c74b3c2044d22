"""File formats: the same body in, whatever the file."""

import importlib.util
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice.errors import ModelError
from cabslice.mesh.load import load_mesh
from cabslice.mesh.topology import signed_volumes
from cabslice.stl import read_stl

SAMPLES = Path(__file__).parents[1] / "samples"
BODY = trimesh.creation.box((2, 3, 4))
BODY.apply_translation((5, 1, 2))


def volume(part):
    return float(signed_volumes(part.vertices, part.faces).sum())


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "off", "3mf"])
def test_every_format_gives_the_same_body(tmp_path, suffix):
    path = tmp_path / f"body.{suffix}"
    trimesh.Scene(BODY).export(path) if suffix == "3mf" else BODY.export(path)
    part = load_mesh(path)
    assert volume(part) == pytest.approx(24)
    np.testing.assert_allclose(part.bounds, BODY.bounds, atol=1e-6)
    assert part.repairs == ()


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "3mf", "stl"])
@given(garbage=st.binary(min_size=1, max_size=300))
@settings(max_examples=15, deadline=None)
def test_garbage_is_refused_with_a_sentence(tmp_path_factory, suffix, garbage):
    path = tmp_path_factory.mktemp("garbage") / f"garbage.{suffix}"
    path.write_bytes(garbage)
    with pytest.raises(ModelError) as refusal:
        load_mesh(path)
    assert path.name in refusal.value.sentence


def binary(triangles, count=None):
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    count = len(triangles) if count is None else count
    return b"solid not ascii".ljust(80) + np.uint32(count).tobytes() + record.tobytes()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.lists(st.floats(-1e6, 1e6, width=32), min_size=9, max_size=9), min_size=1, max_size=20))
def test_binary_and_ascii_stl_read_the_same(rows):
    triangles = np.array(rows, dtype=np.float32).astype(float).reshape(-1, 3, 3)
    facets = [
        "facet normal 0 0 0\n outer loop\n" + "".join("  vertex {!r} {!r} {!r}\n".format(*map(float, p)) for p in t)
        + " endloop\nendfacet\n" for t in triangles
    ]
    text = ("solid x\n" + "".join(facets) + "endsolid x\n").encode()
    for data in (binary(triangles), text):
        read, notes = read_stl(data, "x")
        np.testing.assert_array_equal(read, triangles)
        assert notes == []


def test_odd_stl_files():
    triangles = np.arange(18.0).reshape(2, 3, 3)
    read, notes = read_stl(binary(triangles) + b"tail", "x")
    assert len(read) == 2
    assert "4 bytes" in notes[0]
    with pytest.raises(ModelError, match="promises 9 triangles, it holds 2"):
        read_stl(binary(triangles, count=9), "x")
    square = b"solid s facet vertex 0 0 0 vertex 1 0 0 vertex 1 1 0 vertex 0 1 0 endfacet facet vertex 0 0 0 endfacet"
    read, notes = read_stl(square, "x")
    np.testing.assert_array_equal(read, [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    assert len(notes) == 2
    with pytest.raises(ModelError, match="corner 2 is '1 oops 0'"):
        read_stl(b"solid s facet vertex 0 0 0 vertex 1 oops 0 vertex 1 1 0 endfacet", "x")


def three_mf(tmp_path, model):
    path = tmp_path / "part.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
        archive.writestr("[Content_Types].xml", "<Types/>")
    return path


def mesh_xml(mesh):
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    return f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh>"


SPACE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"


def test_3mf_units_objects_and_mirrored_transforms(tmp_path):
    model = f"""<?xml version="1.0"?><model unit="inch" xmlns="{SPACE}"><resources>
        <object id="1" type="model">{mesh_xml(BODY)}</object>
        <object id="2" type="model"><components>
          <component objectid="1"/>
          <component objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>
        </components></object></resources>
      <build><item objectid="2" transform="1 0 0 0 1 0 0 0 2 0 0 10"/></build></model>"""
    part = load_mesh(three_mf(tmp_path, model))
    assert volume(part) == pytest.approx(2 * 2 * 24 * 25.4**3)   # two objects, twice as high, inches
    np.testing.assert_allclose(part.bounds, 25.4 * np.array([[-6, -0.5, 10], [6, 2.5, 18]]), atol=1e-9)
    assert part.repairs == ("Merged 2 objects into one part.", "Turned the faces of 1 mirrored objects.")


def test_3mf_without_unit_is_millimetres_and_keeps_to_it(tmp_path):
    model = f"""<model xmlns="{SPACE}"><resources><object id="1">{mesh_xml(BODY)}</object></resources>
      <build><item objectid="1"/></build></model>"""
    path = three_mf(tmp_path, model)
    assert volume(load_mesh(path)) == pytest.approx(24)
    part = load_mesh(path, unit="m")
    assert volume(part) == pytest.approx(24)
    assert "--unit m was not used" in part.repairs[0]


def test_many_solids_in_one_obj(tmp_path):
    path = tmp_path / "two.obj"
    other = BODY.copy()
    other.apply_translation((10, 0, 0))
    text = io.StringIO()
    for k, mesh in enumerate((BODY, other)):
        text.write(f"o body{k}\n" + "".join("v {} {} {}\n".format(*v) for v in mesh.vertices))
        text.write("".join("f {} {} {}\n".format(*(f + 1 + 8 * k)) for f in mesh.faces))
    path.write_text(text.getvalue())
    assert volume(load_mesh(path)) == pytest.approx(48)


def test_samples_are_what_their_script_makes(tmp_path):
    spec = importlib.util.spec_from_file_location("make", SAMPLES / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    make.main(tmp_path)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in SAMPLES.glob("*.stl"))
    for name in made:
        assert (tmp_path / name).read_bytes() == (SAMPLES / name).read_bytes()
        assert (tmp_path / name).stat().st_size < 100_000
        assert load_mesh(tmp_path / name).repairs == ()
