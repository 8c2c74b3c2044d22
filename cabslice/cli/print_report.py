"""cabslice report"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cabslice.cli import options
from cabslice.cli.options import Output
from cabslice.cli.report import Talk


@click.command("report")
@click.argument("file", metavar="PRODUCT")
@options.jobs
@click.option("--no-check", is_flag=True, help="Leave check and audit out of the page (a motor file carries its own).")
@options.output
@options.talk
def report(file: str, jobs: int, no_check: bool, output: Output, talk: Talk) -> None:
    """A print in figures: one HTML page to read, to print or to keep.

    PRODUCT is a .path, a .plan or a motor file. Time by feature, filament and cost, peaks and histograms of speed and
    tension, motors, stiffness and first mode along the print, air between cables, what was checked, settings and
    hashes. --json prints every number of the page.
    """
    target, talk = options.target(output, f"{Path(file).stem}.report.", {"html": ".html"}, talk)
    from cabslice.cli.told import charts_of, told_of
    from cabslice.files import atomic
    from cabslice.view import report as room

    with talk.progress() as tick:
        answer, curve, picture = told_of(Path(file), not no_check, jobs, tick)
    answer |= {"output": target.path}
    content = room.page(answer, sections(answer), cables(), charts_of(answer, curve), picture)
    with atomic(target.path, target.overwrite) as out:
        out.write(content)
    from cabslice.cli import tables

    blocks = tables.number_table(answer["numbers"]), tables.cable_table(answer["numbers"])
    talk.answer(answer, *blocks, f"wrote {target.path}: open it in a browser")


def sections(answer: dict[str, Any]) -> list[Any]:
    """Headings, and rows of words, key and how it is said."""
    from cabslice.cli import tables
    from cabslice.cli.report import clock

    plain = [(words, f"numbers.{key}", show) for key, (words, show) in tables.NUMBERS.items()]
    spent = [(name.replace("_", " "), f"numbers.duration_s_by_feature.{name}", clock)
             for name in answer["numbers"].get("duration_s_by_feature", {})]
    laid = [(name.replace("_", " "), f"numbers.roles.{name}.filament_mm", lambda value: f"{value / 1e3:.3f} m")
            for name in answer["numbers"].get("roles", {})]
    held = [(words, key, show) for key, (words, show) in HELD.items()]
    slabs = [(f"{row['from_mm']:.1f} to {row['to_mm']:.1f} mm", f"clearance_by_height.{i}.least_cable_gap_mm",
              lambda value: f"{value:.2f} mm") for i, row in enumerate(answer.get("clearance_by_height", []))]
    cost = [("cost of the filament", "cost", lambda value: f"{value:.2f}")]
    return [("the print", plain + cost), ("time by feature", spent), ("filament by feature", laid),
            ("along the print, at rest", held), ("least air between cables by height", slabs)]


def cables() -> list[Any]:
    """Heads, keys and how they are said, of the numbers that each cable has."""
    from cabslice.cli import tables

    return [(words, key, _formatted(form)) for key, (words, form) in tables.CABLES.items()]


def _formatted(form: str) -> Any:
    return lambda value: f"{value:{form}}"


HELD: dict[str, tuple[str, Any]] = {
    "min_first_mode_hz": ("lowest first mode", lambda value: f"{value:.2f} Hz"),
    "mean_first_mode_hz": ("mean first mode", lambda value: f"{value:.2f} Hz"),
    "min_nozzle_stiffness_kn_m": ("least stiffness of the nozzle", lambda value: f"{value:.2f} kN/m"),
    "mean_nozzle_stiffness_kn_m": ("mean stiffness of the nozzle", lambda value: f"{value:.2f} kN/m"),
    "min_cable_gap_mm": ("least air between cables", lambda value: f"{value:.2f} mm"),
}
