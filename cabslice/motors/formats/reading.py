"""Opening a motor file to read it, and the sentence where it is damaged: the same for all formats."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, NoReturn

from cabslice.errors import ProductError


def opened(path: str | Path) -> BinaryIO:
    """Raises ProductError where the file cannot be read."""
    try:
        return open(path, "rb")
    except OSError as error:
        name = Path(path).name
        raise ProductError(f"{name} cannot be read: {error.strerror}.", file=name) from error


def damaged(path: str | Path, what: str) -> NoReturn:
    name = Path(path).name
    raise ProductError(f"{name} is damaged: {what}; export it again.", file=name)
