"""The elastic catenary against quadrature, its limits, and when a straight line is good enough."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import cabfab_optim, cable_robot, random_poses
from scipy.integrate import quad

from cabslice.errors import PoseError
from cabslice.robot.kinematics import cables
from cabslice.robot.sag import hang, pull_of, sag_estimate, straight_enough

SEEDS = st.integers(0, 2**31 - 1)
STEEL_054 = 1.3e-3 * 9.80665e-3  # N/mm: 1.3 g/m
ROPE_6 = 0.15 * 9.80665e-3  # N/mm: 0.15 kg/m, 6 mm wire rope


def draw(seed, count=20, m=3):
    rng = np.random.default_rng(seed)
    chord = rng.uniform(-1, 1, (count, m, 3)) * [10000, 10000, 6000]
    weight, stiff = rng.uniform(1e-4, 2e-3, m), rng.uniform(1e5, 1e6, m)
    tension = rng.uniform(1.5, 20, (count, m)) * weight * np.linalg.norm(chord, axis=2)
    return chord, tension, weight, stiff


def span_of(shape, weight, stiff):
    """Where each cable arrives: every bit of it from the platform on, hanging and stretched, added up by quadrature."""
    arrived = np.empty((*shape.rest.shape, 3))
    for pose, cable in np.ndindex(shape.rest.shape):
        pull, load = shape.tension[pose, cable] * shape.pull[pose, cable], np.array([0, 0, weight[cable]])

        def way(s, axis, pull=pull, load=load, cable=cable):
            here = pull + load * s
            return (1 / stiff[cable] + 1 / np.linalg.norm(here)) * here[axis]

        for axis in range(3):
            arrived[pose, cable, axis] = quad(way, 0, shape.rest[pose, cable], args=(axis,), epsabs=1e-9, limit=200)[0]
    return arrived


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_the_catenary_spans_its_chord(seed):
    chord, tension, weight, stiff = draw(seed, 3)
    np.testing.assert_allclose(span_of(hang(chord, tension, weight, stiff), weight, stiff), chord, rtol=0, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_tension_and_rest_length_are_inverse(seed):
    chord, tension, weight, stiff = draw(seed)
    shape = hang(chord, tension, weight, stiff)
    again = pull_of(chord, shape.rest, weight, stiff)
    np.testing.assert_allclose(again.tension, tension, rtol=1e-8)
    np.testing.assert_allclose(again.pull, shape.pull, rtol=0, atol=1e-8)
    np.testing.assert_allclose(again.exit, shape.exit, rtol=1e-8)


def test_slack_cables_hang_too():
    chord = np.array([[[1000.0, 0, 0], [600, 800, 300], [0, 500, -400]]])
    weight, stiff, rest = np.full(3, 1e-3), np.full(3, 1e5), np.array([[1500.0, 2000, 900]])
    shape = pull_of(chord, rest, weight, stiff)
    np.testing.assert_allclose(span_of(shape, weight, stiff), chord, rtol=0, atol=1e-6)
    assert (shape.pull[0, :2, 2] < 0).all()  # they pull the platform down
    # a level cable carries half its weight at each end
    assert abs(shape.tension[0, 0] * shape.pull[0, 0, 2] + 0.5 * 1e-3 * 1500) < 1e-9


def test_without_weight_it_is_a_straight_elastic_cable():
    chord, tension, _, stiff = draw(1)
    length = np.linalg.norm(chord, axis=2)
    straight = length / (1 + tension / stiff)
    light = hang(chord, tension, np.zeros(3), stiff)
    np.testing.assert_allclose(light.rest, straight, rtol=1e-13)
    np.testing.assert_allclose(light.pull, chord / length[..., None], rtol=0, atol=1e-13)
    gaps = [np.abs(hang(chord, tension, np.full(3, w), stiff).pull - light.pull).max() for w in (1e-6, 1e-7, 1e-8)]
    np.testing.assert_allclose(np.divide(gaps[:-1], gaps[1:]), 10, rtol=1e-3)


@pytest.mark.parametrize("x", [0.0, 1e-9, 1e-3])
@pytest.mark.parametrize("z", [3000.0, -3000.0])
def test_a_plumb_cable_only_stretches(x, z):
    weight, stiff, tension = 2e-3, 1e5, 50.0
    shape = hang(np.array([[[x, 0.0, z]]]), np.array([[tension]]), np.array([weight]), np.array([stiff]))
    rest = shape.rest[0, 0]
    mean = tension + np.sign(z) * weight * rest / 2
    assert abs(rest * (1 + mean / stiff) - 3000) < 1e-6
    np.testing.assert_allclose(shape.pull[0, 0], [0, 0, np.sign(z)], atol=1e-6)
    np.testing.assert_allclose(shape.exit, tension + np.sign(z) * weight * rest, rtol=1e-9)


def test_the_estimate_is_the_first_order_of_the_catenary():
    """Rest length, pull direction, and the stiffness by differencing the catenary's own rest length and tension."""
    robot = cabfab_optim(pulley_radius=0.0)
    lines = cables(robot, random_poses(3, 40))
    tension = np.random.default_rng(3).uniform(2, 60, lines.free.shape)
    weight, stiff, chord = np.full(8, 5 * STEEL_054), robot.axial_stiffness, lines.exit - lines.tip
    shape, estimate = hang(chord, tension, weight, stiff), sag_estimate(lines, tension, weight, stiff)
    straight = lines.free / (1 + tension / stiff)
    assert (np.abs(shape.rest - straight) <= 1.1 * estimate.length).all()
    angle = np.arccos(np.clip(np.einsum("kmi,kmi->km", shape.pull, lines.unit), -1, 1))
    np.testing.assert_allclose(estimate.angle, angle, rtol=0.02)
    step = 1e-3 * tension
    more, less = (hang(chord, tension + s * step, weight, stiff).rest for s in (1, -1))
    soft = -2 * step / (more - less) * straight**2 / lines.free  # dt/drest, counted as ES
    np.testing.assert_allclose(1 - soft / stiff, estimate.stiffness, rtol=0.05, atol=2e-3)


