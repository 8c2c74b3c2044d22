"""Writing a result whole or not at all: a temporary name in the same folder, renamed when nothing is missing.

    atomic       one file, written at one go
    Unfinished   one or more files that a later run can go on with where a killed one stopped
"""

from __future__ import annotations

import errno
import io
import json
import os
import secrets
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, cast

from cabslice.errors import OutputError

STDOUT = "-"
BUFFER = 1 << 20


@contextmanager
def atomic(path: str | os.PathLike[str], overwrite: bool = False) -> Iterator[BinaryIO]:
    """A binary file to write to; it appears under `path` only when the ``with`` block ends without an exception.

    Until then it has a temporary name in the same folder, removed on any exception (Ctrl-C included). `path` "-" is
    standard output: written as it comes, not seekable. Raises OutputError (a sentence; ``details["quiet"]`` is true
    for a closed pipe) where the file exists already and `overwrite` is false, or cannot be written; an OSError
    raised by other work inside the ``with`` block is left as it is.
    """
    if os.fspath(path) == STDOUT:
        yield from _standard_output()
        return
    target = Path(path)
    if not overwrite and target.exists():
        _exists(target)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    sink = _Sink(_create(target, temporary), str(target))
    buffer = io.BufferedWriter(cast(Any, sink), BUFFER)
    try:
        yield cast(BinaryIO, buffer)
        buffer.flush()
        sink.settle()
        buffer.close()
        _rename(temporary, target, overwrite)
    except BaseException:
        sink.dead = True
        buffer.close()
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


