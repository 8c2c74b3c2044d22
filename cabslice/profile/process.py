"""What a process file may say: how a part is cut into layers and beads."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cabslice.profile.printer import Name, Table
from cabslice.profile.stand import Adaptive, Brim, Raft, Range, Support

Speed = Annotated[float, Field(gt=0, le=5000)]
LayerNumber = Annotated[int, Field(ge=0, le=1_000_000)]


class Speeds(Table):
    """Nozzle speed asked for each feature, mm/s. Cables, motors and melt flow may make it slower."""

    outer_wall: Speed = Field(description="the wall one sees")
    inner_wall: Speed = Field(description="walls behind it")
    solid_infill: Speed = Field(description="solid layers inside the part")
    top_skin: Speed = Field(description="the topmost solid layer")
    sparse_infill: Speed = Field(description="infill at the density `infill`")
    bridge: Speed = Field(description="beads over air")
    gap_fill: Speed = Field(description="thin leftovers between walls")
    ironing: Speed | None = Field(default=None, description="ironing of top skins; absent: as top_skin")
    skirt: Speed = Field(description="loops around the part")
    support: Speed | None = Field(default=None, description="support; absent: as sparse_infill")
    support_interface: Speed | None = Field(default=None, description="its dense layers; absent: as solid_infill")
    first_layer: Speed = Field(description="highest speed of any bead on the bed")
    travel: Speed = Field(description="moves without a bead")


class Retraction(Table):
    """Filament drawn back where the nozzle travels."""

    length_mm: float = Field(ge=0, le=50, description="filament drawn back before a travel")
    speed_mm_s: float = Field(gt=0, le=500, description="filament speed back")
    prime_speed_mm_s: float = Field(gt=0, le=500, description="filament speed forth again")
    min_travel_mm: float = Field(ge=0, le=1000, description="shorter travels are made without retraction")
    hop_mm: float = Field(default=0.0, ge=0, le=50, description="lift of the nozzle during a retracted travel")
    inside_travel_mm: float = Field(
        default=15.0, ge=0, le=10000,
        description="travels up to this inside the part, hidden from above and below, are made without retraction",
    )
    max_detour: float = Field(
        default=3.0, ge=1, le=100,
        description="a travel is led inside the part, round its walls, where that is at most so many times as long",
    )
    wipe_mm: float = Field(default=0.0, ge=0, le=100, description="way back along the bead while drawing back")
    prime_extra_mm: float = Field(default=0.0, ge=-10, le=10, description="filament primed beyond what was drawn back")
    coast_mm: float = Field(
        default=0.0, ge=0, le=100, description="last part of a bead before a retraction, laid by pressure alone",
    )


class Ironing(Table):
    """A second pass of the hot nozzle over top skins, with little plastic, that makes them smooth."""

    enabled: bool = Field(default=False, description="whether top skins are ironed")
    spacing_mm: float = Field(default=0.1, gt=0.01, le=5, description="distance of the lines")
    flow: float = Field(default=0.15, ge=0.01, le=1, description="plastic, as a share of what a layer would hold")


class Compensation(Table):
    """By how much outlines are moved, so that the print has the size of the part."""

    outlines_mm: float = Field(default=0.0, ge=-5, le=5, description="outer outlines move outwards; < 0 inwards")
    holes_mm: float = Field(default=0.0, ge=-5, le=5, description="holes grow on every side; < 0 shrink")
    first_layer_mm: float = Field(
        default=0.0, ge=0, le=5,
        description="the first layer is drawn in (elephant's foot), but for what is too thin",
    )


class Process(Table):
    """How a part is cut into layers and beads."""

    schema_: Literal[1] = Field(default=1, alias="schema", description="version of this file format")
    name: Name
    description: str = Field(default="", description="one line for lists; never inherited")
    source: str = Field(default="cabslice", description="where the numbers come from")
    nozzle_mm: float = Field(gt=0.05, le=10, description="bore of the nozzle it is made for")
    layer_mm: float = Field(gt=0.02, le=5, description="layer height")
    first_layer_mm: float = Field(gt=0.02, le=5, description="height of the first layer")
    bead_mm: float = Field(gt=0.05, le=20, description="bead width of infill and inner walls")
    outer_bead_mm: float = Field(gt=0.05, le=20, description="bead width of the outer wall")
    first_bead_mm: float = Field(gt=0.05, le=20, description="bead width in the first layer")
    walls: int = Field(ge=0, le=1000, description="number of walls")
    spiral: bool = Field(
        default=False,
        description="a vase: over the bottom layers one wall that rises without a stop, no infill, no top",
    )
    outer_wall_first: bool = Field(default=False, description="outer walls are laid before the inner ones beside them")
    seam: Literal["aligned", "rear", "nearest", "random", "hidden"] = Field(
        default="aligned",
        description="where outer walls begin; hidden: in the sharpest concave corner; aligned: over the last or hidden",
    )
    overhang_speeds_mm_s: Annotated[list[Speed], Field(min_length=4, max_length=4)] | None = Field(
        default=None,
        description="walls with more than 1/4, 1/2, 3/4 and all of their width over air; absent: like other walls",
    )
    top_layers: int = Field(ge=0, le=10000, description="solid layers under every top surface")
    bottom_layers: int = Field(ge=0, le=10000, description="solid layers over every bottom surface")
    infill: float = Field(ge=0, le=1, description="share of the inside that is filled")
    pattern: Literal[
        "rectilinear", "aligned", "grid", "triangles", "cubic", "honeycomb", "gyroid", "concentric",
        "lightning",
    ] = Field(description="infill pattern; rectilinear turns in every layer, aligned does not; lightning: under tops")
    bridge_over_infill: bool = Field(
        default=False, description="solid lines over sparse infill are laid across its lines, at the speed of bridges",
    )
    min_infill_area_mm2: float = Field(
        default=0.0, ge=0, le=1e6, description="connected parts of a layer's inside smaller than this are solid",
    )
    infill_every: int = Field(
        default=1, ge=1, le=100,
        description="layers whose sparse infill is laid at once, as far as the nozzle is as wide as they are high",
    )
    infill_angle_deg: float = Field(
        default=45.0, ge=-360, le=360,
        description="direction of the first infill line, from x",
    )
    skin_angle_deg: Annotated[float, Field(ge=-360, le=360)] | None = Field(
        default=None,
        description="direction of solid lines in the first layer, turned by 90 deg in every next; absent: of infill",
    )
    infill_overlap: float = Field(
        default=0.15, ge=0, le=0.5,
        description="how far infill reaches into the wall, in bead widths",
    )
    skirt_loops: int = Field(default=1, ge=0, le=100, description="loops around the part before the first layer")
    skirt_gap_mm: float = Field(default=5.0, ge=0, le=1000, description="air between what it surrounds and skirt")
    skirt_layers: int = Field(default=1, ge=1, le=100000, description="layers of the skirt")
    skirt_min_mm: float = Field(
        default=0.0, ge=0, le=10000, description="loops are added in the first layer until the skirt is this long")
    resolution_mm: float = Field(default=0.0125, gt=0, le=1, description="outlines are simplified by at most this")
    corner_mm: float = Field(
        default=0.05, gt=0, le=5,
        description="how far the nozzle may leave the toolpath where corners are rounded",
    )
    reroute_travels: bool = Field(
        default=True,
        description="travels in which a cable or the platform would meet the print are led around it, or lifted",
    )
    reorder_islands: bool = Field(
        default=True,
        description="islands of a layer in which a cable would meet another one just laid are laid before that one",
    )
    pause_layers: list[LayerNumber] = Field(
        default=[], max_length=1000, description="layers before which the print pauses, counted from 0",
    )
    filament_change_layers: list[LayerNumber] = Field(
        default=[], max_length=1000, description="layers before which the filament is changed, counted from 0",
    )
    compensation: Compensation = Compensation()
    ironing: Ironing = Ironing()
    speeds_mm_s: Speeds
    retraction: Retraction
    adaptive: Adaptive = Adaptive()
    ranges: list[Range] = Field(default=[], max_length=1000, description="other values between two heights")
    brim: Brim = Brim()
    raft: Raft = Raft()
    support: Support = Support()
