"""One sentence about a checked profile."""

from __future__ import annotations

from typing import Any

from cabslice.profile.shelf import PRINTING


def summary(kind: str, model: Any) -> str:
    """What it is and what it is good for, for the end of ``cabslice profile check``."""
    return {"printers": _printer, "materials": _material, "processes": _process}[kind](model)


def _printer(model: Any) -> str:
    missing = [f"[{table}]" for table in PRINTING if getattr(model, table) is None]
    prints = f"it has no {', '.join(missing)} and cannot print"
    if not missing:
        prints = f"it prints with a {model.nozzle.diameter_mm:g} mm nozzle on {_by(model.bed.size_mm)} mm"
    assumed = f"{len(model.assumed)} entries are marked as assumed" if model.assumed else "nothing is marked as assumed"
    if model.kind == "linear-delta":
        return (f"Printer {model.name} is right: a linear Delta with arms of {model.delta.arm_mm:g} mm, {prints}; "
                f"{assumed}.")
    low, high = min(c.min_tension_n for c in model.cable), max(c.max_tension_n for c in model.cable)
    return (f"Printer {model.name} is right: {len(model.cable)} cables of {low:g} to {high:g} N hold "
            f"{len(model.freedoms)} freedoms, {prints}; {assumed}.")


def _material(model: Any) -> str:
    low, high = model.nozzle_c
    return (f"Material {model.name} is right: nozzle {low:g} to {high:g} degC, melt flow up to "
            f"{model.max_flow_mm3_s:g} mm^3/s, {model.density_g_cm3:g} g/cm^3.")


def _process(model: Any) -> str:
    return (f"Process {model.name} is right: {model.layer_mm:g} mm layers of {model.bead_mm:g} mm beads for a "
            f"{model.nozzle_mm:g} mm nozzle, {model.walls} walls, {model.infill:.0%} infill.")


def _by(sizes: list[float]) -> str:
    return " x ".join(f"{size:g}" for size in sizes)
