"""Numbers and verdicts as the tables a person reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cabslice.cli.report import Table, clock

Show = Callable[[Any], str]

NUMBERS: dict[str, tuple[str, Show]] = {   # key of view.numbers: what it is called, how it is said
    "triangles": ("triangles", lambda value: f"{value}"),
    "size_mm": ("size", lambda value: " x ".join(f"{side:.2f}" for side in value) + " mm"),
    "part_mm3": ("volume", lambda value: f"{value / 1e3:.3f} cm3"),
    "layers": ("layers", lambda value: f"{value}"),
    "height_mm": ("height", lambda value: f"{value:.2f} mm"),
    "moves": ("moves", lambda value: f"{value}"),
    "extruded_mm": ("beads", lambda value: f"{value / 1e3:.2f} m"),
    "travel_mm": ("travel", lambda value: f"{value / 1e3:.2f} m"),
    "retractions": ("retractions", lambda value: f"{value}"),
    "filament_mm": ("filament", lambda value: f"{value / 1e3:.3f} m"),
    "mass_g": ("weight", lambda value: f"{value:.2f} g"),
    "cost": ("cost", lambda value: f"{value:.2f}"),
    "duration_s": ("print time", lambda value: clock(value)),
    "peak_nozzle_speed_mm_s": ("peak nozzle speed", lambda value: f"{value:.2f} mm/s"),
    "peak_nozzle_acceleration_mm_s2": ("peak nozzle acceleration", lambda value: f"{value:.0f} mm/s2"),
    "period_s": ("period", lambda value: f"{value * 1e3:g} ms"),
    "rows": ("rows", lambda value: f"{value}"),
}
CABLES: dict[str, tuple[str, str]] = {     # per-cable key: head, format
    "min_tension_n": ("tension N", ".2f"),
    "max_tension_n": ("to", ".2f"),
    "peak_motor_speed_rad_s": ("speed rad/s", ".3f"),
    "peak_motor_acceleration_rad_s2": ("accel. rad/s2", ".1f"),
    "peak_torque_n_m": ("torque N m", ".3f"),
    "rms_torque_n_m": ("rms N m", ".3f"),
}


def number_table(numbers: Mapping[str, Any]) -> Table:
    return Table(("", ""), [(words, show(numbers[key])) for key, (words, show) in NUMBERS.items() if key in numbers])


def cable_table(numbers: Mapping[str, Any]) -> Table | str:
    """One row a cable, where the numbers have any."""
    keys = [key for key in CABLES if key in numbers]
    if not keys:
        return ""
    columns = [[f"{value:{CABLES[key][1]}}" for value in numbers[key]] for key in keys]
    rows = [(str(cable), *row) for cable, row in enumerate(zip(*columns, strict=True), start=1)]
    heads = [f">{CABLES[key][0]}" for key in keys]
    if numbers.get("machine_kind"):
        return Table((">motor", *(head.replace("tension", "force") for head in heads)), rows)
    return Table((">cable", *heads), rows)


def finding_table(findings: Sequence[Any]) -> Table | str:
    if not findings:
        return ""
    rows = [
        (f.code, str(f.layer), *(f"{x:.2f}" for x in f.xyz), str(f.cable or "-"),
         f"{f.value:.4g}", f"{f.limit:.4g}", f.unit)
        for f in findings
    ]
    return Table(("what", ">layer", ">x mm", ">y mm", ">z mm", ">cable", ">value", ">limit", "unit"), rows)


def checked_lines(verdict: Any) -> str:
    words = dict.fromkeys(verdict.capped, "at least ")
    shares = {key: value for key, value in verdict.margins.items() if key.endswith("_share")}
    margins = [f"  smallest margin {key}: {words.get(key, '')}{value:.4g}" for key, value in verdict.margins.items()
               if key not in shares]
    margins += [f"  largest share used of {key.removesuffix('_share')}: {value:.4g}" for key, value in shares.items()]
    return "\n".join([*verdict.changed, "checked:", *(f"  {sentence}" for sentence in verdict.checked), *margins])


def share_table(title: str, shares: Mapping[str, float]) -> Table:
    """Names with their shares of a whole."""
    return Table((title, ">"), [(name, f"{100 * share:.1f} %") for name, share in shares.items()])


def feature_table(seconds: Mapping[str, float]) -> Table:
    """Seconds of each feature, the longest first."""
    total = sum(seconds.values()) or 1.0
    longest = sorted((item for item in seconds.items() if item[1] > 0), key=lambda item: -item[1])
    rows = [(name.replace("_", " "), f"{100 * spent / total:.1f} %", clock(spent)) for name, spent in longest]
    return Table(("time by feature", ">", ">"), rows)


def compared_line(row: Mapping[str, Any]) -> str:
    """A baseline beside the plan."""
    broken = ", ".join(f"{code} {share:.3g}" for code, share in row["broken"].items())
    kept = f"breaks limits, times the limit: {broken}" if broken else "keeps every limit"
    return (f"{row['name']} ({row['acceleration_mm_s2']:.0f} mm/s2, corners step by up to "
            f"{row['corner_step_mm_s']:.1f} mm/s): {clock(row['duration_s'])}, {row['times_ours']:.2f} x this plan; "
            f"{kept}")
