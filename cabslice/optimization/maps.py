"""How large a thing can be printed: tallest cylinders and boxes, the volcano they make, and copies of a part.

Legend
    R, H(R)    radius of a cylinder, and the height up to which no cable touches it while it is printed, mm
    volcano    the union of all centred cylinders (R, H(R)): where something can be printed as long as nothing is wider

A prism is printed layer by layer with the nozzle on its outline; its answer is that of the search through beads
(feasibility.sweep), exact but for polygons drawn around circles and layers `step` mm thick, both on the safe side.
The tension of the weight is asked for at every corner of every layer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.exits import offsets
from cabslice.feasibility.obstacles import Moves, Obstacles
from cabslice.feasibility.sweep import contacts
from cabslice.feasibility.trees import tree_of_beads, tree_of_moves
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.workspace import feasible_margin

SIDES = 48           # of the polygon that stands for a circle
THIN = 1e-3          # mm, half the width of the wall that stands for the prism


@dataclass(frozen=True)
class Volcano:
    """radius (N,) and height (N,) mm of centred cylinders that can be printed; at (2,) mm, their middle on the bed."""

    radius: Array
    height: Array
    at: Array

    @property
    def largest(self) -> int:
        """Row of the cylinder of the largest volume."""
        return int(np.argmax(self.radius**2 * self.height))


def circle(radius: float) -> Array:
    """(SIDES + 1, 2) mm: a closed polygon around a circle."""
    turn = 2 * np.pi / SIDES * np.arange(SIDES + 1)
    return np.asarray(radius / np.cos(np.pi / SIDES) * np.stack((np.cos(turn), np.sin(turn)), axis=1))


def box(x: float, y: float) -> Array:
    """(5, 2) mm: a closed rectangle."""
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]) / 2


def prism_height(robot: Robot, grow: Array, outline: Array, *, step: float = 5.0, top: float | None = None) -> float:
    """Height, mm, a multiple of step, up to which a prism can be printed: outline (N, 2) mm, closed, on the bed.

    0 where it does not fit on the bed or its first layer fails; `top`: not looked for above.
    """
    assert robot.bed_size is not None
    if (np.abs(outline).max(axis=0) > robot.bed_size / 2).any():
        return 0.0
    layers = int((top or highest(robot)) / step)
    heights = step * np.arange(1, layers + 1)
    held = held_up_to(robot, outline, heights)
    low = _free_layers(robot, grow, outline, heights[:held], step)
    return float(step * low)


def highest(robot: Robot) -> float:
    """mm over the bed: the nozzle with the lowest attachment as high as the highest anchor."""
    assert robot.bed_origin is not None
    return float(robot.anchors[:, 2].max() - robot.bed_origin[2] - offsets(robot)[:, 2].min())


def held_up_to(robot: Robot, outline: Array, heights: Array) -> int:
    """How many of some heights, from the lowest, have a feasible tension at all corners of an outline."""
    count = len(outline)
    places = np.hstack((np.tile(outline, (len(heights), 1)), np.repeat(heights, count)[:, None]))
    margin = np.nan_to_num(feasible_margin(robot, nozzle_poses(robot, places)), nan=-np.inf)
    bad = np.flatnonzero((margin.reshape(len(heights), count) < 0).any(axis=1))
    return int(bad[0]) if len(bad) else len(heights)


def _free_layers(robot: Robot, grow: Array, outline: Array, heights: Array, step: float) -> int:
    """Layers that no cable touches: halving, as what is blocked at one height is blocked above."""
    low, high = 0, len(heights)
    while low < high:
        middle = (low + high + 1) // 2
        if _ring_is_free(robot, grow, outline, float(heights[middle - 1])):
            low = middle
        else:
            high = middle - 1
    return low


def _ring_is_free(robot: Robot, grow: Array, outline: Array, height: float) -> bool:
    """The nozzle on the outline at a height, past the prism below it."""
    count = len(outline) - 1
    top, stage, rows = np.full((count, 1), height), np.zeros(count, np.int32), np.arange(count)
    paths = Moves(np.hstack((outline[:-1], top)), np.hstack((outline[1:], top)), stage, rows)
    beads = Obstacles(
        outline[:-1], outline[1:], np.full(count, THIN), np.zeros(count), np.full(count, height), stage, rows)
    return not len(contacts(tree_of_moves(paths, robot), tree_of_beads(beads), robot, grow, stop=1, far=0.0).move)


def volcano(
    robot: Robot, grow: Array, *, radii: Sequence[float] | Array, at: Sequence[float] = (0.0, 0.0), step: float = 5.0,
    tick: Callable[[int, int], None] | None = None,
) -> Volcano:
    """H(R) of cylinders around a place on the bed, radii rising; heights that can be printed never rise with R."""
    heights, top = [], None
    middle = np.asarray(at, dtype=float)
    for done, radius in enumerate(radii):
        top = prism_height(robot, grow, circle(float(radius)) + middle, step=step, top=top) if top != 0 else 0.0
        heights.append(top)
        if tick:
            tick(done + 1, len(radii))
    return Volcano(np.asarray(radii, dtype=float), np.array(heights, dtype=float), middle)


def largest_cube(robot: Robot, grow: Array, *, accuracy: float = 0.5) -> float:
    """Edge, mm, of the largest centred cube with its sides along x and y."""
    assert robot.bed_size is not None
    low, high = 0.0, float(min(*robot.bed_size, highest(robot)))
    while high - low > accuracy:
        edge = (low + high) / 2
        outline = box(edge, edge)
        held = held_up_to(robot, outline, np.linspace(1.0, edge, 20)) == 20
        low, high = (edge, high) if held and _ring_is_free(robot, grow, outline, edge) else (low, edge)
    return low


def surface(found: Volcano) -> tuple[Array, Array]:
    """Vertices (V, 3) and faces (F, 3) of the volcano: a closed stepped body of revolution, on the bed."""
    rows = np.flatnonzero(found.height > 0)
    profile = [(0.0, 0.0)]
    radius, height = found.radius[rows], found.height[rows]
    steps = [(0.0, float(height[0]))] if len(rows) else []
    for r, h, lower in zip(radius, height, [*height[1:], 0.0], strict=True):
        steps += [(float(r), float(h)), (float(r), float(lower))]
    profile = [point for i, point in enumerate(steps) if i == 0 or point != steps[i - 1]]
    return _revolved(np.array([*profile, (0.0, 0.0)]), found.at)


def _revolved(profile: Array, at: Array) -> tuple[Array, Array]:
    """A closed mesh from a profile (r, z) that starts and ends on the axis."""
    turn = 2 * np.pi / SIDES * np.arange(SIDES)
    ring = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    inner = profile[1:-1]
    vertices = [np.array([[at[0], at[1], profile[0, 1]], [at[0], at[1], profile[-1, 1]]])]
    vertices += [np.hstack((r * ring + at, np.full((SIDES, 1), z))) for r, z in inner]
    after, here = np.roll(np.arange(SIDES), -1), np.arange(SIDES)
    first = 2 + SIDES * np.arange(len(inner))
    faces = [np.stack((np.zeros(SIDES, int), first[0] + here, first[0] + after), axis=1)]
    for a, b in pairwise(first):
        faces += [np.stack((a + here, b + here, b + after), axis=1), np.stack((a + here, b + after, a + after), axis=1)]
    faces.append(np.stack((np.ones(SIDES, int), first[-1] + after, first[-1] + here), axis=1))
    return np.vstack(vertices), np.vstack(faces)
