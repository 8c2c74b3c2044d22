"""The cable robot: one frozen value of columns, the first argument of every function of this wing.

Legend (Gueners 2021; Pott 2018, Cable-Driven Parallel Robots)
    m    number of cables                    K     number of poses
    a_i  anchor: entry point P_i of the pulley, or the eyelet        mm, machine frame
    c_i  attachment                                                  mm, platform frame
    e_z  swivel axis of the pulley: direction in which the cable arrives at P from the winder
    r_p  pulley radius: groove radius + cable radius; 0 is an eyelet  mm
    ES   axial stiffness, N (force per unit strain)
    pose (x, y, z mm, rotation vector rad): platform origin in the machine frame

Forces in N, moments in N mm; 1 kg mm/s^2 = 1e-3 N and 1 kg mm^2/s^2 = 1e-3 N mm (NEWTON).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import ProfileError
from cabslice.robot.rotation import matrix
from cabslice.robot.turning import Turning, turning_of

NEWTON = 1e-3                                  # N per kg mm/s^2, and N mm per kg mm^2/s^2
GRAVITY = np.array([0.0, 0.0, -9806.65])       # mm/s^2


def _zero() -> Array:
    return np.zeros(())


def _one() -> Array:
    return np.ones(())


def _unknown() -> Array:
    return np.array(np.nan)


def _earth() -> Array:
    return GRAVITY


@dataclass(frozen=True)
class WinderColumns:
    """Winders of all cables as columns (see robot.winder for the maths).

    One description holds every kind: the radius at spool angle phi is that of the ramps plus `slope` times phi.
        radial           layers and ramps
        spiral           one layer (or equal ones), slope > 0, span
        helical drum     one layer, axial > 0, span
        build-up spool   spiral with slope = lines per spool x build-up factor / 2, gear and advantage (Hangprinter)
    """

    radii: Array          # (m, n) mm, radius of the cable's centre line in layers 0..n-1
    ramp_start: Array     # (m,) rad of the spool (the motor, without gear), where layer 0 begins to climb
    ramp_end: Array       # (m,) rad of the spool, where layer 1 is reached
    home_angle: Array     # (m,) rad, multi-turn motor angle at the home pose
    centre: Array         # (m, 3) mm, machine frame; nan: not known, the line to the pulley is `line` long
    crossed: Array        # (m,) bool: crossed common tangent; else open
    max_speed: Array      # (m,) rad/s
    continuous_torque: Array   # (m,) N mm
    peak_torque: Array    # (m,) N mm
    inertia: Array        # (m,) kg mm^2
    friction: Array       # (m,) N mm
    # those below may be left out, or be one number for all
    slope: Array = field(default_factory=_zero)     # (m,) mm/rad of the spool, radius gained all along
    axial: Array = field(default_factory=_zero)     # (m,) mm/rad of the spool, signed travel of a helical drum's exit
    gear: Array = field(default_factory=_one)       # (m,) motor turns per spool turn
    advantage: Array = field(default_factory=_one)  # (m,) strands between frame and platform, all on this winder
    line: Array = field(default_factory=_zero)      # (m,) mm, constant line to the pulley where `centre` is nan
    span: Array = field(default_factory=_unknown)   # (m, 2) rad, motor angles it is known for; nan: to its last layer

    def __post_init__(self) -> None:
        shape = Shapes("WinderColumns")
        names = ("ramp_start", "ramp_end", "home_angle", "max_speed", "continuous_torque", "peak_torque", "inertia")
        columns = {name: shape.column(name, getattr(self, name), "m") for name in (*names, "friction")}
        columns["radii"] = shape.column("radii", self.radii, "m n")
        columns["centre"] = shape.column("centre", self.centre, "m 3", finite=False)
        columns["crossed"] = shape.column("crossed", self.crossed, "m", np.bool_)
        for name in ("slope", "axial", "gear", "advantage", "line"):
            value = np.asarray(getattr(self, name))
            columns[name] = shape.column(name, value if value.ndim else np.full(len(self.radii), value), "m")
        set_columns(self, **columns)
        set_columns(self, span=shape.column("span", self._known_span(), "m 2", finite=False))
        _refuse(self._faults())

    def _known_span(self) -> Array:
        """Where `span` is nan: radius r_0 for all angles below layer 0's ramp, and up to the end of the last layer."""
        last = (self.ramp_start + 2 * np.pi * (self.radii.shape[1] - 1)) * self.gear
        known = np.stack((np.full_like(last, -np.inf), last), axis=1)
        return np.where(np.isnan(self.span), known, self.span)

    def _faults(self) -> Iterator[str]:
        """What no winder can be, one sentence each."""
        (low, high), ramp = self.span.T, np.degrees(self.ramp_end - self.ramp_start)
        for i in range(len(self.radii)):
            thinnest = low[i] if self.slope[i] > 0 else high[i]
            least = self.radii[i].min() + (self.slope[i] * thinnest / self.gear[i] if self.slope[i] else 0.0)
            if not least > 0:
                yield f"winder {i + 1}: its radius falls to {least:.3f} mm within its span, expected more than 0"
            if self.radii.shape[1] > 1 and not 0 < ramp[i] <= 360:
                yield f"winder {i + 1}: its ramp spans {ramp[i]:.3f} deg, expected more than 0 and at most 360"
            if not low[i] < high[i]:
                yield f"winder {i + 1}: its span ends at {high[i]:.3f} rad, expected more than {low[i]:.3f}"
            if self.axial[i] and (self.slope[i] or np.ptp(self.radii[i])):
                yield f"winder {i + 1}: a helical drum has one radius, expected no slope and equal layers"
            if not (self.gear[i] > 0 and self.advantage[i] >= 1):
                yield f"winder {i + 1}: expected gear > 0 and mechanical advantage >= 1"


