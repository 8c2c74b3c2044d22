"""What would help a part that a robot cannot make as asked, each tried; and where a part stands best.

Spots are ranked by slabs and pixels (optimization.placement). What is said to be printable was then placed, sliced and
checked like any part: as asked where a placement is wanted, with its walls only where help is looked for.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabslice import pipeline
from cabslice.arrays import Array
from cabslice.errors import CabsliceError
from cabslice.feasibility.findings import Verdict
from cabslice.mesh.place import place
from cabslice.optimization.field import Field, field_of
from cabslice.optimization.maps import Volcano, largest_cube, volcano
from cabslice.optimization.placement import Spot, Standing, measured, room, spots
from cabslice.optimization.solid import SLABS, THINNEST, Solid, solid_of
from cabslice.pipeline import Placed, Profiles, Progress, silent
from cabslice.profile import shelf
from cabslice.robot.model import Robot, robot_from_printer
from cabslice.store import Laid

FAR = 25.0           # mm, up to which clearances are measured
TRIES = 4            # spots that are sliced and checked before none is said to have been found
LEAST = 0.05         # of the size, below which no scale is looked for
RADII = 40           # of cylinders that are asked for
PRINTERS = 3         # others that are named
BARE = {"walls": 1, "top_layers": 0, "bottom_layers": 0, "infill": 0.0}


@dataclass(frozen=True)
class Way:
    """One thing that was tried: found, with the options to give; or not."""

    what: str                    # turn, shift, turn and shift, scale, height, printer
    found: bool
    sentence: str
    options: str = ""

    def as_dict(self) -> dict[str, Any]:
        return {"what": self.what, "found": self.found, "sentence": self.sentence, "options": self.options}


@dataclass(frozen=True)
class Model:
    """A part and its robot as the search sees them."""

    placed: Placed
    robot: Robot
    solid: Solid
    field: Field
    border: float                # mm beside the part that its skirt takes

    @property
    def origin(self) -> Array:
        """(2,) mm: where the middle of its bounds stands now."""
        return np.asarray(self.placed.part.bounds[:, :2].mean(axis=0))


def model_of(placed: Placed, *, dz: float | None = None, slabs: int | None = None, modes: bool = False) -> Model:
    """dz and slabs: of parts that stand together; else as the part's height asks."""
    profiles = pipeline.profiles_of(placed.origin)
    robot = pipeline.robot_of(placed)
    keep = robot.cable_radii + robot.clearance + profiles.process.corner_mm
    solid = solid_of(placed.part.vertices, placed.part.faces, dz=dz)
    field = field_of(robot, keep, max(slabs or 0, solid.slabs), solid.dz, modes=modes)
    return Model(placed, robot, solid, field, _border(profiles))


def _border(profiles: Profiles) -> float:
    process = profiles.process
    return (process.skirt_gap_mm + process.skirt_loops * process.first_bead_mm) if process.skirt_loops else 0.0


# ---- placing and trying

def stood(placed: Placed, turn: float, x: float, y: float, *, scale: float = 1.0) -> Placed:
    """The part scaled, turned about z by `turn` more degrees, the middle of its present bounds brought to (x, y)."""
    part = placed.part
    middle = np.append(part.bounds[:, :2].mean(axis=0), 0.0)
    part = replace(part, vertices=(part.vertices - middle) * scale)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    plan = part.vertices[:, :2] @ np.array([[c, s], [-s, c]])
    at = tuple(float(value) for value in np.round((plan.min(0) + plan.max(0)) / 2 + (x, y), 3))
    origin, given = placed.origin, placed.origin.turn_deg
    turns = (given[0], given[1], float(round((given[2] + turn + 180) % 360 - 180, 6)))
    origin = replace(origin, turn_deg=turns, at_mm=at, scale=origin.scale * scale)
    return Placed(origin, place(part, turn_deg=(0, 0, turn), at_mm=at))


