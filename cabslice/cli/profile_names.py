"""Names of profiles on the command line: of which kind one is, and where a file of that name goes."""

from __future__ import annotations

import re
from pathlib import Path

import click

from cabslice.errors import ProfileError, UsageError

KINDS = {"printer": "printers", "material": "materials", "process": "processes"}
NAME = re.compile(r"[a-z0-9]+([.-][a-z0-9]+)*")


kind_option = click.option("--kind", type=click.Choice(list(KINDS)), help="What it is, where the name does not tell.")


def checked_name(name: str) -> None:
    """Raises UsageError where it is none."""
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no profile name; expected lower-case letters, digits, hyphens: my-printer.")


def target(to: str | None, name: str, suffix: str = "toml") -> str:
    """Where -o puts a file of that name."""
    if to is None or to == "-":
        return to or f"{name}.{suffix}"
    return str(Path(to) / f"{name}.{suffix}") if to.endswith("/") or Path(to).is_dir() else to


def kind_of(ref: str, given: str | None) -> str:
    """The folder of a reference. Raises ProfileError where there is none, UsageError where there are several."""
    from cabslice.profile import shelf

    found = [KINDS[given]] if given else shelf.kinds_of(ref)
    if len(found) > 1:
        words = " and ".join(f"a {shelf.SINGULAR[one]}" for one in found)
        raise UsageError(f"{ref} is {words}: say which with --kind.")
    if not found:
        raise ProfileError(ref, [shelf.unknown_name(list(KINDS.values()), ref)])
    return found[0]
