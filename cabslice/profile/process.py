"""What a process file may say: how a part is cut into layers and beads."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cabslice.profile.printer import Table

Speed = Annotated[float, Field(gt=0, le=5000)]


class Speeds(Table):
    """Nozzle speed asked for each feature, mm/s. Cables, motors and melt flow may make it slower."""

    outer_wall: Speed
    inner_wall: Speed
    solid_infill: Speed
    top_skin: Speed
    sparse_infill: Speed
    bridge: Speed
    gap_fill: Speed
    skirt: Speed
    first_layer: Speed
    travel: Speed


class Retraction(Table):
    length_mm: Annotated[float, Field(ge=0, le=50, description="filament drawn back before a travel")]
    speed_mm_s: Annotated[float, Field(gt=0, le=500)]
    prime_speed_mm_s: Annotated[float, Field(gt=0, le=500)]
    min_travel_mm: Annotated[float, Field(ge=0, le=1000, description="shorter travels are made without retraction")]
    hop_mm: Annotated[float, Field(ge=0, le=50, description="lift of the nozzle during a retracted travel")] = 0.0


class Process(Table):
    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    name: str
    description: str = ""
    source: str = "cabslice"
    nozzle_mm: Annotated[float, Field(gt=0.05, le=10, description="nozzle it is made for")]
    layer_mm: Annotated[float, Field(gt=0.02, le=5, description="layer height")]
    first_layer_mm: Annotated[float, Field(gt=0.02, le=5, description="height of the first layer")]
    bead_mm: Annotated[float, Field(gt=0.05, le=20, description="bead width of infill and inner walls")]
    outer_bead_mm: Annotated[float, Field(gt=0.05, le=20, description="bead width of the outer wall")]
    first_bead_mm: Annotated[float, Field(gt=0.05, le=20, description="bead width in the first layer")]
    walls: Annotated[int, Field(ge=0, le=1000, description="number of walls")]
    top_layers: Annotated[int, Field(ge=0, le=10000, description="solid layers under every top surface")]
    bottom_layers: Annotated[int, Field(ge=0, le=10000, description="solid layers over every bottom surface")]
    infill: Annotated[float, Field(ge=0, le=1, description="share of the inside that is filled")]
    pattern: Annotated[Literal["rectilinear", "grid"], Field(description="infill pattern")]
    infill_angle_deg: Annotated[float, Field(ge=-360, le=360)] = 45.0
    infill_overlap: Annotated[float, Field(ge=0, le=0.5, description="how far infill reaches into the wall, in bead widths")] = 0.15
    skirt_loops: Annotated[int, Field(ge=0, le=100)] = 1
    skirt_gap_mm: Annotated[float, Field(ge=0, le=1000)] = 5.0
    resolution_mm: Annotated[float, Field(gt=0, le=1, description="outlines are simplified by at most this")] = 0.005
    corner_mm: Annotated[
        float, Field(gt=0, le=5, description="how far the nozzle may leave the toolpath where corners are rounded")
    ] = 0.05
    speeds_mm_s: Speeds
    retraction: Retraction
