"""Jobs on the workers of a Dask scheduler (extra "cluster"). The workers must see the same folders as we do.

A worker that is lost has its job done again by another one: Dask does so by itself, and where it gives up on a job
(KilledWorker), the job is handed out anew, up to TRIES times.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cabslice import __version__
from cabslice.batch.jobs import Job
from cabslice.batch.local import LOST, TRIES, Done
from cabslice.batch.make import failed, make
from cabslice.errors import UsageError

PATIENCE_S = 20


def run(jobs: Sequence[Job], folder: str, *, scheduler: str, resume: bool = False) -> Iterator[Done]:
    """The records as they come, in any order. Raises UsageError where there is no such cluster, or another version."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise UsageError("--scheduler needs Dask: pip install 'cabslice[cluster]'.") from error
    client = _client(Client, scheduler)
    try:
        def hand_out(number: int) -> Any:
            job = replace(jobs[number], part=str(Path(jobs[number].part).resolve()))
            return client.submit(make, job, os.path.abspath(folder), resume, pure=False)

        running = {hand_out(number): number for number in range(len(jobs))}
        tries = dict.fromkeys(range(len(jobs)), 0)
        waiting = as_completed(list(running), loop=client.loop)
        for future in waiting:
            number = running.pop(future)
            failure = future.exception()
            tries[number] += 1
            if failure is None:
                yield number, *future.result()
            elif isinstance(failure, KilledWorker) and tries[number] < TRIES:
                again = hand_out(number)
                running[again] = number
                waiting.add(again)
            else:
                lost = isinstance(failure, KilledWorker)
                words = LOST.format(TRIES) if lost else f"{type(failure).__name__}: {failure}"
                yield number, failed(jobs[number], words), "" if lost else words
    finally:
        client.close()


def _client(Client: Any, scheduler: str) -> Any:
    """Connected, with a worker at least, all of our version."""
    try:
        client = Client(scheduler, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(f"There is no Dask scheduler at {scheduler}: start one with dask scheduler.") from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
        found = client.run(version)
    except TimeoutError as error:
        client.close()
        raise UsageError(f"The scheduler at {scheduler} has no workers: dask worker {scheduler}.") from error
    except Exception as error:
        client.close()
        raise UsageError(f"The workers of {scheduler} do not have cabslice {__version__} ({error}).") from error
    if wrong := {where: theirs for where, theirs in found.items() if theirs != __version__}:
        client.close()
        where, theirs = next(iter(wrong.items()))
        raise UsageError(f"The worker {where} has cabslice {theirs}, this is {__version__}: they must be the same.")
    return client


def version() -> str:
    return __version__
