"""A linear Delta: three carriages on vertical rails carry the platform by arms of constant length. No cables.

Legend (the answers are known exactly: an oracle for the chain from pose to axis to time)
    p        platform origin (x, y, z) mm, machine frame; the platform neither tilts nor turns
    e_k      direction of rail k from the middle, level, a unit vector
    D        rail's distance less that of the arm's joint on the platform, R - r, mm        L    length of the arms, mm
    s_k      level part of the arm, xy - D e_k        h_k    its height, sqrt(L^2 - |s_k|^2)
    q_k      height of carriage k, z + h_k, mm        J      dq/dp, rows (-s_k / h_k, 1)
    F_k      force of motor k upwards along its rail, N: by virtual work  J^T (F - m_c (q'' + g)) = m (a - g)
    theta_k  motor angle, rad: (q_k - q_k at home) / belt radius + home angle; positive lifts the carriage

Arms are without mass: profiles give half of it to the platform and half to the carriages.
Source: q and its rates by differentiation; forward kinematics is the intersection of three spheres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns
from cabslice.errors import PoseError
from cabslice.robot.model import GRAVITY, NEWTON, Robot, WinderColumns, robot_from_printer

KIND = "linear-delta"


@dataclass(frozen=True)
class Delta:
    """Motors, rails and arms are columns of three; `winders` are the belt pulleys: one radius, the span of the travel.

    What a machine has in common with robot.model.Robot has the same name.
    """

    arm: float                 # mm
    radius: float              # mm, D
    rails: Array               # (3, 2) unit vectors
    travel: Array              # (2,) mm, lowest and highest carriage
    arm_angle_max: float       # rad, of an arm from the vertical
    winders: WinderColumns
    mass: float                # kg, of the platform
    carriage_mass: float       # kg, of one
    home: Array                # (6,) pose
    acceleration_max: float = np.inf   # mm/s^2, of a carriage
    nozzle: Array | None = None        # (3,) mm, platform frame
    bed_origin: Array | None = None    # (3,) mm, machine frame
    bed_size: Array | None = None      # (2,) mm
    bed_slope: Array = field(default_factory=lambda: np.zeros(2))
    gravity: Array = field(default_factory=lambda: GRAVITY)      # (3,) mm/s^2
    name: str = ""
    turning: None = None               # its platform is level

    def __post_init__(self) -> None:
        shape = Shapes("Delta")
        given = (("rails", "3 2"), ("travel", "2"), ("home", "6"), ("bed_slope", "2"), ("gravity", "3"),
                 ("nozzle", "3"), ("bed_origin", "3"), ("bed_size", "2"))
        set_columns(self, **{name: shape.column(name, getattr(self, name), size) for name, size in given
                             if getattr(self, name) is not None})

    @property
    def cables(self) -> int:
        """Motors."""
        return 3


Machine = Robot | Delta


def machine_from_printer(printer: Any) -> Machine:
    """The machine of a printer profile (cabslice.profile.printer.Printer), whatever its kind."""
    return delta_from_printer(printer) if printer.kind == KIND else robot_from_printer(printer)


def delta_from_printer(printer: Any) -> Delta:
    """The linear Delta of a printer profile of that kind. Raises PoseError where its arms do not reach home."""
    given, bed = printer.delta, printer.bed
    angles = np.radians(given.rail_angles_deg)
    rails = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    home = np.array([*printer.platform.home_mm, 0.0, 0.0, 0.0])
    heights = _heights(home[None, :3], rails, given.radius_mm, given.arm_mm)[0]
    turns = np.array(given.travel_mm) - heights[:, None]
    home_angle = np.radians(given.home_angle_deg)
    return Delta(
        arm=given.arm_mm, radius=given.radius_mm, rails=rails, travel=np.array(given.travel_mm),
        arm_angle_max=float(np.radians(given.max_arm_angle_deg)),
        winders=_belts(given, home_angle, turns / given.belt_radius_mm + home_angle),
        mass=printer.platform.mass_kg, carriage_mass=given.carriage_mass_kg, home=home,
        acceleration_max=given.max_acceleration_mm_s2 or np.inf,
        nozzle=np.array(printer.nozzle.offset_mm) if printer.nozzle else None,
        bed_origin=np.array([*bed.centre_mm, bed.z_mm + bed.first_layer_offset_mm]) if bed else None,
        bed_size=np.array(bed.size_mm) if bed else None,
        bed_slope=np.array(bed.slope_mm_m) / 1e3 if bed else np.zeros(2),
        gravity=np.array([0.0, 0.0, -printer.gravity_mm_s2]), name=printer.name,
    )


def _belts(given: Any, home_angle: float, span: Array) -> WinderColumns:
    motor = given.motor
    each = {name: np.full(3, value) for name, value in (
        ("ramp_start", 0.0), ("ramp_end", np.pi), ("home_angle", home_angle), ("max_speed", motor.max_speed_rad_s),
        ("continuous_torque", motor.continuous_torque_n_m * 1e3), ("peak_torque", motor.peak_torque_n_m * 1e3),
        ("inertia", motor.inertia_kg_mm2), ("friction", motor.friction_n_m * 1e3))}
    return WinderColumns(radii=np.full((3, 1), given.belt_radius_mm), centre=np.full((3, 3), np.nan),
                         crossed=np.zeros(3, np.bool_), span=span, **each)


def belt_radius(delta: Delta) -> float:
    """mm of rail per rad of a motor."""
    return float(delta.winders.radii[0, 0])


def carriages(delta: Delta, poses: Array) -> Array:
    """q (K, 3) mm at poses (K, 6). Raises PoseError where an arm is too short."""
    return _heights(np.asarray(poses, float)[:, :3], delta.rails, delta.radius, delta.arm)


def _heights(places: Array, rails: Array, radius: float, arm: float) -> Array:
    level = places[:, None, :2] - radius * rails
    square = arm**2 - np.einsum("kmi,kmi->km", level, level)
    if not (square > 0).all():
        pose, rail = (int(one) for one in np.argwhere(~(square > 0))[0])
        reach = float(np.linalg.norm(level[pose, rail]))
        raise PoseError(f"arm {rail + 1} does not reach at pose {pose}: it is {arm:g} mm long, its ends are "
                        f"{reach:.6g} mm apart in the level plane", pose=pose, cable=rail + 1, value=reach)
    return np.asarray(places[:, 2:3] + np.sqrt(square))


def spans(delta: Delta, poses: Array) -> Array:
    """|s| (K, 3) mm, which no arm may be shorter than."""
    return np.asarray(np.linalg.norm(poses[:, None, :2] - delta.radius * delta.rails, axis=2))


def arms(delta: Delta, poses: Array) -> tuple[Array, Array]:
    """s (K, 3, 2) and h (K, 3), mm. Raises PoseError as `carriages`."""
    poses = np.asarray(poses, float)
    return poses[:, None, :2] - delta.radius * delta.rails, carriages(delta, poses) - poses[:, 2:3]


def arm_angles(delta: Delta, poses: Array) -> Array:
    """(K, 3) rad from the vertical."""
    level, height = arms(delta, poses)
    return np.arctan2(np.linalg.norm(level, axis=2), height)


def jacobian(delta: Delta, poses: Array) -> Array:
    """dq/d(x, y, z), (K, 3, 3) mm/mm."""
    level, height = arms(delta, poses)
    return np.concatenate((-level / height[..., None], np.ones((*height.shape, 1))), axis=2)


def carriage_accelerations(delta: Delta, poses: Array, rates: Array, accels: Array) -> Array:
    """q'' (K, 3) mm/s^2 at rates and accels (K, >= 3) of the platform: of its last term, h h'' + h'^2 = -(s s')'."""
    level, height = arms(delta, poses)
    moved = np.einsum("kmi,ki->km", level, rates[:, :2]) / height
    turned = (np.einsum("ki,ki->k", rates[:, :2], rates[:, :2])[:, None] + moved**2) / height
    return np.asarray(np.einsum("kmi,ki->km", jacobian(delta, poses), accels[:, :3]) - turned)


