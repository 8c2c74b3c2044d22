"""The ringing of a wrong robot by its modes: against the simulation, and calmed where it is too much."""


import numpy as np
import pytest
from cli_cases import planned_box

from cabslice import pipeline, store
from cabslice.simulation import calm, ringing
from cabslice.simulation.accuracy import cases, wrong_ones
from cabslice.simulation.prints import play_stream
from cabslice.timing.retime import task_for
from cabslice.timing.trajectory import sample

BOUND = 0.06


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return store.load(planned_box(tmp_path_factory.mktemp("planned")))[1]


@pytest.fixture(scope="module")
def robot(plan):
    return pipeline.robot_of(plan)


def calming(plan, robot):
    profiles = pipeline.profiles_of(plan.origin)
    task = task_for(plan.toolpath, robot, profiles.printer, profiles.material, profiles.process, "compiled")
    return calm.Calming(task, lambda motion: wrong_ones(robot, motion))


@pytest.mark.parametrize(("case", "share"), [(1, 0.05), (2, -0.05), (3, 0.05), (4, -0.05)])
def test_modes_ring_as_the_simulation(plan, robot, case, share):
    """Modulus lower and higher, mass higher and lower."""
    stream = pipeline.stream_of(plan, {}, 2e-3)
    printer = pipeline.profiles_of(plan.origin).printer
    run = play_stream(stream, robot, cases(stream, robot, printer, 0.02)[case].plant, tolerance=1e-5)
    motion, lead = plan.trajectory, stream.header["lead_rows"]
    found = ringing.Ringing(robot, share, 0.01, motion).play(motion, 0.0, motion.duration)
    count = min(len(run) - lead, len(found.move))
    real, quick = run.error[lead:lead + count], found.error[:count]
    both = run.laying[lead:lead + count] & found.laying[:count]
    assert both.sum() > 2000
    real, quick = real[both] - real[both].mean(axis=0), quick[both] - quick[both].mean(axis=0)
    largest = np.linalg.norm(real, axis=1).max()
    assert largest > BOUND
    assert np.linalg.norm(quick, axis=1).max() == pytest.approx(largest, rel=0.2)
    assert np.sqrt(np.mean((real - quick) ** 2)) < 0.3 * np.sqrt(np.mean(real**2))


def test_a_step_is_the_solution_of_the_oscillator():
    from scipy.integrate import solve_ivp

    omega, zeta, h = 130.0, 0.03, 2e-3
    q, rate, f0, f1 = 0.3, -20.0, 900.0, -400.0

    def slope(t, y):
        return [y[1], f0 + (f1 - f0) * t / h - 2 * zeta * omega * y[1] - omega**2 * y[0]]

    exact = solve_ivp(slope, (0, h), [q, rate], rtol=1e-12, atol=1e-12).y[:, -1]
    step = ringing._one_step(np.array([omega]), np.array([zeta]), h)[0].reshape(2, 4)
    np.testing.assert_allclose(step @ [q, rate, f0, f1], exact, rtol=1e-9)


def test_the_motion_is_calmed_only_where_it_rings(plan, robot):
    room = calming(plan, robot)
    before, plain = room.x.copy(), room.motion
    loudest = room.largest()
    assert room.keep(1.01 * loudest) is plain
    calmed = room.keep(BOUND)
    assert loudest > BOUND
    assert room.largest() <= BOUND
    assert plain.duration < calmed.duration < 1.5 * plain.duration
    assert (room.task.calm == 1.0).any()
    same = ~np.isin(np.arange(len(room.pieces)), np.unique(room.piece[room.task.calm < 1.0]))
    nodes = np.repeat(same, np.diff(room.whole.offsets))
    np.testing.assert_array_equal(room.x[nodes], before[nodes])


def test_calm_moves_keep_their_acceleration(plan, robot):
    room = calming(plan, robot)
    room.keep(BOUND)
    found = sample(room.motion, np.arange(0, room.motion.duration, 1e-3))
    most = room.task.calm[found.move] * room.task.limits.acceleration
    # averaging takes over a little of what the neighbours do
    inner = np.convolve(np.diff(found.move, prepend=0) != 0, np.ones(13), "same") == 0
    assert inner.mean() > 0.3
    assert (np.abs(found.accels[:, :3]).max(axis=1)[inner] <= 1.02 * most[inner]).all()


def test_stretches_do_not_matter(plan, robot):
    motion = plan.trajectory
    one = ringing.Ringing(robot, 0.05, 0.01, motion)
    whole, late = one.play(motion, 0.0, motion.duration), one.play(motion, 10.0, motion.duration)
    np.testing.assert_array_equal(late.move, whole.move[-len(late.move):])
    size = np.abs(whole.error - one.at_rest(sample(motion, np.arange(len(whole.move)) * ringing.STEP_S).poses[:, :3]))
    assert np.abs(late.error - whole.error[-len(late.move):]).max() < 0.1 * size.max()
