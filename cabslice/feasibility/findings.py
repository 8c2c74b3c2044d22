"""Verdicts: what was checked, and every reason to say no."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One reason why the robot cannot make the part, at its worst place.

    xyz is the nozzle in bed coordinates, mm. cable counts from 1 as in the papers; 0 means no single cable.
    """

    code: str                              # short and stable: "tension", "cable-part", "cable-cable", ...
    layer: int
    xyz: tuple[float, float, float]
    cable: int
    value: float
    limit: float
    unit: str
    sentence: str                          # names layer, mm, cable, value, limit
    help: str = ""                         # what would help
    free_mm: float | None = None           # what is printed below this height does not meet it
    travel: bool = False                   # only moves without a bead are meant

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Verdict:
    """ok is true only where something was checked and nothing was found."""

    checked: tuple[str, ...]               # sentences: what was looked at, with how many points or pairs
    findings: tuple[Finding, ...] = ()
    margins: Mapping[str, float] = field(default_factory=dict)   # smallest margin of each check; unit in the key
    capped: tuple[str, ...] = ()           # margins that were not looked for any further: at least what is told
    changed: tuple[str, ...] = ()          # sentences: what of the path was changed so that it can be made

    def __post_init__(self) -> None:
        if not self.checked:
            raise ValueError("a verdict needs to say what was checked")

    @property
    def ok(self) -> bool:
        return not self.findings

    def joined(self, other: Verdict) -> Verdict:
        return Verdict(
            self.checked + other.checked, self.findings + other.findings, {**self.margins, **other.margins},
            self.capped + other.capped, self.changed + other.changed,
        )

    def as_dict(self) -> dict[str, Any]:
        return {
            "ok": self.ok,
            "checked": list(self.checked),
            "findings": [finding.as_dict() for finding in self.findings],
            "margins": dict(self.margins),
            "margins_at_least": list(self.capped),
            "changed": list(self.changed),
        }
