"""Which settings of PrusaSlicer and Cura are which keys of a process and a material.

A rule gives a key its value out of the settings, or None where they do not say. Percentages are of another setting.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cabslice.profile.toml import Place

ANY_LENGTH, ANY_DETOUR = 10000.0, 100.0   # the bounds of retraction.inside_travel_mm and max_detour
AUTO_WIDTH = 1.125   # of the nozzle: PrusaSlicer's automatic extrusion width


@dataclass
class Settings:
    """Settings as texts; `asked` are those that were looked at on the way to another's value."""

    texts: Mapping[str, str]
    asked: set[str] = field(default_factory=set)

    def text(self, key: str) -> str | None:
        """The first of a list of values, one an extruder; None where it is absent or left to be computed (nil)."""
        found = self.texts.get(key)
        if found is None:
            return None
        self.asked.add(key)
        found = found.split(";")[0].split(",")[0].strip().strip('"')
        return None if found in ("", "nil") or found.startswith("=") else found

    def number(self, key: str, *of: str) -> float | None:
        """A number; "50%" is that of the first setting in `of` that has a value, of 1 without `of`."""
        text = self.text(key)
        if text is None:
            return None
        try:
            if not text.endswith("%"):
                return float(text)
            share = float(text[:-1]) / 100
        except ValueError:
            return None
        if not of:
            return share
        whole = self.number(of[0], *of[1:])
        return None if whole is None else share * whole

    def on(self, key: str) -> bool | None:
        text = self.text(key)
        return None if text is None else text.lower() in ("1", "true", "yes")


@dataclass(frozen=True)
class Rule:
    place: Place
    keys: tuple[str, ...]
    read: Callable[[Settings], Any]
    of_material: bool = False

    def value(self, settings: Settings) -> Any:
        return self.read(settings) if any(key in settings.texts for key in self.keys) else None


def _number(key: str, *of: str, times: float = 1.0, above: float = -1e9) -> Callable[[Settings], float | None]:
    def read(settings: Settings) -> float | None:
        found = settings.number(key, *of)
        return round(found * times, 6) if found is not None and found > above else None
    return read


def _whole(key: str) -> Callable[[Settings], int | None]:
    def read(settings: Settings) -> int | None:
        found = settings.number(key)
        return None if found is None else round(found)
    return read


def _share(key: str) -> Callable[[Settings], float | None]:
    """0..1 of a percentage that may be written without its sign."""
    def read(settings: Settings) -> float | None:
        found, text = settings.number(key), settings.text(key)
        return None if found is None or text is None else round(found if text.endswith("%") else found / 100, 6)
    return read


def _switch(key: str) -> Callable[[Settings], bool | None]:
    return lambda settings: settings.on(key)


def _choice(key: str, names: Mapping[str, str]) -> Callable[[Settings], str | None]:
    return lambda settings: names.get((settings.text(key) or "").lower())


def _width(*keys: str) -> Callable[[Settings], float | None]:
    """PrusaSlicer's widths: in mm, in percent of the layer height, 0: as the next of `keys`, at last automatic."""
    def read(settings: Settings) -> float | None:
        height = "first_layer_height" if keys[0].startswith("first") else "layer_height"
        for key in keys:
            if (found := settings.number(key, height, "layer_height")) is not None and found > 0:
                return round(found, 6)
        nozzle = settings.number("nozzle_diameter")
        return None if nozzle is None else round(AUTO_WIDTH * nozzle, 6)
    return read


def _if_on(switch: str, read: Callable[[Settings], Any], otherwise: Any = None) -> Callable[[Settings], Any]:
    return lambda settings: read(settings) if settings.on(switch) in (None, True) else otherwise


def _rule(place: str, key: str, read: Callable[[Settings], Any] | None = None, *more: str) -> Rule:
    return Rule(tuple(place.split(".")), (key, *more), read or _number(key))


def _of(place: str, key: str, read: Callable[[Settings], Any] | None = None, *more: str) -> Rule:
    return Rule((place,), (key, *more), read or _number(key, above=0.0), of_material=True)


def _prime(settings: Settings) -> float | None:
    return settings.number("deretract_speed") or settings.number("retract_speed")


def _overhang(settings: Settings) -> float | None:
    """PrusaSlicer counts from the bed, 0 is automatic."""
    found = settings.number("support_material_threshold")
    return 90 - found if found else None


