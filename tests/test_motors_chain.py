"""A planned print as a motor file: the same bytes always, and the nozzle where the plan has it."""

from types import SimpleNamespace

import numpy as np
import pytest
from motors_fakes import whole
from robots import cabfab_optim
from timing_cases import MATERIAL, PRINTER, PROCESS, print_like

from cabslice.motors import formats
from cabslice.motors.check import verify_stream
from cabslice.motors.stream import make_stream
from cabslice.timing.retime import plan
from cabslice.timing.trajectory import sample

GENTLE = SimpleNamespace(
    motion=SimpleNamespace(**{**vars(PRINTER.motion), "max_acceleration_mm_s2": 4000.0}), extruder=PRINTER.extruder
)


@pytest.fixture(scope="module")
def planned():
    path, robot = print_like(turns=6), cabfab_optim()
    return path, robot, plan(path, robot, GENTLE, MATERIAL, PROCESS)


def stream_of(planned, **more):
    path, robot, trajectory = planned
    return make_stream(trajectory, robot, period_s=0.002, header={"part": "wall"}, layers=path.layer, **more)


def test_the_file_of_a_planned_print_holds_the_nozzle_on_the_plan(planned, tmp_path):
    """Acceptance 3, real corners, retracts and stops: within 1 um; the quanta leave 0.04 um."""
    _, robot, trajectory = planned
    formats.format_for("a.stream").write(stream_of(planned), tmp_path / "a.stream")
    verdict = verify_stream(formats.read(tmp_path / "a.stream"), robot, trajectory)
    assert verdict.ok
    assert verdict.margins["nozzle_error_mm"] < 4e-5


def test_the_bytes_are_the_same_with_one_thread_and_with_two(planned, tmp_path):
    for name, jobs in (("a", 1), ("b", 1), ("c", 2)):
        formats.format_for("a.stream").write(stream_of(planned, jobs=jobs), tmp_path / name)
    first = (tmp_path / "a").read_bytes()
    assert first == (tmp_path / "b").read_bytes() == (tmp_path / "c").read_bytes()


def test_the_last_row_has_all_filament_and_stands_on_the_last_move(planned):
    path, _, trajectory = planned
    rows = whole(stream_of(planned))
    assert rows.filament[-1] == pytest.approx(path.filament.sum(), abs=1e-9)
    assert rows.move[-1] == len(path.xyz) - 1
    assert not rows.velocity[[0, -1]].any()
    times = np.minimum(np.arange(len(rows.move)) * 0.002, trajectory.duration)
    np.testing.assert_array_equal(rows.move, sample(trajectory, times).move)
