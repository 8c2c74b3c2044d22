"""Filament is kept at every vertex, not in sum alone."""

from dataclasses import replace

import numpy as np
import pytest
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, polyline, print_like

from cabslice.timing.audit import audit
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

ROBOT = cabfab_optim()


def near_ones(path):
    """The same path with vertices 0.3 and 0.6 um before some of its own: they are passed as one."""
    rows = np.arange(8, 20, 3)
    xyz, filament = path.xyz.copy(), path.filament.copy()
    for row in rows:
        xyz[row] = xyz[row - 1] + [3e-4, 0, 0]
    lengths = np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1)
    filament[rows] = 0.034 * lengths[rows]
    return replace(path, xyz=xyz, filament=filament)


@pytest.mark.parametrize("path", [
    print_like(1), polyline(2, count=60), polyline(3, count=40, speed=150.0), near_ones(polyline(5, count=40))])
def test_every_vertex_has_its_filament(path):
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    verdict = audit(trajectory, path, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert verdict.ok, verdict.findings
    assert verdict.margins["filament_at_vertex_share"] <= 1
    nodes = np.flatnonzero((trajectory.s == trajectory.path.start[trajectory.move]) & (trajectory.s > 0))
    seen = sample(trajectory, trajectory.time[nodes])
    due = np.cumsum(path.filament)[trajectory.path.before[trajectory.move[nodes]]]
    assert np.abs(seen.filament - due).max() < 0.01


@pytest.mark.parametrize("moved_mm", [0.05, -0.05])
def test_filament_that_is_laid_elsewhere_is_found(moved_mm):
    """The sum is right, but a bead has what belongs to the next one."""
    path = print_like(1)
    trajectory = plan(path, ROBOT, PRINTER, MATERIAL, PROCESS)
    rows = np.flatnonzero(path.filament > 0)
    other = path.filament.copy()
    other[rows[10]] += moved_mm
    other[rows[11]] -= moved_mm
    told = replace(path, filament=other)
    verdict = audit(trajectory, told, ROBOT, PRINTER, MATERIAL, PROCESS)
    assert [finding.code for finding in verdict.findings] == ["filament-at-vertex"]
    assert verdict.findings[0].value == pytest.approx(0.05, abs=0.02)
    assert verdict.findings[0].limit < 0.012
