"""What a printer file may say: every key with its unit, its bound and its meaning.

Keys carry their unit in their name. A key without a default must be given: there is no default for what can hurt
(tensions, masses, speeds, travel). What holds between keys (a tension below another, a rank) is in `checks`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Name = Annotated[str, Field(
    min_length=1, json_schema_extra={"default": None}, description="absent: the name of the file; never inherited",
)]
SELDOM: Any = {"seldom": True}            # a table or key that starter files keep as a comment
BY_DEFAULT: Any = {"needed": True}        # may be absent, but not where the kind of its table is the default one
Freedom = Literal["x", "y", "z", "rx", "ry", "rz"]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False)


class Turn(Table):
    """How the platform is turned while it prints, by where the nozzle is: angles at knots, smoothly in between."""

    x_mm: list[float] = Field(default=[0.0], min_length=1, max_length=50, description="knots, bed coordinates, rising")
    y_mm: list[float] = Field(default=[0.0], min_length=1, max_length=50, description="knots, bed coordinates, rising")
    z_mm: list[float] = Field(default=[0.0], min_length=1, max_length=50, description="knots, over the bed, rising")
    angles_deg: list[Vector] = Field(
        min_length=1,
        description="psi, theta, phi (turns about x, y, z) at each x, y, z, that of z fastest; level at home",
    )


class Platform(Table):
    """The moving body that carries the print head."""

    mass_kg: float = Field(gt=0, le=1e5, description="everything that moves: platform, head, hose share")
    inertia_kg_mm2: list[Positive] = Field(
        min_length=3, max_length=3,
        description="inertia xx, yy, zz about the centre of mass, platform axes",
    )
    inertia_products_kg_mm2: Vector = Field(
        default=[0.0, 0.0, 0.0],
        description="elements xy, xz, yz of the inertia matrix beside them",
    )
    centre_of_mass_mm: Vector = Field(default=[0.0, 0.0, 0.0], description="in the platform frame")
    pull_n: Vector = Field(
        default=[0.0, 0.0, 0.0],
        description="steady force of filament tube and hose on the platform, in the axes of the machine",
    )
    pull_n_mm: Vector = Field(default=[0.0, 0.0, 0.0], description="its moment about the platform origin")
    home_mm: Vector = Field(
        default=[0.0, 0.0, 0.0],
        description="platform origin when homed, in the frame of the machine",
    )


    tilt_max_deg: float = Field(
        default=5.0, ge=0, le=45, description="the most the platform may be turned about x and about y while it prints",
    )
    yaw_max_deg: float = Field(
        default=15.0, ge=0, le=90, description="the most the platform may be turned about z while it prints",
    )
    turn: Turn | None = Field(default=None, json_schema_extra=SELDOM)
    hull_mm: list[Vector] = Field(
        default=[],
        description="corners of a convex body that holds the platform, platform frame; or the name of an STL file, "
                    "relative to this one, of which the convex hull is taken; absent: not judged",
    )
    cable_free_mm: float = Field(
        default=20.0, ge=0, le=1000,
        description="of each cable, at the end where it is fastened to a body, not judged against that body",
    )


class Nozzle(Table):
    """Where the bead comes out."""

    diameter_mm: float = Field(gt=0.05, le=10, description="bore")
    offset_mm: Vector = Field(description="nozzle tip in the platform frame")
    hull_mm: list[Vector] = Field(
        default=[],
        description="corners of a convex body that holds the print head, platform frame; or the name of an STL file, "
                    "as platform.hull_mm; absent: not judged",
    )


class Extruder(Table):
    """What pushes and melts the filament."""

    filament_diameter_mm: float = Field(default=1.75, gt=0.5, le=10, description="of the filament as bought")
    max_flow_mm3_s: float = Field(
        gt=0, le=5000,
        description="what the hot end can melt, before the material's own limit",
    )
    max_speed_mm_s: float = Field(gt=0, le=1000, description="filament speed, also of retraction")
    max_acceleration_mm_s2: float = Field(gt=0, le=1e6, description="filament acceleration")
    max_jump_mm_s: float = Field(
        default=5.0, gt=0, le=100,
        description="filament speed step it follows without losing position",
    )
    pressure_advance_s: float = Field(
        default=0.0, ge=0, le=2,
        description="while the nozzle moves, filament runs ahead by this times its speed, to build up the pressure "
                    "that the flow needs; what it asks of the extruder is planned for; needs smoothing_ms; 0: none",
    )


class Bed(Table):
    """The plate the part stands on."""

    z_mm: float = Field(description="height of the bed in the machine frame, at its middle")
    first_layer_offset_mm: float = Field(
        default=0.0, ge=-2, le=2,
        description="what the bed is found to stand higher: below 0 presses the first layer on; moves every layer",
    )
    slope_mm_m: list[Annotated[float, Field(ge=-20, le=20)]] = Field(
        default=[0.0, 0.0], min_length=2, max_length=2,
        description="rise of the plate towards +x and +y, mm per m: every layer follows it",
    )
    centre_mm: list[float] = Field(
        default=[0.0, 0.0], min_length=2, max_length=2,
        description="x, y of its middle, machine frame",
    )
    size_mm: list[Positive] = Field(min_length=2, max_length=2, description="x, y of the plate")


class Motion(Table):
    """Limits of the nozzle's own motion, on top of those of cables and motors."""

    max_speed_mm_s: float = Field(gt=0, le=10000, description="nozzle speed, any move")
    max_acceleration_mm_s2: float | None = Field(
        default=None, gt=0, le=1e6,
        description="nozzle acceleration per axis; absent: only cables and motors limit it",
    )
    smoothing_ms: float = Field(
        default=5.0, ge=0, le=1000,
        description="window over which the nozzle's motion is averaged, so that acceleration ramps; 0: it may step",
    )
    accuracy_um: float | None = Field(
        default=None, gt=0, le=10000, json_schema_extra=SELDOM,
        description="the simulated nozzle stays so near to the planned motion while it lays filament: acceleration is "
                    "lowered until it does; absent: not simulated",
    )


