"""Layers and profiles made by hand for the tests of toolpath/."""

import numpy as np

from cabslice.profile.material import Material
from cabslice.profile.process import Process
from cabslice.slicing.layer import Beads, Layer, Polygons, Role

SPEEDS = {
    "outer_wall": 30, "inner_wall": 60, "solid_infill": 61, "top_skin": 40, "sparse_infill": 80, "bridge": 21,
    "gap_fill": 20, "skirt": 35, "first_layer": 25, "travel": 150,
}
RETRACTION = {"length_mm": 1.2, "speed_mm_s": 33, "prime_speed_mm_s": 27, "min_travel_mm": 2, "hop_mm": 0.3}
PLA = Material(
    name="pla", source="made up", nozzle_c=[190, 220], bed_c=[50, 60], speed_mm_s=[40, 90], max_flow_mm3_s=10,
    density_g_cm3=1.24, fan=0.6,
)


def process(retraction=(), **changes):
    keys = {
        "name": "made-up", "nozzle_mm": 0.4, "layer_mm": 0.2, "first_layer_mm": 0.2, "bead_mm": 0.45,
        "outer_bead_mm": 0.45, "first_bead_mm": 0.45, "walls": 2, "top_layers": 4, "bottom_layers": 4, "infill": 0.2,
        "pattern": "grid", "speeds_mm_s": SPEEDS, "retraction": RETRACTION | dict(retraction),
    }
    return Process(**keys | changes)


def line(points, role=Role.SOLID_INFILL, *, closed=False, island=0, width=0.45):
    points = np.asarray(points, float)
    return points, role, closed, island, np.broadcast_to(width, len(points))


def ring(x, y, half, role=Role.OUTER_WALL, island=0):
    """A square, counter-clockwise."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return line(corners * half + (x, y), role, closed=True, island=island)


def circle(x, y, radius, role=Role.OUTER_WALL, island=0, points=120, phase=0.0):
    angle = phase + 2 * np.pi * np.arange(points) / points
    return line(radius * np.column_stack((np.cos(angle), np.sin(angle))) + (x, y), role, closed=True, island=island)


def layer(lines, index=0, height=0.2):
    points, roles, closed, islands, widths = zip(*lines, strict=True) if lines else ((), (), (), (), ())
    starts = np.cumsum([0, *map(len, points)])
    beads = Beads(
        np.vstack(points) if points else np.empty((0, 2)), starts, np.concatenate(widths) if widths else np.empty(0),
        np.array(roles, np.uint8), np.array(closed, np.bool_), np.array(islands, np.int32),
    )
    return Layer(index, height * (index + 1), height, Polygons(np.empty((0, 2)), np.zeros(1)), beads)


def block(layers=4, half=10.0, shuffle=0):
    """A solid square tower with two walls and a skirt around its first layer, its lines in no order."""
    rng = np.random.default_rng(shuffle)
    made = []
    for index in range(layers):
        ends = np.arange(-half + 1.2, half - 1.1, 0.45)
        lines = [line([(x, -half + 1), (x, half - 1)]) for x in ends]
        lines += [ring(0, 0, half), ring(0, 0, half - 0.45, Role.INNER_WALL)]
        if index == 0:
            lines.append(ring(0, 0, half + 5, Role.SKIRT, island=-1))
        made.append(layer([lines[k] for k in rng.permutation(len(lines))], index))
    return made


def laid_lengths(layers):
    """mm per role of all beads as they were asked for."""
    total = np.zeros(len(Role))
    for one in layers:
        beads = one.beads
        for low, high, role, closed in zip(beads.starts[:-1], beads.starts[1:], beads.role, beads.closed, strict=True):
            points = beads.points[low:high]
            if closed:
                points = np.vstack((points, points[:1]))
            total[role] += np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return total