def options_of(placed: Placed, scale: bool = False) -> str:
    """What to give on the command line for a part to stand like this."""
    turn, at = (" ".join(f"{value:g}" for value in values) for values in (
        placed.origin.turn_deg, placed.origin.at_mm or (0.0, 0.0)))
    return f'--turn "{turn}" --at "{at}"' + (f" --scale {placed.origin.scale:g}" if scale else "")


def bare(placed: Placed) -> Placed:
    """The same part, to be made of its walls alone: what stands in the way of cables is the same."""
    process = pipeline.profiles_of(placed.origin).process.model_copy(update=BARE)
    return replace(placed, origin=replace(placed.origin, process=process.model_dump_json(by_alias=True)))


def tried(placed: Placed, progress: Progress = silent, *, far: float | None = None) -> Verdict:
    """Sliced and checked. Raises CabsliceError where it cannot be sliced."""
    box = pipeline.check_box(placed)
    if box is not None and not box.ok:
        return box
    return pipeline.freed(pipeline.to_path(placed, progress), progress, far=far)[1]


def proven(model: Model, found: Sequence[Spot], progress: Progress, *, whole: bool) -> Placed | None:
    """The first of some spots whose path passes the check; as asked where `whole`, else with walls only."""
    for spot in found[:TRIES]:
        if min(spot.tension_n, spot.air_mm) < 0:
            continue
        placed = stood(model.placed, spot.turn_deg, spot.x, spot.y)
        if tried(placed if whole else bare(placed), progress).ok:
            return placed
    return None


# ---- help

def help_for(placed: Placed, verdict: Verdict, progress: Progress = silent) -> Iterator[Way]:
    """What would help, one thing at a time, each as it was tried."""
    model = model_of(placed)
    x, y = (float(value) for value in model.origin)
    every = np.arange(0.0, 360.0, 10.0)
    turned = [measured(model.solid, model.field, float(turn), x, y) for turn in every
              if (room(model.solid, model.field, float(turn), model.border) >= np.abs((x, y)) - 1e-9).all()]
    turned = sorted(turned, key=lambda spot: -spot.score("clearance"))
    yield _way(model, "turn", "turned about z where it stands", turned[:TRIES], progress)
    best = spots(model.solid, model.field, "clearance", turns=[0.0], finest=2.0, border=model.border)
    yield _way(model, "shift", "shifted on the bed", best, progress)
    best = spots(model.solid, model.field, "clearance", turns=every.tolist(), border=model.border)
    yield _way(model, "turn and shift", "turned and shifted", best, progress)
    yield _scaled(placed, progress)
    yield from _split(verdict)
    yield _elsewhere(placed, progress)


def _way(model: Model, what: str, words: str, found: Sequence[Spot], progress: Progress) -> Way:
    likely = [spot for spot in found if spot.gap_mm > -1.0]
    placed = proven(model, likely, progress, whole=False)
    if placed is None:
        return Way(what, False, f"{words}: nothing printable was found{_lacking(found)}.")
    return Way(what, True, f"{words} it can be printed: {options_of(placed)}.", options_of(placed))


def _lacking(found: Sequence[Spot]) -> str:
    if not found or found[0].printable:
        return ""
    spot = found[0]
    least = min((spot.gap_mm, "mm between cables and part"), (spot.tension_n, "N of tension"),
                (spot.air_mm, "mm beside other cables and the bed"))
    return f"; the nearest lacks {-least[0]:.3g} {least[1]}"


def _scaled(placed: Placed, progress: Progress, high: float = 1.0) -> Way:
    """The largest scale up to `high` at which the part can be printed where and as it stands, to half a per cent."""
    x, y = (float(value) for value in placed.part.bounds[:, :2].mean(axis=0))

    def free(scale: float) -> bool:
        model = model_of(stood(placed, 0.0, x, y, scale=scale))
        inside = (room(model.solid, model.field, 0.0, model.border) >= np.abs((x, y)) - 1e-9).all()
        return bool(inside) and measured(model.solid, model.field, 0.0, x, y).printable

    low = LEAST * high
    if not free(low):
        return Way("scale", False, f"no size above {100 * low:.3g} % of it can be printed where it stands.")
    while high - low > 0.005 * high:
        low, high = ((low + high) / 2, high) if free((low + high) / 2) else (low, (low + high) / 2)
    for less in (0.0, 0.01, 0.03, 0.08):
        scale = float(np.floor(low * (1 - less) * 1000) / 1000)
        small = stood(placed, 0.0, x, y, scale=scale)
        if tried(bare(small), progress).ok:
            options = f"--scale {small.origin.scale:g}"
            return Way("scale", True, f"at {100 * scale:.1f} % of this size it can be printed: {options}.", options)
    return Way("scale", False, "no smaller size was found to be printable where it stands.")