class Start(Table):
    """How a motor file begins at the homing pose and comes back to it."""

    tensioning_s: float = Field(
        default=5.0, gt=0, le=600,
        description="time over which the cables are tensioned at home, before anything moves",
    )
    first_tension: float = Field(
        default=0.3, gt=0, le=1,
        description="level they are tensioned from, as a share of the reference tension",
    )
    speed_mm_s: float = Field(default=20.0, gt=0, le=1000, description="nozzle speed between home and the print")
    lift_mm: float = Field(
        default=5.0, ge=0, le=1000,
        description="height over the first and the last point at which the way from and to home ends and begins",
    )


class Stream(Table):
    """What the drives are told."""

    period_ms: float = Field(default=2.0, ge=0.25, le=50, description="sample time of the drives")


class Gcode(Table):
    """Lines of the printer's own in G-code files; {name} in them stands for a figure (profile.placeholders)."""

    start: str = Field(default="", max_length=20000, description="before the print; {layers} and such filled in")
    end: str = Field(default="", max_length=20000, description="after it; {height_mm} and such are filled in")


class Drives(Table):
    """Servo drives as `simulate --drives cascade` has them: P position, PI velocity; defaults as the thesis' drives."""

    position_gain_1_min: float = Field(default=2000.0, gt=0, le=1e6, description="speed asked per position error")
    velocity_gain_n_m_s: float = Field(default=0.48, gt=0, le=1e4, description="torque per speed error")
    reset_ms: float = Field(default=1.0, gt=0, le=1e4, description="reset time of the velocity loop")
    cycle_us: float = Field(default=125.0, ge=10, le=1e4, description="cycle of the velocity loop")


class Pulley(Table):
    """The swivelling guide pulley on the frame; a groove of radius 0 is an eyelet."""

    groove_radius_mm: float = Field(
        default=0.0, ge=0, le=1000,
        description="0: an eyelet, the cable leaves from the anchor point",
    )
    axis: Vector = Field(
        default=[0.0, 0.0, 1.0],
        description="unit vector: direction in which the cable arrives from the winder",
    )


