"""Small robots and toolpaths made by hand, and a judge of distances that shares no code with the package."""

from __future__ import annotations

import numpy as np

from cabslice.feasibility.obstacles import beads_of, moves_of, printing_stages
from cabslice.feasibility.sweep import Contacts, contacts
from cabslice.feasibility.trees import Tree, tree_of_beads, tree_of_moves
from cabslice.robot.kinematics import cables
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.toolpath.path import Events, Toolpath

# line-collision example machine of tobbelobb/linc: the six lower lines of a Hangprinter
LINC_ANCHORS = [
    [220.0, -1744.54, 15.92], [-220.0, -1744.54, 15.92], [1542.51, 1140.88, -32.19], [1317.51, 1540.88, -32.19],
    [-1435.30, 1011.60, -31.23], [-1670.30, 611.63, -31.23],
]
LINC_ATTACHMENTS = [
    [220.0, -140.0, 130.0], [-220.0, -140.0, 130.0], [230.0, -130.0, 130.0], [5.0, 270.0, 130.0],
    [-5.0, 270.0, 130.0], [-230.0, -130.0, 130.0],
]
LINC_EDGE = 470.928      # mm: exact answer for a centred cube


def robot_of(anchors, attachments, *, pulley=0.0, radius=0.0, clearance=0.0, bed=(4000.0, 4000.0), nozzle=(0, 0, 0)):
    """Attachments seen from the nozzle where that is (0, 0, 0); the bed in the middle of the machine frame."""
    one = np.ones(len(anchors))
    return Robot(
        anchors=anchors, attachments=attachments, pulley_axes=np.tile([0.0, 0.0, 1.0], (len(anchors), 1)),
        pulley_radii=pulley * one, axial_stiffness=1e4 * one, cable_radii=radius * one, clearance=clearance * one,
        tension_min=1.0 * one, tension_max=100.0 * one, tension_reference=30.0 * one, mass=2.5, inertia=np.eye(3),
        centre_of_mass=np.zeros(3), home=np.zeros(6), freedoms=np.ones(6, bool), nozzle=nozzle,
        bed_origin=np.zeros(3), bed_size=bed, name="by hand",
    )


def frame_robot(*, pulley=0.0, clearance=2.0, bed=400.0, size=500.0, height=100.0, crossed=False):
    """A cube-shaped frame with a flat platform, much as CABFAB Optim; the bed 40 mm above the lower anchors.

    Crossed: much as Init X, where each upper cable passes the lower one of its corner at a few millimetres.
    """
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    level = np.full((4, 1), 1.0)
    anchors = np.vstack([np.hstack((size * signs, z * level)) for z in (960.0, -40.0)])
    upper, lower = np.hstack((signs * [86.6, 50.0], 2.5 * level)), np.hstack((signs * [96.2, 27.3], -2.5 * level))
    if crossed:
        upper = np.hstack((signs * [44.0528, 44.0528], -25.0 * level))
        lower = np.hstack((signs * [47.5969, 40.1974], 25.0 * level))
    return robot_of(
        anchors, np.vstack((upper, lower)), pulley=pulley, radius=0.27, clearance=clearance, bed=(bed, bed),
        nozzle=(0, 0, -height),
    )


def toolpath_of(points, extruding, layer, *, width=0.45, height=0.2):
    """points (N, 3), extruding (N,) bool, layer (N,): rows of a toolpath of one piece."""
    extruding = np.asarray(extruding, bool)
    count = len(extruding)
    return Toolpath(
        xyz=points, filament=np.where(extruding, 0.1, 0.0), width=np.where(extruding, width, 0.0),
        height=np.where(extruding, height, 0.0), speed=np.full(count, 50.0), role=extruding.astype(np.uint8),
        layer=layer, object=np.zeros(count), starts=[1, count], events=Events.none(), filament_diameter_mm=1.75,
        source="made by hand",
    )


def stacked(layers, *, width=0.45, height=0.2):
    """A toolpath from, per layer, a list of polylines (n, 2); travels between them."""
    rows = [(0.0, 0.0, height, False, 0)]
    for number, lines in enumerate(layers):
        for line in lines:
            rows += [(*point, (number + 1) * height, i > 0, number) for i, point in enumerate(line)]
    table = np.array(rows, float)
    return toolpath_of(table[:, :3], table[:, 3], table[:, 4], width=width, height=height)


