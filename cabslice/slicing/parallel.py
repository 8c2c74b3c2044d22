"""Work shared by processes, its results in the order it was given."""

from __future__ import annotations

import signal
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from itertools import islice, starmap
from multiprocessing import get_context
from typing import Any, TypeVar

T = TypeVar("T")
_task: Callable[..., Any] | None = None   # of a worker process


def in_order(task: Callable[..., T], given: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[T]:
    """task(*arguments) for each of `given`, in order, by up to `jobs` processes that are at most 2 jobs ahead.

    The workers are forks, so that they hold what the task holds without a copy; without fork there is one process.
    They begin at once, before the first result is asked for.
    """
    jobs = min(jobs, len(given))
    if jobs < 2 or sys.platform != "linux":
        return starmap(task, given)
    pool = ProcessPoolExecutor(jobs, get_context("fork"), _begin, (task,))
    left = iter(given)
    waiting: deque[Future[T]] = deque()
    with warnings.catch_warnings():   # of forks beside threads: the workers use neither locks nor threads
        warnings.simplefilter("ignore", DeprecationWarning)
        waiting.extend(pool.submit(_work, arguments) for arguments in islice(left, 2 * jobs))
    return _results(pool, waiting, left)


def _results(pool: ProcessPoolExecutor, waiting: deque[Future[T]], left: Iterator[tuple[Any, ...]]) -> Iterator[T]:
    try:
        while waiting:
            waiting.extend(pool.submit(_work, arguments) for arguments in islice(left, 1))
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _begin(task: Callable[..., Any]) -> None:
    global _task
    _task = task
    signal.signal(signal.SIGINT, signal.SIG_IGN)   # the first process stops the others


def _work(arguments: tuple[Any, ...]) -> Any:
    assert _task is not None
    return _task(*arguments)
