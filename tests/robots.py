"""Robots built by hand for the tests of the robot wing: no profile file is read here."""

import numpy as np

from cabslice.robot.model import Robot, WinderColumns
from cabslice.robot.rotation import turned

MEASURED = [
    [60.21, 60.80, 61.29, 61.85, 62.41],
    [60.26, 60.90, 61.42, 61.98, 62.51],
    [60.25, 60.81, 61.32, 61.84, 62.42],
    [60.25, 60.84, 61.35, 61.88, 62.46],
    [60.28, 60.82, 61.38, 61.90, 62.59],
    [60.25, 60.79, 61.36, 61.87, 62.47],
    [60.26, 60.83, 61.33, 61.84, 62.40],
    [60.23, 60.79, 61.34, 61.85, 62.48],
]  # G table 6.4
START = np.radians([136.58, 61.75, 234.92, 242.91, 385.11, 363.99, 206.10, 301.61])  # G table 6.3
END = np.radians([145.34, 70.50, 243.68, 251.67, 393.87, 372.75, 214.86, 310.37])
CUBE = 500.0 * np.array(
    [[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1], [1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]]
)


def cable_robot(anchors, attachments, *, axes=None, pulley_radius=0.0, winders=None, **more):
    m = len(anchors)
    axes = np.tile([0.0, 0.0, 1.0], (m, 1)) if axes is None else axes
    values = {
        "axial_stiffness": np.full(m, 69490 * np.pi / 4 * 0.54**2),
        "cable_radii": np.full(m, 0.27),
        "clearance": np.full(m, 2.0),
        "tension_min": np.ones(m),
        "tension_max": np.full(m, 100.0),
        "tension_reference": np.full(m, 30.0),
        "mass": 2.598,
        "inertia": np.diag([2092.5, 2092.5, 2897.8]),
        "centre_of_mass": np.zeros(3),
        "home": np.zeros(6),
        "freedoms": np.ones(6, bool),
        "nozzle": np.array([0, 0, -100.0]),
        "bed_origin": np.array([0, 0, -460.0]),
        "bed_size": np.array([600.0, 600.0]),
        **more,
    }
    return Robot(
        anchors=np.asarray(anchors, float),
        attachments=np.asarray(attachments, float),
        pulley_axes=np.asarray(axes, float),
        pulley_radii=np.broadcast_to(pulley_radius, m),
        winders=winders,
        **values,
    )


def cabfab_init_x(*, pulley_radius=25.27, measured=True, **more):
    """Cables from the top of the frame go to the lower points (G table 5.2, annex B)."""
    signs = np.sign(CUBE[:4, :2])
    attachments = np.vstack(
        (np.c_[signs * 44.0528, np.full(4, -25.0)], np.c_[signs * [47.5969, 40.1974], np.full(4, 25.0)])
    )
    return _cabfab(attachments, pulley_radius, measured, name="cabfab-init-x", **more)


def cabfab_optim(*, pulley_radius=25.27, measured=True, **more):
    signs, (top, bottom) = np.sign(CUBE[:4, :2]), np.radians([29.98, 15.87])
    attachments = np.vstack(
        [np.c_[signs * 100 * [np.cos(a), np.sin(a)], np.full(4, z)] for a, z in ((top, 2.5), (bottom, -2.5))]
    )
    values = {"mass": 2.565, "inertia": np.diag([2329.2, 2329.2, 3326.1]), **more}
    return _cabfab(attachments, pulley_radius, measured, name="cabfab-optim", **values)


def _cabfab(attachments, pulley_radius, measured, **more):
    """The cable arrives from a winder 700 mm behind the pulley: below the top ones, above the lower ones (assumed)."""
    axes = np.array([[0.0, 0.0, s] for s in np.sign(CUBE[:, 2])])
    outward = np.sign(CUBE) * [1, 1, 0] / np.sqrt(2)
    return cable_robot(
        CUBE,
        attachments,
        axes=axes,
        pulley_radius=pulley_radius,
        winders=radial_winders(CUBE - 700 * axes + 60.27 * outward, measured=measured),
        **more,
    )


