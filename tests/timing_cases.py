"""Toolpaths and profiles made by hand for the tests of the timing room."""

from types import SimpleNamespace

import numpy as np

from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Events, Toolpath

PRINTER = SimpleNamespace(
    motion=SimpleNamespace(max_acceleration_mm_s2=None, max_speed_mm_s=150.0, smoothing_ms=5.0),
    extruder=SimpleNamespace(
        max_flow_mm3_s=12.0, max_speed_mm_s=60.0, max_acceleration_mm_s2=1500.0, max_jump_mm_s=5.0,
        pressure_advance_s=0.0),
)
MATERIAL = SimpleNamespace(max_flow_mm3_s=15.0)
PROCESS = SimpleNamespace(corner_mm=0.05)
FEED = 0.034   # mm of 1.75 mm filament per mm of a 0.45 x 0.2 mm bead


def polyline(seed=0, count=20, *, points=None, speed=100.0, pieces=2):
    """A random polyline around the middle of the bed, long and short moves mixed, cut into pieces."""
    rng = np.random.default_rng(seed)
    if points is None:
        step = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-1.5, 1.2, (count, 1))
        step[:, 2] *= 0.02
        points = np.cumsum(step, axis=0)
        points = points - points.mean(axis=0) + [0, 0, 20 - min(0.0, points[:, 2].min())]
    points = np.asarray(points, float)
    lengths = np.concatenate(([0.0], np.linalg.norm(np.diff(points, axis=0), axis=1)))
    starts = np.unique(np.linspace(1, len(points), min(pieces, len(points) - 1) + 1).astype(int))
    return toolpath(points, FEED * lengths, starts, speed)


def toolpath(points, filament, starts, speed=100.0):
    count = len(points)
    return Toolpath(
        xyz=points, filament=filament, width=np.full(count, 0.45), height=np.full(count, 0.2),
        speed=np.broadcast_to(speed, count).copy(), role=np.full(count, Role.INNER_WALL), layer=np.zeros(count),
        object=np.zeros(count), starts=starts, events=Events.none(), filament_diameter_mm=1.75)


def print_like(seed=0, turns=30):
    """Walls of short facets, a zigzag, travels, retract and prime as pieces of their own."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 60)
    wall = np.stack((30 * np.cos(angle), 20 * np.sin(angle)), axis=1) + rng.uniform(-40, 40, 2)
    across, along = np.repeat(np.arange(turns) * 0.45, 2), np.tile([0, 18, 18, 0], turns)[:2 * turns]
    zig = np.stack((across, along), axis=1) - [5, 40]
    rows = [(wall[0], 0.0)] + [(point, FEED) for point in wall[1:]]
    starts = [1, len(rows)]
    rows.append((wall[-1], "retract"))
    starts.append(len(rows))
    rows.append((zig[0], 0.0))
    starts.append(len(rows))
    rows.append((zig[0], "prime"))
    starts.append(len(rows))
    rows += [(point, FEED) for point in zig[1:]]
    starts.append(len(rows))
    points = np.array([[*point, 0.2] for point, _ in rows])
    lengths = np.concatenate(([0.0], np.linalg.norm(np.diff(points, axis=0), axis=1)))
    feed = {"retract": -0.8, "prime": 0.8}
    pairs = zip((kind for _, kind in rows), lengths, strict=True)
    filament = np.array([feed[kind] if isinstance(kind, str) else kind * length for kind, length in pairs])
    speed = np.where(lengths > 0, 100.0, 35.0)
    return toolpath(points, filament, np.array(starts), speed)