class Unfinished:
    """Files in the making, in steps: each step is bytes for every file and a note, kept in a journal beside them.

    NAME is written as .NAME.part, the journal is .NAME.journal, named after the first file and locked while a run
    writes it. A run that is killed leaves both; one that goes on (`resume`) with the same `key` finds the steps that
    are whole (by length and CRC-32) through `found`. Use as a context manager and call `finish` in it; on any other
    way out everything is removed, unless `resume` was asked for and `error` is one of `kept`.
    """

    kept: tuple[type[BaseException], ...] = (OutputError, KeyboardInterrupt)

    def __init__(self, paths: Sequence[Path], key: str, *, overwrite: bool = False, resume: bool = False) -> None:
        self.paths, self.key, self.overwrite, self.resume = list(paths), key, overwrite, resume
        self.parts = [path.with_name(f".{path.name}.part") for path in self.paths]
        self.journal_path = self.paths[0].with_name(f".{self.paths[0].name}.journal")
        if not overwrite:
            self._refuse_existing()
        self.journal = locked(self.journal_path, str(self.paths[0]))
        if resume and not overwrite:
            self._take_back()
        self.files: list[BinaryIO] = []
        self.sinks: list[_Sink] = []
        self.ends = [0] * len(self.paths)

    def __enter__(self) -> Unfinished:
        return self

    def _refuse_existing(self) -> None:
        """A file that is there is not replaced; a run killed after its last file got its name left just the journal."""
        left = self.journal_path.exists()
        for part, path in zip(self.parts, self.paths, strict=True):
            if left and path.exists() and part.exists() and part.samefile(path):      # half of a rename
                part.unlink(missing_ok=True)
        if self.paths[0].exists():
            if left and not any(part.exists() for part in self.parts):
                journal = locked(self.journal_path, str(self.paths[0]))
                self.journal_path.unlink(missing_ok=True)
                journal.close()
            _exists(self.paths[0])
        for part, path in zip(self.parts[1:], self.paths[1:], strict=True):
            if path.exists() and not (self.resume and left and not part.exists()):
                _exists(path)

    def _take_back(self) -> None:
        """Files that got their names before the run was killed are parts again until the first one follows them."""
        for part, path in zip(self.parts[1:], self.paths[1:], strict=True):
            if path.exists() and not part.exists():
                _rename(path, part, overwrite=False)

    def found(self, take: Callable[[list[bytes], Any], None]) -> None:
        """Hand the steps of an earlier run that are whole to `take(bytes of each file, note)`, drop what follows them.

        Must be called once, before the first step.
        """
        for part in self.parts:
            self._open(part)
        whole = 0
        if self.resume:
            for length, parts, note in self._steps():
                whole += length
                take(parts, note)
        for file, end in zip(self.files, self.ends, strict=True):
            file.seek(end)
            file.truncate()
        self.journal.inner.truncate(whole)
        if not whole:
            self._note({"key": self.key})

    def _open(self, part: Path) -> None:
        try:
            raw = open(part, "r+b" if part.exists() else "w+b", buffering=0)      # noqa: SIM115
        except OSError as error:
            _refuse(str(self.paths[0]), error)
        self.sinks.append(_Sink(raw, str(self.paths[len(self.sinks)])))
        self.files.append(cast(BinaryIO, io.BufferedWriter(cast(Any, self.sinks[-1]), BUFFER)))

    def _steps(self) -> Iterator[tuple[int, list[bytes], Any]]:
        self.journal.inner.seek(0)
        lines = io.BufferedReader(cast(Any, self.journal.inner))
        try:
            yield from self._checked(lines)
        finally:
            lines.detach()

    def _checked(self, lines: io.BufferedReader) -> Iterator[tuple[int, list[bytes], Any]]:
        """Journal bytes, bytes of each file and note of every step up to the first that is not whole."""
        first, pending = lines.readline(), 0
        if not first.endswith(b"\n") or _parsed(first).get("key") != self.key:
            return
        pending = len(first)
        for line in lines:
            step = _parsed(line) if line.endswith(b"\n") else {}
            if "note" not in step:
                return
            parts = []
            for i, sink in enumerate(self.sinks):
                sink.inner.seek(self.ends[i])
                parts.append(sink.inner.read(step["sizes"][i]))
            if [zlib.crc32(part) for part in parts] != step["crcs"]:
                return
            self.ends = [end + size for end, size in zip(self.ends, step["sizes"], strict=True)]
            yield pending + len(line), parts, step["note"]
            pending = 0

    def step(self, parts: Sequence[bytes], note: Any, crcs: Sequence[int]) -> None:
        """Append bytes to each file, and the note once they are out of our hands; `crcs` are CRC-32 of the bytes."""
        for file, part in zip(self.files, parts, strict=True):
            file.write(part)
            file.flush()
        self.ends = [end + len(part) for end, part in zip(self.ends, parts, strict=True)]
        self._note({"sizes": [len(part) for part in parts], "crcs": list(crcs), "note": note})

    def _note(self, line: Any) -> None:
        self.journal.write(json.dumps(line, separators=(",", ":")).encode() + b"\n")

    def finish(self, parts: Sequence[bytes]) -> None:
        """Append the last bytes and let the files appear under their names, the first one last."""
        for file, sink, part in zip(self.files, self.sinks, parts, strict=True):
            file.write(part)
            file.flush()
            sink.settle()
        for done, path in reversed(list(zip(self.parts, self.paths, strict=True))):
            _rename(done, path, self.overwrite)

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        keep = error is not None and self.resume and isinstance(error, self.kept)
        for sink in self.sinks:
            sink.dead = sink.dead or error is not None
        for file in self.files:
            file.close()
        if not keep:
            for path in (*self.parts, self.journal_path):
                with suppress(OSError):
                    path.unlink(missing_ok=True)
        self.journal.close()


def locked(path: Path, name: str) -> _Sink:
    """A journal to read and append to, ours alone until we end. Raises OutputError, which speaks of `name`."""
    try:
        file = open(path, "a+b", buffering=0)      # noqa: SIM115
    except OSError as error:
        if not path.parent.is_dir():
            sentence = f"{name}: the folder {path.parent} does not exist; make it first."
            raise OutputError(sentence, file=name) from error
        _refuse(name, error)
    if not _lock(file) or not _is_at(file, path):
        file.close()
        raise OutputError(f"{name} is being written by another run; let it end, or stop it first.", file=name)
    return _Sink(file, name)


