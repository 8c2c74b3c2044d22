"""STEP files, where the optional package is there; a sentence where it is not."""

import importlib.util

import numpy as np
import pytest
from step_box import step_box

from cabslice.errors import ModelError
from cabslice.mesh.load import load_mesh
from cabslice.mesh.topology import signed_volumes

HERE = importlib.util.find_spec("cascadio") is not None


@pytest.mark.skipif(not HERE, reason="the optional package cascadio is not installed")
@pytest.mark.parametrize(("unit", "size"), [(".MILLI.", (20, 30, 40)), ("$", (0.02, 0.03, 0.04))])
@pytest.mark.parametrize("suffix", ["step", "stp"])
def test_a_box_has_its_size_in_whatever_unit_it_was_drawn(tmp_path, unit, size, suffix):
    path = tmp_path / f"box.{suffix}"
    path.write_text(step_box(size, unit))
    part = load_mesh(path)
    np.testing.assert_allclose(part.bounds, [(0, 0, 0), (20, 30, 40)], atol=1e-4)
    assert signed_volumes(part.vertices, part.faces).sum() == pytest.approx(24000, rel=1e-5)


@pytest.mark.skipif(not HERE, reason="the optional package cascadio is not installed")
def test_a_damaged_file_is_refused(tmp_path):
    path = tmp_path / "box.step"
    path.write_text(step_box((1, 2, 3))[:600])
    with pytest.raises(ModelError, match=r"box\.step"):
        load_mesh(path)


def test_without_the_package_it_is_named(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "cascadio" else find(name))
    path = tmp_path / "box.stp"
    path.write_text(step_box((1, 2, 3)))
    with pytest.raises(ModelError, match=r"box\.stp: STEP needs the optional package cascadio"):
        load_mesh(path)