def _refuse(faults: Iterator[str]) -> None:
    sentences = "; ".join(faults)
    if sentences:
        raise ValueError(sentences)


@dataclass(frozen=True)
class Robot:
    anchors: Array             # (m, 3) mm, machine frame
    attachments: Array         # (m, 3) mm, platform frame
    pulley_axes: Array         # (m, 3) unit vectors
    pulley_radii: Array        # (m,) mm, groove + cable radius
    axial_stiffness: Array     # (m,) N, of all strands of a cable together
    cable_radii: Array         # (m,) mm
    clearance: Array           # (m,) mm
    tension_min: Array         # (m,) N
    tension_max: Array         # (m,) N
    tension_reference: Array   # (m,) N
    mass: float                # kg
    inertia: Array             # (3, 3) kg mm^2, about the centre of mass, platform axes
    centre_of_mass: Array      # (3,) mm, platform frame
    home: Array                # (6,) pose
    freedoms: Array            # (6,) bool: x y z rx ry rz
    winders: WinderColumns | None = None
    nozzle: Array | None = None      # (3,) mm, nozzle tip in the platform frame
    bed_origin: Array | None = None  # (3,) mm, middle of the bed in the machine frame
    bed_size: Array | None = None    # (2,) mm
    bed_slope: Array = field(default_factory=lambda: np.zeros(2))   # (2,) rise of the bed per mm along x and y
    gravity: Array = field(default_factory=_earth)   # (3,) mm/s^2, machine frame
    name: str = ""
    bodies: tuple[tuple[str, Array], ...] = ()       # convex, by name: corners (V, 3) mm, platform frame
    obstacles: tuple[tuple[str, Array], ...] = ()    # convex, by name: corners (V, 3) mm, machine frame
    body_free: float = 0.0           # mm of a cable at the body it is fastened to that are not judged against it
    turning: Turning | None = None   # how the platform is turned while it prints; None: level
    pull: Array = field(default_factory=lambda: np.zeros(6))   # (6,) N, N mm at the platform origin, machine axes: hose

    def __post_init__(self) -> None:
        shape = Shapes("Robot")
        vectors = ("anchors", "attachments", "pulley_axes")
        columns = {name: shape.column(name, getattr(self, name), "m 3") for name in vectors}
        bounds = ("tension_min", "tension_max", "tension_reference")
        for name in ("pulley_radii", "axial_stiffness", "cable_radii", "clearance", *bounds):
            columns[name] = shape.column(name, getattr(self, name), "m")
        columns["inertia"] = shape.column("inertia", self.inertia, "3 3")
        columns["centre_of_mass"] = shape.column("centre_of_mass", self.centre_of_mass, "3")
        columns["home"] = shape.column("home", self.home, "6")
        columns["freedoms"] = shape.column("freedoms", self.freedoms, "6", np.bool_)
        columns["bed_slope"] = shape.column("bed_slope", self.bed_slope, "2")
        columns["gravity"] = shape.column("gravity", self.gravity, "3")
        columns["pull"] = shape.column("pull", self.pull, "6")
        for name, size in (("nozzle", "3"), ("bed_origin", "3"), ("bed_size", "2")):
            if getattr(self, name) is not None:
                columns[name] = shape.column(name, getattr(self, name), size)
        set_columns(self, **columns)

    @property
    def cables(self) -> int:
        return len(self.anchors)


