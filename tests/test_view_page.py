"""What stands in a page: values that come back, moves that say what the motion does, the same bytes again."""

import json
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from robots import cabfab_optim

from cabslice.robot.model import nozzle_poses
from cabslice.view import machine as machine_room
from cabslice.view.packing import LEVELS, packed, unpacked
from cabslice.view.page import page
from cabslice.view.scene import Field, Moves, Scene, of_mesh

UNHURRIED = settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow])


@UNHURRIED
@given(arrays.arrays(np.int64, st.integers(0, 50), elements=st.integers(-(2**40), 2**40)))
def test_whole_numbers_come_back(values):
    np.testing.assert_array_equal(unpacked(packed(values, 1)), values)


@UNHURRIED
@given(arrays.arrays(np.float64, st.integers(1, 50), elements=st.floats(-1e6, 1e6)))
def test_values_come_back_to_half_a_step(values):
    found = packed(values)
    assert found["step"] <= (np.ptp(values) / LEVELS or 1.0) + 1e-300
    np.testing.assert_allclose(unpacked(found), values, atol=found["step"] * (0.5 + 1e-6) + 1e-9)
    assert unpacked(found).min() == pytest.approx(values.min(), abs=1e-9)


def test_what_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="not finite"):
        packed(np.array([0.0, np.nan]))


def small(title="a"):
    xyz = np.array([[0, 0, 0.2], [10, 0, 0.2], [10, 10, 0.2], [0, 0, 0.4]])
    moves = Moves(xyz, [0, 1, 1, 0], [0, 0, 0, 1], [0, 0.4, 0.4, 0], [0, 0.2, 0.2, 0], [0, 1, 2, 3], "planned",
                  (Field("speed_mm_s", "speed", "mm/s", np.array([0, 10, 20, 30.0])),))
    return Scene(title, "plan", {"a": "</script><b>"}, cabfab_optim(), moves=moves)


def test_a_page_is_one_file_that_asks_for_nothing_and_cannot_be_broken_out_of():
    text = page(small("x</title><script>alert(1)</script>")).decode()
    assert page(small()) == page(small())
    assert not re.search(r"https?://(?!www\.w3\.org)", text)
    assert not re.search(r"<(link|img|script)[^>]+(src|href)=(?!\"data:)", text)
    assert "alert(1)</script>" not in text
    assert text.count("</script>") == 2
    assert "{{" not in text
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    assert data["facts"] == {"a": "</script><b>"}
    np.testing.assert_allclose(unpacked(data["moves"]["xyz"][0]), [0, 10, 10, 0], atol=1e-3)


def test_the_machine_is_drawn_where_the_robot_has_it():
    """Platform origin = nozzle - offset in bed coordinates: the attachments as nozzle_poses puts them."""
    robot, place = cabfab_optim(), np.array([[12.0, -7.0, 33.0]])
    found = machine_room.machine(robot)
    origin = place[0] - found["nozzle"]
    np.testing.assert_allclose(origin, nozzle_poses(robot, place)[0, :3] - robot.bed_origin, atol=1e-3)
    np.testing.assert_allclose(np.array(found["anchors"]) + robot.bed_origin, robot.anchors, atol=1e-3)
    faces, points = np.array(found["hull"]["faces"]), np.array(found["hull"]["points"])
    a, b, c = (points[faces[:, i]] for i in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert volume > 0
    outward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - points.mean(axis=0))
    assert (outward > 0).all()


def test_overhangs_of_a_wedge():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2.0, 0, 1]])
    down, up, tilted = [0, 2, 1], [0, 1, 2], [1, 2, 4]
    values = of_mesh(vertices, np.array([down, up, tilted])).fields[0].values
    np.testing.assert_allclose(values[:2], [90, 0], atol=1e-9)
    assert values[2] == pytest.approx(45, abs=1e-9) or values[2] == 0
