"""A batch from what is wanted to its manifest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cabslice import errors
from cabslice.batch import cluster, local, manifest
from cabslice.batch.jobs import Job, Wanted, ready
from cabslice.batch.local import Done
from cabslice.batch.make import Record, files, not_begun
from cabslice.errors import CabsliceError, OutputError

WORST = (errors.EXIT_BUG, errors.EXIT_OUTPUT, errors.EXIT_IMPOSSIBLE, errors.EXIT_INPUT, errors.EXIT_USAGE)
Told = Callable[[Record, str, int, int], None]      # record, traceback or "", done, of


def run(
    wanted: Sequence[Wanted], folder: str | Path, *, processes: int = 1, scheduler: str | None = None,
    resume: bool = False, overwrite: bool = False, tell: Told = lambda record, trace, done, total: None,
) -> dict[str, Any]:
    """Make everything that can be made, in `folder`, and write the manifest; its content.

    With `resume`, what an earlier run has told of a job is kept where nothing of the job has changed and its files are
    there still. Raises OutputError where something stands in the way that neither `resume` nor `overwrite` allows, or
    where the manifest cannot be written; UsageError where the scheduler cannot be used. Nothing a job does is raised.
    """
    folder = Path(folder)
    _make_folder(folder)
    jobs, records = _begun(wanted)
    if not (overwrite or resume):
        _refuse_existing(jobs, folder)
    with manifest.Journal(folder, resume=resume) as journal:
        records |= {number: kept for number, job in jobs.items() if (kept := journal.kept(job.key))}
        for count, record in enumerate(records.values(), start=1):
            tell(record, "", count, len(wanted))
        left = [number for number in jobs if number not in records]
        for number, record, trace in _results([jobs[number] for number in left], folder, processes, scheduler, resume):
            journal.add(jobs[left[number]].key, record)
            records[left[number]] = record
            tell(record, trace, len(records), len(wanted))
        keys = [jobs[number].key if number in jobs else "" for number in range(len(wanted))]
        told = manifest.content(keys, [records[number] for number in range(len(wanted))])
        manifest.write(folder, told)
    return told


def _results(
    jobs: Sequence[Job], folder: Path, processes: int, scheduler: str | None, resume: bool
) -> Iterator[Done]:
    if scheduler is not None and jobs:
        return cluster.run(jobs, str(folder), scheduler=scheduler, resume=resume)
    return local.run(jobs, str(folder), processes=processes, resume=resume)


def _begun(wanted: Sequence[Wanted]) -> tuple[dict[int, Job], dict[int, Record]]:
    """Jobs, and the records of what cannot even begin, by number."""
    jobs: dict[int, Job] = {}
    records: dict[int, Record] = {}
    known: dict[Any, Any] = {}
    for number, one in enumerate(wanted):
        try:
            jobs[number] = ready(one, known)
        except CabsliceError as error:
            records[number] = not_begun(one, error)
    return jobs, records


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"The folder {folder} cannot be made: {error.strerror}.", file=str(folder)) from error


def _refuse_existing(jobs: dict[int, Job], folder: Path) -> None:
    wanted = [folder / manifest.NAME, folder / manifest.JOURNAL]
    wanted += [path for job in jobs.values() for path in files(job, folder)]
    if there := [path for path in wanted if path.exists()]:
        path = there[0]
        raise OutputError(f"{path} exists: --resume goes on with it, --overwrite begins anew.", file=str(path))


def exit_code(told: dict[str, Any]) -> int:
    """0 where all was made; else the worst of what happened."""
    codes = {record["exit_code"] for record in told["jobs"]}
    return next((code for code in WORST if code in codes), errors.EXIT_OK)