def robot_from_printer(printer: Any, *, pulleys: bool = True) -> Robot:
    """The robot part of a printer profile (cabslice.profile.printer.Printer) as columns.

    With ``pulleys=False`` every cable leaves from its anchor point, to compare with papers. Raises ProfileError where
    it is a printer of another kind (robot.delta).
    """
    cables = printer.cable
    if not cables:
        raise ProfileError(printer.name, [
            f'it is a printer of kind "{printer.kind}": expected one with cables, which is what this is about'])
    diameter = np.array([cable.diameter_mm for cable in cables])
    groove = np.array([cable.pulley.groove_radius_mm for cable in cables])
    return Robot(
        anchors=np.array([cable.anchor_mm for cable in cables]),
        attachments=np.array([cable.attachment_mm for cable in cables]),
        pulley_axes=np.array([cable.pulley.axis for cable in cables]),
        pulley_radii=np.where(groove > 0, groove + diameter / 2, 0.0) * pulleys,
        axial_stiffness=np.array([_strand_stiffness(cable) * _strands(cable) for cable in cables]),
        cable_radii=diameter / 2,
        clearance=np.array([cable.clearance_mm for cable in cables]),
        tension_min=np.array([cable.min_tension_n for cable in cables]),
        tension_max=np.array([cable.max_tension_n for cable in cables]),
        tension_reference=np.array([cable.reference_tension_n for cable in cables]),
        mass=printer.platform.mass_kg,
        inertia=_inertia(printer.platform),
        centre_of_mass=np.array(printer.platform.centre_of_mass_mm),
        pull=np.array([*printer.platform.pull_n, *printer.platform.pull_n_mm]),
        home=np.array([*printer.platform.home_mm, 0.0, 0.0, 0.0]),
        freedoms=np.array([freedom in printer.freedoms for freedom in ("x", "y", "z", "rx", "ry", "rz")]),
        winders=_winders(cables) if all(cable.winder for cable in cables) else None,
        nozzle=np.array(printer.nozzle.offset_mm) if printer.nozzle else None,
        bed_origin=_bed_origin(printer.bed) if printer.bed else None,
        bed_slope=np.array(printer.bed.slope_mm_m) / 1e3 if printer.bed else np.zeros(2),
        bed_size=np.array(printer.bed.size_mm) if printer.bed else None,
        gravity=np.array([0.0, 0.0, -printer.gravity_mm_s2]),
        name=printer.name,
        bodies=_hulls(printer),
        obstacles=tuple((f"obstacle {i}", np.array(body)) for i, body in enumerate(printer.obstacles_mm, start=1)),
        body_free=printer.platform.cable_free_mm,
        turning=turning_of(printer, _nozzle_at_home(printer)),
    )


def _nozzle_at_home(printer: Any) -> Array | None:
    if not (printer.nozzle and printer.bed):
        return None
    return np.array(printer.platform.home_mm) + np.array(printer.nozzle.offset_mm) - _bed_origin(printer.bed)


def _bed_origin(bed: Any) -> Array:
    return np.array([*bed.centre_mm, bed.z_mm + bed.first_layer_offset_mm])


def _hulls(printer: Any) -> tuple[tuple[str, Array], ...]:
    given = (("platform", printer.platform.hull_mm), ("print head", printer.nozzle and printer.nozzle.hull_mm))
    return tuple((name, np.array(corners)) for name, corners in given if corners)


def _strand_stiffness(cable: Any) -> float:
    """N per unit strain of one strand: as given, else the modulus on the full circle."""
    given = cable.axial_stiffness_n
    return float(cable.modulus_gpa * 1e3 * np.pi / 4 * cable.diameter_mm**2 if given is None else given)


def _strands(cable: Any) -> int:
    return cable.winder.mechanical_advantage if cable.winder else 1


def _inertia(platform: Any) -> Array:
    xy, xz, yz = platform.inertia_products_kg_mm2
    return np.diag(platform.inertia_kg_mm2) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])


