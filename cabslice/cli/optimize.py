"""cabslice optimize"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.options import Machine, Placing
from cabslice.cli.report import Table, Talk
from cabslice.errors import ImpossibleError, UsageError

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.pipeline import Placed

GOALS = ("clearance", "tension", "first-mode")       # of optimization.placement, which --help does not import
UNITS = {"clearance": "mm between cables and part", "tension": "N of tension to spare", "first-mode": "Hz first mode"}
FAR = 25.0           # of advice


@click.group("optimize", context_settings={"help_option_names": ["-h", "--help"]})
def optimize() -> None:
    """What is best among many."""


@optimize.command("placement")
@click.argument("files", metavar="PART...", nargs=-1, required=True)
@options.machine
@options.placing
@click.option("--for", "goal", type=click.Choice(GOALS), default="clearance", show_default=True,
              help="What is made as large as it can be.")
@click.option("--turn-step", "turn_step", type=click.FloatRange(0.5, 360), default=10.0, show_default=True,
              help="Degrees between the turns about z that are tried.")
@click.option("--shift-step", "shift_step", type=click.FloatRange(0.5, 1000), default=5.0, show_default=True,
              help="Places at least this fine on the bed are told apart, mm.")
@click.option("-o", "--output", "output", metavar="FILE.stl", help="Write the placed part, in bed coordinates.")
@click.option("--overwrite", is_flag=True, help="Replace the output if it exists.")
@options.talk
def placement(
    files: tuple[str, ...], machine: Machine, placing: Placing, goal: str, turn_step: float, shift_step: float,
    output: str | None, overwrite: bool, talk: Talk,
) -> None:
    """Where on the bed and how turned about z can this part be printed best?

    Searches all shifts and turns, slices and checks the best of them, and prints the score before and after with the
    options to give. Several PARTs are placed beside each other to be printed together, layer by layer; -o writes them
    as one STL. --turn, --scale and --unit say how the parts lie before; exit code 4 where no printable place is found.
    """
    from cabslice import advice

    if output:
        if not output.lower().endswith(".stl"):
            raise UsageError(f"{output}: the placed part is written as STL; name it so.")
        options.claim(output, overwrite)
    parts = [_part(file, machine, placing, talk) for file in files]
    turns = [turn_step * i for i in range(int(360 / turn_step - 1e-9) + 1)]
    with talk.progress() as tick:
        before, _ = advice.score(parts[0], goal, tick) if len(parts) == 1 else (float("nan"), None)
        found = advice.arrange(parts, goal, turns=turns, finest=shift_step, progress=tick)
        after = advice.score(found, goal, tick)[0] if found else float("nan")
    if found is None:
        raise ImpossibleError(_nowhere(parts, len(turns), shift_step))
    if output:
        _write(found, output, overwrite)
    _answer(parts, found, goal, before, after, output, talk)


def _part(file: str, machine: Machine, placing: Placing, talk: Talk) -> Placed:
    from cabslice.cli.job import begin
    from cabslice.pipeline import Placed

    product = begin(file, machine, placing, talk)
    if not isinstance(product, Placed):
        raise UsageError(f"{file} is sliced already: a placement is looked for before, start from the part.")
    return product


def _nowhere(parts: list[Placed], turns: int, step: float) -> str:
    from cabslice import pipeline

    printer = pipeline.profiles_of(parts[0].origin).printer.name
    names = ", ".join(placed.origin.part for placed in parts)
    together = " beside each other" if len(parts) > 1 else ""
    return (
        f"{printer} cannot print {names}{together}: no place on the bed was found at any of {turns} turns about z, to "
        f"{step:g} mm. `cabslice check` says why it cannot as asked, and tries smaller sizes and other printers."
    )


def _write(found: Placed, output: str, overwrite: bool) -> None:
    _stl(found.part.vertices, found.part.faces, output, overwrite)


def _stl(vertices: Array, faces: Array, output: str, overwrite: bool) -> None:
    from cabslice.files import atomic
    from cabslice.stl import write_stl

    with atomic(output, overwrite) as file:
        file.write(write_stl(vertices, faces))


def _answer(
    parts: list[Placed], found: Placed, goal: str, before: float, after: float, output: str | None, talk: Talk
) -> None:
    from cabslice import advice, pipeline
    from cabslice.cli.job import summary

    at = " ".join(f"{value:g}" for value in found.origin.at_mm or (0.0, 0.0))
    paste = advice.options_of(found) if len(parts) == 1 else f'--at "{at}"'
    start = parts[0].origin
    content: dict[str, Any] = summary("optimize placement", found, output) | {
        "goal": goal, "options": paste, "before": {"placement": pipeline.placement_of(start), "score": _known(before)},
        "after": {"placement": pipeline.placement_of(found.origin), "score": _known(after)}, "unit": UNITS[goal],
    }
    rows = [("before", *_place(parts[0]), _said(before, goal))] if len(parts) == 1 else []
    rows.append(("after", *_place(found), _said(after, goal)))
    blocks: list[str | Table] = [
        Table(("", ">turn deg", ">x mm", ">y mm", f">{UNITS[goal]}"), rows),
        f"options: {paste}" if len(parts) == 1 else f"options for {output or 'the STL that -o writes'}: {paste}",
    ]
    talk.answer(content, *blocks, f"wrote {output}" if output else "")


def _place(placed: Placed) -> tuple[str, str, str]:
    x, y = placed.origin.at_mm or (0.0, 0.0)
    return f"{placed.origin.turn_deg[2]:g}", f"{x:.2f}", f"{y:.2f}"


def _known(score: float) -> float | None:
    return None if score != score else score


def _said(score: float, goal: str) -> str:
    if score != score:
        return "cannot be printed"
    return f"at least {score:g}" if goal == "clearance" and score >= FAR else f"{score:.2f}"


@optimize.command("size")
@click.argument("file", metavar="[PART]", required=False)
@options.machine
@options.placing
@click.option("--step-mm", "step", type=click.FloatRange(0.5, 100), default=5.0, show_default=True,
              help="Heights and radii are told in steps of this.")
@click.option("-o", "--output", "output", metavar="FILE.stl", help="Write the volcano, the printable volume.")
@click.option("--png", metavar="FILE.png", help="Draw the printable height over the bed.")
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@options.talk
def size(
    file: str | None, machine: Machine, placing: Placing, step: float, output: str | None, png: str | None,
    overwrite: bool, talk: Talk,
) -> None:
    """How large can it be? The tallest cylinders, the largest cube, and the largest copy of PART.

    The cylinders stand in the middle of the bed; together they are the volcano: where something can be printed before
    a cable of this platform touches it. Tension under the weight is asked for as well.
    """
    from cabslice import advice

    for path, suffix in ((output, ".stl"), (png, ".png")):
        if path:
            if not path.lower().endswith(suffix):
                raise UsageError(f"{path}: expected a name that ends in {suffix}.")
            options.claim(path, overwrite)
    placed = _part(file, machine, placing, talk) if file else None
    with talk.progress() as tick:
        found = advice.sizes(_profiles(machine, placed), step, tick)
        copy = advice.largest_copy(placed, tick) if placed else None
    if not (found.volcano.height > 0).any() and not placed:
        raise ImpossibleError(f"{found.printer} cannot print anything in the middle of its bed.")
    _draw(found, output, png, overwrite)
    _tell_sizes(found, copy, {key: path for key, path in (("output", output), ("png", png)) if path}, talk)


def _profiles(machine: Machine, placed: Placed | None) -> Any:
    from cabslice import pipeline
    from cabslice.cli.job import printer_name

    if placed is not None:
        return pipeline.profiles_of(placed.origin)
    return pipeline.load_profiles(printer_name(machine.printer), machine.material, machine.process, machine.sets)


def _draw(found: Any, output: str | None, png: str | None, overwrite: bool) -> None:
    from cabslice.optimization.maps import surface

    if output:
        _stl(*surface(found.volcano), output, overwrite)
    if png:
        from cabslice.view.volcano import save_volcano

        title = f"{found.printer}, nozzle {found.nozzle_mm:g} mm below the platform's origin"
        save_volcano(found.volcano.radius, found.volcano.height, found.bed_mm, png, title=title, overwrite=overwrite)


def _tell_sizes(found: Any, copy: Any, files: dict[str, str], talk: Talk) -> None:
    best = found.volcano.largest
    radius, height = float(found.volcano.radius[best]), float(found.volcano.height[best])
    numbers = {
        "cylinder_radius_mm": radius, "cylinder_height_mm": height, "cube_edge_mm": found.cube_mm,
        "radius_mm": found.volcano.radius, "height_mm": found.volcano.height,
    }
    content = {"ok": True, "command": "optimize size", "printer": found.printer, "numbers": numbers, **files}
    blocks: list[str | Table] = [
        f"{found.printer}: centred, from the bed up, free of cables and held by them",
        f"largest cylinder  radius {radius:g} mm, height {height:g} mm",
        f"largest cube      edge {found.cube_mm:.1f} mm",
    ]
    if copy is not None:
        content["copy"] = copy.as_dict()
        blocks.append(f"largest copy      {copy.sentence}")
    rows = [(f"{r:g}", f"{h:g}") for r, h in zip(found.volcano.radius, found.volcano.height, strict=True)]
    talk.answer(content, *blocks, Table((">radius mm", ">printable height mm"), rows),
                *(f"wrote {path}" for path in files.values()))