def test_metre_size_is_straight_and_fifteen_metres_are_not():
    """CABFAB at 10 N and more: below 0.1 um and 0.02 %.  CoGiRo, 6 mm rope at 300 N: millimetres."""
    small = cabfab_optim(pulley_radius=0.0)
    lines = cables(small, random_poses(1, 100, reach=300))
    tight = sag_estimate(lines, np.full((100, 8), 10.0), np.full(8, STEEL_054), small.axial_stiffness)
    assert straight_enough(tight).all()
    assert tight.length.max() < 1e-3
    loose = sag_estimate(lines, np.full((100, 8), 1.0), np.full(8, STEEL_054), small.axial_stiffness)
    assert not straight_enough(loose).all()  # 1 N is where it ends, by the lost stiffness
    corner = np.array([[-7119.66, 5472.61, 5410.63], [7505.56, 5078.92, 5418.2]])  # data/robots.toml, cogiro
    large = cable_robot(corner, np.zeros((2, 3)), axial_stiffness=np.full(2, 1.0e6))
    lines = cables(large, np.array([[0.0, 0, 1500, 0, 0, 0]]))
    hung = sag_estimate(lines, np.full((1, 2), 300.0), np.full(2, ROPE_6), large.axial_stiffness)
    assert not straight_enough(hung).any()
    exact = hang(lines.exit - lines.tip, np.full((1, 2), 300.0), np.full(2, ROPE_6), large.axial_stiffness)
    longer = exact.rest - lines.free / (1 + 300.0 / large.axial_stiffness)
    assert (longer > 0.3).all()
    assert (hung.droop > 30).all()


def test_too_little_tension_for_the_weight_is_refused():
    with pytest.raises(PoseError, match="cable 2 at pose 0: no catenary found"):
        hang(np.full((1, 2, 3), [9000.0, 0, 0]), np.array([[100.0, 1.0]]), np.full(2, 2e-3), np.full(2, 1e6))
