"""The first run on a machine: inner loops are compiled once and kept, by a second process while the first one slices.

    python -m cabslice.cli.first_run    origin of a product as JSON on stdin; plans two small squares with it
"""

from __future__ import annotations

import atexit
import json
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from cabslice.cli.report import Talk
from cabslice.errors import CabsliceError

if TYPE_CHECKING:
    from cabslice.store import Laid, Origin

KEPT = Path(__file__).parents[1] / "timing" / "__pycache__"
SIDE, FED = 8.0, 0.03   # mm of each square, mm of filament per mm


def compiled_before() -> bool:
    """Whether the planner was compiled on this machine: numba keeps it beside the code, or in the user's cache."""
    if any(KEPT.glob("kernel._solve-*.nbi")):   # without loading numba, which is not needed yet
        return True
    from cabslice.timing import kernel

    return any(Path(kernel.compiled_to()).glob("kernel._solve-*.nbi"))


def prepare(origin: Origin, talk: Talk, *, planning: bool) -> None:
    """Says it, or the first run looks stuck; where it is going to plan, compiles in another process meanwhile."""
    if compiled_before():
        return
    talk.say("First run on this machine: the inner loops are compiled once and kept, which takes some seconds.")
    if planning:
        command = [sys.executable, "-m", "cabslice.cli.first_run"]
        quiet = subprocess.DEVNULL
        ahead = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, text=True)
        atexit.register(ahead.kill)
        assert ahead.stdin
        with suppress(BrokenPipeError), ahead.stdin:
            json.dump(asdict(origin), ahead.stdin)


def squares(origin: Origin) -> Laid:
    """Two layers of one square each in the middle of the bed, with what else a path has: travels and retractions."""
    import numpy as np

    from cabslice import pipeline
    from cabslice.slicing.layer import Role
    from cabslice.store import Laid
    from cabslice.toolpath.path import Events, Toolpath, piece_starts

    profiles = pipeline.profiles_of(origin)
    process, extruder = profiles.process, profiles.printer.extruder
    assert extruder
    ring = SIDE / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1.0]])
    rows = [(*(1.5 * ring[0]), process.first_layer_mm, 0.0, Role.TRAVEL, 0)]
    for layer in range(2):
        z = process.first_layer_mm + layer * process.layer_mm
        rows += [(*ring[0], z, 0.0, Role.TRAVEL, layer), (*ring[0], z, 1.0, Role.TRAVEL, layer)]
        rows += [(*corner, z, SIDE * FED, Role.OUTER_WALL, layer) for corner in ring[1:]]
        rows += [(*ring[-1], z, -1.0, Role.TRAVEL, layer)]
    table = np.array(rows)
    laid = table[:, 4] != Role.TRAVEL
    rests = np.append(False, (np.diff(table[:, :3], axis=0) == 0).all(1))
    toolpath = Toolpath(
        xyz=table[:, :3], filament=table[:, 3], width=np.where(laid, process.bead_mm, 0),
        height=np.where(laid, process.layer_mm, 0), speed=np.full(len(table), 30.0), role=table[:, 4],
        layer=table[:, 5], object=np.zeros(len(table)), starts=piece_starts(rests), events=Events.none(),
        filament_diameter_mm=extruder.filament_diameter_mm,
    )
    return Laid(origin, toolpath)


def compile_now(origin: Origin) -> None:
    """Everything from the check to the motor file, on two squares."""
    from cabslice import pipeline

    plan, verdict = pipeline.to_plan(squares(origin))
    stream = pipeline.to_stream(plan, verdict, period_s=pipeline.period_of(plan))
    with tempfile.TemporaryDirectory() as folder:
        pipeline.save_stream(stream, Path(folder) / "squares.stream", "stream")


if __name__ == "__main__":
    from cabslice.store import Origin as _Origin

    with suppress(CabsliceError):   # what this printer cannot do is for the other process to say
        compile_now(_Origin(**json.load(sys.stdin)))
