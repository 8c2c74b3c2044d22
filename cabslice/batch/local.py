"""Jobs on this machine: one after the other in this process, or several processes at once.

A process that dies takes its pool with it; what was in the making is made again in a new one, up to TRIES times each.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from cabslice.batch.jobs import Job
from cabslice.batch.make import Record, failed, make

TRIES = 3
LOST = "The process that made it was killed {} times: not enough memory?"
Done = tuple[int, Record, str]          # which job, its record, a traceback or ""


def run(jobs: Sequence[Job], folder: str, *, processes: int, resume: bool = False) -> Iterator[Done]:
    """The records as they come, in any order."""
    if min(processes, len(jobs)) <= 1:
        for number, job in enumerate(jobs):
            yield number, *make(job, folder, resume)
        return
    left, tries = list(range(len(jobs))), dict.fromkeys(range(len(jobs)), 0)
    while left:
        pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _born)
        try:
            for done in _in_pool(pool, jobs, left, folder, processes, resume):
                left.remove(done[0])
                yield done
        except _Died as died:
            for number in died.numbers:
                tries[number] += 1
                if tries[number] == TRIES:
                    left.remove(number)
                    yield number, failed(jobs[number], LOST.format(TRIES)), ""
        finally:
            _end(pool)


class _Died(Exception):
    """A process died while it, or its neighbours, made these."""

    def __init__(self, numbers: Sequence[int]) -> None:
        super().__init__()
        self.numbers = numbers


def _in_pool(
    pool: ProcessPoolExecutor, jobs: Sequence[Job], left: Sequence[int], folder: str, processes: int, resume: bool
) -> Iterator[Done]:
    """No more jobs are handed out than there are processes, so that it is known which ones a death takes along."""
    waiting = iter(tuple(left))
    running: dict[Future[tuple[Record, str]], int] = {}
    while True:
        try:
            while len(running) < processes and (number := next(waiting, None)) is not None:
                running[pool.submit(make, jobs[number], folder, resume)] = number
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            results = [(running[future], *future.result()) for future in done]
        except BrokenProcessPool:
            raise _Died([*running.values()]) from None
        for future in done:
            del running[future]
        yield from results


def _born() -> None:
    """Ctrl-C is for the parent, which ends its children."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end(pool: ProcessPoolExecutor) -> None:
    """No process is left behind, whatever it is at."""
    children = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for child in children:
        child.terminate()
    for child in children:
        child.join()
