"""How a machine is started with a motor file: the tensioning at home before the motion, and the words that go with it.

Legend
    level   share of the reference tension that the tensions are kept near; it rises from `first` to 1 over `seconds` as
            s(x) = x^3 (10 - 15 x + 6 x^2) with the platform at rest in the first pose of the motion
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array


@dataclass(frozen=True)
class Lead:
    """Rows before the motion, in which the cables are tensioned."""

    seconds: float = 0.0
    first: float = 1.0

    def rows(self, period_s: float) -> int:
        return math.ceil(self.seconds / period_s - 1e-9)

    def level(self, row: Array, period_s: float) -> Array:
        """(K,) at rows (K,)."""
        x = np.clip(np.asarray(row, float) / max(self.rows(period_s), 1), 0.0, 1.0) if self.seconds else np.ones(1)
        rise = x**3 * (10 - 15 * x + 6 * x * x)
        return np.broadcast_to(self.first + (1 - self.first) * rise, np.shape(row))


TENSIONING = [
    "bring the platform to the homing pose, every cable on its winder as the profile says",
    "tension every cable to its reference tension and set encoder i to home.angles_rad[i] (multi-turn)",
    "slacken to start.tensions_n: the motors then stand at start.angles_rad, which is the first row",
    "heat as the events at time 0 say, then play; the first rows tension the cables, nothing moves",
]
RAILS = [
    "bring the platform to the homing pose, every carriage where its motor holds it",
    "set encoder i to home.angles_rad[i] (multi-turn); angles above it lift the carriage",
    "the motors stand at start.angles_rad, which is the first row",
    "heat as the events at time 0 say, then play",
]
REACTION = {
    "underrun": "hold the last position with the torque it was held with, lay no filament, brakes on after 1 s: do not "
                "coast, and do not go on by itself. The motors have stood still at a place that is not in the plan of "
                "the motion: take the print up again with --from-layer.",
    "slack_cable": "a cable below its least tension is no longer a straight line: stop all motors at once, together, "
                   "hold positions; then home and zero again, for the pose is not known any more.",
    "speed_override": "none: the rows are for this period only. Played slower, the inertia they account for is not "
                      "there; another speed is another file (--speed).",
}


def reaction(*, cables: bool) -> dict[str, str]:
    """What drives must do; without cables none can go slack."""
    return {name: words for name, words in REACTION.items() if cables or name != "slack_cable"}


def start_header(header: Mapping[str, Any], lead: Lead, period_s: float) -> dict[str, Any]:
    """What to do before the first row, as JSON; `header` has start_angles_rad, start_tensions_n and machine.home."""
    home = header["machine"]["home"]
    rigid = header["machine"].get("kind") == "linear-delta"
    return {
        "steps": RAILS if rigid else TENSIONING,
        "home_pose": home["pose"], "zero_angles_rad": home["angles_rad"], "zero_tensions_n": home["tensions_n"],
        "angles_rad": header["start_angles_rad"], "tensions_n": header["start_tensions_n"],
        "bed": _bed(header), "tensioning_rows": lead.rows(period_s), "tensioning_s": lead.rows(period_s) * period_s,
        "ends": f"at rest{'' if rigid else ', tensions kept'}: the drives hold the last row",
    }


def _bed(header: Mapping[str, Any]) -> dict[str, Any] | None:
    """The plane z = height + slope (x - centre) the first layer is laid on, machine frame; None where not known."""
    bed = (header.get("printer") or {}).get("bed")
    return bed and {
        "centre_mm": bed["centre_mm"], "height_mm": bed["z_mm"] + bed["first_layer_offset_mm"],
        "first_layer_offset_mm": bed["first_layer_offset_mm"], "slope_mm_m": bed["slope_mm_m"],
    }


def after_power_loss(header: Mapping[str, Any], angle: Array) -> list[dict[str, Any]]:
    """What each encoder still knows, for motor angles (m,) rad: a row for each winder."""
    rows = []
    for i, value in enumerate(angle):
        turns = math.floor(value / (2 * math.pi))
        rows.append({
            "winder": i + 1, "angle_rad": float(value), "turn": turns, "within_turn_rad": float(value % (2 * math.pi)),
            "multi_turn_absolute": "nothing to do",
            "single_turn_absolute": f"the count of turns is lost: set it to {turns} while the platform is held within "
                                    "half a motor turn of this row",
            "incremental": "home and zero again",
        })
    return rows