def _winders(cables: Any) -> WinderColumns:
    winders, motors = [cable.winder for cable in cables], [cable.motor for cable in cables]
    layers = max(winder.layers or 1 for winder in winders)
    gear = np.array([winder.gear_ratio for winder in winders])
    ramps = np.radians([_ramp(winder) for winder in winders]) / gear[:, None]
    unknown = (np.nan,) * 3
    return WinderColumns(
        radii=np.array([_layer_radii(winder, layers) for winder in winders]),
        ramp_start=ramps[:, 0],
        ramp_end=ramps[:, 1],
        home_angle=np.radians([winder.home_angle_deg for winder in winders]),
        centre=np.array([winder.centre_mm or unknown for winder in winders], float),
        crossed=np.array([winder.routing == "crossed" for winder in winders]),
        max_speed=np.array([motor.max_speed_rad_s for motor in motors]),
        continuous_torque=np.array([motor.continuous_torque_n_m for motor in motors]) * 1e3,
        peak_torque=np.array([motor.peak_torque_n_m for motor in motors]) * 1e3,
        inertia=np.array([motor.inertia_kg_mm2 for motor in motors]),
        friction=np.array([motor.friction_n_m for motor in motors]) * 1e3,
        slope=np.array([_slope(winder) for winder in winders]),
        axial=np.array([winder.pitch_mm if winder.kind == "drum" else 0.0 for winder in winders]) / (2 * np.pi),
        gear=gear,
        advantage=np.array([winder.mechanical_advantage for winder in winders], float),
        line=np.array([winder.line_mm or 0.0 for winder in winders]),
        span=np.array([_span(winder) for winder in winders]),
    )


def _ramp(winder: Any) -> tuple[float, float]:
    """Degrees; kinds without layers climb nowhere: their radii are all the same."""
    return (winder.ramp_start_deg, winder.ramp_end_deg) if winder.kind == "radial" else (0.0, 180.0 * winder.gear_ratio)


def _slope(winder: Any) -> float:
    """mm per rad of the spool. A spool's r^2 grows by the factor per mm of line: dr/dphi = factor lines / 2."""
    if winder.kind == "spiral":
        return float(winder.radius_per_turn_mm / (2 * np.pi))
    return float(winder.buildup_factor_mm * (winder.lines_per_spool or 1) / 2) if winder.kind == "spool" else 0.0


def _span(winder: Any) -> tuple[float, float]:
    """Motor angles it is known for, rad: of a disc all below the end of its last layer."""
    if winder.kind != "radial":
        low, high = np.radians(winder.angle_range_deg)
        return low, high
    return -np.inf, np.radians(winder.ramp_start_deg) + 2 * np.pi * (winder.layers - 1) * winder.gear_ratio


def _layer_radii(winder: Any, layers: int) -> Array:
    """Radii of layers 0..layers-1: the measured ones, then the nominal step on top of the last of them."""
    if winder.kind != "radial":
        return np.full(layers, winder.first_radius_mm)
    known = winder.radii_mm or [winder.first_radius_mm]
    more = known[-1] + winder.layer_step_mm * np.arange(1, layers - len(known) + 1)
    return np.concatenate((known, more))[:layers]


class WithNozzle(Protocol):
    """A machine of any kind that can print."""

    @property
    def nozzle(self) -> Array | None: ...

    @property
    def bed_origin(self) -> Array | None: ...

    @property
    def turning(self) -> Turning | None: ...


def nozzle_poses(robot: WithNozzle, xyz: Array) -> Array:
    """Platform poses (K, 6), level or as the robot turns, that put the nozzle at xyz (K, 3) mm in bed coordinates."""
    poses = np.zeros((len(xyz), 6))
    poses[:, :3] = xyz + level_shift(robot)
    if robot.turning is not None:
        poses[:, 3:] = robot.turning.vectors(xyz)
        poses[:, :3] += robot.nozzle - matrix(poses[:, 3:]) @ robot.nozzle
    return poses


def nozzle_places(robot: WithNozzle, poses: Array) -> Array:
    """Nozzle tips (K, 3) mm in bed coordinates of poses (K, 6)."""
    shift = level_shift(robot)
    if not poses[:, 3:].any():
        return np.asarray(poses[:, :3] - shift)
    return np.asarray(poses[:, :3] + matrix(poses[:, 3:]) @ robot.nozzle - robot.bed_origin)


def level_shift(robot: WithNozzle) -> Array:
    """(3,) mm: origin of a level platform in the machine frame less the nozzle in bed coordinates."""
    if robot.nozzle is None or robot.bed_origin is None:
        raise ValueError("the robot has no nozzle or no bed")
    return np.asarray(robot.bed_origin - robot.nozzle)


def turned(robot: WithNozzle) -> tuple[Turning | None, Array | None]:
    """How it turns its platform, and the nozzle it turns about; of a level one nothing."""
    return (robot.turning, robot.nozzle) if robot.turning is not None else (None, None)
