"""How far the platform and its nozzle are from where they should be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.robot.model import Robot
from cabslice.robot.rotation import matrix, to_angles, turned


@dataclass(frozen=True)
class Deviation:
    """Of K rows: what is minus what should be, machine axes."""

    nozzle: Array      # (K, 3) mm; of the platform origin where the robot has no nozzle
    origin: Array      # (K, 3) mm, platform origin
    angles: Array      # (K, 3) rad: psi, theta, phi of the turn from the wanted orientation

    def __post_init__(self) -> None:
        shape = Shapes("Deviation")
        set_columns(self, **{name: shape.column(name, getattr(self, name), "K 3") for name in (
            "nozzle", "origin", "angles")})

    @property
    def distance(self) -> Array:
        """(K,) mm of the nozzle."""
        return np.sqrt(np.einsum("ki,ki->k", self.nozzle, self.nozzle))


def deviation(robot: Robot, poses: Array, wanted: Array) -> Deviation:
    """Of poses (K, 6) from poses wanted (K, 6)."""
    return Deviation(
        nozzle=nozzle_places(robot, poses) - nozzle_places(robot, wanted), origin=poses[:, :3] - wanted[:, :3],
        angles=to_angles(turned(-wanted[:, 3:], poses[:, 3:])))


def nozzle_places(robot: Robot, poses: Array) -> Array:
    """The nozzle (K, 3) mm, machine frame; the platform origin where there is none."""
    if robot.nozzle is None:
        return poses[:, :3]
    return poses[:, :3] + matrix(poses[:, 3:]) @ robot.nozzle


def spread(distance: Array) -> dict[str, float]:
    """Root mean square, the value that 95 % stay below, and the largest of distances (K,) mm."""
    if not len(distance):
        return {"rms_mm": 0.0, "p95_mm": 0.0, "max_mm": 0.0}
    return {"rms_mm": float(np.sqrt(np.mean(distance**2))), "p95_mm": float(np.quantile(distance, 0.95)),
            "max_mm": float(distance.max())}


def peaks(found: Deviation) -> dict[str, Any]:
    """Largest errors by axis, and the spread of the nozzle's."""
    return {
        "max_abs_error_mm": np.abs(found.origin).max(axis=0).tolist(),
        "max_abs_error_deg": np.degrees(np.abs(found.angles)).max(axis=0).tolist(),
        "nozzle_error": spread(found.distance),
    }
