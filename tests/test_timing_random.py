"""Any robot, any path: the motion keeps every limit and stops nowhere inside a piece, or the print is refused with the
place and the limit that forbid it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_optim, cable_robot, drives
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline, print_like

from cabslice.errors import ImpossibleError
from cabslice.robot.model import WinderColumns
from cabslice.timing.audit import audit
from cabslice.timing.proof import plan_proven

CORNERS = np.array([[x, y, z] for z in (1, -1) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))], float)


def any_robot(seed, m, *, pulleys, wound):
    """m >= 7 cables from near the corners and edges of a box to a platform as a flat box turned inside it, so that many
    can hold it; mass, tensions and centre of mass at random."""
    rng = np.random.default_rng(seed)
    side = rng.uniform(300, 1500, 3)
    which = np.concatenate((rng.permutation(8), rng.integers(0, 8, max(m - 8, 0))))[:m]
    anchors = CORNERS[which] * side * rng.uniform(0.7, 1.1, (m, 3))
    turn = rng.uniform(-0.6, 0.6)
    turned = CORNERS[which] @ np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    attachments = turned * [1, 1, rng.choice([-1, 1])] * rng.uniform(10, 150, 3) * rng.uniform(0.8, 1.2, (m, 3))
    least = rng.choice([0.0, 1.0, 10.0])
    more = {
        "mass": rng.uniform(0.2, 10), "centre_of_mass": rng.uniform(-15, 15, 3), "tension_min": np.full(m, least),
        "tension_max": np.full(m, least + 10.0 ** rng.uniform(1, 3.3)),
        "bed_origin": np.array([0, 0, rng.uniform(-0.8, 0.3) * side[2] - 100])}
    more["tension_reference"] = (more["tension_min"] * 2 + more["tension_max"]) / 3
    axes = np.tile([0.0, 0.0, 1.0], (m, 1)) * np.sign(anchors[:, 2:])
    radius = rng.uniform(5, 40, m) * pulleys
    return cable_robot(anchors, attachments, axes=axes, pulley_radius=radius, winders=drums(m, rng) if wound else None,
                       **more)


def drums(m, rng):
    still, motors = np.zeros(m), drives(m)
    motors["max_speed"] = np.full(m, 10.0 ** rng.uniform(0.7, 2))
    motors["continuous_torque"] = np.full(m, 10.0 ** rng.uniform(3, 5))
    motors["peak_torque"] = 3 * motors["continuous_torque"]
    return WinderColumns(radii=rng.uniform(20, 90, (m, 1)), ramp_start=still, ramp_end=still, home_angle=still,
                         centre=np.full((m, 3), np.nan), crossed=np.zeros(m, bool), slope=0.0,
                         span=np.tile([-1e4, 1e4], (m, 1)), **motors)


def a_printer(rng):
    acceleration = rng.choice([None, 10.0 ** rng.uniform(2, 4.5)])
    motion = SimpleNamespace(max_acceleration_mm_s2=acceleration, max_speed_mm_s=rng.uniform(10, 500),
                             smoothing_ms=float(rng.choice([0.0, 2.0, 5.0, 20.0])))
    return SimpleNamespace(motion=motion, extruder=PRINTER.extruder)


def a_path(seed, count, rng):
    """Long and short moves mixed; walls, infill and retractions; facets of a few um; lines forth and back; a path that
    leaves the frame."""
    speed, pieces = rng.uniform(5, 400), int(rng.integers(1, 4))
    kind = rng.integers(5)
    if kind == 0:
        return polyline(seed, count, speed=speed, pieces=pieces)
    if kind == 1:
        return print_like(seed, turns=count)
    if kind == 2:
        angle = np.cumsum(rng.uniform(0, 0.2, 10 * count)) * rng.choice([1e-3, 1.0])
        points = 10.0 ** rng.uniform(-1, 1.5) * np.stack((np.cos(angle), np.sin(angle), 0 * angle + 0.02), axis=1)
    elif kind == 3:
        points = np.cumsum(rng.normal(size=(count, 3)) * [5, 5, 0], axis=0)[np.arange(4 * count) // 2 % count]
        points[::2] += rng.choice([1e-9, 1e-3, 1.0])
    else:
        points = rng.uniform(-1, 1, (count, 3)) * 10.0 ** rng.uniform(1.5, 3.5) * [1, 1, 0.2]
    return polyline(seed, points=points, speed=speed, pieces=pieces)


def judged(seed, m, count, pulleys, wound):
    rng = np.random.default_rng(seed + 1)
    robot, printer = any_robot(seed, m, pulleys=pulleys, wound=wound), a_printer(rng)
    given = a_path(seed, count, rng), robot, printer, MATERIAL, PROCESS
    try:
        trajectory, verdict = plan_proven(*given)
    except ImpossibleError as refused:
        return named(refused)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    ends = np.concatenate((trajectory.pieces[:-1], trajectory.pieces[1:] - 1))
    inner = np.setdiff1d(np.arange(len(trajectory.x)), ends)
    assert (trajectory.x[inner] > 0).all()
    assert (trajectory.x[ends] == 0).all()
    assert np.isfinite(trajectory.duration)
    assert audit(trajectory, *given, step_s=5e-4).margins["tension_share"] <= 1 + 1e-6
    return "planned"


def named(refused):
    """A refusal says layer, place and limit, or which motor is too weak for any print."""
    if "its motor cannot hold" in str(refused):
        return "weak"
    (finding,) = refused.findings
    assert finding.code
    assert f"layer {finding.layer}" in finding.sentence
    x, y, z = finding.xyz
    assert f"x {x:.1f} y {y:.1f} z {z:.1f}" in finding.sentence
    return finding.code


@given(st.integers(0, 100_000), st.integers(7, 10), st.integers(2, 25), st.booleans(), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_random_print_keeps_every_limit_or_is_refused_with_its_place(seed, m, count, pulleys, wound):
    judged(seed, m, count, pulleys, wound)


def test_vertices_left_out_at_the_start_are_passed():
    """Facets of less than a um at the start of the path are one with the first vertex: nothing is missed."""
    points = np.array([[0, 0, 1], [4e-4, 0, 1], [8e-4, 0, 1], [9e-4, 0, 1], [10, 0, 1], [10, 5, 1]])
    path = polyline(points=points, pieces=1)
    trajectory, verdict = plan_proven(path, cabfab_optim(), PRINTER, MATERIAL, PROCESS)
    assert verdict.ok, [finding.sentence for finding in verdict.findings]
    lost = replace(trajectory, move=np.full_like(trajectory.move, trajectory.move[-1]))
    found = audit(lost, path, cabfab_optim(), PRINTER, MATERIAL, PROCESS).findings
    assert "missed" in {finding.code for finding in found}


def test_a_path_into_a_pulley_is_refused_with_cable_and_place():
    assert judged(2172, 7, 11, True, False) == "pulley"


def test_motors_too_hot_from_turning_are_cooled_by_slowing_the_print():
    assert judged(5557, 9, 24, False, True) == "planned"