class Winder(Table):
    """The disc, drum or spool that takes the cable in; the words before a colon are the kinds that have the key."""

    kind: Literal["radial", "spiral", "drum", "spool"] = Field(
        default="radial",
        description="radial: on itself, turn after turn; spiral: radius linear in the angle; drum: side by side in a "
                    "helical groove; spool: anyhow, the radius grows with what is wound (Hangprinter)",
    )
    first_radius_mm: float = Field(gt=0, le=2000, description="cable centre line in layer 0, or at motor angle 0")
    layer_step_mm: float | None = Field(
        default=None, ge=0, le=100, json_schema_extra=BY_DEFAULT,
        description="radial: radius gained per layer beyond those in radii_mm",
    )
    radii_mm: list[Positive] | None = Field(
        default=None, min_length=1,
        description="radial: measured radius of layers 0, 1, ...; layer_step_mm goes on from the last",
    )
    ramp_start_deg: float | None = Field(
        default=None, json_schema_extra=BY_DEFAULT,
        description="radial: motor angle where layer 0 begins to climb to layer 1",
    )
    ramp_end_deg: float | None = Field(
        default=None, json_schema_extra=BY_DEFAULT,
        description="radial: motor angle where layer 1 is reached",
    )
    layers: int | None = Field(
        default=None, ge=1, le=1000, json_schema_extra=BY_DEFAULT,
        description="radial: layers the disc holds",
    )
    radius_per_turn_mm: float | None = Field(
        default=None, gt=0, le=100,
        description="spiral: radius gained per turn of the drum",
    )
    pitch_mm: float | None = Field(
        default=None, ge=-100, le=100,
        description="drum: travel of the cable along the axis per turn; level with the pulley at home_angle_deg",
    )
    buildup_factor_mm: float | None = Field(
        default=None, ge=0, le=100,
        description="spool: radius squared gained per mm of line (M666 Q of a Hangprinter)",
    )
    lines_per_spool: int | None = Field(
        default=None, ge=1, le=100,
        description="spool: lines wound on it side by side; absent: 1",
    )
    gear_ratio: float = Field(default=1.0, gt=0, le=10000, description="motor turns per turn of disc, drum or spool")
    mechanical_advantage: int = Field(
        default=1, ge=1, le=100,
        description="strands between frame and platform: line wound per mm of cable",
    )
    angle_range_deg: list[float] | None = Field(
        default=None, min_length=2, max_length=2,
        description="spiral, drum, spool: motor angles it can turn to; lowest: empty, highest: full",
    )
    home_angle_deg: float = Field(description="multi-turn motor angle with the platform at home")
    centre_mm: Vector | None = Field(
        default=None, json_schema_extra=BY_DEFAULT,
        description="centre of the disc in the machine frame; absent (spool): the line to the pulley is line_mm long",
    )
    line_mm: float | None = Field(
        default=None, ge=0, le=1e5,
        description="spool without centre_mm: constant length of line from spool to anchor; absent: 0",
    )
    routing: Literal["open", "crossed"] = Field(
        default="open",
        description="which common tangent joins disc and pulley",
    )


class Motor(Table):
    """The servo motor of a winder."""

    max_speed_rad_s: float = Field(gt=0, le=1000, description="shaft speed it is used up to")
    continuous_torque_n_m: float = Field(gt=0, le=10000, description="torque it gives without end")
    peak_torque_n_m: float = Field(gt=0, le=10000, description="torque it gives for a moment")
    inertia_kg_mm2: float = Field(ge=0, le=1e9, description="rotor, brake and winder disc")
    friction_n_m: float = Field(default=0.0, ge=0, le=1000, description="Coulomb friction at the shaft")
    counts_per_turn: int | None = Field(
        default=None, ge=1, le=2**32,
        description="position units per motor turn the drive is set to; only files of counts (CiA 402) need it",
    )


class ModulusByTension(Table):
    """The modulus at other tensions than the one modulus_gpa was taken at."""

    tension_n: list[NotNegative] = Field(min_length=2, description="of one strand, rising")
    modulus_gpa: list[Positive] = Field(min_length=2, description="there; straight between, constant beyond the ends")


class ModulusByFrequency(Table):
    """The modulus at other frequencies than the one modulus_gpa was taken at."""

    frequency_hz: list[Positive] = Field(min_length=2, description="of the vibration, rising")
    modulus_gpa: list[Positive] = Field(
        min_length=2,
        description="there; straight over the logarithm between, constant beyond the ends",
    )


class Damping(Table):
    """Kelvin-Voigt damping: a cable of rest length l0 damps with c = damping_n_s / l0."""

    frequency_hz: list[Positive] = Field(min_length=1, description="of the vibration, rising")
    damping_n_s: list[Positive] = Field(
        min_length=1,
        description="there, viscosity times section: N per 1/s of strain; a power law between, constant beyond",
    )


class Creep(Table):
    """Tension lost by a tensioned cable that is left alone, growing with the logarithm of time."""

    loss: float = Field(ge=0, lt=1, description="share of the tension lost after after_s")
    after_s: float = Field(gt=0, le=1e9, description="time since tensioning that loss was measured at")
    onset_s: float = Field(gt=0, le=1e9, description="time up to which the loss grows in proportion to time")


