"""A toolpath in figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath


def summary(path: Toolpath, *, density_g_cm3: float | None = None) -> dict[str, Any]:
    """Counts, lengths mm, filament mm, volume mm^3, mass g (where a density is given), bounds mm; sums per role too.

    Filament, volume and mass are what is laid; what is drawn back and primed again is counted as retractions.
    """
    length, laid = path.lengths, path.role != Role.TRAVEL
    roles = {}
    for role in Role:
        rows = path.role == role
        if role != Role.TRAVEL and rows.any():
            roles[role.name.lower()] = _amounts(length[rows].sum(), path.filament[rows].sum(), path, density_g_cm3)
    total = _amounts(length[laid].sum(), path.filament[laid].sum(), path, density_g_cm3)
    still = length == 0
    places = path.xyz[laid | np.append(laid[1:], False)]
    return {
        "layers": len(np.unique(path.layer[laid])), "moves": len(path.xyz) - 1, "pieces": max(len(path.starts) - 1, 0),
        "extruded_mm": total["length_mm"], "travel_mm": float(length[~laid].sum()),
        "filament_mm": total["filament_mm"], "volume_mm3": total["volume_mm3"],
        **({"mass_g": total["mass_g"]} if density_g_cm3 is not None else {}),
        "filament_diameter_mm": path.filament_diameter_mm,
        "retractions": int((still & (path.filament < 0)).sum()),
        "retracted_mm": float(-path.filament[~laid & (path.filament < 0)].sum()),
        "bounds_mm": [places.min(0).tolist(), places.max(0).tolist()] if len(places) else None,
        "roles": roles, "source": path.source,
    }


def _amounts(length: float, filament: float, path: Toolpath, density_g_cm3: float | None) -> dict[str, float]:
    volume = filament * path.filament_area_mm2
    mass = {"mass_g": float(volume * density_g_cm3 * 1e-3)} if density_g_cm3 is not None else {}
    return {"length_mm": float(length), "filament_mm": float(filament), "volume_mm3": float(volume)} | mass
