"""What the slicing tests share: processes, solids whose sections are known, random shapes, figures of layers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from hypothesis import strategies as st

from cabslice.profile.process import Process, Retraction, Speeds
from cabslice.slicing.flow import bead_area
from cabslice.slicing.region import Region, following

SPEEDS = Speeds(**dict.fromkeys(Speeds.model_fields, 50.0))
RETRACTION = Retraction(length_mm=1, speed_mm_s=40, prime_speed_mm_s=40, min_travel_mm=1.5)


def process(**changes):
    asked = {
        "name": "test", "nozzle_mm": 0.4, "layer_mm": 0.2, "first_layer_mm": 0.2, "bead_mm": 0.45,
        "outer_bead_mm": 0.45, "first_bead_mm": 0.45, "walls": 2,
        "top_layers": 4, "bottom_layers": 4, "infill": 1.0, "pattern": "rectilinear",
        "speeds_mm_s": SPEEDS, "retraction": RETRACTION,
    }
    return Process(**{**asked, **changes})


@dataclass
class Mesh:
    vertices: np.ndarray
    faces: np.ndarray
    name: str = "mesh"


def prism(polygon, z0, z1):
    """A closed mesh from a shapely polygon, holes and all."""
    rings = [np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    points = np.concatenate(rings)
    flat = shapely.constrained_delaunay_triangles(polygon)
    index = {tuple(p): k for k, p in enumerate(points)}
    lid = []
    for triangle in flat.geoms:
        corner = [index[tuple(p)] for p in shapely.orient_polygons(triangle).exterior.coords[:3]]
        lid.append(corner)
    lid = np.array(lid)
    n = len(points)
    sides = []
    start = 0
    for k, ring in enumerate(rings):
        loop = np.arange(start, start + len(ring))
        outward = shapely.LinearRing(ring).is_ccw == (k == 0)
        loop = loop if outward else loop[::-1]
        ahead = np.roll(loop, -1)
        sides += [np.stack((loop, ahead, ahead + n), 1), np.stack((loop, ahead + n, loop + n), 1)]
        start += len(ring)
    vertices = np.concatenate((np.column_stack((points, np.full(n, z0))), np.column_stack((points, np.full(n, z1)))))
    return Mesh(vertices, np.concatenate((lid + n, lid[:, ::-1], *sides)))


def joined(*meshes):
    """Bodies in one mesh, overlapping or not."""
    shift = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + s for mesh, s in zip(meshes, shift, strict=True)]),
    )


def region_of(shape):
    """A Region from a shapely polygon or several."""
    rings = []
    for polygon in getattr(shape, "geoms", [shape]):
        polygon = shapely.orient_polygons(polygon)
        rings += [np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    return Region(rings)


def shape_of(points, starts):
    """A shapely shape from rings by the even-odd rule."""
    shape = shapely.Polygon()
    for a, b in pairwise(starts):
        shape = shape.symmetric_difference(shapely.Polygon(points[a:b]).buffer(0))
    return shape


def ring_area(points, starts):
    ahead = points[following(starts)]
    return float((points[:, 0] * ahead[:, 1] - ahead[:, 0] * points[:, 1]).sum() / 2)


def bead_volume(layer, roles=None):
    """mm^3 of the beads of a layer, the skirt left out."""
    beads = layer.beads
    total = 0.0
    for b, (i, j) in enumerate(pairwise(beads.starts)):
        if beads.island[b] >= 0 and (roles is None or beads.role[b] in roles):
            p, w = beads.points[i:j], beads.width[i:j]
            if beads.closed[b]:
                p, w = np.concatenate((p, p[:1])), np.concatenate((w, w[:1]))
            length = np.linalg.norm(np.diff(p, axis=0), axis=1)
            total += float((bead_area(w[1:], beads.height[b] or layer.height_mm) * length).sum())
    return total


@st.composite
def shapes(draw, size=20.0, holes=2):
    """Random polygons of some mm, with spikes, slivers, holes and touching bits; never empty."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    corners = draw(st.integers(3, 24))
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = size / 2 * rng.uniform(0.05, 1.0, corners)
    shape = shapely.Polygon(radius[:, None] * np.stack((np.cos(angle), np.sin(angle)), 1)).buffer(0)
    for _ in range(draw(st.integers(0, 3))):     # fins and bars, thin ones too
        a, b = rng.uniform(-size / 2, size / 2, (2, 2))
        if np.linalg.norm(a - b) > 1e-3:
            half = rng.choice([0.05, 0.15, 0.3, 0.6, 1.5])
            shape = shape.union(shapely.LineString([a, b]).buffer(half, cap_style="flat"))
    for _ in range(draw(st.integers(0, holes))):
        hole = shapely.Point(rng.uniform(-size / 2, size / 2, 2)).buffer(rng.uniform(0.1, size / 5), quad_segs=3)
        shape = shape.difference(hole)
    shape = shapely.set_precision(shape, 1e-4)
    polygons = [p for p in getattr(shape, "geoms", [shape]) if p.geom_type == "Polygon" and p.area > 0.01]
    if not polygons:
        return shapely.box(0, 0, 1, 2)
    return shapely.MultiPolygon(polygons)


def prisms(shape, z0, z1):
    return joined(*[prism(polygon, z0, z1) for polygon in getattr(shape, "geoms", [shape])])
