"""A toolpath in figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath


def summary(path: Toolpath, *, density_g_cm3: float | None = None) -> dict[str, Any]:
    """Counts, lengths mm, filament mm, volume mm^3, mass g (where a density is given), bounds mm; sums per role too.

    Filament, volume and mass are what is laid; what is drawn back and primed again is counted as retractions.
    """
    sums, drawn_back, layers, bounds = np.zeros((3, len(Role))), np.zeros(2), set[int](), np.empty((0, 3))
    for low, high in path.spans():
        sums += _sums(path, low, high)
        drawn_back += _drawn_back(path, low, high)
        layers.update(np.unique(path.layer[low:high][path.role[low:high] != Role.TRAVEL]).tolist())
        bounds = _bounds(bounds, path, low, high)
    length, filament, moves = sums
    roles = {
        role.name.lower(): _amounts(length[role], filament[role], path, density_g_cm3)
        for role in Role if role != Role.TRAVEL and moves[role]
    }
    total = _amounts(length[1:].sum(), filament[1:].sum(), path, density_g_cm3)
    return {
        "layers": len(layers), "moves": len(path.xyz) - 1, "pieces": max(len(path.starts) - 1, 0),
        "extruded_mm": total["length_mm"], "travel_mm": float(length[Role.TRAVEL]),
        "filament_mm": total["filament_mm"], "volume_mm3": total["volume_mm3"],
        **({"mass_g": total["mass_g"]} if density_g_cm3 is not None else {}),
        "filament_diameter_mm": path.filament_diameter_mm,
        "retractions": int(drawn_back[0]), "retracted_mm": float(drawn_back[1]),
        "bounds_mm": bounds.tolist() if len(bounds) else None,
        "roles": roles, "source": path.source,
    }


def _sums(path: Toolpath, low: int, high: int) -> Array:
    """(3, roles) length mm, filament mm and count of the moves."""
    role, count = path.role[low:high], len(Role)
    return np.stack((
        np.bincount(role, path.lengths_of(low, high), count), np.bincount(role, path.filament[low:high], count),
        np.bincount(role, minlength=count),
    ))


def _drawn_back(path: Toolpath, low: int, high: int) -> Array:
    """(2,) how often filament is drawn back at rest, and how much in all, mm."""
    back = path.filament[low:high] < 0
    travelling = path.role[low:high] == Role.TRAVEL
    still = path.lengths_of(low, high) == 0
    return np.array([(still & back).sum(), -path.filament[low:high][travelling & back].sum()])


def _bounds(known: Array, path: Toolpath, low: int, high: int) -> Array:
    """(2, 3) mm of all beads so far, or (0, 3)."""
    laid = path.role[low:high + 1] != Role.TRAVEL
    ends = (laid | np.append(laid[1:], False))[:high - low]
    places = np.concatenate((known, path.xyz[low:high][ends]))
    return np.stack((places.min(0), places.max(0))) if len(places) else known


def _amounts(length: float, filament: float, path: Toolpath, density_g_cm3: float | None) -> dict[str, float]:
    volume = filament * path.filament_area_mm2
    mass = {"mass_g": float(volume * density_g_cm3 * 1e-3)} if density_g_cm3 is not None else {}
    return {"length_mm": float(length), "filament_mm": float(filament), "volume_mm3": float(volume)} | mass
