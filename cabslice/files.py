"""Writing a result whole or not at all: a temporary name in the same folder, renamed when nothing is missing."""

from __future__ import annotations

import errno
import io
import os
import secrets
import sys
from collections.abc import Iterator
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
        temporary.unlink()


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
