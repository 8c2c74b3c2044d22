"""The records of a batch: kept one by one as they come, and written in the order of the jobs when all are there.

    .manifest.journal   while a batch runs: a line of JSON for each record, {"key": of the job, "record": ...}
    manifest.json       kind "cabslice batch", schema, version, counts, totals, jobs: the records; keys: of the jobs
    manifest.csv        the same as a table
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cabslice import __version__
from cabslice.batch.make import Record, hashed
from cabslice.errors import ProductError
from cabslice.files import atomic, locked

KIND, SCHEMA = "cabslice batch", 1
NAME, TABLE, JOURNAL = "manifest.json", "manifest.csv", ".manifest.journal"
FINAL = ("made", "impossible", "wrong")        # what making it again would not change
COLUMNS = ("name", "part", "printer", "verdict", "exit_code", "duration_s", "filament_mm", "mass_g", "layers", "file",
           "bytes", "sha256", "sentence")


class Journal:
    """The records so far, ours alone: use as a context manager."""

    def __init__(self, folder: Path, *, resume: bool) -> None:
        self.folder, self.path = folder, folder / JOURNAL
        self.file = locked(self.path, str(folder / NAME))
        self.known: dict[str, Record] = {}
        if resume:
            self.known = _of_manifest(folder / NAME) | _of_journal(self.path)
        else:
            self.file.inner.truncate(0)

    def kept(self, key: str) -> Record | None:
        """What an earlier run has told of the job with this key, where it still holds."""
        record = self.known.get(key)
        if record is None or record["verdict"] not in FINAL:
            return None
        return record if all(_is_there(self.folder, file) for file in record.get("files", ())) else None

    def add(self, key: str, record: Record) -> None:
        self.file.write(json.dumps({"key": key, "record": record}).encode() + b"\n")

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if error is None:
            self.path.unlink(missing_ok=True)
        self.file.close()


def _is_there(folder: Path, told: Mapping[str, Any]) -> bool:
    try:
        return hashed(folder / told["file"]) == dict(told)
    except OSError:
        return False


def _of_journal(path: Path) -> dict[str, Record]:
    """Whole lines only: the last one may be torn."""
    found = {}
    for line in path.read_bytes().split(b"\n")[:-1]:
        try:
            row = json.loads(line)
            found[row["key"]] = row["record"]
        except (ValueError, TypeError, KeyError):
            continue
    return found


def _of_manifest(path: Path) -> dict[str, Record]:
    return dict(zip(*(read(path)[name] for name in ("keys", "jobs")), strict=True)) if path.exists() else {}


def read(path: Path) -> dict[str, Any]:
    """A manifest.json. Raises ProductError."""
    try:
        content = json.loads(path.read_bytes())
        if (content["kind"], content["schema"]) == (KIND, SCHEMA) and len(content["keys"]) == len(content["jobs"]):
            return dict(content)
    except OSError as error:
        raise ProductError(f"{path.name} cannot be read: {error.strerror}.", file=path.name) from error
    except (ValueError, TypeError, KeyError):
        pass
    raise ProductError(f"{path.name} is no manifest of schema {SCHEMA}: remove it, or --overwrite.", file=path.name)


def content(keys: Sequence[str], records: Sequence[Record]) -> dict[str, Any]:
    made = [record["numbers"] for record in records if record["verdict"] == "made"]
    verdicts = [record["verdict"] for record in records]
    return {
        "kind": KIND, "schema": SCHEMA, "version": __version__,
        "counts": {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))},
        "totals": {key: sum(numbers.get(key, 0.0) for numbers in made)
                   for key in ("duration_s", "filament_mm", "mass_g")},
        "keys": list(keys), "jobs": list(records),
    }


def write(folder: Path, told: Mapping[str, Any]) -> None:
    """manifest.json and manifest.csv. Raises OutputError."""
    with atomic(folder / TABLE, overwrite=True) as file:
        file.write(table(told["jobs"]))
    with atomic(folder / NAME, overwrite=True) as file:
        file.write(json.dumps(told, indent=1, sort_keys=True).encode() + b"\n")


def table(records: Iterable[Record]) -> bytes:
    text = io.StringIO()
    rows = csv.DictWriter(text, COLUMNS, restval="", extrasaction="ignore", lineterminator="\n")
    rows.writeheader()
    for record in records:
        first = (record.get("files") or [{}])[0]
        rows.writerow({**record, **record.get("numbers", {}), **first, "part": record["part"]["file"]})
    return text.getvalue().encode()
