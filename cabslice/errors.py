"""Everything that can go wrong, in one tree, and the exit code each ends in.

CabsliceError
    UsageError        2    wrong command line
    InputError        3    an input file is wrong
        ModelError         a mesh
        ProfileError       a printer, material or process file: all its faults at once
        ProductError       a file this program wrote earlier, damaged or of another version
        GcodeError         G-code of another slicer
    ImpossibleError   4    the robot cannot make this part as asked
        PoseError          a pose, length or motor angle outside what the model of the robot covers
    OutputError       5    the result could not be written
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

EXIT_OK, EXIT_BUG, EXIT_USAGE, EXIT_INPUT, EXIT_IMPOSSIBLE, EXIT_OUTPUT, EXIT_INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


class CabsliceError(Exception):
    """A sentence for the user; `details` holds the same as data, for --json."""

    exit_code = EXIT_BUG

    def __init__(self, sentence: str, **details: Any) -> None:
        super().__init__(sentence)
        self.sentence = sentence
        self.details = details


class UsageError(CabsliceError):
    exit_code = EXIT_USAGE


class InputError(CabsliceError):
    """Names the file, the place in it and what was expected."""

    exit_code = EXIT_INPUT


class ModelError(InputError):
    pass


class ProfileError(InputError):
    """All faults of a profile at once, one sentence each."""

    def __init__(self, file: str, faults: Sequence[str]) -> None:
        super().__init__("\n".join(f"{file}: {fault}" for fault in faults), file=file, faults=list(faults))


class ProductError(InputError):
    pass


class GcodeError(InputError):
    pass


class ImpossibleError(CabsliceError):
    """The robot says no. `findings` are the reasons (see feasibility.findings.Finding)."""

    exit_code = EXIT_IMPOSSIBLE

    def __init__(self, sentence: str, findings: Sequence[Any] = (), **details: Any) -> None:
        super().__init__(sentence, **details)
        self.findings = tuple(findings)


class PoseError(ImpossibleError):
    """Names the cable (from 1), the pose and what was expected."""


class OutputError(CabsliceError):
    exit_code = EXIT_OUTPUT