def forces(delta: Delta, poses: Array, rates: Array, accels: Array) -> Array:
    """F (K, 3) N that move platform and carriages with rates and accels (K, >= 3)."""
    lift = carriage_accelerations(delta, poses, rates, accels) - delta.gravity[2]
    weight = delta.mass * (np.asarray(accels)[:, :3] - delta.gravity)
    held = np.linalg.solve(np.swapaxes(jacobian(delta, poses), 1, 2), weight[..., None])[..., 0]
    return np.asarray((held + delta.carriage_mass * lift) * NEWTON)


def motor_angles(delta: Delta, heights: Array) -> Array:
    """theta (K, 3) rad of carriages at heights q (K, 3). Raises PoseError beyond the travel."""
    winders = delta.winders
    angle = (heights - carriages(delta, delta.home[None])) / belt_radius(delta) + winders.home_angle
    low, high = winders.span.T
    beyond = ~((angle >= low - 1e-9) & (angle <= high + 1e-9))
    if beyond.any():
        sample, rail = (int(one) for one in np.argwhere(beyond)[0])
        raise PoseError(
            f"carriage {rail + 1} leaves its rail at sample {sample}: it would stand at {heights[sample, rail]:.6g} "
            f"mm, expected {delta.travel[0]:g} to {delta.travel[1]:g}", sample=sample, cable=rail + 1,
            value=float(angle[sample, rail]), span=(float(low[rail]), float(high[rail])))
    return np.asarray(np.clip(angle, low, high))


def heights_of(delta: Delta, angle: Array) -> Array:
    """q (K, 3) mm of motor angles (K, 3) rad."""
    turned = (angle - delta.winders.home_angle) * belt_radius(delta)
    return np.asarray(turned + carriages(delta, delta.home[None]))


def forward(delta: Delta, heights: Array) -> Array:
    """Poses (K, 6) of carriages at heights q (K, 3) mm: the lower of the two points that are L from all three."""
    level = np.broadcast_to(delta.radius * delta.rails, (*heights.shape, 2))
    ends = np.concatenate((level, heights[..., None]), axis=2)
    first, across, third = ends[:, 0], ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]
    length = np.linalg.norm(across, axis=1, keepdims=True)
    x = across / length
    along = np.einsum("ki,ki->k", x, third)[:, None]
    y = third - along * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    up = np.einsum("ki,ki->k", y, third)[:, None]
    a = length / 2
    b = (along**2 + up**2 - 2 * along * a) / (2 * up)
    normal = np.cross(x, y)
    normal = normal * -np.sign(normal[:, 2:])
    below = np.sqrt(delta.arm**2 - a**2 - b**2)
    poses = np.zeros((len(heights), 6))
    poses[:, :3] = first + a * x + b * y + below * normal
    return poses
