"""Platform, print head and frame, where the profile gives their shapes: against cables, bed, frame and the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.bodies import (
    Body,
    cables_and,
    moving_bodies,
    plate,
    shifted_apart,
    standing_bodies,
    swept_bodies,
)
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.feasibility.obstacles import Moves, Obstacles
from cabslice.feasibility.reasons import Job, place_of
from cabslice.feasibility.survey import Cells, Survey, explore
from cabslice.feasibility.sweep import FAR
from cabslice.feasibility.trees import (
    AXES,
    DIRECTIONS,
    Bounds,
    Tree,
    bounds_of_beads,
    bounds_of_moves,
    members,
)
from cabslice.robot.model import Robot

THICK = 1000.0       # mm, of the bed plate
TOUCH = 0.05         # mm: a nozzle this much below what is laid still counts as on it
LEVELS = 64          # heights at which the width of a body is known
PAIRS = 1 << 12
TIP = "nozzle tip"


def shapes(job: Job, cells: Cells, grow: Array) -> Verdict:
    """Cables against the bodies on the platform and what stands around; these bodies against bed plate and frame."""
    robot = job.robot
    assert robot.bed_size is not None
    moving, standing = moving_bodies(robot), standing_bodies(robot)
    verdict = Verdict((f"Shapes of the printer profile: {len(moving)} on the platform, {len(standing)} around.",))
    for bodies, code in ((moving, "cable-platform"), (standing, "cable-frame")):
        if bodies:
            judge = cables_and(robot, bodies, grow, moving=code == "cable-platform")
            verdict = _with(verdict, job, explore(cells, judge, cap=FAR), bodies, code)
    if moving:
        others = [plate(robot.bed_size, THICK, robot.bed_slope), *standing]
        moving = swept_bodies(robot, *reached(job.moves))
        survey = explore(cells, shifted_apart(moving, others), cap=FAR)
        pairs = [(one, other) for one in moving for other in others]
        ones, against = zip(*pairs, strict=True)
        verdict = _with(verdict, job, survey, ones, "platform-frame", against)
    return verdict


def reached(moves: Moves) -> tuple[Array, Array]:
    """Corners (3,) mm of the box of all places of the nozzle."""
    return np.minimum(moves.start, moves.end).min(axis=0), np.maximum(moves.start, moves.end).max(axis=0)


def without_shapes(robot: Robot) -> tuple[str, ...]:
    """What cannot be checked, as the printer profile does not give it: sentences."""
    missing = (
        ("platform and print head against cables, bed and part (platform.hull_mm, nozzle.hull_mm)", robot.bodies),
        ("cables and platform against the frame (obstacles_mm)", robot.obstacles),
    )
    start = "Not checked, as the printer profile gives no shape"
    return tuple(f"{start}: {words}." for words, given in missing if not given)


def _with(
    verdict: Verdict, job: Job, survey: Survey, bodies: Sequence[Body], code: str, others: Sequence[Body] = ()
) -> Verdict:
    """The verdict with one survey of bodies: what was covered, its margin, and a finding for each that is hit."""
    cables, found = job.robot.cables if not others else 1, []
    for column in np.flatnonzero(survey.worst < 0).tolist():
        cable, body = (0, bodies[column]) if others else (column % cables + 1, bodies[column // cables])
        xyz, layer, value = survey.where[column], job.layer(survey.move[column]), float(survey.worst[column])
        what = f"the {body.name} meets the {others[column].name}" if others else (
            f"cable {cable} comes to the {body.name}, nearer than its radius and clearance,")
        found.append(Finding(
            code, layer, (float(xyz[0]), float(xyz[1]), float(xyz[2])), cable, value, 0.0, "mm",
            f"{place_of(layer, xyz)}: {what} by {-value:.2f} mm with the nozzle at x {xyz[0]:.1f} y {xyz[1]:.1f} mm.",
            "Shift the part, make it smaller or lower; or mend the shape in the printer profile.",
        ))
    proof = f"{survey.visits} places and a bound on the change between them"
    names = ", ".join(dict.fromkeys(body.name for body in bodies))
    against = " and ".join(dict.fromkeys(other.name for other in others)) if others else "cables"
    sentence = f"{names} against {against}: all of {job.count} moves, by {proof}."
    worst = float(survey.worst.min())
    margin = worst if worst < 0 or survey.open else min(worst, survey.proven)
    key = f"{code.replace('-', '_')}_mm"
    return verdict.joined(Verdict((sentence[0].upper() + sentence[1:],), tuple(found), {key: margin}))


# ---- against the part

def head_and_part(job: Job, moves: Tree, beads: Tree, level: tuple[Tree, Tree] | None = None) -> Verdict:
    """Nozzle tip and bodies against what was laid in earlier stages: only what stands higher than they can be met.

    `level`: moves and beads as over a level bed, for the tip, which a slope lifts as much as what is under it.
    """
    tip = Body(TIP, np.zeros((1, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
    found: list[Finding] = []
    bodies = [tip, *swept_bodies(job.robot, *reached(job.moves))]
    for body in bodies:
        trees = level if level and body is tip else (moves, beads)
        pair = first_met(*trees, Widths(body))
        if pair is not None:
            found.append(_met(job, *trees, body, *pair))
    names = ", ".join(body.name for body in bodies)
    sentence = f"Against the part printed in earlier layers: {names}; {job.count} moves."
    return Verdict((sentence,), tuple(found))


class Widths:
    """How far a body reaches along the directions of the bounds, below each height over the nozzle tip."""

    def __init__(self, body: Body) -> None:
        low, high = body.corners[:, 2].min(), body.corners[:, 2].max()
        ends, heights = _edges(body.corners), np.linspace(low, high, LEVELS)
        self.reach = np.stack([_reach(body.corners, ends, height) for height in heights]) + body.pad
        self.low, self.heights = float(low) - body.pad, heights - body.pad

    def below(self, height: Array) -> Array:
        """(K, 2 AXES): greatest x . axis, and greatest -x . axis, of what is not above a height (K,) over the tip."""
        row = np.searchsorted(self.heights, height, side="left")
        return np.asarray(self.reach[np.minimum(row, LEVELS - 1)])


def _edges(corners: Array) -> Array:
    """(P, 2, 3): all pairs of corners; the hull of what lies below a height is that of their ends and crossings."""
    i, j = np.triu_indices(len(corners), 1)
    return np.stack((corners[i], corners[j]), axis=1)


def _reach(corners: Array, ends: Array, height: float) -> Array:
    points = [corners[corners[:, 2] <= height + 1e-9]]
    z = ends[:, :, 2]
    rows = (z.min(axis=1) < height) & (z.max(axis=1) > height)
    share = (height - z[rows, 0]) / (z[rows, 1] - z[rows, 0])
    points.append(ends[rows, 0] + share[:, None] * (ends[rows, 1] - ends[rows, 0]))
    plan = np.vstack(points)[:, :2] @ DIRECTIONS
    return np.concatenate((plan.max(axis=0), -plan.min(axis=0)))


def first_met(moves: Tree, beads: Tree, widths: Widths) -> tuple[int, int] | None:
    """Leaves of moves and beads of the first stage in which the body is not proven apart from what was laid before."""
    best: list[tuple[int, int, int]] = []                    # stage, move, bead: each of an earlier stage
    for move, bead in _meetings(moves, beads, widths, best):
        stages = moves.items.stage[move]
        at = int(stages.argmin())
        if not best or stages[at] < best[-1][0]:
            best.append((int(stages[at]), int(move[at]), int(bead[at])))
    return best[-1][1:] if best else None


def all_met(moves: Tree, beads: Tree, widths: Widths) -> Array:
    """Rows of the moves in which the body is not proven apart from what was laid in stages before."""
    found = [move for move, _ in _meetings(moves, beads, widths, [])]
    return np.unique(np.concatenate([np.zeros(0, int), *found]))


def _meetings(
    moves: Tree, beads: Tree, widths: Widths, known: Sequence[tuple[int, int, int]]
) -> Iterator[tuple[Array, Array]]:
    """Pairs of stretches and beads that are not proven apart, some at a time; only in stages before the last known."""
    level, other = len(moves.levels) - 1, len(beads.levels) - 1
    stack = [(level, other, np.zeros(1, int), np.zeros(1, int))]
    while stack:
        level, other, move, bead = stack.pop()
        if len(move) > PAIRS:
            stack.append((level, other, move[PAIRS:], bead[PAIRS:]))
            move, bead = move[:PAIRS], bead[:PAIRS]
        rows = _near(moves.levels[level].take(move), beads.levels[other].take(bead), widths)
        rows = rows[moves.levels[level].first[move[rows]] < known[-1][0]] if known else rows
        move, bead = move[rows], bead[rows]
        if not len(move):
            continue
        if level == other == 0:
            move, bead = _confronted(moves, beads, move, bead, widths)
            if len(move):
                yield move, bead
            continue
        if level >= other:
            level -= 1
            move, bead = _halved(move, bead, len(moves.levels[level].low))
        else:
            other -= 1
            bead, move = _halved(bead, move, len(beads.levels[other].low))
        stack.append((level, other, move, bead))


def _confronted(moves: Tree, beads: Tree, home: Array, leaf: Array, widths: Widths) -> tuple[Array, Array]:
    """Pairs of stretches and beads, in leaves that are not apart, that are not apart themselves."""
    paths, laid = moves.items, beads.items
    assert isinstance(paths, Moves)
    assert isinstance(laid, Obstacles)
    met: list[tuple[Array, Array]] = [(np.zeros(0, int), np.zeros(0, int))]
    for i in range(0, len(home), PAIRS // 64):
        move, (others,) = members(moves.starts, home[i:i + PAIRS // 64], leaf[i:i + PAIRS // 64])
        bead, (move,) = members(beads.starts, others, move)
        rows = _near(bounds_of_moves(paths.take(move)), bounds_of_beads(laid.take(bead)), widths)
        met.append((move[rows], bead[rows]))
    return np.concatenate([pair[0] for pair in met]), np.concatenate([pair[1] for pair in met])


def _halved(nodes: Array, others: Array, count: int) -> tuple[Array, Array]:
    children = np.concatenate((2 * nodes, 2 * nodes + 1))
    rows = np.flatnonzero(children < count)
    return children[rows], np.concatenate((others, others))[rows]


def _near(moves: Bounds, beads: Bounds, widths: Widths) -> Array:
    """Rows of pairs in which the body may reach below the top of something laid in an earlier stage."""
    deep = beads.top - TOUCH - moves.low
    reach = widths.below(deep)
    apart = np.maximum(beads.lo - moves.hi - reach[:, :AXES], moves.lo - reach[:, AXES:] - beads.hi).max(axis=1)
    return np.flatnonzero((beads.first < moves.last) & (deep > widths.low) & (apart < 0))


def _met(job: Job, moves: Tree, beads: Tree, body: Body, move: int, bead: int) -> Finding:
    paths, laid = moves.items, beads.items
    assert isinstance(paths, Moves)
    assert isinstance(laid, Obstacles)
    lower = paths.start[move] if paths.start[move, 2] <= paths.end[move, 2] else paths.end[move]
    xyz, layer, height = lower, job.layer(move), float(laid.top[bead])
    value = height - float(xyz[2]) - float(body.corners[:, 2].min())
    return Finding(
        "head-part", layer, (float(xyz[0]), float(xyz[1]), float(xyz[2])), 0, -value, 0.0, "mm",
        f"{place_of(layer, xyz)}: the {body.name} comes to what is printed there up to {height:.4g} mm, {value:.2f} mm "
        f"above its lower end, near x {xyz[0]:.1f} y {xyz[1]:.1f} mm.",
        "Print objects together layer by layer, farther apart, or the tall one last; or lift the nozzle in travels.",
        travel=job.travels(paths.move[[move]]),
    )
