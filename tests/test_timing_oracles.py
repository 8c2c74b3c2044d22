"""The compiled engine against linear programmes by HiGHS, and against toppra on the pieces of a real print."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import cabfab_optim
from scipy.optimize import linprog
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline

from cabslice.timing import retime as planner
from cabslice.timing.limits import rows
from cabslice.timing.recursion import widened

ROBOT = replace(cabfab_optim(), winders=None)      # nothing but cables, nozzle and filament: the cables are active
BENCHY = Path(__file__).parents[2] / "shared" / "models" / "benchy.stl"
EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def problem(task, block):
    """Rows and tops of a block, as planned."""
    places = planner.nodes_at(task, block.move, block.sigma)
    a, b, _ = rows(task.robot, task.limits, places)
    top = widened(planner._tops(task, block), block.step, block.offsets, task.limits.window)
    return a, b, np.minimum(top, task.bend / np.maximum(np.linalg.norm(places.d2, axis=1), 1e-9))


def reachable(a, b, top, step):
    """x (n+1,) of one piece by two linear programmes an interval (Pham & Pham 2018, algorithm 1), x scaled by top."""
    scale = top.max()
    a, b, top, n = a * scale, b * scale, top / scale, len(step) - 1
    halves = []
    for i in range(n):
        gain = 0.5 / step[i]
        halves.append(np.concatenate((np.stack((b[i] - a[i] * gain, a[i] * gain), axis=1),
                                      np.stack((-a[i + 1] * gain, b[i + 1] + a[i + 1] * gain), axis=1))))
    reach = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        found = linprog([-1, 0], A_ub=halves[i], b_ub=np.ones(len(halves[i])),
                        bounds=[(0, top[i]), (0, reach[i + 1])], options=EXACT)
        reach[i] = found.x[0]
    x = np.zeros(n + 1)
    for i in range(n):
        found = linprog([0, -1], A_ub=halves[i], b_ub=np.ones(len(halves[i])),
                        bounds=[(x[i], x[i]), (0, reach[i + 1])], options=EXACT)
        x[i + 1] = found.x[1]
    return x * scale


def compare(seeds):
    for seed in seeds:
        path = polyline(seed, 6, speed=200.0, pieces=1)
        task = planner.task_for(path, ROBOT, PRINTER, MATERIAL, PROCESS, "compiled")
        (block,) = planner.blocks_of(task.grid, np.arange(len(task.grid.intervals) - 1))
        ours = planner._solved(task, block, np.ones(len(block.step)))
        oracle = reachable(*problem(task, block), block.step)
        np.testing.assert_allclose(ours, oracle, rtol=1e-9, atol=1e-9 * oracle.max())


def test_the_compiled_engine_gives_the_answer_of_linear_programmes():
    compare(range(3))


@pytest.mark.slow
def test_the_compiled_engine_gives_the_answer_of_linear_programmes_on_twenty_pieces():
    compare(range(20))


@pytest.mark.slow
@pytest.mark.skipif(not BENCHY.exists(), reason=f"{BENCHY} is not here")
def test_the_compiled_engine_gives_the_answer_of_toppra_on_400_pieces_of_a_print(monkeypatch):
    """Within 1e-6 of the largest x. As it comes, toppra lowers x by TINY = 1e-8 of its unit at each step forwards,
    which a steep row magnifies at the next node: by up to 3e-4, in proportion to TINY, and linear programmes (above)
    side with ours. With 1e-11 in its place nothing is left of it."""
    from toppra.algorithm.reachabilitybased import reachability_algorithm

    from cabslice import pipeline

    profiles = pipeline.load_profiles("cabfab-optim", None, None, ["motion.max_acceleration_mm_s2=30000"])
    laid = pipeline.to_path(pipeline.read(BENCHY, profiles, pipeline.Placement()))
    given = laid.toolpath, ROBOT, profiles.printer, profiles.material, profiles.process
    ours, theirs = (planner.task_for(*given, engine) for engine in ("compiled", "toppra"))
    pieces = np.linspace(0, len(laid.toolpath.starts) - 2, 400).astype(int)
    for some in np.array_split(pieces, 20):
        block = planner.block_of(ours.grid, some)
        found, whole = planner._solved(ours, block, np.ones(len(block.step))), block.offsets[:-1]
        for lowered, near in ((1e-8, 1e-3), (1e-11, 1e-6)):
            monkeypatch.setattr(reachability_algorithm, "TINY", lowered)
            reference = planner._solved(theirs, block, np.ones(len(block.step)))
            apart = np.maximum.reduceat(np.abs(found - reference), whole)
            assert (apart <= near * np.maximum.reduceat(reference, whole)).all()


def test_a_straight_line_between_two_tensions_is_driven_in_the_time_of_a_double_integrator():
    """Time from rest to rest with the acceleration that the tensions bear along the line: 2 sqrt(L / a), within 1e-4
    of the exact answer where the bearable acceleration hardly changes over the line."""
    path = polyline(points=[[-0.05, 0, 100], [0.05, 0, 100]], pieces=1, speed=5000.0)
    swift = _with(PRINTER, max_speed_mm_s=5000.0, smoothing_ms=0.0)
    task = planner.task_for(replace(path, filament=np.zeros(2)), ROBOT, swift, MATERIAL, PROCESS, "compiled")
    (block,) = planner.blocks_of(task.grid, np.arange(len(task.grid.intervals) - 1))
    x = planner._solved(task, block, np.ones(len(block.step)))
    a, b, _ = problem(task, block)
    assert np.abs(b).max() * x.max() < 1e-2
    most = 1 / a.max(axis=1), 1 / -a.min(axis=1)                         # forwards and backwards
    away, back = (value.mean() for value in most)
    exact = np.sqrt(2 * 0.1 * (1 / away + 1 / back))
    spent = 2 * np.diff(np.append(0, np.cumsum(block.step[:-1]))) / (np.sqrt(x[1:]) + np.sqrt(x[:-1]))
    assert spent.sum() == pytest.approx(exact, rel=1e-4)


def _with(printer, **motion):
    from types import SimpleNamespace

    return SimpleNamespace(motion=SimpleNamespace(**{**vars(printer.motion), **motion}), extruder=printer.extruder)
