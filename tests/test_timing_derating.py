"""What the audit finds in one place is cured there: a long piece does not become slower as a whole."""

import numpy as np
import pytest
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline

from cabslice.timing import proof
from cabslice.timing.audit import audit
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import eased, slowed, times_between

ROBOT = cabfab_optim()


def zigzag(rows=60):
    """One long piece: 40 mm to and fro, asked for at 100 mm/s."""
    x = np.tile([-20.0, 20.0, 20.0, -20.0], rows // 2 + 1)[:2 * rows]
    y = np.repeat(np.arange(rows) * 0.5, 2) - rows / 4
    return polyline(points=np.column_stack((x, y, np.full(2 * rows, 5.0))), pieces=1)


def hasty(path, places, share):
    """A plan that is `share` too fast around some of its nodes."""
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    middle = trajectory.time[(np.array(places) * len(trajectory.time)).astype(int)]
    near = np.abs(trajectory.time[:, None] - middle).min(axis=1)
    return trajectory, eased(trajectory, 1 - share * np.clip(1 - near / 0.4, 0, 1))


def test_one_place_costs_little_elsewhere(monkeypatch):
    path = zigzag()
    right, fast = hasty(path, [0.5], 0.05)
    assert not audit(fast, path, ROBOT, PRINTER, MATERIAL, PROCESS).ok
    monkeypatch.setattr(proof, "plan", lambda *args, **options: fast)
    cured, verdict = proof.plan_proven(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok, verdict.findings
    assert max(verdict.margins.values()) <= 1 + 1e-6
    whole = right.duration
    assert cured.duration - fast.duration < 0.01 * whole
    assert slowed(fast, np.array([1.05])).duration - fast.duration > 0.04 * whole
    far = np.abs(fast.time - whole / 2) > 0.15 * whole
    assert (cured.x[far] >= fast.x[far] * (1 - 1e-12)).mean() > 0.95


def test_several_places_and_the_end_of_a_piece(monkeypatch):
    path = zigzag()
    _, fast = hasty(path, [0.02, 0.4, 0.97], 0.1)
    monkeypatch.setattr(proof, "plan", lambda *args, **options: fast)
    cured, verdict = proof.plan_proven(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok, verdict.findings
    assert cured.duration < 1.03 * fast.duration


def test_where_local_cures_do_not_help_the_piece_is_slowed(monkeypatch):
    """Rounds of nothing, then the last resort."""
    path = zigzag(20)
    _, fast = hasty(path, [0.5], 0.05)
    monkeypatch.setattr(proof, "plan", lambda *args, **options: fast)
    monkeypatch.setattr(proof, "_around", lambda trajectory, *given: np.ones(len(trajectory.time)))
    cured, verdict = proof.plan_proven(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok
    assert cured.duration > 1.03 * fast.duration


def test_eased_motion_keeps_its_clock():
    """Times are those of its speeds, stretched as asked where the factor is constant."""
    trajectory = plan(zigzag(20), ROBOT, PRINTER, MATERIAL, PROCESS)
    same = eased(trajectory, np.full(len(trajectory.time), 1.2))
    assert same.time == pytest.approx(slowed(trajectory, np.array([1.2])).time, rel=1e-12)
    factor = 1 + 0.2 * np.sin(np.linspace(0, 3, len(trajectory.time))) ** 2
    found = eased(trajectory, factor)
    assert np.diff(found.time) == pytest.approx(times_between(found.s, found.x), rel=1e-9)
    assert (found.x <= trajectory.x).all()


def test_pieces_beside_it_stay_as_they_are():
    path = polyline(2, count=60, pieces=3)
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    first, last = trajectory.pieces[1], trajectory.pieces[2] - 1
    time = (trajectory.time[first] + trajectory.time[last]) / 2
    factor = proof._around(trajectory, np.array([time]), np.array([1.1]))
    assert factor[first:last + 1].max() == pytest.approx(1.1 * proof.MARGIN)
    assert (factor[:first] == 1).all()
    assert (factor[last + 1:] == 1).all()
    assert (np.abs(np.diff(factor[first:last + 1])) <= proof.SLOPE * np.diff(trajectory.time[first:last + 1])
            + 1e-9).all()
