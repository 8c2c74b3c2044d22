"""What an error is made of: each cause switched on alone, beside the robot that is as its profile says.

    cause                      what is played, or looked at
    corner rounding            the motion the file means, from the toolpath
    sampling and quantisation  the file on the robot it is made for, ideal drives: rows a period apart, rounded
    stretch at rest            the other robot (modulus, mass, geometry), motors standing: what it shows under preload
                               and weight, a quadratic through PLACES of the print
    deflection by inertia      what the other robot does beyond that when it moves
    winder radii               the file on its own robot with the winders of the other one
    servo lag                  the file on its own robot, driven by the drives asked for
    calibration                standard deviation by a covariance of the parameters, at PLACES of the print: it is no
                               error of this run, and no part of its total
    interaction                total less the causes played: what is not the sum of its parts
Causes are vectors, row by row: their sum with the interaction is the total. Corner rounding is a distance and apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import UsageError
from cabslice.motors.stream import MotorStream
from cabslice.robot.model import Robot, nozzle_places, nozzle_poses
from cabslice.simulation.deviation import spread
from cabslice.simulation.drives import Drive
from cabslice.simulation.plant import Plant
from cabslice.simulation.prints import Run, Tick, play_all, play_stream
from cabslice.simulation.report import layers_of, rounding
from cabslice.simulation.sensitivity import Standing, parameters, sensitivity, shift, standing
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath

PLACES, CALIBRATED = 300, 60     # of the print, looked at standing
SAME_MM = 1e-12


@dataclass(frozen=True)
class Budget:
    """Errors of the K rows of a run by cause: vectors (K, 3) or distances (K,), mm; rows that lay filament count."""

    total: Run
    causes: Mapping[str, Array]

    def sizes(self) -> dict[str, Array]:
        """Distances (K,) by cause."""
        return {name: np.linalg.norm(column, axis=1) if column.ndim == 2 else column
                for name, column in self.causes.items()}


def budget(
    stream: MotorStream, robot: Robot, meant: Plant, real: Plant, *, drive: Drive | None = None,
    path: Toolpath | None = None, tolerance: float, tick: Tick | None = None,
) -> Budget:
    """Of a file made for `robot` (with the damping of `meant`), played on `real` by drives. Raises as play_stream."""
    turning = real.robot.winders is not None and robot.winders is not None and not _alike(robot, real.robot)
    other = replace(real, robot=replace(real.robot, winders=robot.winders)) if turning else real
    plants = [meant, other, *([replace(meant, robot=replace(robot, winders=real.robot.winders))] if turning else [])]
    base, wrong, *wound = play_all(stream, robot, plants, tolerance=tolerance, tick=tick)
    total = wrong if drive is None and not turning else play_stream(
        stream, robot, real, tolerance=tolerance, drive=drive, tick=tick)
    lag = base if drive is None else play_stream(stream, robot, meant, tolerance=tolerance, drive=drive, tick=tick)
    still = _at_rest(robot, other.robot, base)
    causes = {
        "sampling and quantisation": base.error, "stretch at rest": still,
        "deflection by inertia": wrong.error - base.error - still,
        "winder radii": (wound[0].error if wound else base.error) - base.error, "servo lag": lag.error - base.error,
    }
    causes["interaction"] = total.error - np.sum(list(causes.values()), axis=0)
    return Budget(total, causes | ({} if path is None else {"corner rounding": rounding(total, path)}))


def _alike(robot: Robot, other: Robot) -> bool:
    assert robot.winders is not None
    assert other.winders is not None
    return all(np.array_equal(getattr(robot.winders, name), getattr(other.winders, name), equal_nan=True)
               for name in robot.winders.__dataclass_fields__)


def _poses(robot: Robot, run: Run, count: int) -> Array:
    """Poses (K, 6) of the platform spread evenly over the rows that lay filament."""
    rows = np.flatnonzero(run.laying) if run.laying.any() else np.arange(len(run))
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, count).astype(np.int64)])
    return nozzle_poses(robot, run.wanted[rows].astype(float))


def _at_rest(robot: Robot, real: Robot, run: Run) -> Array:
    """(K, 3) mm"""
    poses = _poses(robot, run, PLACES)
    places = nozzle_places(robot, poses)
    centre, reach = places.mean(axis=0), np.maximum(np.ptp(places, axis=0), 1.0)
    weights = np.linalg.lstsq(_quadratic((places - centre) / reach), shift(standing(robot, poses), real), rcond=1e-9)[0]
    return np.asarray(_quadratic((run.wanted - centre) / reach) @ weights)


def _quadratic(x: Array) -> Array:
    i, j = np.triu_indices(3)
    return np.hstack((np.ones((len(x), 1)), x, x[:, i] * x[:, j]))


def calibration(robot: Robot, run: Run, names: Sequence[str], covariance: Array) -> dict[str, float]:
    """Spread of the standard deviation of the nozzle over the print, by a covariance (P, P) of parameters by name.

    Names and units as in simulation.sensitivity (mm; % of modulus and mass). Raises UsageError for what does not fit.
    """
    known = {one.name: k for k, one in enumerate(parameters(robot))}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise UsageError(f"There is no parameter {unknown[0]!r}; expected for example: {', '.join(list(known)[:9])}.")
    matrix = np.asarray(covariance, dtype=float)
    if matrix.shape != (len(names), len(names)) or not np.isfinite(matrix).all() or np.abs(matrix - matrix.T).max(
            initial=0.0) > 1e-9 * np.abs(matrix).max(initial=1.0):
        raise UsageError(f"A covariance of {len(names)} parameters is a symmetric matrix of as many rows.")
    at: Standing = standing(robot, _poses(robot, run, CALIBRATED))
    slope = sensitivity(at).slope[[known[name] for name in names]]
    return spread(np.sqrt(np.maximum(np.einsum("pki,pq,qki->k", slope, matrix, slope), 0.0)))


def numbers(found: Budget, header: Mapping[str, Any], path: Toolpath | None = None) -> dict[str, Any]:
    """Spreads by cause: over all, by layer and by feature, and what the causes add up to."""
    run, sizes = found.total, found.sizes()
    laying = run.laying if run.laying.any() else np.ones(len(run), bool)
    sizes = {"total": run.distance} | {name: size for name, size in sizes.items() if size[laying].max() > SAME_MM}
    keys = {"layers": layers_of(run, header, path)}
    if path is not None and run.move.min() >= 0:
        keys["features"] = path.role[run.move]
    causes: dict[str, dict[str, Any]] = {}
    for name, size in sizes.items():
        by = {key: _grouped(key, column[laying], size[laying]) for key, column in keys.items()}
        causes[name] = {**spread(size[laying]), **by}
    played = [row for name, row in causes.items() if name not in ("total", "corner rounding")]
    return {
        "method": "each cause switched on alone; vectors by row, their sum with the interaction is the total",
        "causes": causes, "root_sum_square_of_rms_mm": float(np.sqrt(sum(row["rms_mm"] ** 2 for row in played))),
        "sum_of_max_mm": float(sum(row["max_mm"] for row in played)),
    }


def _grouped(kind: str, keys: Array, size: Array) -> dict[str, dict[str, float]]:
    order = np.argsort(keys, kind="stable")
    names, starts = np.unique(keys[order], return_index=True)
    parts = np.split(size[order], starts[1:])
    return {Role(name).name.lower() if kind == "features" else str(name): spread(part)
            for name, part in zip(names.tolist(), parts, strict=True)}
