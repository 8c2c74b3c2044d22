"""Robots that cannot be: refused with sentences by `profile check` (exit 3), and at a pose by robot and command (4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profile_cases import MOTOR, PLATFORM, SHARED, WINDER, printer_toml, write

from cabslice.cli.main import main
from cabslice.errors import PoseError, ProfileError
from cabslice.profile import shelf
from cabslice.robot.kinematics import cables, lengths
from cabslice.robot.model import robot_from_printer
from cabslice.robot.sound import faults, require_sound
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import required_wrench

CEILING = [[-1000, -1000, 2000], [1000, -1000, 2000], [1000, 1000, 2000], [-1000, 1000, 2000]]


def ended(capsys, *arguments):
    """Exit code and what was said."""
    code = main(list(map(str, arguments)))
    return code, capsys.readouterr().err


def ceiling(folder, **changes):
    """A point platform under four anchors of one height: in their plane nothing holds it up."""
    blocks = [f"[[cable]]\nanchor_mm = {anchor}\nattachment_mm = [0, 0, 0]\n" for anchor in CEILING]
    return write(folder, printer_toml(head='freedoms = ["x", "y", "z"]', cables=blocks, **changes))


def of_init_x(folder, blocks):
    """cabfab-init-x with other words for some cables, by their number from 1."""
    rows = "".join("[[cable]]\n" + blocks.get(cable, "") + "\n" for cable in range(1, 9))
    return write(folder, f'inherits = "cabfab-init-x"\n{rows}')


# ---- singular

def test_a_singular_home(tmp_path, capsys):
    path = ceiling(tmp_path, platform=PLATFORM + "home_mm = [0, 0, 2000]\n")
    code, said = ended(capsys, "profile", "check", path)
    assert code == 3
    assert "expected a wrench matrix of rank 3 at home, one for each freedom, found rank 2" in said
    assert "the cables do not hold z" in said


def test_a_singular_pose(tmp_path, capsys):
    path = ceiling(tmp_path)
    assert ended(capsys, "profile", "check", path)[0] == 0
    code, said = ended(capsys, "stiffness", "-p", path, "--pose", "100 50 2000 0 0 0")
    assert code == 4
    assert "the pose is singular" in said
    robot = robot_from_printer(shelf.load_printer(path))
    (fault,) = faults(robot, np.array([100.0, 50, 2000, 0, 0, 0]))
    assert isinstance(fault, PoseError)
    assert "loose" in fault.sentence
    require_sound(robot, np.array([100.0, 50, 1500, 0, 0, 0]))


# ---- a cable through the platform

def test_a_cable_through_the_platform(tmp_path, capsys):
    """Cables 1 and 3 of Init X end on each other's corner."""
    swapped = {1: "attachment_mm = [-44.0528, -44.0528, -25]", 3: "attachment_mm = [44.0528, 44.0528, -25]"}
    path = of_init_x(tmp_path, swapped)
    code, said = ended(capsys, "profile", "check", path)
    assert code == 3
    assert [line.split(": ")[2].split(" it dips")[0] for line in said.splitlines()] == [
        "cable 1 runs through the platform", "cable 3 runs through the platform"]
    robot = robot_from_printer(shelf.load_printer(path))
    with pytest.raises(PoseError, match=r"cable 1 runs through the platform: it dips .* deg into the hull") as caught:
        require_sound(robot, robot.home)
    assert caught.value.details["cable"] == 1
    assert caught.value.exit_code == 4


# ---- a cable without length

def test_a_cable_without_length_at_home(tmp_path, capsys):
    path = of_init_x(tmp_path, {2: "attachment_mm = [-500, 500, 500]"})
    code, said = ended(capsys, "profile", "check", path)
    assert code == 3
    assert "cable.2.attachment_mm" in said
    assert "expected a cable longer than 0 mm at home, found the attachment on the anchor" in said


def test_a_cable_without_length_at_a_pose(capsys):
    code, said = ended(capsys, "stiffness", "-p", "hangprinter-v4", "--pose", "0 0.01 2299.83 0 0 0")
    assert code == 4
    assert "cable 4: attachment at (0.000, 0.010, 2299.830) mm: it has no length" in said


