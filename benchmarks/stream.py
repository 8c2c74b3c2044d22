"""Rows a second and memory of writing motor files, beside numpy.save of the same numbers in the same run.

    python benchmarks/stream.py [--rows N] [--hours H ...] [--formats NAME ...] [--from FILE.stream]

Speed: the rows of a motor file (--from), else of a minute of infill-like strokes, over and over; one thread. numpy.save
writes position, velocity and torque of 8 axes; ours has tension, filament and feed as well, and waits for the disk.
Every file is a new one; best of five, alternating.
Memory: each job length is a process of its own that writes its rows, made block by block, to a file it removes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from cabslice.arrays import Array
from cabslice.motors import formats
from cabslice.motors.formats.writing import BLOCK_ROWS
from cabslice.motors.stream import Block, MotorStream, make_stream, present, rechunk
from cabslice.profile import shelf
from cabslice.robot.model import robot_from_printer

PERIOD_S = 0.002
TARGETS = {"rows_s": 500_000, "times_numpy": 10.0, "mib": 50.0}


@dataclass(frozen=True)
class Strokes:
    """Strokes of infill to and fro, each from rest to rest with smooth acceleration."""

    duration: float = 60.0
    stroke: float = 0.4        # s
    length: float = 25.0       # mm


def sample(strokes: Strokes, t: Array) -> SimpleNamespace:
    x, number = np.modf(t / strokes.stroke)
    d, way = strokes.stroke, np.where(number % 2 == 0, 1.0, -1.0) * strokes.length
    share, rate = x**3 * (10 - 15 * x + 6 * x * x), 30 * x**2 * (1 - x) ** 2 / d
    bend = 60 * x * (1 - x) * (1 - 2 * x) / d**2
    poses, rates, accels = np.zeros((3, len(t), 6))
    poses[:, 0] = np.where(number % 2 == 0, share, 1 - share) * strokes.length - strokes.length / 2
    poses[:, 1], poses[:, 2] = 0.4 * (number + share), -300.0
    rates[:, 0], accels[:, 0] = way * rate, way * bend
    rates[:, 1], accels[:, 1] = 0.4 * rate, 0.4 * bend
    filament = 0.03 * strokes.length * (number + share)
    return SimpleNamespace(poses=poses, rates=rates, accels=accels, filament=filament, move=number.astype(np.int64))


def minute() -> MotorStream:
    robot = robot_from_printer(shelf.load_printer("cabfab-optim"))
    header = {"encoder_counts_per_turn": [1 << 20] * robot.cables}
    return make_stream(Strokes(), robot, period_s=PERIOD_S, header=header, sample=sample)


def repeated(blocks: list[Block], header: dict, rows: int) -> MotorStream:
    """The blocks over and over, `rows` in all."""
    def again() -> Iterator[Block]:
        row = 0
        while row < rows:
            for block in blocks:
                if row < rows:
                    count = min(len(block), rows - row)
                    yield Block(row, **{name: column[:count] for name, column in present(block).items()})
                    row += count

    return MotorStream({**header, "rows": rows, "duration_s": (rows - 1) * PERIOD_S}, again)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """CPU and wall seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()
    return time.process_time() - cpu, time.perf_counter() - wall


def speed(stream: MotorStream, names: list[str], folder: Path) -> bool:
    blocks = list(rechunk(stream, BLOCK_ROWS))
    held = replace(stream, blocks=lambda: blocks, later=None)
    array = np.concatenate([np.hstack((block.angle, block.velocity, block.torque)) for block in blocks])
    print(f"{stream.rows} rows of {stream.cables} axes: {array.nbytes / 1e6:.0f} MB as numpy has them")
    print(f"{'':14}{'CPU s':>8}{'wall s':>8}{'rows/CPU s':>12}{'rows/wall s':>12}{'bytes/row':>11}{'x numpy':>9}")
    works = {"numpy.save": lambda: np.save(folder / "a.npy", array)}
    files = {"numpy.save": folder / "a.npy"}
    for name in names:
        files[name] = folder / f"a{formats.FORMATS[name].suffix}"
        works[name] = lambda name=name: formats.FORMATS[name].write(held, files[name], overwrite=True)
    best = dict.fromkeys(works, (np.inf, np.inf))
    for _ in range(5):
        for name, work in works.items():
            files[name].unlink(missing_ok=True)
            best[name] = tuple(map(min, zip(best[name], timed(work), strict=True)))
    good = True
    for name, (cpu, wall) in best.items():
        size, times = files[name].stat().st_size / stream.rows, wall / best["numpy.save"][1]
        rates = f"{stream.rows / cpu:12.0f}{stream.rows / wall:12.0f}"
        print(f"{name:14}{cpu:8.2f}{wall:8.2f}{rates}{size:11.1f}{times:9.2f}")
        if name == "stream":
            good = stream.rows / cpu >= TARGETS["rows_s"] and times <= TARGETS["times_numpy"]
    return good


def job(hours: float) -> None:
    """What a process of its own does: write a long file."""
    stream = minute()
    long = repeated(list(stream), dict(stream.header), round(hours * 3600 / PERIOD_S))
    with tempfile.TemporaryDirectory() as folder:
        formats.FORMATS["stream"].write(long, Path(folder) / "a.stream")
        size = (Path(folder) / "a.stream").stat().st_size / 1e6
    print(f"{hours:g} h: {long.rows} rows, {size:.0f} MB, {time.process_time():.1f} CPU s, peak {peak_mib():.1f} MiB")


def peak_mib() -> float:
    """Of this process since it began: getrusage would tell of the one it was forked from as well."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(next(line for line in status.read_text().splitlines() if line.startswith("VmHWM")).split()[1]) / 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def memory(hours: list[float]) -> bool:
    peaks = []
    for length in hours:
        told = subprocess.run([sys.executable, __file__, "--job", str(length)], capture_output=True, text=True)
        print(told.stdout + told.stderr, end="")
        if told.returncode:
            return False
        peaks.append(float(told.stdout.split()[-2]))
    return max(peaks) - min(peaks) <= TARGETS["mib"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--hours", type=float, nargs="*", default=[1.0, 24.0])
    parser.add_argument("--formats", nargs="*", default=["stream"], choices=list(formats.FORMATS))
    parser.add_argument("--from", dest="source")
    parser.add_argument("--job", type=float, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.job:
        job(given.job)
        return 0
    source = formats.read(given.source) if given.source else minute()
    rows = source.rows if given.source else given.rows
    with tempfile.TemporaryDirectory() as folder:
        fast = speed(repeated(list(source), dict(source.header), rows), given.formats, Path(folder))
    small = memory(given.hours) if given.hours else True
    print(f"{'met' if fast and small else 'NOT MET'}: at least {TARGETS['rows_s']:,} rows a CPU second and at most "
          f"{TARGETS['times_numpy']:g} times numpy.save to .stream; peaks within {TARGETS['mib']:g} MiB of each other")
    return 0 if fast and small else 1


if __name__ == "__main__":
    sys.exit(main())