def _parsed(line: bytes) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _lock(file: BinaryIO | io.FileIO) -> bool:
    """Whether the file is ours alone now; the system lets go of it when we end, however we end."""
    try:
        import fcntl
    except ImportError:                # no such locks: two runs at once then end in "exists already"
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_at(file: io.FileIO, path: Path) -> bool:
    """Whether the open file is still what stands under the name: another run may have finished between."""
    try:
        there = path.stat()
    except OSError:
        return False
    here = os.fstat(file.fileno())
    return (here.st_ino, here.st_dev) == (there.st_ino, there.st_dev)


class _Sink(io.RawIOBase):
    """Passes bytes on to `inner`; its OSErrors become OutputErrors with a sentence. Swallows bytes once `dead`."""

    def __init__(self, inner: Any, name: str, *, owned: bool = True) -> None:
        self.inner, self.name, self.owned, self.dead = inner, name, owned, False

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return self.owned

    def tell(self) -> int:
        return int(self.inner.tell())

    def seek(self, offset: int, whence: int = 0) -> int:
        return int(self.inner.seek(offset, whence))

    def truncate(self, size: int | None = None) -> int:
        return int(self.inner.truncate(size))

    def write(self, data: Any) -> int:
        if self.dead:
            return len(data)
        try:
            return int(self.inner.write(data))
        except OSError as error:
            _refuse(self.name, error)

    def settle(self) -> None:
        try:
            if self.owned:
                os.fsync(self.inner.fileno())
            else:
                self.inner.flush()
        except OSError as error:
            _refuse(self.name, error)

    def close(self) -> None:
        if not self.closed:
            if self.owned:
                self.inner.close()
            super().close()


def _standard_output() -> Iterator[BinaryIO]:
    sink = _Sink(sys.stdout.buffer, "standard output", owned=False)
    buffer = io.BufferedWriter(cast(Any, sink), BUFFER)
    try:
        yield cast(BinaryIO, buffer)
        buffer.flush()
        sink.settle()
    except BaseException:
        sink.dead = True
        raise
    finally:
        buffer.close()


def _create(target: Path, temporary: Path) -> Any:
    try:
        return open(temporary, "xb", buffering=0)
    except OSError as error:
        if not target.parent.is_dir():
            sentence = f"{target}: the folder {target.parent} does not exist; make it first."
            raise OutputError(sentence, file=str(target)) from error
        _refuse(str(target), error)


def _rename(temporary: Path, target: Path, overwrite: bool) -> None:
    try:
        if overwrite:
            os.replace(temporary, target)
        else:
            _rename_if_free(temporary, target)
    except OSError as error:
        _refuse(str(target), error)


def _rename_if_free(temporary: Path, target: Path) -> None:
    """Rename, but never over a file that another run put there meanwhile (a hard link refuses, a rename does not)."""
    try:
        os.link(temporary, target)
    except FileExistsError:
        _exists(target)
    except OSError:                    # a file system without hard links
        if target.exists():
            _exists(target)
        os.replace(temporary, target)
    else:
        temporary.unlink(missing_ok=True)


def _exists(target: Path) -> NoReturn:
    raise OutputError(f"{target} exists already; give another name with -o, or --overwrite.", file=str(target))


def _refuse(name: str, error: OSError) -> NoReturn:
    reasons = {
        errno.ENOSPC: "the disk is full",
        errno.EDQUOT: "the disk quota is used up",
        errno.EPIPE: "the reader of the pipe has gone",
        errno.EACCES: "no permission to write there",
        errno.EROFS: "the file system is read-only",
        errno.EISDIR: "it is a folder",
    }
    reason = reasons.get(error.errno or 0, error.strerror or str(error))
    quiet = error.errno == errno.EPIPE
    raise OutputError(f"{name} could not be written: {reason}.", file=name, quiet=quiet) from error
