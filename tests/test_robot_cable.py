"""Cables beyond a constant modulus: against the sample measurements of the CABFAB thesis, quadrature and energy."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profile_cases import SHARED, WINDER, faults_of, printer_toml, write
from scipy.integrate import quad

from cabslice.profile import shelf
from cabslice.robot import cable, stiffness
from cabslice.robot.cable import Curve
from cabslice.robot.model import robot_from_printer

# D. Gueners, PhD thesis, Clermont Auvergne 2021, chapter 4; as in the project's data/cabfab.toml
SAMPLE_MM, HOUR = 45.0, 3600.0
DYNEEMA = """
[cables.modulus_by_frequency]
frequency_hz = [1, 40]
modulus_gpa = [118.48, 130.97]
[cables.damping]
frequency_hz = [1, 40]
damping_n_s = [157.5, 1.8]            # 3500 and 40 N s/m on 45 mm
[cables.creep]
loss = 0.10
after_s = 3600
onset_s = 60
"""
DYNEEMA_CABLE = SHARED.replace("diameter_mm = 1.0", "diameter_mm = 0.38").replace("= 70.0", "= 123.28")
CYCLES = {  # stiffness on loading kN/m, area N mm, of the 5th cycle between 10 and 50 N on 100 mm
    "steel-0.54": (129.95, 1.0551), "dyneema-0.38": (118.90, 1.7113), "dyneema-0.83": (278.50, 0.9099),
    "aramid-0.40": (87.12, 1.9284)}


def made(folder, more, shared=SHARED, winder=WINDER):
    printer = shelf.load_printer(write(folder, printer_toml(shared=shared + more, winder=winder)))
    robot = robot_from_printer(printer)
    return robot, cable.laws_from_printer(printer, robot.axial_stiffness)


# ---- modulus

def test_dyneema_stiffens_with_frequency_as_measured(tmp_path):
    robot, laws = made(tmp_path, DYNEEMA, DYNEEMA_CABLE)
    circle = np.pi / 4 * 0.38**2 * 1e3
    pulled = np.full((1, 8), 30.0)
    for hertz, modulus in ((1, 118.48), (40, 130.97), (0.01, 118.48), (400, 130.97), (40**0.5, (118.48 + 130.97) / 2)):
        np.testing.assert_allclose(cable.axial_stiffness(laws, pulled, hertz), modulus * circle, rtol=1e-12)
    np.testing.assert_array_equal(cable.axial_stiffness(laws, pulled)[0], robot.axial_stiffness)
    assert robot.axial_stiffness[0] / 1000 == pytest.approx(13981.37e-3, rel=1e-4)   # stiffness of 1 m


BY_TENSION = "[cables.modulus_by_tension]\ntension_n = [5, 20, 60]\nmodulus_gpa = [40, 70, 90]\n"


@settings(max_examples=40, deadline=None)
@given(tension=st.floats(0, 200))
def test_strain_is_the_integral_of_the_compliance(tmp_path_factory, tension):
    _, laws = made(tmp_path_factory.mktemp("laws"), BY_TENSION)
    circle = np.pi / 4 * 1e3

    def compliance(pull):
        return 1 / (np.interp(pull, [5, 20, 60], [40, 70, 90]) * circle)

    whole = quad(compliance, 0, tension, points=[5, 20, 60] if tension > 5 else None, epsabs=1e-13, limit=200)[0]
    np.testing.assert_allclose(cable.strain(laws, np.full((1, 8), tension)), whole, rtol=1e-9, atol=1e-15)


def test_a_constant_table_changes_nothing(tmp_path):
    flat = "[cables.modulus_by_tension]\ntension_n = [1, 90]\nmodulus_gpa = [70, 70]\n"
    robot, laws = made(tmp_path, flat)
    tension = np.random.default_rng(0).uniform(0, 100, (20, 8))
    loaded = np.full((20, 8), 1500.0)
    np.testing.assert_allclose(cable.axial_stiffness(laws, tension), np.tile(robot.axial_stiffness, (20, 1)))
    expected = stiffness.rest_lengths(robot, loaded, tension)
    np.testing.assert_allclose(cable.rest_lengths(laws, loaded, tension), expected, rtol=1e-14)


def test_strands_share_the_pull_that_the_table_is_read_at(tmp_path):
    spool = ("first_radius_mm = 60.0\nhome_angle_deg = 0.0\nangle_range_deg = [-9000.0, 9000.0]\n"
             'kind = "spool"\nbuildup_factor_mm = 0.1\nmechanical_advantage = 3\n')
    robot, laws = made(tmp_path, BY_TENSION, winder=spool)
    one = np.pi / 4 * 1e3 * 70
    np.testing.assert_allclose(cable.axial_stiffness(laws, np.full((1, 8), 60.0)), 3 * one, rtol=1e-12)
    small = np.array([[59.99], [60.01]]) + np.zeros((2, 8))
    np.testing.assert_allclose(0.02 / np.diff(cable.strain(laws, small), axis=0), 3 * one, rtol=1e-4)
    np.testing.assert_allclose(robot.axial_stiffness, 3 * one)


# ---- damping

def test_damping_is_that_of_the_sample_and_falls_with_the_length(tmp_path):
    _, laws = made(tmp_path, DYNEEMA, DYNEEMA_CABLE)
    rest = np.array([[SAMPLE_MM], [2000.0]]) + np.zeros((2, 8))
    for hertz, newton_seconds_per_m in ((1, 3500), (40, 40), (1000, 40)):
        c = cable.damping(laws, rest, hertz)
        np.testing.assert_allclose(c[0] * 1000, newton_seconds_per_m, rtol=1e-12)
        np.testing.assert_allclose(c[1] * 1000, newton_seconds_per_m * SAMPLE_MM / 2000, rtol=1e-12)
    # a power law between the two frequencies: the middle of the logarithms is the geometric mean
    middle = cable.damping(laws, rest[:1], 40**0.5)
    np.testing.assert_allclose(middle * 1000, (3500 * 40) ** 0.5, rtol=1e-12)
    _, none = made(tmp_path, "")
    assert not cable.damping(none, rest, 10).any()


@settings(max_examples=20, deadline=None)
@given(hertz=st.floats(0.5, 50), swing=st.floats(1, 40), preload=st.floats(25, 60))
def test_a_kelvin_voigt_cycle_turns_its_area_into_heat(hertz, swing, preload):
    """A sample of 100 mm, strained by a sine: force over elongation encloses pi c omega X^2; loss_factor reads it."""
    axial, rest, c = 12000.0, 100.0, 0.4
    k = axial / rest
    x, omega = swing / 2 / k, 2 * np.pi * hertz
    time = np.linspace(0, 1 / hertz, 20001)
    longer, rate = preload / k + x * np.sin(omega * time), x * omega * np.cos(omega * time)
    force = cable.pull(axial, c, rest, rest + longer, rate)
    if force.min() == 0:
        return                                             # it went slack: no ellipse
    area = ((force[1:] + force[:-1]) / 2 * np.diff(longer)).sum()
    assert area == pytest.approx(np.pi * c * omega * x**2, rel=1e-6)
    assert cable.loss_factor(area, k, swing) == pytest.approx(c * omega / k, rel=1e-6)
    assert cable.loop_damping(area, k, swing, hertz) == pytest.approx(c, rel=1e-6)


def test_a_slack_cable_does_not_push():
    assert cable.pull(1e4, 0.5, 100.0, 99.0, 0.0) == 0
    assert cable.pull(1e4, 0.5, 100.0, 101.0, -1e6) == 0
    assert cable.pull(1e4, 0.5, 100.0, 101.0, 10.0) == pytest.approx(105.0)


@pytest.mark.parametrize("name", CYCLES)
def test_loss_factors_of_the_measured_cycles(name):
    """Cycle 5, 10 to 50 N: steel and thick Dyneema lose least; all lie between a tenth and a fifth."""
    kilonewtons_per_m, area = CYCLES[name]
    factor = cable.loss_factor(area, kilonewtons_per_m, 40.0)
    assert factor == pytest.approx(area / (2 * np.pi * 20**2 / (2 * kilonewtons_per_m)), rel=1e-12)
    assert 0.1 < factor < 0.21


# ---- creep

def test_tension_lost_in_an_hour_is_what_was_measured(tmp_path):
    _, laws = made(tmp_path, DYNEEMA, DYNEEMA_CABLE)
    times = np.array([0.0, HOUR, 24 * HOUR])
    left = cable.tension_left(laws, np.full(8, 50.0), times)
    np.testing.assert_allclose(left[:2, 0], [50.0, 45.0], rtol=1e-12)
    assert 0.6 * 50 < left[2, 0] < 45
    np.testing.assert_allclose(cable.time_to_lose(laws, 0.10), HOUR, rtol=1e-12)
    _, steel = made(tmp_path, "")
    assert (cable.tension_left(steel, np.full(8, 50.0), times) == 50).all()
    assert np.isinf(cable.time_to_lose(steel, 0.01)).all()


@settings(max_examples=40, deadline=None)
@given(share=st.floats(1e-4, 0.3), first=st.floats(600, 1e5))
def test_creep_goes_with_the_logarithm_of_time(tmp_path_factory, share, first):
    """time_to_lose is the inverse of loss; after the onset each doubling of time loses about as much."""
    _, laws = made(tmp_path_factory.mktemp("laws"), DYNEEMA, DYNEEMA_CABLE)
    back = cable.loss(laws, cable.time_to_lose(laws, share)[:1])[0]
    np.testing.assert_allclose(back, share, rtol=1e-9)
    steps = np.diff(cable.loss(laws, first * 2.0 ** np.arange(4))[:, 0])
    np.testing.assert_allclose(steps, steps[-1], rtol=0.08)
    early = cable.loss(laws, np.array([0.5, 1.0]))[:, 0]
    assert early[1] / early[0] == pytest.approx(2, rel=0.01)


def test_crept_cable_is_as_much_longer_as_the_tension_lost(tmp_path):
    """At the same loaded length the crept rest length pulls with what is left."""
    _, laws = made(tmp_path, DYNEEMA + BY_TENSION)
    tension, since = np.random.default_rng(1).uniform(10, 100, (12, 8)), np.geomspace(1, 1e6, 12)
    rest = np.full((12, 8), 1800.0)
    loaded = rest * (1 + cable.strain(laws, tension))
    crept = cable.crept_rest(laws, rest, tension, since)
    assert (crept > rest).all()
    left = cable.tension_left(laws, tension, since)
    np.testing.assert_allclose(cable.rest_lengths(laws, loaded, left), crept, rtol=1e-14)


# ---- the keys

@pytest.mark.parametrize(("more", "key", "words"), [
    (BY_TENSION.replace("[5, 20, 60]", "[5, 60, 20]"), "cables.modulus_by_tension.tension_n", "numbers that rise"),
    (BY_TENSION.replace("[40, 70, 90]", "[40, 70]"), "cables.modulus_by_tension.modulus_gpa", "as many numbers"),
    (DYNEEMA.replace("loss = 0.10", "loss = 1.1"), "cables.creep.loss", "< 1"),
    (DYNEEMA.replace("onset_s = 60\n", ""), "cables.creep.onset_s", "missing; expected a number > 0"),
    (DYNEEMA.replace("damping_n_s", "damping_n"), "cables.damping.damping_n", "did you mean damping_n_s"),
    ("axial_stiffness_n = 20000", "cables.modulus_gpa", "either the modulus or axial_stiffness_n, found both"),
])
def test_tables_are_checked(tmp_path, more, key, words):
    (fault,) = faults_of(write(tmp_path, printer_toml(shared=SHARED + more)))
    assert fault.split(" (")[0].split(":")[0] == key
    assert words in fault


def test_a_line_without_thickness_says_its_stiffness(tmp_path):
    thin = SHARED.replace("diameter_mm = 1.0", "diameter_mm = 0")
    (fault,) = faults_of(write(tmp_path, printer_toml(shared=thin)))
    assert "expected more than 0 with modulus_gpa" in fault
    stiff = thin.replace("modulus_gpa = 70.0", "axial_stiffness_n = 20000.0")
    robot = robot_from_printer(shelf.load_printer(write(tmp_path, printer_toml(shared=stiff))))
    assert (robot.axial_stiffness == 20000).all()
    (fault,) = faults_of(write(tmp_path, printer_toml(shared=stiff.replace("axial_stiffness_n = 20000.0", ""))))
    assert fault.startswith("cables.modulus_gpa: missing; expected a number > 0")


def test_a_child_may_say_the_stiffness_in_the_other_way(tmp_path):
    write(tmp_path, printer_toml(shared=SHARED + BY_TENSION), "parent.toml")
    child = shelf.load_printer(write(tmp_path, 'inherits = "parent"\n[cables]\naxial_stiffness_n = 5000\n'))
    said = {(one.modulus_gpa, one.modulus_by_tension, one.axial_stiffness_n) for one in child.cable}
    assert said == {(None, None, 5000)}
    back = shelf.load_printer(tmp_path / "mine.toml", ["cables.modulus_gpa=12"])
    assert {(one.modulus_gpa, one.axial_stiffness_n) for one in back.cable} == {(12, None)}


def test_a_curve_must_rise():
    with pytest.raises(ValueError, match="rise"):
        Curve(np.array([1.0, 1.0]), np.array([1.0, 2.0]))


def test_numbers_equal_the_data_of_the_project():
    data = Path(__file__).parents[2] / "shared" / "data" / "cabfab.toml"
    if not data.is_file():
        pytest.skip("shared/data/cabfab.toml is not beside the checkout")
    cycles = {one["name"]: one for one in tomllib.loads(data.read_text())["cable_cycles"]}
    for name, (stiff, area) in CYCLES.items():
        assert (cycles[name]["stiffness_kn_m"][-1], cycles[name]["hysteresis_n_mm"][-1]) == (stiff, area)
    assert cycles["dyneema-0.38"]["damping_of_45_mm_n_s_per_m"] == [40.0, 3500.0]
