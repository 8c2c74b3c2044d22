"""Makes the sample parts, same bytes every time:  python samples/make.py

cube      20 mm
cylinder  25 mm across, 15 mm tall
c-shape   ring 40 mm across with a gap, 10 mm tall: round walls, two ends
arch      40 x 10 x 25 mm: bridges and overhangs
tower     24 mm at the foot, 12 mm at the top, 120 mm tall
gear      24 teeth, 100 mm across, 10 mm thick: mostly infill
fins      1.0, 0.8, 0.5 and 0.35 mm thick on a foot: walls thinner than a pair of beads
square    60 x 60 x 2 mm: four sharp corners with long ways between
ringing   tower 40 x 40 x 12 mm, two sides waved 0.5 mm deep, pitch falling from 8 to 2 mm: at 100 mm/s they shake it at
          12 to 50 Hz; the other two show how it rings after a sharp corner
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

HERE = Path(__file__).parent


def box(low, high):
    """Triangles (12, 3, 3) of an upright box."""
    x0, y0, z0 = low
    x1, y1, z1 = high
    inner = np.array([[x0, y0], [x1, y0]])
    outer = np.array([[x0, y1], [x1, y1]])
    return ribbon(outer, inner, z0, z1)


def ribbon(left, right, z0, z1):
    """A closed body between two curves (n, 2): left of the way and right of it."""
    quads = []
    for k in range(len(left) - 1):
        a, b, c, d = right[k], right[k + 1], left[k + 1], left[k]
        quads.append([(*a, z1), (*b, z1), (*c, z1), (*d, z1)])
        quads.append([(*a, z0), (*d, z0), (*c, z0), (*b, z0)])
        quads.append([(*a, z0), (*b, z0), (*b, z1), (*a, z1)])
        quads.append([(*c, z0), (*d, z0), (*d, z1), (*c, z1)])
    quads.append([(*left[0], z0), (*right[0], z0), (*right[0], z1), (*left[0], z1)])
    quads.append([(*right[-1], z0), (*left[-1], z0), (*left[-1], z1), (*right[-1], z1)])
    quads = np.array(quads, dtype=float)
    return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def frustum(radius0, radius1, height, sides):
    """A closed body between two regular polygons, standing on z = 0."""
    turn = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    return upright(radius0 * circle, radius1 * circle, height)


def upright(foot, head, height):
    """A closed body between two outlines (n, 2) seen whole from the axis, standing on z = 0."""
    low = np.column_stack((foot, np.zeros(len(foot))))
    high = np.column_stack((head, np.full(len(head), height)))
    low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    foot, top = np.broadcast_to([0.0, 0.0, 0.0], low.shape), np.broadcast_to([0.0, 0.0, height], low.shape)
    faces = [(low, low_next, high_next), (low, high_next, high), (foot, low_next, low), (top, high, high_next)]
    return np.concatenate([np.stack(face, axis=1) for face in faces])


def gear(teeth=24, root=43.0, tip=50.0, height=10.0):
    """Straight-flanked teeth on a disc, about the axis."""
    share = np.array([0.0, 0.15, 0.35, 0.5, 0.75])                    # of a tooth: foot, tip, tip, foot, middle of gap
    radius = np.tile([root, tip, tip, root, root], teeth)
    turn = 2 * np.pi * (np.repeat(np.arange(teeth), len(share)) + np.tile(share, teeth)) / teeth
    circle = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    return upright(circle * radius[:, None], circle * radius[:, None], height)


def arc(radius, start_deg, end_deg, steps):
    turn = np.radians(np.linspace(start_deg, end_deg, steps + 1))
    return radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)


def arch():
    """A ribbon from foot to foot, laid flat, then stood up."""
    inner, outer = arc(15.0, 180, 0, 36), arc(20.0, 180, 0, 36)
    foot = np.array([0.0, -5.0])
    inner = np.concatenate((inner[:1] + foot, inner, inner[-1:] + foot))
    outer = np.concatenate((outer[:1] + foot, outer, outer[-1:] + foot))
    flat = ribbon(outer, inner, -5.0, 5.0)
    return np.stack((flat[..., 0], -flat[..., 2], flat[..., 1] + 5.0), axis=-1)


def fins():
    bodies = [box((-15, -2, 0), (15, 32, 1.2))]
    for k, thick in enumerate((1.0, 0.8, 0.5, 0.35)):
        y = 10.0 * k
        bodies.append(box((-12, y - thick / 2, 0.6), (12, y + thick / 2, 8)))
    return np.concatenate(bodies)


def ringing(half=20.0, deep=0.5, height=12.0, pitches=(8, 8, 6, 4, 4, 3, 3, 2)):
    """A square with waves of falling pitch on two sides."""
    edges = np.concatenate(([0.0], np.cumsum(pitches)))
    edges = (edges - edges[-1] / 2)[::-1]
    along = np.column_stack((edges[:-1], (edges[:-1] + edges[1:]) / 2)).ravel()
    out = np.tile([half, half - deep], len(pitches))
    top, right = np.column_stack((along, out)), np.column_stack((out, along))[::-1]
    corners = half * np.array([[-1.0, 1], [-1, -1], [1, -1]])
    outline = np.concatenate((top, corners, right, [[half, half]]))
    return upright(outline, outline, height)


SAMPLES = {
    "cube": lambda: box((0, 0, 0), (20, 20, 20)),
    "cylinder": lambda: frustum(12.5, 12.5, 15.0, 96),
    "c-shape": lambda: ribbon(arc(14.0, 30, 330, 75), arc(20.0, 30, 330, 75), 0.0, 10.0),
    "arch": arch,
    "tower": lambda: frustum(12.0, 6.0, 120.0, 48),
    "gear": gear,
    "fins": fins,
    "square": lambda: box((0, 0, 0), (60, 60, 2)),
    "ringing": ringing,
}


def write_stl(triangles, path, name):
    """Binary STL."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    record = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["normal"] = np.round(normal / np.linalg.norm(normal, axis=1, keepdims=True), 6) + 0.0
    record["corners"] = np.round(triangles, 6) + 0.0
    head = f"cabslice sample: {name}".encode().ljust(80, b"\0")
    path.write_bytes(head + np.uint32(len(triangles)).tobytes() + record.tobytes())


def main(folder=HERE):
    for name, make in SAMPLES.items():
        write_stl(make(), Path(folder) / f"{name}.stl", name)


if __name__ == "__main__":
    main()
