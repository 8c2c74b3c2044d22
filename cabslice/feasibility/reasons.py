"""Findings in words: what the checks found, with layer, place, cable, value, limit, and what would help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.distance import PRECISION, sweep_gap
from cabslice.feasibility.exits import exit_points, hung, lines_at
from cabslice.feasibility.findings import Finding
from cabslice.feasibility.judges import judged_pairs, pair_limits
from cabslice.feasibility.judges import tensions as judge_tensions
from cabslice.feasibility.obstacles import Moves, Obstacles, depths, laying, section
from cabslice.feasibility.survey import Survey
from cabslice.feasibility.sweep import Contacts
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.tension import least_violation
from cabslice.robot.wrench import required_wrench, wrench_matrix
from cabslice.slicing.layer import Role
from cabslice.toolpath.path import Toolpath

LOOKED_AT = 200      # places at which the depth of a cable in the part is worked out
CENTRED = 1.0        # mm from the middle of the bed: no use telling to move there
ALONG = np.linspace(0.0, 1.0, 9)


@dataclass(frozen=True)
class Job:
    """What is checked: all that sentences need. The moves are in stretches, stage by stage."""

    toolpath: Toolpath
    robot: Robot
    moves: Moves
    count: int           # moves of the toolpath that have a length

    def layer(self, move: int) -> int:
        return int(self.toolpath.layer[self.moves.move[move]])

    def travels(self, rows: Array) -> bool:
        """Whether all of these rows of the toolpath only move the nozzle."""
        return bool(((self.toolpath.role[rows] == Role.TRAVEL) & (self.toolpath.filament[rows] == 0)).all())


def place_of(layer: int, xyz: Array) -> str:
    return f"layer {layer} ({xyz[2]:.4g} mm)"


def _at(xyz: Array) -> str:
    return f"with the nozzle at x {xyz[0]:.1f} y {xyz[1]:.1f} mm"


def _triple(xyz: Array) -> tuple[float, float, float]:
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


def nozzle_findings(toolpath: Toolpath, robot: Robot) -> list[Finding]:
    """Nozzle outside the bed plate, or below it: the worst of each axis."""
    assert robot.bed_size is not None
    found = []
    for axis, name in enumerate("xy"):
        half = float(robot.bed_size[axis]) / 2
        row = int(np.abs(toolpath.xyz[:, axis]).argmax())
        value, xyz = float(toolpath.xyz[row, axis]), toolpath.xyz[row]
        if abs(value) > half + PRECISION:
            layer = int(toolpath.layer[row])
            sentence = (
                f"{place_of(layer, xyz)}: the nozzle leaves the bed plate{_doing(toolpath, row)}, "
                f"{name} {value:.2f} mm where it ends at {np.copysign(half, value):.2f} mm."
            )
            advice = _onto_bed(toolpath, axis, half)
            found.append(Finding("bed", layer, _triple(xyz), 0, abs(value), half, "mm", sentence, advice))
    over = toolpath.xyz[:, 2] - toolpath.xyz[:, :2] @ robot.bed_slope
    row = int(over.argmin())
    xyz, layer, height = toolpath.xyz[row], int(toolpath.layer[row]), float(over[row])
    if height < -PRECISION:
        sentence = f"{place_of(layer, xyz)}: the nozzle is {-height:.3f} mm below the bed, {_at(xyz)}."
        found.append(Finding(
            "bed", layer, _triple(xyz), 0, height, 0.0, "mm", sentence, "Place the part on z = 0."
        ))
    return found


def feature(role: int) -> str:
    """What a move is for, as a reader of a sentence knows it."""
    return Role(role).name.lower().replace("_", " ")


def _doing(toolpath: Toolpath, row: int) -> str:
    role = int(toolpath.role[row])
    return " in a travel move" if role == Role.TRAVEL else f" laying the {feature(role)}"


def _onto_bed(toolpath: Toolpath, axis: int, half: float) -> str:
    """What brings the nozzle back onto the plate along one axis."""
    name, laid = "xy"[axis], laying(toolpath)
    part = toolpath.xyz[laid & (toolpath.role != Role.SKIRT), axis]
    if not laid.any():
        return "Make it smaller."
    if len(part) and np.abs(part).max() <= half:
        return "The part itself stays on the plate: leave its skirt out (-s skirt_loops=0) or bring it nearer."
    span = float(np.ptp(toolpath.xyz[laid, axis]))
    return f"Shift the part along {name}." if span <= 2 * half else "Turn the part or make it smaller."


def pulley_findings(job: Job, survey: Survey) -> list[Finding]:
    """Attachments inside their pulleys or on their anchors: one finding a cable."""
    found, cables = [], job.robot.cables
    for cable in range(cables):
        column = cable if survey.worst[cable] < survey.worst[cables + cable] else cables + cable
        if survey.worst[column] < 0:
            xyz, layer, radius = survey.where[column], job.layer(survey.move[column]), job.robot.pulley_radii[cable]
            value = float(survey.worst[column] + radius)
            sentence = (
                f"{place_of(layer, xyz)}: cable {cable + 1} cannot leave its pulley, its attachment is {value:.2f} mm "
                f"from the {'swivel axis' if column < cables else 'pulley centre'} (limit {radius:.2f} mm) {_at(xyz)}."
            )
            found.append(Finding(
                "pulley", layer, _triple(xyz), cable + 1, value, float(radius), "mm", sentence,
                "Move the part away from this pulley, or make it smaller.",
            ))
    return found


def end_findings(job: Job, survey: Survey, grow: Array) -> list[Finding]:
    """Exit points or attachments at the bed plate: one finding a cable."""
    found, cables = [], job.robot.cables
    for cable in range(cables):
        column = cable if survey.worst[cable] < survey.worst[cables + cable] else cables + cable
        if survey.worst[column] < 0:
            xyz, layer = survey.where[column], job.layer(survey.move[column])
            value, end = float(survey.worst[column] + grow[cable]), "pulley" if column < cables else "platform"
            state = f"{value:.2f} mm from" if value > 0 else f"{-value:.2f} mm inside"
            sentence = (
                f"{place_of(layer, xyz)}: the {end} end of cable {cable + 1} is {state} the bed plate "
                f"(limit {grow[cable]:.2f} mm) {_at(xyz)}."
            )
            found.append(Finding(
                "cable-end", layer, _triple(xyz), cable + 1, value, float(grow[cable]), "mm", sentence,
                "The bed of this printer profile is too large, or too high, for its cables.",
            ))
    return found


def pair_findings(job: Job, survey: Survey) -> list[Finding]:
    """Cables too near to each other: one finding a pair, under the first of the two."""
    found = []
    for (one, other), limit, worst, xyz, move in zip(
        judged_pairs(job.robot) + 1, pair_limits(job.robot), survey.worst, survey.where, survey.move, strict=True
    ):
        if worst < 0:
            layer, value = job.layer(move), float(worst + limit)
            sentence = (
                f"{place_of(layer, xyz)}: cables {one} and {other} come within {value:.2f} mm of each other "
                f"(limit {limit:.2f} mm between centre lines) {_at(xyz)}."
            )
            found.append(Finding(
                "cable-cable", layer, _triple(xyz), int(one), value, float(limit), "mm", sentence,
                "Shift or turn the part, or make it smaller or lower: these cables meet where the platform is here.",
            ))
    return sorted(found, key=lambda finding: finding.value - finding.limit)


def tension_finding(job: Job, survey: Survey, first: int) -> Finding:
    """No feasible tension: the worst place met, the cable that misses its bounds most, and the first layer."""
    robot, xyz, layer = job.robot, survey.where[0], job.layer(survey.move[0])
    poses, lines = nozzle_poses(robot, xyz[None]), lines_at(robot, xyz[None])
    wrench = wrench_matrix(robot, poses, masked=True, lines=lines)
    needed = required_wrench(robot, poses, masked=True)
    tension = least_violation(
        wrench, needed, robot.tension_min, robot.tension_max, robot.tension_reference
    ).tension[0]
    begin = job.layer(first)
    where, since = f"{place_of(layer, xyz)}: ", "" if begin == layer else f"; the first layer without is {begin}"
    since = since if begin >= 0 else "; nor on the way from home to the part"
    advice = _held_where(job, xyz)
    if not np.isfinite(tension).all():
        sentence = f"{where}the cables do not hold the platform at all (singular pose) {_at(xyz)}{since}."
        limit = float(robot.tension_min.max())
        return Finding("tension", layer, _triple(xyz), 0, 0.0, limit, "N", sentence, advice, _free(job, begin))
    missing = np.maximum(robot.tension_min - tension, tension - robot.tension_max)
    cable = int(missing.argmax())
    slack = tension[cable] < robot.tension_min[cable]
    limit = float((robot.tension_min if slack else robot.tension_max)[cable])
    sentence = (
        f"{where}no tension within the bounds holds the platform {_at(xyz)}: at best cable {cable + 1} needs "
        f"{tension[cable]:.2f} N ({'at least' if slack else 'at most'} {limit:.2f} N allowed){since}."
    )
    return Finding(
        "tension", layer, _triple(xyz), cable + 1, float(tension[cable]), limit, "N", sentence, advice,
        _free(job, begin),
    )


def _held_where(job: Job, xyz: Array) -> str:
    """What would help where no tension holds the platform, by what holds in the middle of the bed."""
    robot, laid = job.robot, job.toolpath.xyz[laying(job.toolpath)]
    middle = np.array([[0.0, 0.0, laid[:, 2].min()], [0.0, 0.0, xyz[2]]])
    low, here = judge_tensions(robot)(middle, np.zeros(2))[0][:, 0]
    if low < 0:
        return (
            f"Nor does any in the middle of the bed: these cables and tension bounds cannot carry {robot.mass:g} kg at "
            "this bed, wherever the part stands (platform.mass_kg, cables.max_tension_n, bed.z_mm)."
        )
    if here < 0:
        return f"At {xyz[2]:.4g} mm none does in the middle of the bed either: a lower part, or one split in height."
    centred = np.linalg.norm((laid.min(axis=0) + laid.max(axis=0))[:2] / 2) < CENTRED
    shift = "turn it" if centred else "Move the part towards the middle of the bed, turn it"
    return (shift[:1].upper() + shift[1:]) + ", or make it smaller or lower."


def contact_findings(
    job: Job, contacts: Contacts, moves: Moves, beads: Obstacles, grow: Array, code: str
) -> list[Finding]:
    """Cables at the part (code "cable-part") or at the bed plate ("cable-bed"): one finding a cable, worst first.

    moves, beads: the items of the trees the contacts were found with.
    """
    views = _Views(beads)
    found = [
        _contact(job, contacts, np.flatnonzero(contacts.cable == cable), moves, beads, views, grow, code)
        for cable in np.unique(contacts.cable)
    ]
    return sorted(found, key=lambda finding: finding.value - finding.limit)


def _contact(
    job: Job, contacts: Contacts, rows: Array, moves: Moves, beads: Obstacles, views: _Views, grow: Array, code: str
) -> Finding:
    cable = int(contacts.cable[rows[0]])
    inside = rows[contacts.gap[rows] <= PRECISION]
    worst, value = int(rows[contacts.gap[rows].argmin()]), float(contacts.gap[rows].min())
    if len(inside) and code == "cable-part":
        some = inside[np.unique(np.linspace(0, len(inside) - 1, LOOKED_AT).astype(int))]
        deep = views.depth(job.robot, moves.take(contacts.move[some]), beads.take(contacts.bead[some]), cable)
        worst, value = int(some[deep.argmax()]), -float(deep.max())
    move, bead = moves.take(contacts.move[[worst]]), beads.take(contacts.bead[[worst]])
    xyz = _nearest_place(job.robot, move, bead, cable)
    layers = job.toolpath.layer[moves.move[contacts.move[rows]]]
    layer, first, limit = int(job.toolpath.layer[move.move[0]]), int(layers[0]), float(grow[cable])
    roles = job.toolpath.role[beads.move[contacts.bead[rows]]] if code == "cable-part" else np.zeros(0)
    what = _named(job, int(bead.move[0])) if code == "cable-part" else "the bed plate"
    state = f"comes within {value:.2f} mm of {what}" if value > 0 else f"cuts {-value:.2f} mm into {what}"
    if value == 0:
        state = f"meets {what}"
    blocked, travel = len(np.unique(moves.move[contacts.move[rows]])), job.travels(moves.move[contacts.move[rows]])
    sentence = (
        f"{place_of(layer, xyz)}: cable {cable + 1} {state} (limit {limit:.2f} mm) {_at(xyz)}; "
        f"{blocked} {'travels' if travel else 'moves'} in layers {layers.min()} to {layers.max()} are blocked by it."
    )
    advice = _advice(job, beads, int(moves.stage[contacts.move[rows[0]]]), first, xyz, cable, code)
    if len(roles) and (roles == Role.SKIRT).all():
        advice = "Only the skirt is in its way, not the part: leave it out (-s skirt_loops=0) or bring it nearer."
    return Finding(
        code, layer, _triple(xyz), cable + 1, value, limit, "mm", sentence, advice, _free(job, first), travel)


def _free(job: Job, layer: int) -> float | None:
    """Height of what is laid in the layers below one, mm."""
    below = job.toolpath.xyz[laying(job.toolpath) & (job.toolpath.layer < layer), 2]
    return float(below.max()) if len(below) else None


def _named(job: Job, row: int) -> str:
    role = int(job.toolpath.role[row])
    return f"the {feature(role)}" if role in (Role.SKIRT, Role.SUPPORT) else f"the part ({feature(role)})"


def _advice(job: Job, beads: Obstacles, stage: int, first: int, xyz: Array, cable: int, code: str) -> str:
    """Farther from its pulley a cable runs flatter and crosses the heights of the part farther from the nozzle."""
    away = xyz[:2] - exit_points(job.robot, xyz[None])[0, cable, :2]
    towards = " ".join(f"{name}{'+' if way > 0 else '-'}" for name, way in zip("xy", away, strict=True)
                       if abs(way) > 0.4 * float(np.linalg.norm(away)))
    if code == "cable-bed":
        return f"Shift the part towards {towards}, away from the pulley of this cable, or make it smaller."
    below = beads.top[beads.stage < stage]
    free = f"Up to {below.max():.4g} mm (below layer {first}) this cable is clear. " if len(below) else ""
    return f"{free}A lower part, a turn about z, or a shift towards {towards}, away from its pulley, would help."


def _nearest_place(robot: Robot, move: Moves, bead: Obstacles, cable: int) -> Array:
    """Where on a move (one row) the cable is nearest to the bead."""
    xyz = move.start + ALONG[:, None] * (move.end - move.start)
    tips, exits = xyz + hung(robot, xyz)[:, cable], exit_points(robot, xyz)[:, cable]
    gap, _ = sweep_gap(exits, tips, tips, bead.take(np.zeros(len(xyz), int)), np.full(len(xyz), np.inf))
    return xyz[gap.argmin()]


class _Views:
    """Plan views of the stages of a print, drawn when first asked for."""

    def __init__(self, beads: Obstacles) -> None:
        self.beads, self.drawn = beads, {}          # type: ignore[var-annotated]

    def depth(self, robot: Robot, moves: Moves, beads: Obstacles, cable: int) -> Array:
        """How far inside the plan view of the stage of its bead (row by row) a cable runs, mm."""
        middle = (moves.start + moves.end) / 2
        tips, exits = middle + hung(robot, middle)[:, cable], exit_points(robot, middle)[:, cable]
        rise = tips[:, 2] - exits[:, 2]
        share = ((beads.low + beads.top) / 2 - exits[:, 2]) / np.where(rise == 0, 1.0, rise)
        crossing = exits + np.clip(share, 0.0, 1.0)[:, None] * (tips - exits)
        deep = np.zeros(len(beads))
        for stage in self._chosen(beads.stage):
            if stage not in self.drawn:
                self.drawn[stage] = section(self.beads.take(np.flatnonzero(self.beads.stage == stage)))
            rows = np.flatnonzero(beads.stage == stage)
            deep[rows] = depths(self.drawn[stage], crossing[rows, :2])
        return deep

    @staticmethod
    def _chosen(stages: Array, count: int = 20) -> Sequence[int]:
        found = np.unique(stages)
        return found[np.unique(np.linspace(0, len(found) - 1, count).astype(int))].tolist()
