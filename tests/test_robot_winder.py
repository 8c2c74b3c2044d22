"""Winders: exact maps both ways, the tangent to the pulley, conservation of cable."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import START, cabfab_init_x, cabfab_optim, cable_robot, drives, hangprinter, radial_winders, random_poses
from scipy.integrate import quad

from cabslice.errors import PoseError
from cabslice.profile.printer import Cable, Motor, Winder
from cabslice.robot import winder
from cabslice.robot.kinematics import length_rates, lengths
from cabslice.robot.model import WinderColumns, _winders
from cabslice.robot.winder_line import line_at, touch_points

MEASURED, NOMINAL = cabfab_optim().winders, cabfab_optim(measured=False).winders
SEEDS = st.integers(0, 2**31 - 1)


def spiral(m=3, **more):
    return WinderColumns(
        radii=np.full((m, 1), 40.0),
        ramp_start=np.zeros(m),
        ramp_end=np.zeros(m),
        home_angle=np.full(m, 10.0),
        centre=np.full((m, 3), np.nan),
        crossed=np.zeros(m, bool),
        **drives(m),
        **{"slope": 0.08, "span": np.tile([0.0, 200.0], (m, 1)), **more},
    )


def drum(m=3):
    return spiral(m, slope=0.0, axial=np.full(m, 1.2 / (2 * np.pi)), span=np.tile([-90.0, 90.0], (m, 1)))


KINDS = {
    "measured": MEASURED,
    "nominal": NOMINAL,
    "spiral": spiral(),
    "drum": drum(),
    "hangprinter": hangprinter().winders,
}


def angles_of(winders, count, seed):
    low, high = winders.span.T
    return np.random.default_rng(seed).uniform(np.maximum(low, -30.0), high, (count, len(high)))


def test_radius_follows_the_layers_and_ramps_of_the_thesis():
    middle = START + 2 * np.pi * np.arange(-1, 5)[:, None] - 0.5  # half a radian before the ramps: well inside a layer
    layers = np.maximum(np.arange(-1, 5), 0)[:, None]
    rows = np.broadcast_to(np.arange(8), middle.shape)
    np.testing.assert_allclose(winder.radius(MEASURED, middle), MEASURED.radii[rows, layers], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(winder.layer(MEASURED, middle), np.broadcast_to(layers, middle.shape))
    half = (MEASURED.ramp_start + MEASURED.ramp_end) / 2 + 2 * np.pi * 2
    np.testing.assert_allclose(winder.radius(MEASURED, half[None])[0], MEASURED.radii[:, 2:4].mean(axis=1), atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_wound_is_the_integral_of_the_radius(kind):
    winders = KINDS[kind]
    ends = angles_of(winders, 2, 3)
    wound = winder.wound(winders, ends)
    for cable in range(ends.shape[1]):

        def rate(angle, cable=cable):
            column = np.zeros((1, ends.shape[1])) + winders.home_angle
            column[0, cable] = angle
            return np.hypot(winder.radius(winders, column)[0, cable], winders.axial[cable]) / winders.gear[cable]

        low, high = np.sort(ends[:, cable])
        turns = winders.ramp_start[cable] + 2 * np.pi * np.arange(5)
        ramp = winders.ramp_end[cable] - winders.ramp_start[cable]
        breaks = [x for x in (*turns, *(turns + ramp)) if low < x < high]
        area = quad(rate, low, high, points=breaks or None, epsabs=1e-10, limit=200)[0]
        assert abs(wound[:, cable].max() - wound[:, cable].min() - area) < 1e-8
    np.testing.assert_allclose(winder.wound(winders, winders.home_angle[None] * 0), 0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_angle_of_is_the_inverse_and_both_rise(kind, seed):
    winders = KINDS[kind]
    angle = np.sort(angles_of(winders, 300, seed), axis=0)
    wound = winder.wound(winders, angle)
    again = winder.angle_of(winders, wound)
    rate = winder.radius(winders, angle) / winders.gear
    assert np.abs((again - angle) * rate).max() < 1e-9  # mm of line
    assert (np.diff(wound, axis=0) > 0).all()


def test_wound_is_once_differentiable_at_every_ramp():
    knots = MEASURED.ramp_start + 2 * np.pi * np.arange(4)[:, None]
    for knot in (knots, knots + MEASURED.ramp_end - MEASURED.ramp_start):
        step = 1e-4
        left, right = (winder.wound(MEASURED, knot + s * step) for s in (-1, 1))
        middle = winder.wound(MEASURED, knot)
        rate, steepest = winder.radius(MEASURED, knot), 0.7 / np.radians(8.7)
        for slope in ((right - middle) / step, (middle - left) / step):
            assert np.abs(slope - rate).max() < step * steepest


def test_angles_past_the_last_layer_are_refused():
    last = MEASURED.ramp_start + 2 * np.pi * 4
    np.testing.assert_allclose(MEASURED.span[:, 1], last)
    angle = np.broadcast_to(last, (3, 8)).copy()
    winder.wound(MEASURED, angle)
    angle[2, 4] += 1e-3
    with pytest.raises(PoseError, match=r"winder 5 at sample 2: motor angle .* outside what it holds"):
        winder.wound(MEASURED, angle)
    wound = winder.wound(MEASURED, last[None]) + np.eye(8)[[5]]
    with pytest.raises(PoseError, match="winder 6 at sample 0"):
        winder.angle_of(MEASURED, wound)
    with pytest.raises(PoseError, match="winder 1"):
        winder.angle_of(spiral(), np.full((1, 3), -1e6))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"ramp_end": START}, "winder 1: its ramp spans 0.000 deg"),
        ({"gear": -1.0}, "expected gear > 0"),
        ({"axial": 0.2}, "one radius"),
        ({"slope": 0.1}, "radius falls to"),
        ({"advantage": 0.5}, "advantage"),
        ({"span": np.tile([5.0, 4.0], (8, 1))}, "span ends at 4.000 rad"),
    ],
)
def test_impossible_winders_are_refused(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        radial_winders(np.zeros((8, 3)), **change)


# --- the line between winder and pulley ------------------------------------------------------------------------------


def test_tangent_is_square_to_both_radii_and_its_ends_make_the_line():
    robot = cabfab_optim()
    radii = np.random.default_rng(5).uniform(45, 70, (40, 8))
    disc, pulley = touch_points(robot, radii)
    line = line_at(robot, radii, np.zeros(1))
    straight = pulley - disc
    np.testing.assert_allclose(np.linalg.norm(straight, axis=2), line.tangent, rtol=0, atol=1e-9)
    spokes = disc - robot.winders.centre
    np.testing.assert_allclose(np.linalg.norm(spokes, axis=2), radii, atol=1e-10)
    side = np.where(robot.winders.crossed, -1, 1)[:, None] * (robot.winders.centre - robot.anchors) * [1, 1, 0]
    centre = robot.anchors + robot.pulley_radii[:, None] * side / np.linalg.norm(side, axis=1)[:, None]
    np.testing.assert_allclose(
        np.linalg.norm(pulley - centre, axis=2), np.broadcast_to(robot.pulley_radii, radii.shape), atol=1e-10
    )
    for spoke in (spokes, pulley - centre):
        assert np.abs(np.einsum("kmi,kmi->km", straight, spoke)).max() < 1e-8
    # crossed: disc and pulley on opposite sides of the cable
    apart = np.einsum("kmi,kmi->km", spokes, pulley - centre) < 0
    np.testing.assert_array_equal(apart, np.broadcast_to(robot.winders.crossed, radii.shape))


def test_at_the_design_radius_the_cable_arrives_along_the_swivel_axis():
    robot = cabfab_optim()
    line = line_at(robot, np.full((1, 8), 60.27), np.zeros(1))
    np.testing.assert_allclose(line.tilt, 0, atol=1e-14)
    np.testing.assert_allclose(line.length, 700.0, rtol=0, atol=1e-10)


@pytest.mark.parametrize("pulley_radius", [0.0, 25.27])
def test_the_line_is_a_taut_string_round_both_circles(pulley_radius):
    """Independent of the tilt formula: the shortest way from a far point of the disc to a far point of the pulley."""
    robot = cabfab_init_x(pulley_radius=pulley_radius)
    step, radii = 1e-4, np.random.default_rng(6).uniform(50, 70, (30, 8))
    line, (disc, pulley) = line_at(robot, radii, np.zeros(1)), touch_points(robot, radii)
    out = pulley - robot.anchors
    back = -np.arcsin(np.einsum("kmi,mi->km", out, robot.pulley_axes) / np.maximum(robot.pulley_radii, 1e-300))
    spokes = disc - robot.winders.centre
    turned = np.arcsin(np.einsum("kmi,mi->km", spokes, robot.pulley_axes) / radii)  # sign: up the axis winds on
    length = np.linalg.norm(pulley - disc, axis=2) + robot.pulley_radii * back + radii * turned
    np.testing.assert_allclose(line.length, length, rtol=0, atol=1e-9)
    numeric = (line_at(robot, radii + step, np.zeros(1)).length - line_at(robot, radii - step, np.zeros(1)).length) / (
        2 * step
    )
    np.testing.assert_allclose(line.by_radius, numeric, rtol=0, atol=1e-8)


def test_offset_of_a_helical_drum_lengthens_the_line():
    robot, step = cabfab_optim(), 1e-3
    radii, offset = np.full((4, 8), 60.0), np.array([[-30.0], [-5], [5], [40]])
    line = line_at(robot, radii, offset)
    numeric = (line_at(robot, radii, offset + step).length - line_at(robot, radii, offset - step).length) / (2 * step)
    np.testing.assert_allclose(line.by_offset, numeric, atol=1e-9)
    numeric = (line_at(robot, radii + step, offset).length - line_at(robot, radii - step, offset).length) / (2 * step)
    np.testing.assert_allclose(line.by_radius, numeric, atol=1e-8)


def test_a_winder_that_reaches_its_pulley_is_refused():
    robot = cabfab_optim()
    near = cable_robot(
        robot.anchors,
        robot.attachments,
        pulley_radius=25.0,
        winders=radial_winders(robot.anchors + np.array([80.0, 0, -20])),
    )
    with pytest.raises(PoseError, match=r"winder 1: its disc of radius 60\.000 mm and the pulley"):
        winder.line_to_pulley(near, np.full((1, 8), 60.0))


# --- cable lengths and motor angles ----------------------------------------------------------------------------------


def drum_robot():
    robot = cabfab_optim()
    winders = WinderColumns(
        radii=np.full((8, 1), 60.27),
        ramp_start=np.zeros(8),
        ramp_end=np.zeros(8),
        home_angle=np.full(8, 5.0),
        centre=robot.winders.centre,
        crossed=robot.winders.crossed,
        **drives(8),
        axial=1.2 / (2 * np.pi),
        span=np.tile([-60.0, 60.0], (8, 1)),
    )
    return cable_robot(robot.anchors, robot.attachments, axes=robot.pulley_axes, pulley_radius=25.27, winders=winders)


ROBOTS = {
    "init-x": cabfab_init_x(),
    "optim": cabfab_optim(measured=False),
    "eyelets": cabfab_optim(pulley_radius=0.0),
    "drum": drum_robot(),
    "hangprinter": hangprinter(),
}


def moves(robot, seed):
    rng = np.random.default_rng(seed)
    poses = random_poses(seed, 200, turn=0.1)
    poses[:, ~robot.freedoms] = 0
    return poses, rng.uniform(1, 100, (200, robot.cables))


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_cable_is_conserved(name, seed):
    """Cable on the winder plus everything unwound, at rest length, is the same at every pose and tension."""
    robot = ROBOTS[name]
    poses, tension = moves(robot, seed)
    cable = lengths(robot, poses)
    angle = winder.motor_angles(robot, cable, tension)
    strain, strands = tension / robot.axial_stiffness, robot.winders.advantage
    total = winder.wound(robot.winders, angle) + strands * winder.loaded_length(robot, cable, angle) / (1 + strain)
    home = robot.winders.home_angle[None]
    slack = robot.tension_reference / robot.axial_stiffness
    loaded = winder.loaded_length(robot, lengths(robot, robot.home[None]), home)
    start = winder.wound(robot.winders, home) + strands * loaded / (1 + slack)
    np.testing.assert_allclose(total, np.broadcast_to(start, total.shape), rtol=0, atol=1e-9)
    np.testing.assert_allclose(winder.pulley_lengths_of(robot, angle, tension), cable, rtol=0, atol=1e-9)


def test_home_is_home_and_more_tension_winds_cable_in():
    robot = ROBOTS["init-x"]
    cable = lengths(robot, robot.home[None])
    home = winder.motor_angles(robot, cable, robot.tension_reference[None])
    np.testing.assert_allclose(home, robot.winders.home_angle[None], rtol=0, atol=1e-12)
    pulled = winder.motor_angles(robot, cable, robot.tension_reference[None] + 10)
    stretch = 10 / robot.axial_stiffness * winder.loaded_length(robot, cable, home)
    np.testing.assert_allclose((pulled - home) * winder.radius(robot.winders, home), stretch, rtol=0.01)
    given = winder.motor_angles(robot, cable, np.full((1, 8), 7.0), home_tension=np.full(8, 7.0))
    np.testing.assert_allclose(given, robot.winders.home_angle[None], atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_motor_rates_are_the_derivative_of_motor_angles(name):
    robot, step = ROBOTS[name], 1e-4
    poses, tension = moves(robot, 8)
    rng = np.random.default_rng(9)
    rates = rng.uniform(-100, 100, poses.shape) * [1, 1, 1, 0, 0, 0]
    pulling = rng.uniform(-200, 200, tension.shape)
    cable = lengths(robot, poses)
    ahead, behind = (
        winder.motor_angles(robot, lengths(robot, poses + s * step * rates), tension + s * step * pulling)
        for s in (1, -1)
    )
    angle = winder.motor_angles(robot, cable, tension)
    speeds = winder.motor_rates(robot, angle, cable, tension, length_rates(robot, poses, rates), pulling)
    error = np.abs((ahead - behind) / (2 * step) - speeds) / robot.winders.gear
    assert np.quantile(error, 0.99) < 2e-7  # the rest: a step across the foot of a ramp
    assert error.max() < 1e-3


def test_hangprinter_motor_angles_agree_with_its_firmware():
    """Ludvigsen's build-up law: motor = k0 (sqrt(r0^2 + k2 d) - r0), d the change of line length from the origin."""
    robot = hangprinter(axial_stiffness=np.full(4, 1e15))
    xyz = np.random.default_rng(4).uniform([-500, -500, 0], [500, 500, 1000], (100, 3))
    poses = np.hstack((xyz, np.zeros((100, 3))))
    radii, advantage = np.array([75.546, 75.659, 76.128, 75.192]), np.array([2.0, 2, 2, 4])
    change = np.linalg.norm(xyz[:, None] - robot.anchors, axis=2) - np.linalg.norm(robot.anchors, axis=1)
    k2 = -advantage * 1 * 0.128181
    k0 = 2 * advantage * (255 / 20) / k2  # rad mm per mm
    unwound = k0 * (np.sqrt(radii**2 + k2 * change) - radii)
    angle = winder.motor_angles(robot, lengths(robot, poses), np.full((100, 4), 20.0))
    np.testing.assert_allclose(angle, -unwound, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_transmission_bounds_hold_everywhere_and_are_met(kind):
    winders = KINDS[kind]
    low, high = winder.transmission_bounds(winders)
    ends = np.stack((np.maximum(winders.span[:, 0], -2000.0), winders.span[:, 1]))
    found = winder.transmission(winders, np.linspace(*ends, 20001))
    np.testing.assert_allclose([found.min(axis=0), found.max(axis=0)], [low, high], rtol=1e-12)


def test_transmission_is_the_work_of_the_motor():
    """Torque times turning is tension times cable taken in: transmission is -dL/dtheta where the line stands still."""
    robot = hangprinter(axial_stiffness=np.full(4, 1e15))
    angle, step = np.random.default_rng(2).uniform(-400, 100, (50, 4)), 1e-3
    zero = np.zeros((50, 4))
    numeric = (
        winder.pulley_lengths_of(robot, angle - step, zero) - winder.pulley_lengths_of(robot, angle + step, zero)
    ) / (2 * step)
    np.testing.assert_allclose(winder.transmission(robot.winders, angle), numeric, rtol=1e-7)


# --- from a profile --------------------------------------------------------------------------------------------------

COMMON = {"first_radius_mm": 50.0, "home_angle_deg": 720.0, "centre_mm": [600.0, 0.0, -300.0], "gear_ratio": 4.0}
TABLES = {
    "radial": {"layer_step_mm": 0.5, "ramp_start_deg": 40.0, "ramp_end_deg": 80.0, "layers": 5},
    "spiral": {"radius_per_turn_mm": 0.7, "angle_range_deg": [0.0, 9000.0]},
    "drum": {"pitch_mm": 1.2, "angle_range_deg": [-3000.0, 9000.0]},
    "spool": {
        "buildup_factor_mm": 0.12,
        "lines_per_spool": 2,
        "mechanical_advantage": 3,
        "angle_range_deg": [-100.0, 9000.0],
    },
}


@pytest.mark.parametrize("kind", TABLES)
def test_every_kind_of_a_profile_becomes_columns(kind):
    """Radius against the words of the profile, at a quarter of a spool turn for each degree of the motor."""
    cables = [_profile_cable("radial"), _profile_cable(kind)]
    winders = _winders(cables)
    angle = np.radians(np.tile([[0.0], [100.0], [720.0], [2000.0]], (1, 2)))
    turns = angle[:, 1] / (2 * np.pi) / 4
    radius = {
        "radial": 50 + 0.5 * np.interp(angle[:, 1], np.radians([40, 80, 1480, 1520]), [0, 1, 1, 2]),
        "spiral": 50 + 0.7 * turns,
        "drum": np.full(4, 50.0),
        "spool": 50 + 0.12 * np.pi * 2 * turns,
    }[kind]
    np.testing.assert_allclose(winder.radius(winders, angle)[:, 1], radius, rtol=0, atol=1e-12)
    per_turn = np.hypot(2 * np.pi * 50, 1.2) if kind == "drum" else None
    if per_turn:
        assert abs(winder.wound(winders, angle)[2, 1] - per_turn / 2) < 1e-9
    span = [-np.inf, 40 + 360 * 4 * 4] if kind == "radial" else TABLES[kind]["angle_range_deg"]
    np.testing.assert_allclose(winders.span[1], np.radians(span))
    assert winders.advantage[1] == (3 if kind == "spool" else 1)


def _profile_cable(kind):
    motor = {"max_speed_rad_s": 10.0, "continuous_torque_n_m": 6.0, "peak_torque_n_m": 18.0, "inertia_kg_mm2": 440.0}
    return Cable(
        anchor_mm=[500.0, 0.0, 0.0],
        attachment_mm=[0.0, 0.0, 0.0],
        diameter_mm=0.5,
        modulus_gpa=70.0,
        min_tension_n=1.0,
        max_tension_n=100.0,
        reference_tension_n=30.0,
        clearance_mm=2.0,
        motor=Motor(**motor),
        winder=Winder(kind=kind, **COMMON, **TABLES[kind]),
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_compiled_angles_are_those_of_the_search_over_all_samples_at_once(name):
    robot = ROBOTS[name]
    poses, tension = moves(robot, 3)
    cable, winders = lengths(robot, poses), robot.winders
    angle, lever = winder.angles_and_levers(robot, cable, tension)
    strain = 1 + tension / robot.axial_stiffness
    goal = winder._constant(robot, winders, None) - winders.advantage * cable / strain
    np.testing.assert_allclose(angle, winder.searched_angles(robot, goal, strain), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(lever, winder.transmission(winders, angle), rtol=1e-12)
