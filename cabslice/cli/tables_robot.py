"""Stiffness and workspaces as the tables a person reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.cli.report import Table

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.robot.model import Robot
    from cabslice.robot.workspace import Grid, PrintSpace

AXES = (">x kN/m", ">y kN/m", ">z kN/m", ">rx N m/deg", ">ry N m/deg", ">rz N m/deg")
PARTS = {"cable": "k_cable_", "lateral": "k_lat_", "force": "k_force_", "whole": "k_"}
MODES = {"whole": "modes_hz", "K_cable alone": "modes_k_cable_hz"}
KINDS = {"mean": "", "least": "min_", "largest": "max_"}     # keys of view.stiffness.over_nodes
SINGLE = {
    "nozzle, softest direction, kN/m": "k_nozzle_least_kn_m", "mean tension, N": "mean_tension_n",
    "margin, N": "margin_n",
}
WORDS = {
    "margin_n": "margin, N", "closure_share": "wrench closure", "first_mode_hz": "first mode, Hz",
    "stiffness_n_mm": "nozzle, N/mm", "cable_gap_mm": "cable gap, mm",
}
ROWS = 11            # heights in a table


# ---- stiffness

def pose_tables(numbers: Mapping[str, Any]) -> list[str | Table]:
    """One pose's numbers (a row of view.stiffness.of_held)."""
    forces, margin = numbers["tensions_n"], f"{numbers['margin_n']:.2f}"
    return [
        Table(("stiffness", *AXES), [(name, *_six(numbers, prefix)) for name, prefix in PARTS.items()]),
        Table(_mode_head(numbers), [(name, *_hertz(numbers[key])) for name, key in MODES.items()]),
        Table(("tension", *(f">cable {i + 1}" for i in range(len(forces))), ">mean", ">margin"),
              [("N", *(f"{force:.2f}" for force in forces), f"{numbers['mean_tension_n']:.2f}", margin)]),
        f"nozzle, softest direction: {numbers['k_nozzle_least_kn_m']:.3f} kN/m",
    ]


def node_tables(numbers: Mapping[str, Any]) -> list[Table]:
    """Mean, least and largest over the nodes of a grid (view.stiffness.over_nodes)."""
    return [
        Table(("stiffness", *AXES), [(f"{name}, {kind}", *_six(numbers, prefix, first))
                                     for name, prefix in PARTS.items() for kind, first in KINDS.items()]),
        Table(_mode_head(numbers), [(f"{name}, {kind}", *_hertz(numbers[f"{first}{key}"]))
                                    for name, key in MODES.items() for kind, first in KINDS.items()]),
        Table(("", *(f">{kind}" for kind in KINDS)), [
            (name, *(f"{numbers[f'{first}{key}']:.3f}" for first in KINDS.values())) for name, key in SINGLE.items()]),
    ]


def _six(numbers: Mapping[str, Any], prefix: str, first: str = "") -> list[str]:
    straight, turning = numbers[f"{first}{prefix}trans_kn_m"], numbers[f"{first}{prefix}rot_n_m_deg"]
    return [f"{x:.3f}" for x in straight] + [f"{x:.4f}" for x in turning]


def _mode_head(numbers: Mapping[str, Any]) -> list[str]:
    return ["frequency, Hz", *(f">mode {i + 1}" for i in range(len(numbers["modes_hz"])))]


def _hertz(values: Any) -> list[str]:
    return [f"{hertz:.2f}" for hertz in values]


# ---- workspace

def space_table(numbers: Mapping[str, Any]) -> Table:
    """Shares of the box, and the maps inside (view.workspace)."""
    nodes = " x ".join(str(count) for count in numbers["nodes"])
    rows = [("inside", _percent(numbers["workspace_fraction"]), f"of the box, {nodes} nodes")]
    if "print_space_fraction" in numbers:
        radius, height = numbers["largest_cylinder_mm"]
        rows += [
            ("print space", _percent(numbers["print_space_fraction"]),
             f"of the frame, {numbers['print_space_mm3'] / 1e6:.1f} dm3: union over all cylinders"),
            ("largest cylinder", _percent(numbers["largest_cylinder_fraction"]),
             f"radius {radius:.0f} mm, height {height:.0f} mm, {numbers['largest_cylinder_mm3'] / 1e6:.1f} dm3"),
        ]
    rows += [(name, f"{numbers[f'mean_{key}']:.4g}",
              f"mean inside; {numbers[f'min_{key}']:.4g} to {numbers[f'max_{key}']:.4g}")
             for key, name in WORDS.items() if f"mean_{key}" in numbers]
    return Table(("", ">", ""), rows)


def height_table(grid: Grid, maps: Mapping[str, Array], inside: Array) -> Table:
    """Share inside and the means of the maps there, height by height, highest first."""
    rows = []
    for k in _heights(grid):
        here = inside[:, :, k]
        means = (value[:, :, k][here & np.isfinite(value[:, :, k])] for value in maps.values())
        rows.append((f"{grid.z[k]:.0f}", f"{100 * here.mean():.1f}",
                     *(f"{mean.mean():.4g}" if len(mean) else "-" for mean in means)))
    return Table((">platform z mm", ">inside %", *(f">{WORDS[key]}" for key in maps)), rows)


def print_table(robot: Robot, space: PrintSpace) -> Table:
    """Section of the print space and how far from the bed's middle it reaches, height by height, highest first."""
    assert robot.bed_origin is not None
    grid, (x, y, bed) = space.grid, robot.bed_origin
    apart = np.hypot(grid.x[:, None] - x, grid.y - y)
    rows = []
    for k in _heights(grid):
        here = space.inside[:, :, k]
        rows.append((f"{grid.z[k] - bed:.0f}", f"{100 * here.mean():.1f}", f"{apart[here].max(initial=0):.0f}"))
    return Table((">nozzle mm", ">print space %", ">farthest mm"), rows)


def _heights(grid: Grid) -> list[int]:
    return sorted({round(i * (len(grid.z) - 1) / (ROWS - 1)) for i in range(ROWS)}, reverse=True)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
