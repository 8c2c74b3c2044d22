"""Pressure advance: the extruder runs ahead by k times the speed of the filament, within its limits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline, print_like

from cabslice.errors import ImpossibleError, ProfileError
from cabslice.profile import shelf
from cabslice.timing.audit import audit
from cabslice.timing.proof import plan_proven
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import at_share, sample

ROBOT = cabfab_optim()


def printer(advance, smoothing=5.0):
    return SimpleNamespace(
        motion=SimpleNamespace(**{**vars(PRINTER.motion), "smoothing_ms": smoothing}),
        extruder=SimpleNamespace(**{**vars(PRINTER.extruder), "pressure_advance_s": advance}))


@pytest.mark.parametrize("path", [print_like(1), polyline(3, count=50)])
@pytest.mark.parametrize(("advance", "smoothing"), [(0.05, 5.0), (0.02, 20.0), (0.4, 40.0)])
def test_filament_is_ahead_by_its_speed_and_limits_hold(path, advance, smoothing):
    mine = printer(advance, smoothing)
    trajectory, verdict = plan_proven(path, ROBOT, mine, MATERIAL, PROCESS)
    assert verdict.ok, verdict.findings
    step = 1e-4
    times = np.arange(0, trajectory.duration, step)
    told, plain = sample(trajectory, times), sample(replace(trajectory, advance=0.0), times)
    laid, fed = plain.filament, told.filament
    assert (laid == told.laid).all()
    rate = (laid[2:] - laid[:-2]) / (2 * step)
    moving = trajectory.path.direction[told.move[1:-1]].any(axis=1)
    wanted = laid[1:-1] + np.where(moving, advance * rate, 0.0)
    assert fed[1:-1] == pytest.approx(wanted, abs=advance * 1500 * step)
    assert fed[-1] == pytest.approx(path.filament.sum(), abs=1e-4)
    assert np.abs(np.diff(fed)).max() / step <= 60.0 * (1 + 1e-6)
    middle = np.abs(np.diff(fed, 2)).max() / step
    assert middle <= 5.0 * 2 + 2 * 1500 * step
    assert np.abs(fed - laid).max() > 0.2 * advance * np.abs(rate[moving]).max()


def test_it_costs_time_and_none_costs_nothing():
    path = print_like(1)
    times = [plan(path, ROBOT, printer(k), MATERIAL, PROCESS).duration for k in (0.0, 1e-9, 0.02, 0.1)]
    assert times[1] == pytest.approx(times[0], rel=1e-5)
    assert times[0] < times[2] < times[3]


def test_retractions_are_as_fast_as_without():
    """Nothing flows while the nozzle stands: there the extruder is told what is fed, at its own limits."""
    path = print_like(1)
    with_it, without = (plan(path, ROBOT, printer(k), MATERIAL, PROCESS) for k in (0.05, 0.0))
    lone = np.flatnonzero(~without.path.direction[without.move[without.pieces[:-1]]].any(axis=1))
    assert len(lone) == 2
    spent = [[t.time[t.pieces[p + 1] - 1] - t.time[t.pieces[p]] for p in lone] for t in (with_it, without)]
    assert spent[0] == pytest.approx(spent[1], rel=1e-9)


def test_the_audit_finds_another_advance_and_what_breaks_limits():
    path, mine = print_like(1), printer(0.05)
    trajectory = plan(path, ROBOT, mine, MATERIAL, PROCESS)
    for other in (0.0, 0.04):
        told = audit(replace(trajectory, advance=other), path, ROBOT, mine, MATERIAL, PROCESS)
        assert [finding.code for finding in told.findings] == ["pressure-advance"]
    careless = replace(plan(path, ROBOT, printer(0.0), MATERIAL, PROCESS), advance=0.5)
    codes = {finding.code for finding in audit(careless, path, ROBOT, printer(0.5), MATERIAL, PROCESS).findings}
    assert "filament-step" in codes
    assert audit(at_share(trajectory, 0.5), path, ROBOT, mine, MATERIAL, PROCESS).ok


def test_what_cannot_be_asked():
    with pytest.raises(ProfileError, match=r"expected 0 where motion.smoothing_ms is 0"):
        shelf.load_printer("cabfab-optim", ["extruder.pressure_advance_s=0.05", "motion.smoothing_ms=0"])
    mine = printer(0.05)
    mine.extruder.max_speed_mm_s = 5.0
    with pytest.raises(ImpossibleError, match="at any speed"):
        plan(print_like(1), ROBOT, mine, MATERIAL, PROCESS)
