"""STL to G-code, the whole process with its start-up: CPU seconds, wall seconds and peak memory beside CuraEngine and
PrusaSlicer, in turns in one run.

    python benchmarks/slicing.py [PART ...] [--rounds 3] [--large]

0.2 mm layers, 2 walls, 20 % grid, 4 skins above and below. Of several rounds the smallest figures count. `--large`
adds the bunny with a million triangles, the bunny 2.4 m tall (1.2 mm nozzle, 0.6 mm layers), and benchy at three layer
heights and with 4 and 16 times the triangles, to show how the work grows. A row says how ours stands to CuraEngine or
to a limit; the exit code is 1 where it loses. CuraEngine needs its definitions (Debian packages cura-engine and cura):
CURA_DEFINITIONS or /usr/share/cura/resources/definitions. With CABSLICE_PEERS=1 a missing peer is a failure.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from chain import MODELS, PRUSA, SETTINGS, Cost, cost

PARTS = ("benchy.stl", "counter.stl", "bunny_flat.stl")
DEFINITIONS = Path(os.environ.get("CURA_DEFINITIONS", "/usr/share/cura/resources/definitions"))
CURA = {
    "layer_height": 0.2, "layer_height_0": 0.2, "wall_line_count": 2, "infill_sparse_density": 20,
    "infill_line_distance": 4, "infill_pattern": "grid", "top_layers": 4, "bottom_layers": 4, "adhesion_type": "skirt",
    "support_enable": "false", "machine_width": 5000, "machine_depth": 5000, "machine_height": 5000,
    "machine_center_is_zero": "true",
}
COARSE = (
    "nozzle.diameter_mm=1.2", "nozzle_mm=1.2", "layer_mm=0.6", "first_layer_mm=0.6", "bead_mm=1.3",
    "outer_bead_mm=1.2", "first_bead_mm=1.3",
)
ROW = "{:<24} {:<9} {:>8} {:>8} {:>9}  {}"


@dataclass(frozen=True)
class Job:
    name: str
    part: Path
    settings: tuple[str, ...] = SETTINGS
    peers: bool = True
    limit: Cost | None = None


def commands(job: Job, folder: Path) -> dict[str, list[str] | str]:
    """Per slicer the command that writes G-code, or a sentence where it is not here."""
    sets = [word for key in job.settings for word in ("-s", key)]
    found: dict[str, list[str] | str] = {"cabslice": [
        sys.executable, "-m", "cabslice", "slice", str(job.part), "-p", "cabfab-optim", *sets, "-q", "--overwrite",
        "-o", str(folder / "ours.gcode"),
    ]}
    if not job.peers:
        return found
    cura, prusa = shutil.which("CuraEngine"), shutil.which("prusa-slicer")
    printer = DEFINITIONS / "fdmprinter.def.json"
    if cura and printer.exists():
        settings = [word for key, value in CURA.items() for word in ("-s", f"{key}={value}")]
        found["cura"] = ["env", f"CURA_ENGINE_SEARCH_PATH={DEFINITIONS}", cura, "slice", "-j", str(printer),
                         *settings, "-e0", *settings, "-l", str(job.part), "-o", str(folder / "cura.gcode")]
    else:
        found["cura"] = "CuraEngine or its definitions are not here (Debian packages cura-engine, cura)"
    found["prusa"] = [prusa, "--export-gcode", *PRUSA, "-o", str(folder / "prusa.gcode"), str(job.part)] if prusa else (
        "prusa-slicer is not here (Debian package prusa-slicer)")
    return found


def measure(job: Job, folder: Path, rounds: int) -> bool:
    """One row per slicer, taken in turns; False where ours fails or loses, or a peer is wanted and absent."""
    all_of = commands(job, folder)
    runs: dict[str, list[Cost]] = {name: [] for name in all_of}
    for _ in range(rounds):
        for name, command in all_of.items():
            if isinstance(command, list):
                runs[name].append(cost(command))
    best = {name: least(some) for name, some in runs.items() if some}
    good = best["cabslice"].exit_code == 0
    for name, command in all_of.items():
        if isinstance(command, str):
            good &= os.environ.get("CABSLICE_PEERS") != "1"
            print(ROW.format(job.name, name, "-", "-", "-", f"skipped: {command}"))
        else:
            good &= show(job, name, best)
    return good


def least(runs: list[Cost]) -> Cost:
    return Cost(min(run.cpu_s for run in runs), min(run.wall_s for run in runs), min(run.peak_mib for run in runs),
                max(run.exit_code for run in runs), runs[-1].said)


def show(job: Job, name: str, best: dict[str, Cost]) -> bool:
    done, limit, note, kept = best[name], job.limit or best.get("cura"), "", True
    if done.exit_code:
        note = f"exit code {done.exit_code}: {done.said}"
    elif name == "cabslice" and limit:
        kept = done.cpu_s <= limit.cpu_s and done.wall_s <= limit.wall_s and (
            job.limit is None or done.peak_mib <= limit.peak_mib)
        against = "the limit" if job.limit else "CuraEngine"
        note = f"{done.cpu_s / limit.cpu_s:.2f} of the CPU, {done.wall_s / limit.wall_s:.2f} of the wall of {against}"
    figures = f"{done.cpu_s:.2f}", f"{done.wall_s:.2f}", f"{done.peak_mib:.0f}"
    print(ROW.format(job.name, name, *figures, note), flush=True)
    return kept


def make_large(folder: Path) -> None:
    """The meshes of `large`, each under a name that says how many thousand faces it has."""
    import trimesh

    bunny, benchy = trimesh.load(MODELS / "bunny_flat.stl"), trimesh.load(MODELS / "benchy.stl")
    bunny.subdivide().subdivide().export(folder / "bunny_million.stl")
    for _ in (1, 2):
        benchy = benchy.subdivide()
        benchy.export(folder / f"benchy_{len(benchy.faces) // 1000}k.stl")
    bunny.apply_scale(2400 / bunny.extents[2])
    bunny.export(folder / "bunny_2.4m.stl")


def large(folder: Path) -> list[Job]:
    """A million triangles, 2.4 m, and how the work grows with layers and with triangles."""
    making = get_context("spawn").Process(target=make_large, args=(folder,))   # its memory is not to count as ours
    making.start()
    making.join()
    none = float("inf")
    jobs = [
        Job("bunny, 1.1 M triangles", folder / "bunny_million.stl", (*SETTINGS, "layer_mm=0.2676"),   # 740 layers
            limit=Cost(15, none, 1024, 0, ""), peers=False),
        Job("bunny 2.4 m", folder / "bunny_2.4m.stl", (*SETTINGS, *COARSE), limit=Cost(none, 60, 1024, 0, ""),
            peers=False),
    ]
    for layer in (0.4, 0.2, 0.1):
        jobs.append(Job(f"benchy, {layer} mm", MODELS / "benchy.stl", (*SETTINGS, f"layer_mm={layer}"), peers=False))
    return jobs + [Job(f"{path.stem} triangles", path, peers=False) for path in sorted(folder.glob("benchy_*k.stl"))]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--large", action="store_true")
    given = parser.parse_args()
    paths = [Path(part) for part in given.parts] or [MODELS / part for part in PARTS]
    good = True
    print(ROW.format("part", "slicer", "CPU s", "wall s", "peak MiB", ""))
    with tempfile.TemporaryDirectory(prefix="cabslice-slicing-") as name:
        folder = Path(name)
        jobs = [Job(path.name, path) for path in paths] + (large(folder) if given.large else [])
        for job in jobs:
            if job.part.exists():
                good &= measure(job, folder, given.rounds)
            else:
                print(ROW.format(job.name, "-", "-", "-", "-", f"skipped: {job.part} is not here"))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
