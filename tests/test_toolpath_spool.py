"""A path longer than memory goes through temporary files: the same path, and the same files made of it."""

import io
import mmap

import numpy as np
import pytest
from test_gcode_out import two_objects
from toolpath_samples import PLA, block, process

from cabslice import arrays
from cabslice.arrays import let_go
from cabslice.errors import OutputError
from cabslice.toolpath import gcode, order, spool
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.path import Toolpath
from cabslice.toolpath.summary import summary


def lay():
    return lay_toolpath(block(layers=9), process(), PLA, filament_diameter_mm=1.75)


def file_of(path):
    file = io.BytesIO()
    gcode.write_gcode(path, file, printer_name="p", material=PLA, process=process())
    return file.getvalue()


def mapped(column):
    while isinstance(column, np.ndarray):
        column = column.base
    return isinstance(getattr(column, "obj", column), mmap.mmap)


@pytest.mark.parametrize("make", [lay, two_objects])
def test_a_path_gone_through_in_small_spans_is_the_same_and_gives_the_same_bytes(make, monkeypatch):
    whole = make()
    told, written = summary(whole), file_of(whole)
    assert not mapped(whole.xyz)
    monkeypatch.setattr(arrays, "SPAN", 5)
    monkeypatch.setattr(arrays.spans, "__kwdefaults__", {"size": 5})
    monkeypatch.setattr(Toolpath.spans, "__defaults__", (5,))
    monkeypatch.setattr(gcode, "BLOCK", 3)
    monkeypatch.setattr(spool.Spool.__init__, "__defaults__", (7,))
    spooled = make()
    for name in order.COLUMNS:
        assert mapped(getattr(spooled, name)), name
        np.testing.assert_array_equal(getattr(spooled, name), getattr(whole, name))
    np.testing.assert_array_equal(spooled.starts, whole.starts)
    for name in ("index", "kind", "value"):
        np.testing.assert_array_equal(getattr(spooled.events, name), getattr(whole.events, name))
    assert file_of(spooled) == written
    again = summary(spooled)
    for key in ("layers", "moves", "retractions", "bounds_mm"):
        assert again[key] == told[key], key
    for key in ("extruded_mm", "travel_mm", "filament_mm", "retracted_mm"):
        assert again[key] == pytest.approx(told[key], rel=1e-12), key


def test_columns_let_go_are_read_again_and_take_no_memory_meanwhile():
    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * mmap.PAGESIZE

    many = spool.Spool(["x"], held=1000)
    for block_of in range(40):
        many.add({"x": np.full(200_000, float(block_of))})
    x = many.columns()["x"]
    empty = resident()
    assert x.sum() == 200_000 * sum(range(40))
    full = resident()
    let_go(x)
    assert full - empty > 0.9 * x.nbytes
    assert full - resident() > 0.9 * x.nbytes
    assert x[::200_000].tolist() == list(range(40))


def test_a_full_disk_is_said_in_a_sentence(monkeypatch):
    def full():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spool.tempfile, "TemporaryFile", full)
    few = spool.Spool(["x"], held=1)
    with pytest.raises(OutputError, match="TMPDIR"):
        few.add({"x": np.zeros(2)})