class Cable(Table):
    """One cable, after the keys shared by all cables were filled in from [cables]."""

    anchor_mm: Vector = Field(description="where the cable enters its pulley (or its eyelet), machine frame")
    attachment_mm: Vector = Field(description="on the platform, platform frame")
    diameter_mm: float = Field(ge=0, le=100, description="of the skin; 0: a line without thickness")
    modulus_gpa: float | None = Field(
        default=None, gt=0, le=1000, json_schema_extra=BY_DEFAULT,
        description="Young's modulus of the cable on its full circle",
    )
    axial_stiffness_n: float | None = Field(
        default=None, gt=0, le=1e10,
        description="instead of modulus_gpa: force per unit strain of one strand",
    )
    min_tension_n: float = Field(ge=0, le=1e6, description="below it the cable may go slack")
    max_tension_n: float = Field(gt=0, le=1e6, description="what cable, platform and motor bear")
    reference_tension_n: float = Field(gt=0, le=1e6, description="level the tensions are kept near")
    clearance_mm: float = Field(ge=0, le=1000, description="air wanted between the cable's skin and anything else")
    pulley: Pulley = Pulley()
    winder: Winder | None = None
    motor: Motor | None = None
    modulus_by_tension: ModulusByTension | None = Field(default=None, json_schema_extra=SELDOM)
    modulus_by_frequency: ModulusByFrequency | None = Field(default=None, json_schema_extra=SELDOM)
    damping: Damping | None = Field(default=None, json_schema_extra=SELDOM)
    creep: Creep | None = Field(default=None, json_schema_extra=SELDOM)


class Delta(Table):
    """The rails, arms and motors of a linear Delta: three of each, alike. Its platform does not turn."""

    arm_mm: float = Field(gt=0, le=1e5, description="length of the arms, joint to joint")
    radius_mm: float = Field(
        gt=0, le=1e5,
        description="R - r: from the middle to a carriage's joint, less from the platform's middle to its joint",
    )
    rail_angles_deg: Vector = Field(default=[0.0, 120.0, 240.0], description="where the rails stand, from the x axis")
    travel_mm: list[float] = Field(
        min_length=2, max_length=2,
        description="lowest and highest the joint of a carriage can be, machine frame",
    )
    max_arm_angle_deg: float = Field(gt=0, lt=90, description="of an arm from the vertical, what its joints allow")
    carriage_mass_kg: float = Field(ge=0, le=1e4, description="one carriage with half of its arms")
    max_acceleration_mm_s2: float | None = Field(
        default=None, gt=0, le=1e6,
        description="of a carriage; absent: only its motor limits it",
    )
    belt_radius_mm: float = Field(gt=0, le=1000, description="of the belt's pitch line on the motor's pulley")
    home_angle_deg: float = Field(default=0.0, description="multi-turn motor angles with the platform at home")
    motor: Motor = Field(json_schema_extra=SELDOM, description="of each carriage; above 0 it lifts")


class Defaults(Table):
    """What is used when the command line does not say."""

    material: str | None = Field(default=None, description="material when -m is absent")
    process: str | None = Field(default=None, description="process when --process is absent")


class Printer(Table):
    """A cable printer, or a linear Delta. `assumed` names what the source does not give."""

    schema_: Literal[1] = Field(default=1, alias="schema", description="version of this file format")
    name: Name
    kind: Literal["cable", "linear-delta"] = Field(
        default="cable",
        description="what drives the platform: cables, or carriages on three upright rails (table delta)",
    )
    description: str = Field(default="", description="one line for lists; never inherited")
    source: str = Field(min_length=1, description="where the numbers come from")
    assumed: list[str] = Field(default=[], description="what the source does not give: 'key: what was assumed and why'")
    freedoms: list[Freedom] = Field(
        default=["x", "y", "z", "rx", "ry", "rz"], min_length=1, max_length=6,
        description="what the cables hold",
    )
    gravity_mm_s2: float = Field(
        default=9806.65, ge=0, le=1e5,
        description="downwards; 0: the machine lies flat, or is not meant to feel its weight",
    )
    platform: Platform
    nozzle: Nozzle | None = None
    extruder: Extruder | None = None
    bed: Bed | None = None
    motion: Motion | None = None
    start: Start = Start()
    stream: Stream = Stream()
    gcode: Gcode = Gcode()
    drives: Drives = Drives()
    obstacles_mm: list[list[Vector]] = Field(
        default=[],
        description="convex bodies around the machine (beams of the frame), each by its corners in the machine frame, "
                    "or by the name of an STL file, as platform.hull_mm",
    )
    defaults: Defaults = Defaults()
    delta: Delta | None = Field(default=None, json_schema_extra=SELDOM)
    cable: list[Cable] = Field(
        default=[], json_schema_extra=BY_DEFAULT,
        description="one [[cable]] each; keys common to all stand in [cables]",
    )
