"""What the tests of support share: parts that hang over, and what shapely says of the layers that come of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from slicing_kit import Mesh, joined, prism, process, shape_of

from cabslice.profile.stand import Support
from cabslice.slicing.layer import Role
from cabslice.slicing.sections import Modifiers
from cabslice.slicing.slicer import slice_part

SUPPORT = (Role.SUPPORT, Role.SUPPORT_INTERFACE)


def layers_of(part, *, blockers=(), enforcers=(), process_keys=None, **support):
    asked = Support(**{"kind": "straight", **support})
    keys = {"infill": 0.1, "top_layers": 1, "bottom_layers": 1, "skirt_loops": 0, **(process_keys or {})}
    modifiers = Modifiers(blockers, enforcers)
    return list(slice_part(part, process(support=asked, **keys), nozzle_mm=0.4, modifiers=modifiers))


def lines(layer, roles=SUPPORT):
    """(points, width, role) of each bead with one of the roles; closed ones end where they began."""
    beads = layer.beads
    for b, (i, j) in enumerate(pairwise(beads.starts)):
        if beads.role[b] in roles:
            points = beads.points[i:j]
            yield np.vstack((points, points[:1])) if beads.closed[b] else points, beads.width[j - 1], beads.role[b]


def laid(layer, roles=SUPPORT):
    """What the beads cover."""
    return shapely.union_all([
        shapely.LineString(points).buffer(width / 2, quad_segs=6) for points, width, _ in lines(layer, roles)
    ])


def outline(layer):
    return shape_of(layer.outline.points, layer.outline.starts)


def supported(layers):
    """Indices of the layers with support."""
    return [layer.index for layer in layers if any(True for _ in lines(layer))]


def table(height=4.0, across=20.0, leg=4.0):
    """A plate 2 mm thick on one leg."""
    half = across / 2
    return joined(
        prism(shapely.box(-leg / 2, -leg / 2, leg / 2, leg / 2), 0.0, height + 1.0),
        prism(shapely.box(-half, -half, half, half), height, height + 2.0),
    )


def gate(span=10.0, height=3.0):
    """Two posts and a lintel: a bridge along x."""
    end = span / 2 + 4
    return joined(
        prism(shapely.box(-end, -3, -span / 2, 3), 0.0, height + 1),
        prism(shapely.box(span / 2, -3, end, 3), 0.0, height + 1),
        prism(shapely.box(-end, -3, end, 3), height, height + 2),
    )


def leaning(angle_deg, height=6.0):
    """A post whose one side leans out over x > 3 by an angle from the vertical, from z = 1 up."""
    out = (height - 1) * np.tan(np.radians(angle_deg))
    profile = shapely.Polygon([(0, 0), (3, 0), (3, 1), (3 + out, height), (0, height)])
    flat = prism(profile, 0.0, 8.0)                     # drawn in x and z, pushed along y
    x, z, y = flat.vertices.T
    return Mesh(np.column_stack((x, y, z)), flat.faces[:, ::-1], "leaning")


def write_stl(path, mesh):
    """A binary STL of a mesh."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["corners"] = corners
    path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return path


def farthest(shape, beads, step=0.1):
    """How far a point of a shape may be from the beads: looked for on a grid."""
    x0, y0, x1, y1 = shape.bounds
    x, y = np.meshgrid(np.arange(x0 + step / 2, x1, step), np.arange(y0 + step / 2, y1, step))
    inside = shapely.contains_xy(shape, x.ravel(), y.ravel())
    points = shapely.points(x.ravel()[inside], y.ravel()[inside])
    return float(shapely.distance(points, beads).max()) if len(points) else 0.0
