"""Can this robot follow this toolpath? Every point of it, travels and the stretches between vertices included.

Nothing is sampled: places are judged with a bound that holds around them (survey, judges), cables are set against the
part printed so far by what they sweep (trees, sweep). What was checked is said in the verdict, with counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import InputError, ProfileError
from cabslice.feasibility import judges, reasons
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.feasibility.obstacles import (
    Moves,
    Obstacles,
    beads_of,
    bed_edges,
    island_stages,
    laying,
    moves_of,
    moving,
    printing_stages,
)
from cabslice.feasibility.reasons import Job
from cabslice.feasibility.shapes import head_and_part, shapes, without_shapes
from cabslice.feasibility.survey import WIDTHS, Cells, Survey, explore, first_cells, first_failure
from cabslice.feasibility.sweep import AIR, FAR, Contacts, clearances, contacts
from cabslice.feasibility.trees import Tree, tree_of_beads, tree_of_moves
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.tension import nearest_tension
from cabslice.robot.wrench import required_wrench
from cabslice.toolpath.path import Toolpath

Progress = Callable[[int, int], None]
STEPS = 100          # units of progress: SURVEYED of them for the survey, the rest for cables and part
SURVEYED = 50


def check(
    toolpath: Toolpath, robot: Robot, *, far: float = FAR, progress: Progress | None = None, bare: bool = False
) -> Verdict:
    """Whether `robot` can follow `toolpath`, with every reason why not; progress(done, total).

    The margin of cables to the part is looked for up to `far` mm.

    Checked: the nozzle over the bed plate; every cable able to leave its pulley; a feasible tension under gravity;
    cables against each other, the bed plate and the part printed so far. A verdict is ok only if all of it was done.

    Raises InputError where the toolpath lays nothing and that was not said (`bare`), ProfileError where the robot has
    no nozzle or no bed.
    """
    _refuse(toolpath, robot, bare)
    tell = progress or (lambda done, total: None)
    stages = printing_stages(toolpath)
    moves = tree_of_moves(moves_of(toolpath, stages), robot)
    assert isinstance(moves.items, Moves)
    job = Job(toolpath, robot, moves.items, int(np.count_nonzero(moving(toolpath))))
    verdict = _nozzle(job)
    if not verdict.ok:
        return verdict.joined(Verdict(("Not checked, as the nozzle leaves the bed: cables, tensions, distances.",)))
    verdict = verdict.joined(_places(job, tell))
    if any(finding.code == "pulley" for finding in verdict.findings):
        return verdict.joined(Verdict(("Not checked, as a cable cannot leave its pulley: tensions and distances.",)))
    grow = grown(robot)
    if robot.bodies or robot.obstacles:
        verdict = verdict.joined(shapes(job, first_cells(job.moves), grow))
    verdict = verdict.joined(_plate(job, moves, grow))
    if not bare:
        beads = tree_of_beads(beads_of(toolpath, stages))
        verdict = verdict.joined(head_and_part(job, moves, beads, _levelled(toolpath, stages, robot)))
        verdict = verdict.joined(_part(job, moves, beads, grow, far, tell))
    missing = without_shapes(robot)
    return verdict.joined(Verdict(missing)) if missing else verdict


def part_clearance(toolpath: Toolpath, robot: Robot) -> Array:
    """(N,) mm for each move: what the cables have left to the part printed so far, up to sweep.AIR; proven.

    Of a path that `check` found over the bed, with every cable able to leave its pulley. Raises as check does.
    """
    _refuse(toolpath, robot, False)
    stages = printing_stages(toolpath)
    moves = tree_of_moves(moves_of(toolpath, stages), robot)
    assert isinstance(moves.items, Moves)
    found = np.full(len(toolpath.xyz), AIR)
    each = clearances(moves, tree_of_beads(beads_of(toolpath, stages)), robot, grown(robot))
    np.minimum.at(found, moves.items.move, each)
    return found


def _levelled(toolpath: Toolpath, stages: Array, robot: Robot) -> tuple[Tree, Tree] | None:
    """Moves and beads with the slope of the bed taken out of them; None where the bed is level."""
    if not robot.bed_slope.any():
        return None
    xyz = toolpath.xyz.copy()
    xyz[:, 2] -= xyz[:, :2] @ robot.bed_slope
    flat = replace(toolpath, xyz=xyz)
    return tree_of_moves(moves_of(flat, stages), robot), tree_of_beads(beads_of(flat, stages))


def _places(job: Job, tell: Progress) -> Verdict:
    """What depends on where the nozzle is alone."""
    cells = first_cells(job.moves)
    tell(10, STEPS)
    verdict = _pulleys(job, cells)
    if verdict.ok or all(finding.code != "pulley" for finding in verdict.findings):
        verdict = verdict.joined(_tension(job, cells)).joined(_pairs(job, cells)).joined(_ends(job, cells))
    tell(SURVEYED, STEPS)
    return verdict


def _refuse(toolpath: Toolpath, robot: Robot, bare: bool) -> None:
    name = robot.name or "robot"
    parts = ("nozzle", robot.nozzle), ("bed", robot.bed_origin), ("bed size", robot.bed_size)
    faults = [f"it has no {what}: expected one, to print with." for what, value in parts if value is None]
    if faults:
        raise ProfileError(name, faults)
    if not bare and not laying(toolpath).any():
        source = toolpath.source or "the toolpath"
        raise InputError(f"{source}: none of its {len(toolpath.xyz)} moves lays material; expected at least one bead.")


def grown(robot: Robot) -> Array:
    """(m,) mm: what the centre line of each cable must stay away from anything by, radius and clearance."""
    return robot.cable_radii + robot.clearance


# ---- the nozzle and the cables by themselves

def _nozzle(job: Job) -> Verdict:
    assert job.robot.bed_size is not None
    xyz, half = job.toolpath.xyz, job.robot.bed_size / 2
    margin = float((half - np.abs(xyz[:, :2])).min())
    sentence = f"Nozzle over the bed plate, {2 * half[0]:g} x {2 * half[1]:g} mm, and not below it: {len(xyz)} points."
    return Verdict((sentence,), tuple(reasons.nozzle_findings(job.toolpath, job.robot)), {"nozzle_bed_mm": margin})


def _pulleys(job: Job, cells: Cells) -> Verdict:
    survey = explore(cells, judges.pulleys(job.robot))
    sentence = f"Cables able to leave their pulleys: {_covered(survey, job)}."
    return Verdict((sentence,), tuple(reasons.pulley_findings(job, survey)), {"pulley_mm": float(survey.worst.min())})


def _tension(job: Job, cells: Cells) -> Verdict:
    judge = judges.tensions(job.robot)
    survey = explore(cells, judge)
    found: tuple[Finding, ...] = ()
    if len(survey.failing.move):
        found = (reasons.tension_finding(job, survey, first_failure(survey.failing, judge)[0]),)
    sentence = f"A tension within the bounds of every cable under gravity: {_covered(survey, job)}."
    margin = max(float(survey.worst[0]), -float(job.robot.tension_max.max()))     # finite at a singular pose too
    margins = {"tension_n": margin}
    if not found:
        cable, least = printed_margin(job.robot, cells.place)
        margins["tension_printed_n"] = min(least, margin)
        sentence = (
            f"{sentence} That is with the best of them; with those it is printed with at rest, nearest to "
            f"reference_tension_n, cable {cable + 1} comes within {least:.2f} N of its bounds (at {len(cells.place)})."
        )
    return Verdict((sentence,), found, margins)


def printed_margin(robot: Robot, places: Array) -> tuple[int, float]:
    """Cable (from 0) and N: the least way to a bound of the tensions nearest to the reference, at rest."""
    tension = nearest_tension(robot, nozzle_poses(robot, places), _weight(robot, places), margins=False).tension
    slack = np.nan_to_num(np.minimum(tension - robot.tension_min, robot.tension_max - tension), nan=0.0)
    return int(slack.min(axis=0).argmin()), float(slack.min())


def _weight(robot: Robot, places: Array) -> Array:
    """(K, 6) N, N mm: what the cables supply with the nozzle at rest at places (K, 3)."""
    return required_wrench(robot, nozzle_poses(robot, places))


def _pairs(job: Job, cells: Cells) -> Verdict:
    pairs = judges.judged_pairs(job.robot)
    left = job.robot.cables * (job.robot.cables - 1) // 2 - len(pairs)
    skipped = f" ({left} pairs share an end and were left out)" if left else ""
    if not len(pairs):
        return Verdict((f"Cables against each other: no pair to check{skipped}.",))
    survey = explore(cells, judges.cable_pairs(job.robot), cap=FAR)
    sentence = f"Cables against each other, {len(pairs)} pairs{skipped}: {_covered(survey, job)}."
    return Verdict((sentence,), tuple(reasons.pair_findings(job, survey)), {"cable_cable_mm": _margin(survey)})


def _margin(survey: Survey) -> float:
    """Proven where it can be: the least that was met where something fails or stayed open."""
    worst = float(survey.worst.min())
    return worst if worst < 0 or survey.open else min(worst, survey.proven)


def _covered(survey: Survey, job: Job) -> str:
    proof = f"all of {job.count} moves, by {survey.visits} places and a bound on the change between them"
    if survey.open:
        proof += f"; {survey.open} cells of {WIDTHS[-1]:g} mm, too near the limit for the bound, by their places alone"
    return proof


def _ends(job: Job, cells: Cells) -> Verdict:
    grow = grown(job.robot)
    survey = explore(cells, judges.ends_over_bed(job.robot, grow), cap=FAR)
    found = tuple(reasons.end_findings(job, survey, grow))
    sentence = f"Both ends of every cable clear of the bed plate: {_covered(survey, job)}."
    return Verdict((sentence,), found, {"cable_end_bed_mm": _margin(survey)})


# ---- cables against what stands on the bed

def _plate(job: Job, moves: Tree, grow: Array) -> Verdict:
    assert job.robot.bed_size is not None
    sides = tree_of_beads(bed_edges(job.robot.bed_size, job.robot.bed_slope))
    met = contacts(moves, sides, job.robot, grow)
    found = _told(job, met, moves, sides, grow, "cable-bed")
    count = f"{job.count} moves, {job.robot.cables} cables"
    sentence = f"Cables against the sides of the bed plate, down to the ground: {count}{_until(job, met)}."
    return Verdict((sentence,), tuple(found), {"cable_bed_mm": _least(met, found)}, _capped(met, "cable_bed_mm"))


def _part(job: Job, moves: Tree, part: Tree, grow: Array, far: float, tell: Progress) -> Verdict:
    def share(done: int, of: int) -> None:
        tell(SURVEYED + (STEPS - SURVEYED) * done // of, STEPS)

    met = contacts(moves, part, job.robot, grow, far=far, progress=share)
    within = _within_layers(met, moves, part)
    if within is not None:                   # some of it may have been laid only later in the same layer
        job, moves, part = _by_islands(job, within)
        met = contacts(moves, part, job.robot, grow, far=far, progress=share)
    found = _told(job, met, moves, part, grow, "cable-part")
    tell(STEPS, STEPS)
    least = {"cable_part_mm": _least(met, found)}
    return Verdict((_compared(job, met, part),), tuple(found), least, _capped(met, "cable_part_mm"))


def _within_layers(met: Contacts, moves: Tree, part: Tree) -> int | None:
    """The first stage in which a move meets what is laid in it; None where there is none."""
    stage = moves.items.stage[met.move]
    same = stage == part.items.stage[met.bead]
    return int(stage[same].min()) if same.any() else None


def _by_islands(job: Job, first: int) -> tuple[Job, Tree, Tree]:
    """The same in stages that end with each run of beads, from stage `first` on."""
    path = job.toolpath
    stages = island_stages(path, printing_stages(path), first)
    moves, part = tree_of_moves(moves_of(path, stages), job.robot), tree_of_beads(beads_of(path, stages))
    assert isinstance(moves.items, Moves)
    return replace(job, moves=moves.items), moves, part


def _capped(met: Contacts, key: str) -> tuple[str, ...]:
    return (key,) if met.margin >= met.far else ()


def _told(job: Job, met: Contacts, moves: Tree, beads: Tree, grow: Array, code: str) -> list[Finding]:
    if not len(met.move):
        return []
    paths, laid = moves.items, beads.items
    assert isinstance(paths, Moves)
    assert isinstance(laid, Obstacles)
    return reasons.contact_findings(job, met, paths, laid, grow, code)


def _least(met: Contacts, found: list[Finding]) -> float:
    return min((finding.value - finding.limit for finding in found), default=met.margin)


def _until(job: Job, met: Contacts) -> str:
    if met.complete:
        return ""
    layer = int(job.toolpath.layer[job.moves.move[job.moves.stage <= met.last_stage]].max())
    return f"; stopped at layer {layer}, enough having failed: what comes later was not checked for this"


def _compared(job: Job, met: Contacts, part: Tree) -> str:
    """Counts: every move against all beads of its own and earlier stages, cable by cable."""
    searched = int(np.count_nonzero(job.moves.stage <= met.last_stage))
    laid = np.searchsorted(part.items.stage, job.moves.stage[:searched], side="right")
    pairs = int(laid.sum()) * job.robot.cables
    rows = job.count if met.complete else len(np.unique(job.moves.move[:searched]))
    return (
        f"Cables against the part printed so far, current layer included: {rows} moves, {job.robot.cables} cables, "
        f"{pairs:.3g} pairs of stretches of moves and beads, {met.exact} of them computed one by one, "
        f"the others proven apart{_until(job, met)}."
    )