def box_loop(x, y=None, *, centre=(0.0, 0.0)):
    """Closed rectangle with sides x, y."""
    y = x if y is None else y
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]) / 2 + centre


def until(toolpath, layer):
    """The toolpath of layers 0..layer."""
    rows = int((toolpath.layer <= layer).sum())
    return toolpath_of(
        toolpath.xyz[:rows], toolpath.filament[:rows] > 0, toolpath.layer[:rows],
        width=toolpath.width.max(), height=toolpath.height.max(),
    )


def part_trees(toolpath, robot) -> tuple[Tree, Tree]:
    stages = printing_stages(toolpath)
    return tree_of_moves(moves_of(toolpath, stages), robot), tree_of_beads(beads_of(toolpath, stages))


def part_contacts(toolpath, robot, grow, *, stop=10**9) -> Contacts:
    moves, beads = part_trees(toolpath, robot)
    return contacts(moves, beads, robot, np.broadcast_to(np.asarray(grow, float), (robot.cables,)), stop=stop)


# ---- the independent judge: places along a move, each with its own pose, refined around the nearest of them

SECTIONS = 30        # of a cable: its distance to a bead is convex along it


def bead_distance(points, start, end, half, low, top):
    """Distance (...,) from points (..., 3) to beads (...): lines grown by `half` in plan, low <= z <= top."""
    way = end - start
    share = np.clip(((points[..., :2] - start) * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-30), 0, 1)
    plan = np.linalg.norm(points[..., :2] - start - share[..., None] * way, axis=-1)
    rise = np.maximum(np.maximum(low - points[..., 2], points[..., 2] - top), 0.0)
    return np.hypot(np.maximum(plan - half, 0.0), rise)


def sampled_distance(robot, toolpath, row, cable, bead_rows, *, grid=65, rounds=3, nearest=6):
    """Least distance met between a cable during move `row` and the beads of some rows.

    Along the move the distance may have several dips: the `nearest` of them are looked into.
    """
    b = np.asarray(bead_rows)
    ends = toolpath.xyz[b - 1], toolpath.xyz[b]
    z = np.stack((ends[0][:, 2], ends[1][:, 2]))
    beads = ends[0][:, :2], ends[1][:, :2], toolpath.width[b] / 2, z.min(0) - toolpath.height[b], z.max(0)
    f = np.linspace(0, 1, grid)
    found = _cable_distances(robot, toolpath, row, cable, f, [column[:, None] for column in beads])
    best, step = float(found.min()), 1 / (grid - 1)
    dips = (found <= np.roll(found, 1, 1)) & (found <= np.roll(found, -1, 1))
    dips |= np.isin(np.arange(grid), (0, grid - 1))
    bead, place = np.nonzero(dips)
    order = np.argsort(found[bead, place], kind="stable")[:nearest]
    one, middle = bead[order], f[place[order]]
    for _ in range(rounds if best > 0 else 0):
        near = np.clip(middle[:, None] + step * np.linspace(-1, 1, 17), 0, 1)
        value = _cable_distances(robot, toolpath, row, cable, near, [column[one, None] for column in beads])
        best, step = min(best, float(value.min())), step / 8
        middle = near[np.arange(len(one)), value.argmin(axis=1)]
    return best


def _cable_distances(robot, toolpath, row, cable, f, beads):
    """Distances (B, F) from beads, columns (B, 1), to a cable at shares f (F,) or (B, F) of a move, by sections."""
    xyz = toolpath.xyz[row - 1] + f[..., None] * (toolpath.xyz[row] - toolpath.xyz[row - 1])
    lines = cables(robot, nozzle_poses(robot, xyz.reshape(-1, 3)))
    exits, tips = (ends[:, cable].reshape(xyz.shape) - robot.bed_origin for ends in (lines.exit, lines.tip))
    size = np.broadcast_shapes(beads[2].shape, f.shape)
    low, high = np.zeros(size), np.ones(size)

    def distance(t):
        return bead_distance(exits + t[..., None] * (tips - exits), *beads)

    for _ in range(SECTIONS):
        left, right = low + (high - low) / 3, high - (high - low) / 3
        lower = distance(left) < distance(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return distance((low + high) / 2)
