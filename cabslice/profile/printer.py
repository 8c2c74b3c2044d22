"""What a printer file may say: every key with its unit, its bound and its meaning.

Keys carry their unit in their name. A key without a default must be given: there is no default for what can hurt
(tensions, masses, speeds, travel).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class Platform(Table):
    """The moving body that carries the print head."""

    mass_kg: Annotated[float, Field(gt=0, le=1e5, description="everything that moves: platform, head, hose share")]
    inertia_kg_mm2: Annotated[
        list[float], Field(min_length=3, max_length=3, description="principal inertia about the centre of mass")
    ]
    centre_of_mass_mm: Annotated[Vector, Field(description="in the platform frame")] = [0.0, 0.0, 0.0]
    home_mm: Annotated[Vector, Field(description="platform origin when homed, in the frame of the machine")] = [0.0, 0.0, 0.0]


class Nozzle(Table):
    diameter_mm: Annotated[float, Field(gt=0.05, le=10, description="bore")]
    offset_mm: Annotated[Vector, Field(description="nozzle tip in the platform frame")]


class Extruder(Table):
    filament_diameter_mm: Annotated[float, Field(gt=0.5, le=10)] = 1.75
    max_flow_mm3_s: Annotated[float, Field(gt=0, le=5000, description="what the hot end can melt, before the material's own limit")]
    max_speed_mm_s: Annotated[float, Field(gt=0, le=1000, description="filament speed, also of retraction")]
    max_acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e6, description="filament acceleration")]
    max_jump_mm_s: Annotated[float, Field(gt=0, le=100, description="filament speed step it follows without losing position")] = 5.0


class Bed(Table):
    z_mm: Annotated[float, Field(description="height of the bed in the machine frame")]
    centre_mm: Annotated[list[float], Field(min_length=2, max_length=2, description="x, y of its middle")] = [0.0, 0.0]
    size_mm: Annotated[list[Positive], Field(min_length=2, max_length=2, description="x, y of the plate")]


class Motion(Table):
    max_speed_mm_s: Annotated[float, Field(gt=0, le=10000, description="nozzle speed, any move")]
    max_acceleration_mm_s2: Annotated[
        float | None, Field(gt=0, le=1e6, description="nozzle acceleration per axis; absent: only cables and motors limit it")
    ] = None


class Stream(Table):
    period_ms: Annotated[float, Field(ge=0.25, le=50, description="sample time of the drives")] = 2.0


class Pulley(Table):
    groove_radius_mm: Annotated[float, Field(ge=0, le=1000, description="0: an eyelet, the cable leaves from the anchor point")] = 0.0
    axis: Annotated[Vector, Field(description="unit vector: direction in which the cable arrives from the winder")] = [0.0, 0.0, 1.0]


class Winder(Table):
    kind: Annotated[Literal["radial"], Field(description="radial: the cable stacks on itself turn after turn")] = "radial"
    first_radius_mm: Annotated[float, Field(gt=0, le=2000, description="cable centre line in layer 0")]
    layer_step_mm: Annotated[float, Field(ge=0, le=100, description="radius gained per layer where radii_mm is absent")]
    radii_mm: Annotated[list[Positive] | None, Field(min_length=1, description="measured radius of layers 0, 1, ...")] = None
    ramp_start_deg: Annotated[float, Field(description="motor angle where layer 0 begins to climb to layer 1")]
    ramp_end_deg: Annotated[float, Field(description="motor angle where layer 1 is reached")]
    layers: Annotated[int, Field(ge=1, le=1000, description="layers the disc holds")]
    home_angle_deg: Annotated[float, Field(description="multi-turn motor angle with the platform at home")]
    centre_mm: Annotated[Vector, Field(description="centre of the disc in the machine frame")]
    routing: Annotated[Literal["open", "crossed"], Field(description="which common tangent joins disc and pulley")] = "open"


class Motor(Table):
    max_speed_rad_s: Annotated[float, Field(gt=0, le=1000)]
    continuous_torque_n_m: Annotated[float, Field(gt=0, le=10000)]
    peak_torque_n_m: Annotated[float, Field(gt=0, le=10000)]
    inertia_kg_mm2: Annotated[float, Field(ge=0, le=1e9, description="rotor, brake and winder disc")]
    friction_n_m: Annotated[float, Field(ge=0, le=1000, description="Coulomb friction at the shaft")] = 0.0


class Cable(Table):
    """One cable, after the keys shared by all cables were filled in from [cables]."""

    anchor_mm: Annotated[Vector, Field(description="where the cable enters its pulley (or its eyelet), machine frame")]
    attachment_mm: Annotated[Vector, Field(description="on the platform, platform frame")]
    diameter_mm: Annotated[float, Field(gt=0, le=100)]
    modulus_gpa: Annotated[float, Field(gt=0, le=1000)]
    min_tension_n: Annotated[float, Field(ge=0, le=1e6)]
    max_tension_n: Annotated[float, Field(gt=0, le=1e6)]
    reference_tension_n: Annotated[float, Field(gt=0, le=1e6, description="level the tensions are kept near")]
    clearance_mm: Annotated[float, Field(ge=0, le=1000, description="air wanted between the cable's skin and anything else")]
    pulley: Pulley = Pulley()
    winder: Winder
    motor: Motor


class Defaults(Table):
    material: Annotated[str | None, Field(description="material when -m is absent")] = None
    process: Annotated[str | None, Field(description="process when --process is absent")] = None


class Printer(Table):
    """A cable printer. `assumed` names what the source does not give."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    name: str
    kind: Literal["cable"] = "cable"
    description: str = ""
    source: Annotated[str, Field(min_length=1, description="where the numbers come from")]
    assumed: list[str] = []
    freedoms: Annotated[
        list[Literal["x", "y", "z", "rx", "ry", "rz"]], Field(min_length=1, max_length=6, description="what the cables hold")
    ] = ["x", "y", "z", "rx", "ry", "rz"]
    platform: Platform
    nozzle: Nozzle | None = None
    extruder: Extruder | None = None
    bed: Bed | None = None
    motion: Motion | None = None
    stream: Stream = Stream()
    defaults: Defaults = Defaults()
    cable: Annotated[list[Cable], Field(min_length=1)]