# ---- a pulley turned inside out

@pytest.mark.parametrize(("reach", "words"), [
    ((-20, 0, -300), "further than the pulley radius 25.27 mm from the swivel axis, found 20 mm"),
    ((-30, 0, -3), "further than the pulley radius 25.27 mm from the pulley's centre, found 5.60115 mm"),
])
def test_a_pulley_inside_out_at_home(tmp_path, capsys, reach, words):
    """rho <= r_p, and d <= r_p = 25.27 mm: d = hypot(30 - 25.27, 3)."""
    end = [anchor + step for anchor, step in zip((500, 500, 500), reach, strict=True)]
    code, said = ended(capsys, "profile", "check", of_init_x(tmp_path, {1: f"attachment_mm = {end}"}))
    assert code == 3
    place = ", ".join(f"{x:g}" for x in end)
    assert f"expected the attachment at home, at ({place}) mm, {words}" in said


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-60, 60)] * 3))
def test_the_profile_refuses_the_pulleys_that_the_robot_refuses(reach):
    """Attachment of cable 1 anywhere near its pulley: profile and kinematics agree."""
    end = [500.0 + step for step in reach]
    plain = robot_from_printer(shelf.load_printer("cabfab-init-x"))
    attachments = np.vstack((end, plain.attachments[1:]))
    free = cables(replace(plain, attachments=attachments), plain.home[None], refuse=False).free[0, 0]
    told = []
    try:
        shelf.load_printer("cabfab-init-x", [f"cable.1.attachment_mm={end}"])
    except ProfileError as error:
        told = [fault for fault in error.details["faults"] if "pulley" in fault or "longer than 0" in fault]
    if np.isnan(free) or free > 1e-3:                      # not within rounding of the edge
        assert bool(told) == bool(np.isnan(free))


def test_a_pulley_inside_out_at_a_pose(capsys):
    code, said = ended(capsys, "stiffness", "-p", "cabfab-optim", "--pose", "400 440 400 0 0 0")
    assert code == 4
    assert "cable 1: attachment at (486.620, 489.970, 402.500) mm" in said
    assert "expected more than the pulley radius 25.270 mm" in said


# ---- bounds that admit no pose

def test_bounds_that_do_not_carry_the_platform(tmp_path, capsys):
    """90 kg under four cables that pull up with 100 N at most, four that pull down with 1 N at least."""
    path = write(tmp_path, 'inherits = "cabfab-optim"\n[platform]\nmass_kg = 90\n')
    code, said = ended(capsys, "profile", "check", path)
    assert code == 3
    assert "no tensions within 1..100 N carry 90 kg there" in said
    robot = robot_from_printer(shelf.load_printer(path))
    (fault,) = faults(robot, robot.home)
    found = nearest_tension(robot, robot.home[None], required_wrench(robot, robot.home[None]))
    assert not found.feasible[0]
    assert fault.details["margin_n"] == pytest.approx(found.margin[0])


def test_bounds_that_no_pose_allows(tmp_path, capsys):
    """All cables lead up and must pull 60 N at least: more than the weight at home; the command says so as well."""
    shared = SHARED.replace("min_tension_n = 1.0", "min_tension_n = 60.0").replace("= 30.0", "= 70.0")
    path = ceiling(tmp_path, shared=shared)
    code, said = ended(capsys, "profile", "check", path)
    assert code == 3
    assert "no tensions within 60..100 N carry 2.5 kg there" in said
    code, said = ended(capsys, "stiffness", "-p", path, "--pose", "0 0 0 0 0 0")
    assert code == 4
    assert "no tensions within 60..100 N" in said


def test_a_right_robot_is_not_refused(tmp_path):
    robot = robot_from_printer(shelf.load_printer(write(tmp_path, printer_toml(winder=WINDER, motor=MOTOR))))
    assert faults(robot, robot.home) == []
    assert np.isfinite(lengths(robot, robot.home[None])).all()