def radial_winders(centre, *, measured=True, **more):
    m = len(centre)
    radii = np.array(MEASURED)[:m] if measured else np.tile(60.27 + 0.54 * np.arange(5), (m, 1))
    values = {
        "ramp_start": START[:m],
        "ramp_end": END[:m],
        "home_angle": np.full(m, 8.0),
        "crossed": np.arange(m) % 2 == 1,
        **drives(m),
        **more,
    }
    return WinderColumns(radii=radii, centre=centre, **values)


def drives(m):
    return {
        "max_speed": np.full(m, 10.5),
        "continuous_torque": np.full(m, 6000.0),
        "peak_torque": np.full(m, 18000.0),
        "inertia": np.full(m, 440.0),
        "friction": np.zeros(m),
    }


def random_robot(seed, *, m=8, pulleys=True, **more):
    """Anchors on the faces of a box of about 1.6 m, small platform, swivel axes of any direction across the cables."""
    rng = np.random.default_rng(seed)
    anchors = rng.uniform(600, 1000, (m, 3)) * np.where(np.arange(m)[:, None] >> np.arange(3) & 1, 1, -1)
    inward = -anchors / np.linalg.norm(anchors, axis=1)[:, None]
    axes = rng.normal(size=(m, 3))
    axes -= np.einsum("mi,mi->m", axes, inward)[:, None] * inward
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    axes += rng.uniform(-0.7, 0.7, (m, 1)) * inward
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    centre = {"centre_of_mass": rng.uniform(-20, 20, 3), **more}
    inertia = np.diag(rng.uniform(1000, 4000, 3)) + np.full((3, 3), rng.uniform(-300, 300))
    radius = rng.uniform(5, 60, m) * pulleys
    return cable_robot(
        anchors, rng.uniform(-100, 100, (m, 3)), axes=axes, pulley_radius=radius, **{"inertia": inertia, **centre}
    )


def random_poses(seed, count, *, reach=200.0, turn=0.3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, 6)) * [reach, reach, reach, turn, turn, turn]


def moved(poses, step):
    """Poses after a small platform move (K, 6): translation, left rotation vector."""
    return np.hstack((poses[:, :3] + step[:, :3], turned(poses[:, 3:], step[:, 3:])))


def gt_planar(**more):
    """Planar painting robot of borglab/GTDynamics in x, z: no gravity, so no mass (data/robots.toml)."""
    anchors = np.array([[3000, 0, 0], [3000, 0, 3000], [0, 0, 3000], [0, 0, 0]])
    attachments = np.array([[150, 0, -150], [150, 0, 150], [-150, 0, 150], [-150, 0, -150]])
    values = {
        "freedoms": np.array([1, 0, 1, 0, 1, 0], bool),
        "mass": 1e-12,
        "home": np.array([1500.0, 0, 1500, 0, 0, 0]),
        **more,
    }
    return cable_robot(anchors, attachments, axes=np.tile([0.0, 1, 0], (4, 1)), name="gt-planar", **values)


def hangprinter(**more):
    """Hangprinter v4: point platform, four lines, spool build-up, mechanical advantage and gears (data/robots.toml)."""
    anchors = np.array(
        [[0, -1610.98, -131.53], [1314.22, 1268.14, -121.28], [-1415.73, 707.61, -121.82], [0, 0.01, 2299.83]]
    )
    advantage = np.array([2.0, 2, 2, 4])
    winders = WinderColumns(
        radii=np.array([[75.546], [75.659], [76.128], [75.192]]),
        ramp_start=np.zeros(4),
        ramp_end=np.zeros(4),
        home_angle=np.zeros(4),
        centre=np.full((4, 3), np.nan),
        crossed=np.zeros(4, bool),
        **drives(4),
        slope=0.128181 / 2,
        gear=255 / 20,
        advantage=advantage,
        span=np.tile([-2000.0, 2000.0], (4, 1)),
    )
    values = {
        "freedoms": np.array([1, 1, 1, 0, 0, 0], bool),
        "mass": 2.0,
        "axial_stiffness": np.full(4, 20000.0),
        **more,
    }
    return cable_robot(anchors, np.zeros((4, 3)), winders=winders, name="hangprinter-v4", **values)