PATTERNS = {
    "rectilinear": "rectilinear", "alignedrectilinear": "aligned", "grid": "grid", "triangles": "triangles",
    "cubic": "cubic", "honeycomb": "honeycomb", "gyroid": "gyroid", "concentric": "concentric",
    "lines": "rectilinear", "zigzag": "rectilinear", "line": "rectilinear", "monotonic": "rectilinear",
}
SEAMS = {"aligned": "aligned", "rear": "rear", "nearest": "nearest", "random": "random"}
CURA_SEAMS = {"back": "rear", "shortest": "nearest", "random": "random", "sharpest_corner": "hidden"}
YES_NO = {"0": "none", "1": "straight", "true": "straight", "false": "none"}
P, S, R = "perimeter_speed", "speeds_mm_s.", "retraction."

PRUSA = (
    _rule("nozzle_mm", "nozzle_diameter"), _rule("layer_mm", "layer_height"),
    _rule("first_layer_mm", "first_layer_height", _number("first_layer_height", "layer_height")),
    _rule("bead_mm", "infill_extrusion_width", _width("infill_extrusion_width", "extrusion_width"), "extrusion_width"),
    _rule("outer_bead_mm", "external_perimeter_extrusion_width",
          _width("external_perimeter_extrusion_width", "extrusion_width")),
    _rule("first_bead_mm", "first_layer_extrusion_width", _width("first_layer_extrusion_width", "extrusion_width")),
    _rule("walls", "perimeters", _whole("perimeters")), _rule("spiral", "spiral_vase", _switch("spiral_vase")),
    _rule("outer_wall_first", "external_perimeters_first", _switch("external_perimeters_first")),
    _rule("seam", "seam_position", _choice("seam_position", SEAMS)),
    _rule("top_layers", "top_solid_layers", _whole("top_solid_layers")),
    _rule("bottom_layers", "bottom_solid_layers", _whole("bottom_solid_layers")),
    _rule("infill", "fill_density", _share("fill_density")), _rule("pattern", "fill_pattern",
                                                                   _choice("fill_pattern", PATTERNS)),
    _rule("infill_every", "infill_every_layers", _whole("infill_every_layers")),
    _rule("min_infill_area_mm2", "solid_infill_below_area"),
    _rule("ironing.enabled", "ironing", _switch("ironing")), _rule("ironing.spacing_mm", "ironing_spacing"),
    _rule("ironing.flow", "ironing_flowrate", _share("ironing_flowrate")),
    _rule(S + "ironing", "ironing_speed", _number("ironing_speed", above=0.0)),
    _rule("infill_angle_deg", "fill_angle"), _rule("infill_overlap", "infill_overlap", _share("infill_overlap")),
    _rule("skirt_loops", "skirts", _whole("skirts")), _rule("skirt_gap_mm", "skirt_distance"),
    _rule("skirt_layers", "skirt_height", lambda settings: max(_whole("skirt_height")(settings) or 1, 1)),
    _rule("skirt_min_mm", "min_skirt_length"),
    _rule("compensation.outlines_mm", "xy_size_compensation"),
    _rule("compensation.first_layer_mm", "elefant_foot_compensation"),
    _rule("brim.width_mm", "brim_width"), _rule("raft.layers", "raft_layers", _whole("raft_layers")),
    _rule("support.kind", "support_material", _choice("support_material", YES_NO)),
    _rule("support.angle_deg", "support_material_threshold", _overhang),
    _rule(S + "outer_wall", "external_perimeter_speed", _number("external_perimeter_speed", P, above=0.0)),
    _rule(S + "inner_wall", P, _number(P, above=0.0)),
    _rule(S + "solid_infill", "solid_infill_speed", _number("solid_infill_speed", "infill_speed", above=0.0)),
    _rule(S + "top_skin", "top_solid_infill_speed",
          _number("top_solid_infill_speed", "solid_infill_speed", "infill_speed", above=0.0)),
    _rule(S + "sparse_infill", "infill_speed", _number("infill_speed", above=0.0)),
    _rule(S + "bridge", "bridge_speed", _number("bridge_speed", above=0.0)),
    _rule(S + "gap_fill", "gap_fill_speed", _number("gap_fill_speed", above=0.0)),
    _rule(S + "support", "support_material_speed", _number("support_material_speed", above=0.0)),
    _rule(S + "support_interface", "support_material_interface_speed",
          _number("support_material_interface_speed", "support_material_speed", above=0.0)),
    _rule(S + "first_layer", "first_layer_speed", _number("first_layer_speed", P, above=0.0)),
    _rule(S + "travel", "travel_speed", _number("travel_speed", above=0.0)),
    _rule(R + "length_mm", "retract_length"), _rule(R + "speed_mm_s", "retract_speed"),
    _rule(R + "prime_speed_mm_s", "retract_speed", _prime, "deretract_speed"),
    _rule(R + "min_travel_mm", "retract_before_travel"), _rule(R + "hop_mm", "retract_lift"),
    _rule(R + "prime_extra_mm", "retract_restart_extra"),
    _rule(R + "inside_travel_mm", "only_retract_when_crossing_perimeters",
          _if_on("only_retract_when_crossing_perimeters", lambda settings: ANY_LENGTH, 0.0)),
    _rule(R + "max_detour", "avoid_crossing_perimeters",
          _if_on("avoid_crossing_perimeters", lambda settings: ANY_DETOUR, 1.0)),
    _of("print_nozzle_c", "temperature"), _of("first_nozzle_c", "first_layer_temperature"),
    _of("print_bed_c", "bed_temperature", _number("bed_temperature")),
    _of("first_bed_c", "first_layer_bed_temperature", _number("first_layer_bed_temperature")),
    _of("density_g_cm3", "filament_density"), _of("price_per_kg", "filament_cost"),
    _of("max_flow_mm3_s", "filament_max_volumetric_speed"),
    _of("fan", "max_fan_speed", _share("max_fan_speed")), _of("bridge_fan", "bridge_fan_speed",
                                                              _share("bridge_fan_speed")),
    _of("fan_after_layers", "disable_fan_first_layers", _whole("disable_fan_first_layers")),
    _of("min_layer_s", "slowdown_below_layer_time", _if_on("cooling", _number("slowdown_below_layer_time"), 0.0)),
    _of("min_speed_mm_s", "min_print_speed"),
)
CURA = (
    _rule("nozzle_mm", "machine_nozzle_size"), _rule("layer_mm", "layer_height"),
    _rule("first_layer_mm", "layer_height_0"), _rule("bead_mm", "line_width"),
    _rule("outer_bead_mm", "wall_line_width_0"), _rule("walls", "wall_line_count", _whole("wall_line_count")),
    _rule("spiral", "magic_spiralize", _switch("magic_spiralize")),
    _rule("outer_wall_first", "outer_inset_first", _switch("outer_inset_first")),
    _rule("seam", "z_seam_type", _choice("z_seam_type", CURA_SEAMS)),
    _rule("top_layers", "top_layers", _whole("top_layers")),
    _rule("bottom_layers", "bottom_layers", _whole("bottom_layers")),
    _rule("infill", "infill_sparse_density", _share("infill_sparse_density")),
    _rule("pattern", "infill_pattern", _choice("infill_pattern", PATTERNS)),
    _rule("infill_overlap", "infill_overlap", _share("infill_overlap")),
    _rule("skirt_loops", "skirt_line_count", _whole("skirt_line_count")), _rule("skirt_gap_mm", "skirt_gap"),
    _rule("skirt_min_mm", "skirt_brim_minimal_length"),
    _rule("brim.width_mm", "brim_width", lambda settings: settings.number("brim_width")
          if settings.text("adhesion_type") == "brim" else None),
    _rule("support.kind", "support_enable", _choice("support_enable", YES_NO)),
    _rule("support.angle_deg", "support_angle"),
    _rule("compensation.outlines_mm", "xy_offset"), _rule("compensation.holes_mm", "hole_xy_offset"),
    _rule(S + "outer_wall", "speed_wall_0"), _rule(S + "inner_wall", "speed_wall_x"),
    _rule(S + "solid_infill", "speed_topbottom"), _rule(S + "top_skin", "speed_topbottom"),
    _rule(S + "sparse_infill", "speed_infill"), _rule(S + "skirt", "skirt_brim_speed"),
    _rule(S + "support", "speed_support"), _rule(S + "first_layer", "speed_print_layer_0", None, "speed_layer_0"),
    _rule(S + "travel", "speed_travel"),
    _rule(R + "length_mm", "retraction_amount", _if_on("retraction_enable", _number("retraction_amount"), 0.0)),
    _rule(R + "speed_mm_s", "retraction_speed"), _rule(R + "prime_speed_mm_s", "retraction_speed"),
    _rule(R + "min_travel_mm", "retraction_min_travel"),
    _rule(R + "hop_mm", "retraction_hop", _if_on("retraction_hop_enabled", _number("retraction_hop"), 0.0)),
    _rule(R + "inside_travel_mm", "retraction_combing_max_distance",
          _number("retraction_combing_max_distance", above=0.0)),
    _of("print_nozzle_c", "material_print_temperature"),
    _of("first_nozzle_c", "material_print_temperature_layer_0"),
    _of("print_bed_c", "material_bed_temperature", _number("material_bed_temperature")),
    _of("first_bed_c", "material_bed_temperature_layer_0", _number("material_bed_temperature_layer_0")),
    _of("fan", "cool_fan_speed", _if_on("cool_fan_enabled", _share("cool_fan_speed"), 0.0)),
    _of("min_layer_s", "cool_min_layer_time", _number("cool_min_layer_time")),
    _of("min_speed_mm_s", "cool_min_speed"),
)
