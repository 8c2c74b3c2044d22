"""The audit's tensions, found again by their quadratic programme where it matters."""

import numpy as np
import pytest
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline

from cabslice.robot.distributions import quadratic
from cabslice.robot.projection import projected
from cabslice.robot.tension import nearest
from cabslice.robot.wrench import required_wrench, wrench_matrix
from cabslice.timing import audit_forces
from cabslice.timing.audit import audit
from cabslice.timing.retime import plan
from cabslice.timing.worst import TIGHTEST, Worst

ROBOT = cabfab_optim()


def cases(count, most):
    """Wrenches of accelerations up to `most` mm/s^2 at random poses: the larger, the more cables at bounds."""
    rng = np.random.default_rng(8)
    poses, accels = np.zeros((2, count, 6))
    poses[:, :3] = rng.uniform(-150, 150, (count, 3)) - [0, 0, 150]
    accels[:, :3] = rng.uniform(-most, most, (count, 3))
    required = required_wrench(ROBOT, poses, np.zeros((count, 6)), accels)
    return wrench_matrix(ROBOT, poses), required, ROBOT.tension_min, ROBOT.tension_max, ROBOT.tension_reference


@pytest.mark.parametrize("most", [2e3, 2e4, 6e4])
def test_projected_is_the_quadratic_programme(most):
    """As the polygon's nearest point says, and where it says none: none."""
    given = cases(300, most)
    found, right = projected(*given), nearest(*given)
    assert found[right.feasible] == pytest.approx(right.tension[right.feasible], abs=1e-7)
    assert np.isnan(found[~right.feasible]).all()
    assert (most < 5e4) == right.feasible.all()
    few = slice(0, 20)
    slow = quadratic(given[0][few], given[1][few], *given[2:])
    assert found[few][slow.feasible] == pytest.approx(slow.tension[slow.feasible], abs=1e-6)


def test_the_audit_says_how_often_it_asked_again(monkeypatch):
    path = polyline(4, count=60)
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    verdict = audit(trajectory, path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok
    assert "tension-again" in verdict.checked[0]
    assert "quadratic programme" in verdict.checked[1]
    assert verdict.margins["tension_again_share"] < 1e-2
    right = audit_forces.found_tensions
    monkeypatch.setattr(audit_forces, "found_tensions", lambda *given: (right(*given)[0] + 1e-3, right(*given)[1]))
    found = audit(trajectory, path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert {finding.code for finding in found.findings} == {"tension-again"}
    assert "two methods find other tensions" in found.findings[0].sentence


def test_the_tightest_are_kept_whatever_the_blocks():
    rng = np.random.default_rng(2)
    share, times = rng.random((5 * TIGHTEST, 2)), np.arange(5.0 * TIGHTEST)
    whole = Worst()
    for part in np.array_split(np.arange(len(times)), 7):
        other = Worst()
        other.see_tight(share[part], times[part])
        whole.merge(other)
    kept = np.sort(whole.tightest()[1])
    assert (kept == np.sort(np.argsort(-share.max(axis=1))[:TIGHTEST])).all()


def test_one_in_a_hundred_is_drawn(monkeypatch):
    """And the same ones in every run, for any number of threads."""
    path = polyline(4, count=60)
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    seen = []
    right = audit_forces._again
    monkeypatch.setattr(audit_forces, "_again", lambda *given: seen.append(given[3]) or right(*given))
    rows = int(trajectory.duration / 1e-3)
    for jobs in (1, 2):
        audit_forces.second_opinion(ROBOT, trajectory, 1e-3, rows, Worst(), jobs)
    first, second = seen
    assert (first == second).all()
    assert len(first) == -(-rows // 100)
    assert (np.floor(first / 0.1 + 1e-6) == np.arange(len(first))).all()
