"""OrcaSlicer's process, filament and machine settings (JSON), read as PrusaSlicer's under other names.

Widths in percent are of the nozzle, which only a machine names: without it they are not taken.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

SAME = {   # Orca's key: PrusaSlicer's
    "initial_layer_print_height": "first_layer_height", "line_width": "extrusion_width",
    "sparse_infill_line_width": "infill_extrusion_width", "outer_wall_line_width": "external_perimeter_extrusion_width",
    "initial_layer_line_width": "first_layer_extrusion_width", "wall_loops": "perimeters",
    "spiral_mode": "spiral_vase", "top_shell_layers": "top_solid_layers", "bottom_shell_layers": "bottom_solid_layers",
    "sparse_infill_density": "fill_density", "sparse_infill_pattern": "fill_pattern", "infill_direction": "fill_angle",
    "infill_wall_overlap": "infill_overlap", "skirt_loops": "skirts", "enable_support": "support_material",
    "support_threshold_angle": "support_material_threshold", "outer_wall_speed": "external_perimeter_speed",
    "inner_wall_speed": "perimeter_speed", "internal_solid_infill_speed": "solid_infill_speed",
    "top_surface_speed": "top_solid_infill_speed", "sparse_infill_speed": "infill_speed",
    "gap_infill_speed": "gap_fill_speed", "support_speed": "support_material_speed",
    "support_interface_speed": "support_material_interface_speed", "initial_layer_speed": "first_layer_speed",
    "minimum_sparse_infill_area": "solid_infill_below_area", "ironing_flow": "ironing_flowrate",
    "reduce_crossing_wall": "avoid_crossing_perimeters",
    "reduce_infill_retraction": "only_retract_when_crossing_perimeters", "xy_contour_compensation":
    "xy_size_compensation", "retraction_length": "retract_length", "retraction_speed": "retract_speed",
    "deretraction_speed": "deretract_speed", "retraction_minimum_travel": "retract_before_travel",
    "z_hop": "retract_lift", "nozzle_temperature": "temperature",
    "nozzle_temperature_initial_layer": "first_layer_temperature", "hot_plate_temp": "bed_temperature",
    "hot_plate_temp_initial_layer": "first_layer_bed_temperature", "fan_max_speed": "max_fan_speed",
    "overhang_fan_speed": "bridge_fan_speed", "close_fan_the_first_x_layers": "disable_fan_first_layers",
    "slow_down_layer_time": "slowdown_below_layer_time", "slow_down_min_speed": "min_print_speed",
}
AS_THERE = (   # named alike in both
    "layer_height", "nozzle_diameter", "seam_position", "skirt_distance", "skirt_height", "brim_width", "raft_layers",
    "elefant_foot_compensation", "bridge_speed", "travel_speed", "ironing_spacing", "ironing_speed",
    "retract_restart_extra", "filament_type", "filament_density", "filament_cost", "filament_max_volumetric_speed",
)
FILAMENT = tuple(f"filament_{key}" for key in (   # a filament's own, over the machine's
    "retraction_length", "retraction_speed", "deretraction_speed", "retraction_minimum_travel", "z_hop",
))
VALUES: Mapping[str, Mapping[str, str]] = {   # where the words differ
    "seam_position": {"back": "rear"}, "sparse_infill_pattern": {"zig-zag": "rectilinear"},
}
SWITCHES: Mapping[str, tuple[str, Mapping[str, str]]] = {   # one word of several: PrusaSlicer's switch
    "wall_sequence": ("external_perimeters_first", {
        "inner wall/outer wall": "0", "inner-outer-inner wall": "0", "outer wall/inner wall": "1"}),
    "wall_infill_order": ("external_perimeters_first", {
        "inner wall/outer wall/infill": "0", "outer wall/inner wall/infill": "1"}),
    "ironing_type": ("ironing", {"no ironing": "0", "top": "1", "topmost": "1", "solid": "1"}),
}
ABOUT = ("type", "name", "from", "inherits", "instantiation", "setting_id", "filament_id", "version")
WIDTHS = tuple(key for key in SAME if key.endswith("line_width"))


def read_orca(told: Any) -> dict[str, str]:
    """PrusaSlicer's settings, and Orca's own under their names where they have no counterpart; {} where it is none."""
    if not isinstance(told, dict) or told.get("type") not in ("process", "filament", "machine"):
        return {}
    texts = {key: _text(value) for key, value in told.items() if key not in ABOUT}
    shares = {key: texts.pop(key) for key in WIDTHS if texts.get(key, "").endswith("%")}
    if nozzle := texts.get("nozzle_diameter"):
        texts |= {key: f"{float(nozzle.split(',')[0]) * float(share[:-1]) / 100:g}" for key, share in shares.items()}
        shares = {}
    found = {key: texts.pop(key) for key in AS_THERE if key in texts}
    found |= {there: texts.pop(key) for key, there in SAME.items() if key in texts}
    for key in FILAMENT:
        if texts.get(key, "nil") != "nil":
            found[SAME[key.removeprefix("filament_")]] = texts.pop(key)
    for key, (there, words) in SWITCHES.items():
        if texts.get(key) in words:
            found[there] = words[texts.pop(key)]
    for key, words in VALUES.items():
        place = SAME.get(key, key)
        if found.get(place) in words:
            found[place] = words[found[place]]
    return texts | found | shares


def orca_settings(text: str) -> dict[str, str]:
    """Raises ValueError where the text is no JSON."""
    return read_orca(json.loads(text))


def _text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)