def _split(verdict: Verdict) -> Iterator[Way]:
    """What is free of every finding, up to a height."""
    heights = [finding.free_mm for finding in verdict.findings]
    known = [height for height in heights if height is not None]
    if known and len(known) == len(heights):
        yield Way("height", True, f"up to {min(known):.4g} mm it can be printed: split it there, or make it lower.")


def _elsewhere(placed: Placed, progress: Progress) -> Way:
    """Other printers of the shelf, with their own material and process, that print it in the middle as it is turned."""
    mine = pipeline.profiles_of(placed.origin).printer.name
    names: list[str] = []
    for name in shelf.names("printers"):
        if name != mine and len(names) < PRINTERS and _made_by(placed, name, progress):
            names.append(name)
    if not names:
        return Way("printer", False, "no other printer profile, with its own material and process, can print it.")
    words = f"other printer profiles, as they are on the shelf, that can print it: {', '.join(names)}."
    return Way("printer", True, words, f"-p {names[0]}")


def _made_by(placed: Placed, name: str, progress: Progress) -> bool:
    try:
        profiles = pipeline.load_profiles(name, None, None)
        if robot_from_printer(profiles.printer).nozzle is None:
            return False
        kinds = ("printer", "material", "process")
        changed = {kind: getattr(profiles, kind).model_dump_json(by_alias=True) for kind in kinds}
        other = stood(Placed(replace(placed.origin, **changed), placed.part), 0.0, 0.0, 0.0)
        model = model_of(other)
        if (room(model.solid, model.field, 0.0, model.border) < 0).any():
            return False
        return measured(model.solid, model.field, 0.0, 0.0, 0.0).gap_mm > 0 and tried(bare(other), progress).ok
    except CabsliceError:
        return False


# ---- the best placement

def arrange(
    parts: Sequence[Placed], goal: str, *, turns: Sequence[float], finest: float = 5.0, progress: Progress = silent
) -> Placed | None:
    """Where parts stand best: one, or several as one part, layer by layer; None where no printable place was found.

    Of several the widest is placed first and the others beside what stands, each where it is best then.
    """
    if len(parts) == 1:
        model = model_of(parts[0], modes=goal == "first-mode")
        here = measured(model.solid, model.field, 0.0, float(model.origin[0]), float(model.origin[1]))
        fits = (room(model.solid, model.field, 0.0, model.border) >= np.abs(model.origin) - 1e-9).all()
        found = [*([here] if fits else []), *_searched(model, goal, turns, finest, progress, ())]
        found = sorted(found, key=lambda spot: -spot.score(goal))
        return proven(model, [spot for spot in found if spot.gap_mm > -1.0], progress, whole=True)
    heights = [float(placed.part.bounds[1, 2]) for placed in parts]
    dz = max(max(heights) / SLABS, THINNEST)
    slabs = max(max(round(height / dz), 1) for height in heights)
    models = [model_of(placed, dz=dz, slabs=slabs, modes=goal == "first-mode") for placed in parts]
    standing: list[Standing] = []
    placed_parts = []
    for model in sorted(models, key=lambda model: -model.solid.radius):
        found = _searched(model, goal, turns, finest, progress, standing)
        if not found or not found[0].printable:
            return None
        standing.append(Standing(model.solid, found[0]))
        placed_parts.append(stood(model.placed, found[0].turn_deg, found[0].x, found[0].y))
    together = joined(placed_parts)
    return together if tried(together, progress).ok else None


