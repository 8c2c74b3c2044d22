"""What a material file may say."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cabslice.profile.printer import Name, Positive, Table

Celsius = Annotated[float, Field(ge=-50, le=1000)]
TemperatureRange = Annotated[list[Celsius], Field(min_length=2, max_length=2)]
SpeedRange = Annotated[list[Positive], Field(min_length=2, max_length=2)]


class Material(Table):
    """Speeds are advice: outside them a warning, never a refusal. The melt flow is the limit."""

    schema_: Literal[1] = Field(default=1, alias="schema", description="version of this file format")
    name: Name
    description: str = Field(default="", description="one line for lists; never inherited")
    source: str = Field(min_length=1, description="where the numbers come from")
    assumed: list[str] = Field(default=[], description="what the source does not give: 'key: what was assumed and why'")
    nozzle_c: TemperatureRange = Field(description="lowest and highest nozzle temperature")
    bed_c: TemperatureRange = Field(description="lowest and highest bed temperature")
    speed_mm_s: SpeedRange = Field(description="usual deposition speed, lowest and highest; advice")
    max_flow_mm3_s: float = Field(gt=0, le=5000, description="volumetric flow it melts at; the hard limit")
    density_g_cm3: float = Field(gt=0.1, le=20, description="for the weight of a part")
    price_per_kg: Positive | None = Field(default=None, description="for the cost of a part")
    fan: float = Field(default=1.0, ge=0, le=1, description="part cooling after the first layers")
    bridge_fan: float | None = Field(default=None, ge=0, le=1, description="part cooling on bridges; default: as `fan`")
    fan_after_layers: int = Field(default=1, ge=0, le=1000, description="layers laid before the fan starts")
    print_nozzle_c: Celsius | None = Field(default=None, description="nozzle; default: the middle of nozzle_c")
    first_nozzle_c: Celsius | None = Field(default=None, description="nozzle in the first layer; default: as later")
    print_bed_c: Celsius | None = Field(default=None, description="bed; default: the middle of bed_c")
    first_bed_c: Celsius | None = Field(default=None, description="bed in the first layer; default: as later")
    min_layer_s: float = Field(
        default=0.0, ge=0, le=3600,
        description="a layer takes at least so long to cool: its beads are slowed, and the rest is waited",
    )
    min_speed_mm_s: float = Field(
        default=10.0, gt=0, le=1000, description="beads are not slowed below this to make min_layer_s",
    )
    pressure_advance_s: float | None = Field(
        default=None, ge=0, le=10, description="pressure or linear advance, written into G-code for its firmware",
    )
