"""How far the nozzle travels and how often it draws back, ours beside PrusaSlicer's, counted by one reader.

    python benchmarks/travel.py [PART ...] [-p PRINTER]

Both slice the same part with the same settings (standard-0.4 and travel.ini) to G-code; both files are then read back
by toolpath.gcode_read. `travel` is travelled mm per extruded mm, `retr/m` retractions per extruded metre. With
CABSLICE_PEERS=1 a missing prusa-slicer is a failure.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MODELS = Path(__file__).parents[2] / "shared" / "models"
PARTS = ("xyz_cube.stl", "benchy.stl", "counter.stl")
SETTINGS = (
    "layer_mm=0.2", "first_layer_mm=0.2", "walls=2", "infill=0.2", "pattern=grid", "top_layers=4", "bottom_layers=4",
    "retraction.inside_travel_mm=10000", "retraction.max_detour=100",     # Prusa bounds neither
)
COLUMNS = "{:<16} {:<6} {:>9} {:>9} {:>7} {:>7} {:>7} {:>9}"
INI = Path(__file__).with_name("travel.ini")


def ours(part: Path, target: Path, printer: str) -> None:
    """Slice, lay and write `part`; the seconds of laying and of writing go to the screen."""
    from cabslice import pipeline

    profiles = pipeline.load_profiles(printer, None, None, SETTINGS)
    sliced = pipeline.to_layers(pipeline.read(part, profiles, pipeline.Placement()))
    began = time.process_time()
    laid = pipeline.to_path(sliced)
    laying = time.process_time()
    pipeline.save_gcode(laid, target)
    print(f"{part.name:<16} laid in {laying - began:.2f} CPU s, written in {time.process_time() - laying:.2f} CPU s")


def theirs(part: Path, target: Path) -> bool:
    program = shutil.which("prusa-slicer")
    if program is None:
        print(f"{part.name:<16} skipped prusa: prusa-slicer is not installed (Debian package prusa-slicer)")
        return False
    command = [program, "--export-gcode", "--load", str(INI), "--center", "300,300", "-o", str(target), str(part)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def row(part: str, slicer: str, gcode: Path) -> None:
    from cabslice.toolpath.gcode_read import read_gcode
    from cabslice.toolpath.summary import summary

    figures = summary(read_gcode(gcode, filament_diameter_mm=1.75).toolpath)
    metres = figures["extruded_mm"] / 1e3
    travel, drawn_back, filament = figures["travel_mm"] / 1e3, figures["retractions"], figures["filament_mm"] / 1e3
    shares = f"{travel / metres:.3f}", drawn_back, f"{drawn_back / metres:.3f}"
    print(COLUMNS.format(part, slicer, figures["moves"], f"{metres:.1f}", *shares, f"{filament:.2f}"), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", type=Path, default=[MODELS / name for name in PARTS])
    parser.add_argument("-p", "--printer", default="cabfab-optim")
    asked = parser.parse_args()
    whole = True
    print(COLUMNS.format("part", "slicer", "moves", "extr. m", "travel", "retr", "retr/m", "filam. m"))
    with tempfile.TemporaryDirectory() as folder:
        for part in asked.parts:
            mine, other = Path(folder) / f"{part.stem}.gcode", Path(folder) / f"{part.stem}-prusa.gcode"
            ours(part, mine, asked.printer)
            row(part.name, "ours", mine)
            if theirs(part, other):
                row(part.name, "prusa", other)
            else:
                whole = False
    return 0 if whole or os.environ.get("CABSLICE_PEERS") != "1" else 1


if __name__ == "__main__":
    sys.exit(main())