def _searched(
    model: Model, goal: str, turns: Sequence[float], finest: float, progress: Progress, standing: Sequence[Standing]
) -> list[Spot]:
    return spots(
        model.solid, model.field, goal, turns=turns, finest=finest, border=model.border, standing=standing,
        tick=lambda done, total: progress("search", done, total),
    )


def joined(parts: Sequence[Placed]) -> Placed:
    """Parts that stand beside each other as one, with the profiles of the first."""
    first = np.cumsum([0, *(len(placed.part.vertices) for placed in parts[:-1])])
    vertices = np.vstack([placed.part.vertices for placed in parts])
    faces = np.vstack([placed.part.faces + shift for placed, shift in zip(parts, first, strict=True)])
    names, digest = [placed.part.name for placed in parts], hashlib.sha256(vertices.tobytes() + faces.tobytes())
    part = replace(parts[0].part, vertices=vertices, faces=faces, name=" + ".join(names), sha256=digest.hexdigest())
    middle = tuple(float(value) for value in part.bounds[:, :2].mean(axis=0))
    origin = replace(
        parts[0].origin, part=part.name, sha256=part.sha256, unit="mm", scale=1.0, turn_deg=(0.0, 0.0, 0.0),
        at_mm=middle,
    )
    return Placed(origin, part)


def score(placed: Placed, goal: str, progress: Progress = silent) -> tuple[float, Verdict]:
    """What is maximised, of the path as asked: mm, N or Hz; nan where it cannot be printed. And the verdict."""
    box = pipeline.check_box(placed)
    if box is not None and not box.ok:
        return float("nan"), box
    laid, verdict = pipeline.freed(pipeline.to_path(placed, progress), progress, far=FAR)
    if not verdict.ok:
        return float("nan"), verdict
    if goal == "first-mode":
        return lowest_mode(laid), verdict
    return verdict.margins["cable_part_mm" if goal == "clearance" else "tension_n"], verdict


def lowest_mode(laid: Laid) -> float:
    """Hz: the least first natural frequency at the places of the survey, tensions nearest to the reference."""
    from cabslice.feasibility.obstacles import laying, moves_of, printing_stages
    from cabslice.feasibility.survey import first_cells
    from cabslice.robot.held import first_mode
    from cabslice.robot.model import nozzle_poses

    path, robot = laid.toolpath, pipeline.robot_of(laid)
    moves = moves_of(path, printing_stages(path))
    moves = moves.take(np.flatnonzero(laying(path)[moves.move]))
    return float(np.nanmin(first_mode()(robot, nozzle_poses(robot, first_cells(moves).place))))


# ---- how large

@dataclass(frozen=True)
class Sizes:
    printer: str
    nozzle_mm: float
    bed_mm: Array                # (2,)
    volcano: Volcano
    cube_mm: float               # edge


def sizes(profiles: Profiles, step: float, progress: Progress = silent) -> Sizes:
    """Tallest cylinders by radius and the largest cube, in the middle of the bed."""
    robot = pipeline.robot_for(profiles.printer)
    assert robot.bed_size is not None
    assert robot.nozzle is not None
    keep = robot.cable_radii + robot.clearance + profiles.process.corner_mm
    half = float(robot.bed_size.min() / 2)
    radii = np.arange(max(step, half / RADII), half + 1e-9, max(step, half / RADII))
    found = volcano(robot, keep, radii=radii, step=step, tick=lambda done, total: progress("volcano", done, total))
    cube = largest_cube(robot, keep)
    return Sizes(robot.name, float(-robot.nozzle[2]), robot.bed_size, found, cube)


def largest_copy(placed: Placed, progress: Progress = silent) -> Way:
    """The largest scale of a part, where and as it stands, that can be printed."""
    box, half = placed.part.bounds, pipeline.robot_of(placed).bed_size
    assert half is not None
    return _scaled(placed, progress, high=float((half / np.maximum(np.ptp(box[:, :2], axis=0), 1e-3)).min()))
