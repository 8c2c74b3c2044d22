"""Products as files: the value that comes back is the value that went in, and nothing damaged gets through."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabslice import store
from cabslice.errors import OutputError, ProductError
from cabslice.slicing.layer import Beads, Layer, Polygons
from cabslice.timing.path import smooth
from cabslice.timing.trajectory import Trajectory
from cabslice.toolpath.path import Events, Toolpath

NUMBER = st.floats(-1e4, 1e4)
SMALL = st.integers(0, 4)
ORIGIN = store.Origin(
    "part ü.stl", "0" * 64, ("2 holes were filled.",), (), "mm", 1.5, (0.0, 90.0, 0.0), None, '{"a": 1}', "{}", "{}"
)


@st.composite
def columns(draw, rows, width=None):
    shape = (rows,) if width is None else (rows, width)
    return np.array(draw(st.lists(NUMBER, min_size=int(np.prod(shape)), max_size=int(np.prod(shape))))).reshape(shape)


@st.composite
def layers(draw):
    lengths = draw(st.lists(SMALL, max_size=3))
    starts = np.cumsum([0, *lengths])
    points, lines = int(starts[-1]), len(lengths)
    line, width = np.arange(lines), draw(columns(points))
    beads = Beads(draw(columns(points, 2)), starts, width, line, line % 2 == 0, line)
    outline = Polygons(draw(columns(points, 2)), starts)
    return Layer(draw(SMALL), draw(NUMBER), draw(NUMBER), outline, beads)


@st.composite
def toolpaths(draw):
    rows = draw(st.integers(2, 6))
    column = draw(columns(rows, 3)), *(draw(columns(rows)) for _ in range(4))
    whole = np.arange(rows)
    events = draw(st.sampled_from([Events.none(), Events(np.array([0, 1]), np.array([1, 3]), np.array([210.0, 0.5]))]))
    return Toolpath(*column, whole % 14, whole, whole * 0, np.array([1, rows]), events, 1.75, draw(st.text(max_size=5)))


@st.composite
def products(draw):
    kind = draw(st.sampled_from(sorted(store.KINDS)))
    if kind == "layers":
        return store.Sliced(ORIGIN, tuple(draw(st.lists(layers(), max_size=3))))
    path = draw(toolpaths())
    if kind == "path":
        return store.Laid(dataclasses.replace(ORIGIN, at_mm=(1.0, 2.0)), path)
    nodes = draw(st.integers(2, 5))
    time, s, x = (draw(columns(nodes)) for _ in range(3))
    motion = Trajectory(
        path=smooth(path, 0.05), time=time, s=s, x=x, move=np.arange(nodes), pieces=np.array([0, nodes]),
        to_pose=np.zeros(3), window=0.01,
    )
    return store.Planned(ORIGIN, path, motion)


def same(one, two):
    assert type(one) is type(two)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            same(getattr(one, field.name), getattr(two, field.name))
    elif isinstance(one, np.ndarray):
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)
    elif isinstance(one, tuple):
        assert len(one) == len(two)
        for a, b in zip(one, two, strict=True):
            same(a, b)
    else:
        assert one == two


@given(products())
@settings(max_examples=60, deadline=None)
def test_what_was_saved_comes_back_and_saves_to_the_same_bytes(tmp_path_factory, product):
    folder = tmp_path_factory.mktemp("store")
    store.save(product, folder / "one")
    kind, back = store.load(folder / "one")
    assert kind == store.kind_of(product)
    same(product, back)
    store.save(back, folder / "two")
    assert (folder / "one").read_bytes() == (folder / "two").read_bytes()


@pytest.fixture
def cube_path(tmp_path):
    path = Toolpath(
        np.arange(12.0).reshape(4, 3), np.ones(4), np.ones(4), np.ones(4), np.ones(4),
        np.zeros(4), np.zeros(4), np.zeros(4), np.array([1, 4]), Events.none(), 1.75,
    )
    store.save(store.Laid(ORIGIN, path), tmp_path / "cube.path")
    return tmp_path / "cube.path"


def test_every_flipped_byte_and_every_cut_is_refused(cube_path):
    whole = cube_path.read_bytes()
    for at in range(len(whole)):
        cube_path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        with pytest.raises(ProductError, match=r"cube\.path"):
            store.load(cube_path)
        cube_path.write_bytes(whole[:at])
        with pytest.raises(ProductError, match=r"cube\.path"):
            store.load(cube_path)


def test_another_schema_names_both_and_the_remedy(cube_path):
    whole = bytearray(cube_path.read_bytes())
    whole[8] = store.SCHEMA + 1
    cube_path.write_bytes(whole)
    with pytest.raises(ProductError, match=rf"schema {store.SCHEMA + 1}.*reads schema {store.SCHEMA}; make it again"):
        store.load(cube_path)


def test_a_file_that_exists_is_kept(cube_path):
    before = cube_path.read_bytes()
    product = store.load(cube_path)[1]
    with pytest.raises(OutputError, match="exists"):
        store.save(product, cube_path)
    store.save(dataclasses.replace(product, origin=dataclasses.replace(ORIGIN, scale=9.0)), cube_path, overwrite=True)
    assert cube_path.read_bytes() != before
    assert list(cube_path.parent.iterdir()) == [cube_path]


def test_columns_begin_on_multiples_of_64_as_documented(cube_path):
    import hashlib
    import json
    import struct

    content = cube_path.read_bytes()
    magic, schema, length = struct.unpack_from("<8sII", content)
    header = json.loads(content[16 : 16 + length])
    assert (magic, schema, header["kind"]) == (b"CABSLICE", store.SCHEMA, "path")
    assert all(row["at"] % 64 == 0 for row in header["columns"])
    xyz = header["columns"][header["value"]["fields"]["toolpath"]["fields"]["xyz"]["column"]]
    found = np.frombuffer(content, xyz["dtype"], int(np.prod(xyz["shape"])), xyz["at"])
    np.testing.assert_array_equal(found, np.arange(12.0))
    assert hashlib.sha256(content[:-32]).digest() == content[-32:]
