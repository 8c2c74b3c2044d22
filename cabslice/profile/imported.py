"""A printer profile made of another program's files: what was read, and what had to be assumed, value by value.

`Builder` gathers values with the place they were read at, or why they were assumed, and every fault of the files;
`Builder.finish` checks the whole as a profile and gives it as TOML.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cabslice.errors import ProfileError
from cabslice.profile.faults import checked
from cabslice.profile.reader import Sheet, merge
from cabslice.profile.shown import share
from cabslice.profile.toml import Place, dump

ASSUMED = "assumed"


@dataclass(frozen=True)
class Imported:
    """A checked printer, its text as a profile file, and what of the files was left out."""

    model: Any
    toml: str
    left_out: tuple[str, ...]              # sentences


@dataclass
class Builder:
    """A profile in the making. Places count cables from 0: ("cable", 2, "anchor_mm"); "cables" means all of them."""

    label: str                             # what messages call the file
    values: dict[str, Any] = field(default_factory=dict)
    notes: dict[Place, str] = field(default_factory=dict)          # behind each value
    assumed: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def read(self, place: Place, value: Any, where: str) -> None:
        """A value that stands in the files, at `where`."""
        self._put(place, value, where)

    def assume(self, given: Mapping[Place, Any], why: str) -> None:
        """Values that do not; one entry of `assumed` for all of them."""
        for place, value in given.items():
            self._put(place, value, ASSUMED)
        self.assumed.append(f"{', '.join('.'.join(map(str, place)) for place in given)}: {why}")

    def fault(self, where: str, sentence: str) -> None:
        """What is wrong in the files, told with all the rest by `finish` or `stop`."""
        self.faults.append(f"{where}: {sentence}" if where else sentence)

    def stop(self) -> None:
        """Raises ProfileError with all faults so far, if there are any."""
        if self.faults:
            raise ProfileError(self.label, self.faults)

    def finish(self, name: str, description: str, source: str) -> Imported:
        """Raises ProfileError with every fault of the files, else of the profile they make."""
        self.stop()
        head = {"schema": 1, "name": name, "description": description, "source": source, "assumed": self.assumed}
        shared, own = share(self.values.pop("cable"))
        values = head | self.values | {"cables": shared, "cable": own}
        model = checked("printers", merge([Sheet(self.label, values)]))
        return Imported(model, dump(values, self._note), tuple(self.left_out))

    def _put(self, place: Place, value: Any, note: str) -> None:
        if place[0] == "cables":
            for index in range(len(self.values["cable"])):
                self._put(("cable", index, *place[1:]), value, note)
            return
        table: Any = self.values
        for part in place[:-1]:
            table = table[part] if isinstance(part, int) else table.setdefault(part, {})
        table[place[-1]] = value
        self.notes[place] = note

    def _note(self, place: Place) -> str:
        return self.notes.get(("cable", 0, *place[1:]) if place[0] == "cables" else place, "")


def text_of(path: Path) -> str:
    """A file as text. Raises ProfileError where it cannot be read or is no text."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ProfileError(str(path), [f"cannot be read: {error.strerror}"]) from error
    except UnicodeDecodeError as error:
        raise ProfileError(str(path), [f"not text: byte {error.start} is not UTF-8"]) from error
    if "\0" in text:
        raise ProfileError(str(path), ["not text: it holds a zero byte"])
    return text


def name_from(words: str) -> str:
    """A profile name out of any words: lower case, hyphens; "imported" where nothing is left."""
    return re.sub(r"[^a-z0-9.]+", "-", words.lower()).strip("-.") or "imported"
