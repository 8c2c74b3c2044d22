"""What a material file may say."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cabslice.profile.printer import Positive, Table

Range = Annotated[list[float], Field(min_length=2, max_length=2)]


class Material(Table):
    """Speeds are advice: outside them a warning, never a refusal. The melt flow is the limit."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    name: str
    description: str = ""
    source: Annotated[str, Field(min_length=1)]
    assumed: list[str] = []
    nozzle_c: Annotated[Range, Field(description="lowest and highest nozzle temperature, degC")]
    bed_c: Annotated[Range, Field(description="lowest and highest bed temperature, degC")]
    speed_mm_s: Annotated[Range, Field(description="usual deposition speed; advice")]
    max_flow_mm3_s: Annotated[float, Field(gt=0, le=5000, description="volumetric flow it melts at; the hard limit")]
    density_g_cm3: Annotated[float, Field(gt=0.1, le=20)]
    price_per_kg: Annotated[Positive | None, Field(description="for the cost of a part")] = None
    fan: Annotated[float, Field(ge=0, le=1, description="part cooling after the first layers")] = 1.0
