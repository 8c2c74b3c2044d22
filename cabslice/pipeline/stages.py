"""The stages in order: each takes the product before it, or any earlier one, and refuses what did not pass."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError, ModelError, UsageError
from cabslice.feasibility.findings import Verdict
from cabslice.mesh.part import Part
from cabslice.pipeline.inputs import Placed
from cabslice.pipeline.profiles import lead_of, machine_of, period_of, profiles_of, robot_of
from cabslice.profile.material import Material
from cabslice.profile.printer import Printer
from cabslice.profile.process import Process
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.model import Robot
from cabslice.slicing.layer import Layer, Role
from cabslice.store import Laid, Planned, Product, Sliced
from cabslice.toolpath.path import Toolpath

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream

Progress = Callable[[str, int, int], None]   # stage, done, total


def silent(stage: str, done: int, total: int) -> None:
    pass


def to_layers(product: Placed | Product, progress: Progress = silent, *, jobs: int = 1) -> Sliced:
    if isinstance(product, Placed):
        return Sliced(product.origin, tuple(_cut(product, progress, jobs)))
    return _only(product, Sliced, "layers")


def to_path(product: Placed | Product, progress: Progress = silent, *, jobs: int = 1) -> Laid:
    if not isinstance(product, (Placed, Sliced)):
        return _only(product, Laid, "path")
    profiles = profiles_of(product.origin)
    assert profiles.printer.extruder
    layers: Iterable[Layer] = product.layers if isinstance(product, Sliced) else _cut(product, progress, jobs)
    from cabslice.toolpath.order import lay_toolpath  # here: its compiled parts load while other processes slice

    toolpath = lay_toolpath(
        layers, profiles.process, profiles.material,
        filament_diameter_mm=profiles.printer.extruder.filament_diameter_mm,
        source=f"{product.origin.part} sha256:{product.origin.sha256}",
    )
    if not np.isin(toolpath.role, (Role.TRAVEL, Role.SKIRT), invert=True).any():
        raise ModelError(
            f"{product.origin.part}: no layer of it has room for a bead {profiles.process.outer_bead_mm:g} mm wide; "
            "is the unit right? See --unit and --scale.", file=product.origin.part,
        )
    return Laid(product.origin, toolpath)


def check(
    product: Laid | Planned, progress: Progress = silent, *, jobs: int = 1, free: bool = False
) -> Verdict:
    """Can this robot follow this path, from home and back? Of a plan also: does the motion keep every limit?

    free: a path may be printed with the platform turned (best_turned).
    """
    _refuse_turned(product, free)
    if isinstance(product, Planned):
        return check_path(product, progress).joined(audited(product, progress, jobs=jobs))
    return (best_turned if free else freed)(product, progress)[1]


def freed(product: Laid, progress: Progress = silent, *, far: float | None = None) -> tuple[Laid, Verdict]:
    """The path as it can be followed, with the verdict on it: islands of a layer in an order in which none is in the
    way of another (process.reorder_islands), and travels led around what stands (process.reroute_travels)."""
    from cabslice.feasibility import islands, reroute
    from cabslice.feasibility.check import grown

    verdict = check_path(product, progress, far=far)
    changed: tuple[str, ...] = ()
    process = profiles_of(product.origin).process
    ways: tuple[tuple[bool, Callable[..., Any], Callable[..., Any]], ...] = (
        (process.reorder_islands, islands.only_beads, islands.reordered),
        (process.reroute_travels, reroute.only_travels, reroute.reroute),
    )
    for wanted, helps, change in ways:
        if verdict.ok or not wanted or not helps(verdict.findings) or isinstance(machine_of(product), Delta):
            continue
        robot = _kept_clear(product)
        found = change(with_ends(product).toolpath, robot, grown(robot))
        if found is not None:
            product, changed = Laid(product.origin, found.toolpath), (*changed, found.sentence)
            verdict = replace(check_path(product, progress, far=far), changed=changed)
    return product, verdict


def _refuse_turned(product: Placed | Product, free: bool) -> None:
    if free and isinstance(product, Planned):
        raise UsageError("--orientation free is for a part or a path: a plan is made for the platform as it is turned.")


def best_turned(product: Laid, progress: Progress = silent) -> tuple[Laid, Verdict]:
    """The path with the way of turning the platform, within platform.tilt_max_deg and yaw_max_deg, that lets it be
    printed or keeps cables farther from the part; as it was where none is found. And the verdict on it."""
    from cabslice.feasibility import orient
    from cabslice.feasibility.check import grown
    from cabslice.pipeline.turns import turn_sentence, with_turn

    if isinstance(machine_of(product), Delta):
        raise UsageError("--orientation free is for cable robots: a linear Delta cannot turn its platform.")
    laid, before = freed(product, progress, far=orient.FAR)
    if {finding.code for finding in before.findings} - {"cable-part", "cable-cable", "tension", "head-part"}:
        return laid, before
    robot, platform = _kept_clear(laid), profiles_of(laid.origin).printer.platform
    limits = platform.tilt_max_deg, platform.yaw_max_deg
    found = orient.best_turning(with_ends(laid).toolpath, robot, grown(robot), *limits)
    if found is None:
        return laid, before
    other, after = freed(Laid(with_turn(product.origin, found), product.toolpath), progress, far=orient.FAR)
    gain = after.margins.get("cable_part_mm", -1.0) - before.margins.get("cable_part_mm", -1.0)
    if not after.ok or (before.ok and gain <= 0):
        return laid, before
    return other, replace(after, changed=(turn_sentence(found, before, after), *after.changed))


def _kept_clear(product: Laid | Planned) -> Robot:
    """The robot as it is checked: the motion may leave the path by the corner tolerance, and takes the ends of the
    cables with it."""
    robot = robot_of(product)
    return replace(robot, clearance=robot.clearance + profiles_of(product.origin).process.corner_mm)


def check_path(
    product: Laid | Planned, progress: Progress = silent, *, far: float | None = None, bare: bool = False
) -> Verdict:
    """The margin of cables to the part is looked for up to `far` mm, where that is given. `bare`: nothing is laid."""
    from cabslice.feasibility.check import check
    from cabslice.feasibility.rails import check as check_rails
    from cabslice.toolpath.checks import check_toolpath

    check_toolpath(product.toolpath)
    whole, machine = product if isinstance(product, Planned) else with_ends(product), machine_of(product)
    if isinstance(machine, Delta):
        return check_rails(whole.toolpath, machine, bare=bare)
    robot = _kept_clear(product)
    more = {} if far is None else {"far": far}
    return check(whole.toolpath, robot, progress=partial(progress, "check"), bare=bare, **more)


def part_clearance(product: Laid | Planned, verdict: Verdict) -> Array | None:
    """(N,) mm for each move: what the cables have left to the part; None where the verdict could not look at it."""
    from cabslice.feasibility.check import part_clearance

    if {"bed", "pulley"} & {finding.code for finding in verdict.findings}:
        return None
    return part_clearance(product.toolpath, robot_of(product))


def with_ends(product: Laid) -> Laid:
    """The path with the way from home before it and the way home after it, where it has none yet."""
    from cabslice.motors import approach

    start = profiles_of(product.origin).printer.start
    return Laid(product.origin, approach.with_ends(product.toolpath, machine_of(product), start))


def taken_up(product: Laid | Planned, layer: int) -> tuple[Laid, Laid]:
    """The path from `layer` on, and what has to be checked for it: the same with what stands already. UsageError."""
    from cabslice.motors import approach

    start = profiles_of(product.origin).printer.start
    moved, whole = approach.resumed(product.toolpath, machine_of(product), start, layer)
    return Laid(product.origin, moved), Laid(product.origin, whole)


def check_box(product: Placed | Product) -> Verdict | None:
    """What can be said of a part before it is sliced; None of a product, which is."""
    from cabslice.feasibility.fits import fits

    return fits(product.part.bounds, machine_of(product)) if isinstance(product, Placed) else None


def to_plan(
    product: Placed | Product, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1,
    from_layer: int | None = None, free: bool = False,
) -> tuple[Planned, Verdict]:
    """The audited motion. Raises ImpossibleError with the findings where the robot cannot make it.

    With `from_layer` only what is from that layer on, with what is below it on the bed. `free`: the platform may be
    turned (best_turned). UsageError where that is asked for of a plan, which is made for the platform as it was.
    """
    _refuse_turned(product, free)
    if isinstance(product, Planned) and from_layer is None:
        return product, passed(check(product, progress, jobs=jobs))
    box = check_box(product)
    if box is not None:
        passed(box)
    if isinstance(product, Planned):
        laid = Laid(product.origin, product.toolpath)
    else:
        laid = to_path(product, progress, jobs=jobs)
    if from_layer is None or not isinstance(product, Planned):
        laid, verdict = (best_turned if free else freed)(laid, progress)
    if from_layer is not None:
        laid, shown = taken_up(laid, from_layer)
        verdict = check_path(shown, progress)
    verdict = passed(verdict)
    plan, proof = proven(laid, progress, engine=engine, jobs=jobs)
    return plan, verdict.joined(passed(proof))


def proven(
    laid: Laid, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1
) -> tuple[Planned, Verdict]:
    """The motion with the audit that it passes, slowed where the audit asked for it, or fails."""
    from cabslice.timing.proof import plan_proven

    laid = with_ends(laid)
    printer = profiles_of(laid.origin).printer
    assert printer.motion is not None
    if printer.motion.accuracy_um is not None:
        trajectory, verdict = _accurate(laid, printer.motion.accuracy_um / 1e3, progress, engine, jobs)
    else:
        trajectory, verdict = plan_proven(*_given(laid), engine=engine, jobs=jobs, planning=partial(progress, "plan"),
                                          auditing=partial(progress, "audit"))
    return Planned(laid.origin, laid.toolpath, trajectory), verdict


def _accurate(laid: Laid, asked_mm: float, progress: Progress, engine: str, jobs: int) -> tuple[Any, Verdict]:
    """The motion that keeps the accuracy asked for in simulation."""
    from cabslice.simulation import accuracy
    from cabslice.simulation.calm import Calming
    from cabslice.timing.proof import proven as proof
    from cabslice.timing.retime import task_for

    given, robot, period = _given(laid), robot_of(laid), period_of(laid)
    printer = profiles_of(laid.origin).printer

    def judged(trajectory: Any) -> Any:
        stream = stream_of(Planned(laid.origin, laid.toolpath, trajectory), {}, period)
        cases = accuracy.cases(stream, robot, printer, asked_mm)
        return accuracy.judge(stream, robot, cases, laid.toolpath.layer, partial(progress, "simulate"))

    def prove(trajectory: Any) -> tuple[Any, Verdict]:
        return proof(trajectory, *given, jobs=jobs, auditing=partial(progress, "audit"))

    calming = Calming(task_for(*given, engine), partial(accuracy.wrong_ones, robot), jobs=jobs,
                      progress=partial(progress, "calm"))
    return accuracy.within(calming, prove, judged, asked_mm, laid.toolpath.layer)


def planned(laid: Laid, progress: Progress = silent, *, engine: str = "compiled", jobs: int = 1) -> Planned:
    """The motion alone, neither checked nor audited."""
    from cabslice.timing.retime import plan

    laid, tick = with_ends(laid), partial(progress, "plan")
    return Planned(laid.origin, laid.toolpath, plan(*_given(laid), engine=engine, jobs=jobs, progress=tick))


def audited(plan: Planned, progress: Progress = silent, *, jobs: int = 1) -> Verdict:
    """The audit of the finished motion alone."""
    from cabslice.timing.audit import audit

    return audit(plan.trajectory, *_given(plan), jobs=jobs, progress=partial(progress, "audit"))


def active_limits(plan: Planned) -> dict[str, float]:
    """Limit -> share of the print time in which it is the active one."""
    from cabslice.timing.explain import time_by_limit

    return time_by_limit(plan.trajectory, *_given(plan))


def compared(plan: Planned, *, jobs: int = 1) -> list[dict[str, Any]]:
    """What printer firmware would do with one acceleration that is safe everywhere: time, and the limits it breaks."""
    from cabslice.timing import baseline

    return baseline.compared(plan.trajectory.duration, *_given(plan), jobs=jobs)


def _given(product: Laid | Planned) -> tuple[Toolpath, Machine, Printer, Material, Process]:
    profiles = profiles_of(product.origin)
    return product.toolpath, machine_of(product), profiles.printer, profiles.material, profiles.process


def at_speed(
    plan: Planned, verdict: Verdict, share: float, progress: Progress = silent, *, jobs: int = 1
) -> tuple[Planned, Verdict]:
    """The plan played at `share` of its speed, audited anew: ImpossibleError where that breaks a limit."""
    from cabslice.timing.trajectory import at_share

    if share == 1.0:
        return plan, verdict
    other = replace(plan, trajectory=at_share(plan.trajectory, share))
    found = audited(other, progress, jobs=jobs)
    remedy = f"At {100 * share:g} % of its speed: play it slower, or plan it with other speeds."
    found = replace(found, findings=tuple(replace(finding, help=remedy) for finding in found.findings))
    return other, verdict.joined(passed(found))


def _cut(placed: Placed, progress: Progress, jobs: int) -> Iterator[Layer]:
    """The layers of the part, in the making from now on; of several in turn, numbered on from one to the next."""
    from cabslice.slicing.slicer import slice_part

    profiles = profiles_of(placed.origin)
    assert profiles.printer.nozzle
    cut = partial(
        slice_part, process=profiles.process, nozzle_mm=profiles.printer.nozzle.diameter_mm,
        progress=partial(progress, "slice"), jobs=jobs, modifiers=placed.modifiers,
    )
    return _in_turn(placed.parts, cut) if placed.parts else cut(placed.part)


def _in_turn(parts: Iterable[Part], cut: Callable[[Part], Iterator[Layer]]) -> Iterator[Layer]:
    """The tallest last."""
    done = 0
    for part in sorted(parts, key=lambda part: float(part.vertices[:, 2].max())):
        for layer in cut(part):
            yield replace(layer, index=done + layer.index)
        done += layer.index + 1


def _only(product: Any, cls: type, stage: str) -> Any:
    if isinstance(product, cls):
        return product
    raise UsageError(f"The file is already past the stage \"{stage}\": start from the part or an earlier product.")


def passed(verdict: Verdict) -> Verdict:
    if verdict.ok:
        return verdict
    count = len(verdict.findings)
    raise ImpossibleError(
        f"The robot cannot make this part as asked: {count} reason{'s' if count > 1 else ''}.", verdict.findings,
        checked=list(verdict.checked),
    )


def stream_of(plan: Planned, header: Mapping[str, Any], period_s: float, *, extrude: bool = True) -> MotorStream:
    from cabslice.motors.stream import make_stream
    from cabslice.simulation.damping import relaxation

    machine = machine_of(plan)
    return make_stream(
        plan.trajectory, machine, period_s=period_s, layers=plan.toolpath.layer, header=header,
        lead=lead_of(plan.origin), extrude=extrude,
        relaxation=0.0 if isinstance(machine, Delta) else relaxation(profiles_of(plan.origin).printer, machine),
    )
