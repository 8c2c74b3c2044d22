"""Seconds and peak memory of every stage from a mesh to a motor file, beside PrusaSlicer on the same parts.

    python benchmarks/chain.py [PART ...] [-p PRINTER]

Each stage is a process of its own (start-up, reading and writing its product included), so its peak memory is its own.
Stages are measured also where the robot cannot make the part; a motor file is written only where it can. Wall times on
a busy machine are noisy: compare CPU seconds of one run. With CABSLICE_PEERS=1 a missing prusa-slicer is a failure.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MODELS = Path(__file__).parents[2] / "shared" / "models"
PARTS = ("benchy.stl", "bunny_flat.stl")
SETTINGS = (
    "layer_mm=0.2", "first_layer_mm=0.2", "walls=2", "infill=0.2", "pattern=grid", "top_layers=4", "bottom_layers=4",
)
PRUSA = (
    "--layer-height=0.2", "--first-layer-height=0.2", "--perimeters=2", "--fill-density=20%", "--fill-pattern=grid",
    "--top-solid-layers=4", "--bottom-solid-layers=4", "--nozzle-diameter=0.4", "--skirts=1",
    "--bed-shape=0x0,600x0,600x600,0x600", "--center=300,300", "--max-print-height=600",
)
STAGES = {
    "slice": ("part", "path"), "check": ("path", None), "plan": ("path", "plan"), "audit": ("plan", None),
    "write": ("plan", "stream"),
}


@dataclass(frozen=True)
class Cost:
    cpu_s: float
    wall_s: float
    peak_mib: float
    exit_code: int
    said: str


def cost(command: list[str]) -> Cost:
    """Run one process and measure it alone."""
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        lines = said.read().strip().splitlines()
    wall = time.perf_counter() - began
    cpu, last = used.ru_utime + used.ru_stime, lines[-1] if lines else ""
    return Cost(cpu, wall, used.ru_maxrss / 1024, process.returncode, last)


def chain(part: Path, printer: str, folder: Path) -> bool:
    """Measure every stage of one part; False where one failed by a bug."""
    products = {"part": part, **{kind: folder / f"{part.stem}.{kind}" for kind in ("path", "plan", "stream")}}
    total, checked = [0.0, 0.0, 0.0], True
    for stage, (source, result) in STAGES.items():
        if not products[source].exists() or (stage == "write" and not checked):
            row(part.name, stage, None, "skipped: the robot cannot make this part")
            continue
        target = [str(products[result])] if result else []
        done = cost([sys.executable, __file__, "--stage", stage, "-p", printer, str(products[source]), *target])
        row(part.name, stage, done, done.said)
        if done.exit_code not in (0, 4):
            return False
        checked &= done.exit_code == 0
        total = [total[0] + done.cpu_s, total[1] + done.wall_s, max(total[2], done.peak_mib)]
    row(part.name, "all", Cost(*total, 0, ""), "")
    return True


def peer(part: Path, folder: Path) -> bool:
    program = shutil.which("prusa-slicer")
    if program is None:
        sentence = "prusa-slicer is not installed (Debian package prusa-slicer): nothing to compare slicing with."
        row(part.name, "prusa", None, sentence if os.environ.get("CABSLICE_PEERS") == "1" else f"skipped: {sentence}")
        return os.environ.get("CABSLICE_PEERS") != "1"
    gcode = folder / f"{part.stem}.gcode"
    done = cost([program, "--export-gcode", *PRUSA, "-o", str(gcode), str(part)])
    row(part.name, "prusa", done, "STL to G-code, to be compared with slice" if gcode.exists() else done.said)
    return done.exit_code == 0


def row(part: str, stage: str, done: Cost | None, note: str) -> None:
    figures = f"{done.cpu_s:9.2f} {done.wall_s:9.2f} {done.peak_mib:9.0f}" if done else f"{'-':>9} {'-':>9} {'-':>9}"
    print(f"{part:<16} {stage:<6} {figures}  {note}", flush=True)


def run_stage(stage: str, printer: str, source: str, target: str | None) -> int:
    """One stage, in this process; its exit code as on the command line."""
    from cabslice import errors, pipeline, store

    def tell(verdict: object) -> int:
        ok = getattr(verdict, "ok", False)
        print("nothing found" if ok else verdict.findings[0].sentence)  # type: ignore[attr-defined]
        return errors.EXIT_OK if ok else errors.EXIT_IMPOSSIBLE

    try:
        if stage == "slice":
            profiles = pipeline.load_profiles(printer, None, None, SETTINGS)
            laid = pipeline.to_path(pipeline.read(source, profiles, pipeline.Placement()))
            store.save(laid, str(target))
            print(f"{len(laid.toolpath.xyz) - 1} moves")
            return errors.EXIT_OK
        product = store.load(source)[1]
        if stage == "check":
            return tell(pipeline.check_path(product))
        if stage == "plan":
            planned = pipeline.planned(product, jobs=os.cpu_count() or 1)
            store.save(planned, str(target))
            print(f"{planned.trajectory.duration:.0f} s of printing, {len(planned.trajectory.time)} nodes")
            return errors.EXIT_OK
        if stage == "audit":
            return tell(pipeline.audited(product, jobs=os.cpu_count() or 1))
        stream = pipeline.stream_of(product, {"numbers": pipeline.numbers_of(product)}, pipeline.period_of(product))
        pipeline.save_stream(stream, str(target), "stream")
        print(f"{stream.rows} rows")
        return errors.EXIT_OK
    except errors.CabsliceError as error:
        print(error.sentence.splitlines()[0])
        return error.exit_code


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*")
    parser.add_argument("-p", "--printer", default="cabfab-optim")
    parser.add_argument("--stage", choices=STAGES, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.stage:
        return run_stage(given.stage, given.printer, given.parts[0], (given.parts[1:] or [None])[0])
    parts = [Path(part) for part in given.parts] or [MODELS / part for part in PARTS]
    print(f"{'part':<16} {'stage':<6} {'CPU s':>9} {'wall s':>9} {'peak MiB':>9}")
    good = True
    with tempfile.TemporaryDirectory(prefix="cabslice-chain-") as folder:
        for part in parts:
            if not part.exists():
                row(part.name, "-", None, f"skipped: {part} is not here")
                continue
            good &= chain(part, given.printer, Path(folder))
            good &= peer(part, Path(folder))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
