"""What stiffness says in numbers: the same in --json, in tables and in saved files.

Every key names its unit. Diagonals of K: translations x, y, z in kN/m, rotations about x, y, z in N m/deg, machine axes
(at a level platform the papers' psi, theta, phi); k_ is the sum of k_cable_, k_lat_ and k_force_.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.held import Held, hold, softest
from cabslice.robot.model import Robot
from cabslice.robot.nullspace import blocks

N_M_PER_DEG = 1e-3 * np.pi / 180      # of 1 N mm/rad; 1 N/mm is 1 kN/m
BLOCK = 4096                          # poses whose matrices are in memory together
PARTS = {"k_cable_": "cable", "k_lat_": "lateral", "k_force_": "force", "k_": "total"}


def of_held(robot: Robot, held: Held) -> dict[str, Array]:
    """Columns of K poses by key, (K, 3), (K, f), (K, m) or (K,); nan where the pose is not held."""
    found: dict[str, Array] = {}
    for prefix, part in PARTS.items():
        diagonal = np.einsum("kii->ki", getattr(held.stiffness, part))
        found[f"{prefix}trans_kn_m"], found[f"{prefix}rot_n_m_deg"] = diagonal[:, :3], diagonal[:, 3:] * N_M_PER_DEG
    return found | {
        "modes_hz": held.modes_hz, "modes_k_cable_hz": held.cable_modes_hz, "tensions_n": held.tensions.tension,
        "mean_tension_n": held.tensions.tension.mean(axis=1), "margin_n": held.tensions.margin,
        "k_nozzle_least_kn_m": softest(robot, held),
    }


def of_poses(
    robot: Robot, poses: Array, *, method: str = "nearest", preload: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Array]:
    """of_held for any number of poses (K, 6), in blocks; `progress` is told the poses done. Errors as held.hold."""
    parts = []
    for part in blocks(len(poses), BLOCK):
        parts.append(of_held(robot, hold(robot, poses[part], method=method, preload=preload)))
        if progress:
            progress(min(part.stop, len(poses)))
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def one_or_rows(columns: Mapping[str, Array]) -> dict[str, Any]:
    """For JSON: a single pose as it is, several as a row each."""
    return {key: (column[0] if len(column) == 1 else column).tolist() for key, column in columns.items()}


def over_nodes(columns: Mapping[str, Array]) -> dict[str, Any]:
    """For JSON: under each key the mean over the nodes that are held, and the extremes as min_ and max_ of it."""
    held = np.isfinite(columns["mean_tension_n"])
    found: dict[str, Any] = {}
    for key, column in columns.items():
        values = column[held]
        found |= {key: values.mean(axis=0).tolist(), f"min_{key}": values.min(axis=0).tolist(),
                  f"max_{key}": values.max(axis=0).tolist()}
    return found
