"""What a product says in numbers: the same in inspect, in --json and in the header of a motor file.

Every key names its unit; per-cable values are lists in the order of the cables.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.arrays import Array
from cabslice.mesh.part import Part
from cabslice.slicing.layer import Layer, Role
from cabslice.timing.trajectory import Trajectory, sample
from cabslice.toolpath.path import Toolpath

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream

ROWS = 1 << 16   # samples looked at together


def of_part(part: Part) -> dict[str, Any]:
    low, high = part.bounds
    corners = part.vertices[part.faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return {
        "triangles": len(part.faces), "part_mm3": float(volume),
        "size_mm": (high - low).tolist(), "low_mm": low.tolist(), "high_mm": high.tolist(),
    }


def of_layers(layers: tuple[Layer, ...]) -> dict[str, Any]:
    lengths = np.zeros(len(Role))
    for layer in layers:
        lengths += _bead_lengths(layer)
    return {
        "layers": len(layers), "height_mm": float(layers[-1].z_mm) if layers else 0.0,
        "extruded_mm": float(lengths.sum()), "extruded_mm_by_feature": _by_role(lengths),
    }


def of_motion(trajectory: Trajectory, path: Toolpath, period_s: float) -> dict[str, Any]:
    """Time, and the peaks of the nozzle's motion sampled every period_s."""
    speed = acceleration = 0.0
    for times in _times(trajectory.duration, period_s):
        found = sample(trajectory, times)
        speed = max(speed, float(np.linalg.norm(found.rates[:, :3], axis=1).max()))
        acceleration = max(acceleration, float(np.linalg.norm(found.accels[:, :3], axis=1).max()))
    spans = np.diff(trajectory.time)
    by_role = np.bincount(path.role[trajectory.move[:-1]], spans, len(Role))
    return {
        "duration_s": trajectory.duration, "duration_s_by_feature": _by_role(by_role),
        "peak_nozzle_speed_mm_s": speed, "peak_nozzle_acceleration_mm_s2": acceleration,
    }


def of_stream(stream: MotorStream) -> dict[str, Any]:
    """What its header says and, per cable, what its rows say."""
    from cabslice.motors.statistics import statistics

    header = stream.header
    found = statistics(stream).as_dict() | {"duration_s": header["duration_s"]} | dict(header.get("numbers", {}))
    kind = header.get("machine", {}).get("kind")
    return found | ({"machine_kind": kind} if kind else {})


def _times(duration: float, period: float) -> Iterator[Array]:
    count = int(np.ceil(duration / period)) + 1
    for start in range(0, count, ROWS):
        yield np.arange(start, min(start + ROWS, count)) * period


def _bead_lengths(layer: Layer) -> Array:
    """(roles,) mm of centre line per role."""
    beads = layer.beads
    count = np.diff(beads.starts)
    line = np.repeat(np.arange(len(count)), count)
    after = np.arange(1, len(beads.points) + 1)
    last = beads.starts[1:][count > 0] - 1
    after[last] = beads.starts[:-1][count > 0]
    lengths = np.linalg.norm(beads.points[after] - beads.points, axis=1)
    lengths[last] *= beads.closed[count > 0]
    return np.bincount(beads.role[line], lengths, len(Role))


def _by_role(values: Array) -> dict[str, float]:
    return {Role(i).name.lower(): float(value) for i, value in enumerate(values) if value > 0}
