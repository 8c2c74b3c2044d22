"""What a page shows of a file, whatever it is: for view."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cabslice.cli import tables
from cabslice.cli.options import Machine, Placing
from cabslice.cli.report import Tick
from cabslice.errors import ModelError, ProductError, ProfileError, UsageError
from cabslice.feasibility.findings import Finding
from cabslice.view.scene import LOW, Field, Scene, facts_of, of_grid, of_layers, of_mesh, of_path

if TYPE_CHECKING:
    from cabslice.robot.model import Robot

MAPS = {     # columns of `workspace -o`: what they are called, unit
    "margin_n": ("tension margin", "N"), "first_mode_hz": ("first natural frequency", "Hz"),
    "stiffness_n_mm": ("nozzle's stiffness", "N/mm"), "cable_gap_mm": ("air between cables", "mm"),
    "closure_share": ("wrench closure", "share"), "free_radius_mm": ("free radius", "mm"),
}


def scene_of(
    file: str, machine: Machine, placing: Placing, verdict: str | None, checked: bool, tick: Tick
) -> Scene:
    """Raises ModelError, ProductError, GcodeError, ProfileError; UsageError for options that do not fit the file."""
    path = Path(file)
    if not path.is_file():
        raise ModelError(f"{file}: there is no such file.", file=file)
    scene = _opened(path, machine, placing, checked, tick)
    if verdict is None:
        return scene
    if not Path(verdict).is_file():
        raise ProductError(f"{verdict}: there is no such file.", file=verdict)
    told = _verdict(Path(verdict))
    return replace(scene, findings=scene.findings + told.findings, notes=scene.notes + told.notes)


def _opened(path: Path, machine: Machine, placing: Placing, checked: bool, tick: Tick) -> Scene:
    from cabslice import pipeline, store
    from cabslice.motors.formats import FORMATS, format_of

    suffix = path.suffix.lower()
    if store.is_product(path) or suffix.removeprefix(".") in store.KINDS:
        return _product(path, checked, tick)
    if checked:
        raise UsageError(f"--check is for a .path or a .plan; {path.name} is neither.")
    found = format_of(path)
    if suffix in pipeline.GCODE and found is None:
        return _gcode(path, machine)
    if suffix == ".json" and found is None:
        return _verdict(path)
    if suffix == ".npz" or (suffix == ".csv" and _is_map(path)):
        return _workspace(path)
    found = found or next((row for row in FORMATS.values() if path.name.endswith(row.suffix)), None)
    return _stream(path, found, tick) if found else _part(path, machine, placing)


# ---- products

def _product(path: Path, checked: bool, tick: Tick) -> Scene:
    from cabslice import pipeline, store
    from cabslice.toolpath.summary import summary
    from cabslice.view import motion, numbers

    kind, product = store.load(path)
    origin, robot = product.origin, pipeline.robot_of(product)
    names = {what: row["name"] for what, row in pipeline.profile_names(origin).items()}
    scene = Scene(origin.part, kind, names, robot, notes=(*origin.repairs, *origin.warnings))
    if isinstance(product, store.Sliced):
        if checked:
            raise UsageError(f"--check is for a .path or a .plan; {path.name} is neither.")
        return _with(scene, numbers.of_layers(product.layers), moves=of_layers(product.layers))
    said = summary(product.toolpath, density_g_cm3=pipeline.profiles_of(origin).material.density_g_cm3)
    if isinstance(product, store.Planned):
        said |= {"duration_s": product.trajectory.duration}
        tick("sample", 0, 1)
        moves = motion.of_plan(product.trajectory, product.toolpath, robot, pipeline.period_of(product))
    else:
        moves = of_path(product.toolpath)
    scene = _with(scene, said, moves=moves)
    if not checked:
        return scene
    verdict = pipeline.check(product, tick)
    air = pipeline.part_clearance(product, verdict)
    if air is not None:
        moves = replace(moves, fields=(*moves.fields, Field("clearance_mm", "air, cables to part", "mm", air, LOW)))
    return replace(scene, moves=moves, findings=verdict.findings, notes=(*scene.notes, *verdict.checked))


def _with(scene: Scene, numbers: Mapping[str, Any], **more: Any) -> Scene:
    return replace(scene, facts={**facts_of(numbers, tables.NUMBERS), **scene.facts}, **more)


def _gcode(path: Path, machine: Machine) -> Scene:
    from cabslice.toolpath.gcode_read import read_gcode
    from cabslice.toolpath.summary import summary

    reading = read_gcode(path)
    scene = Scene(path.name, "G-code", {}, _printer(machine), notes=tuple(reading.warnings))
    return _with(scene, summary(reading.toolpath), moves=of_path(reading.toolpath))


def _stream(path: Path, format: Any, tick: Tick) -> Scene:
    from cabslice.motors.machine import robot_of
    from cabslice.view import motion

    stream = format.read(path)
    header = dict(stream.header)
    robot = robot_of(header)
    tick("read", 0, 1)
    scene = Scene(header.get("part", {}).get("name", path.name), f"motor file, {format.name}", {}, robot,
                  notes=(*header.get("repairs", ()), *header.get("verdict", {}).get("checked", ())))
    said = {"period_s": stream.period_s, "rows": stream.rows, "duration_s": header["duration_s"]}
    names = {what: row["name"] for what, row in header.get("profiles", {}).items()}
    said = dict(header.get("numbers", {})) | said
    return _with(replace(scene, facts=names), said, moves=motion.of_stream(stream, robot))


def _part(path: Path, machine: Machine, placing: Placing) -> Scene:
    from cabslice.mesh.load import load_mesh
    from cabslice.mesh.place import place
    from cabslice.view import numbers

    part = place(load_mesh(path, unit=placing.unit, scale=placing.scale), turn_deg=placing.turn, at_mm=placing.at)
    scene = Scene(part.name, "part", {}, _printer(machine), notes=(*part.repairs, *part.warnings))
    return _with(scene, numbers.of_part(part), mesh=of_mesh(part.vertices, part.faces))


def _printer(machine: Machine) -> Robot | None:
    """The robot of -p or of the user's choice; None where nothing was said."""
    from cabslice.profile import shelf
    from cabslice.robot.model import robot_from_printer

    name = machine.printer or shelf.default_printer()
    return robot_from_printer(shelf.load_printer(name, machine.sets)) if name else None


# ---- answers of other commands

def _verdict(path: Path) -> Scene:
    """What check printed with --json; or what any command printed that the robot said no to."""
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ProductError(f"{path.name} is not JSON: {error}.", file=path.name) from error
    told = content.get("verdict") or content.get("error") if isinstance(content, dict) else None
    if not isinstance(told, dict) or not {"findings", "checked"} & set(told):
        words = "expected what `cabslice check --json` prints, with a verdict in it"
        raise ProductError(f"{path.name}: {words}.", file=path.name)
    try:
        findings = tuple(Finding(**{**row, "xyz": tuple(row["xyz"])}) for row in told.get("findings", ()))
    except (TypeError, KeyError) as error:
        raise ProductError(f"{path.name}: a finding is not one of cabslice ({error}).", file=path.name) from error
    facts = {f"margin {key}": f"{value:.4g}" for key, value in told.get("margins", {}).items()}
    return Scene(content.get("part") or path.name, "verdict", facts, _named_robot(content), findings=findings,
                 notes=tuple(told.get("checked", ())))


def _named_robot(head: Mapping[str, Any]) -> Robot | None:
    """The robot that an answer names, where the profile is still the same."""
    from cabslice.profile import shelf
    from cabslice.robot.model import robot_from_printer

    named = head.get("profiles", {}).get("printer", {})
    try:
        printer = shelf.load_printer(str(named.get("name", "")))
    except ProfileError:
        return None
    return robot_from_printer(printer) if shelf.profile_hash(printer) == named.get("sha256") else None


def _is_map(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4096).find(b"# step_mm:") >= 0


def _workspace(path: Path) -> Scene:
    from cabslice.view.machine import bed_of

    head, columns = _map_npz(path) if path.suffix.lower() == ".npz" else _map_csv(path)
    robot = _named_robot(head)
    shift = np.zeros(3) if robot is None else bed_of(robot)
    axes = columns["x_mm"], columns["y_mm"], columns["z_mm"]
    maps = {key: (*MAPS[key], columns[key]) for key in MAPS if key in columns}
    heights = np.broadcast_to(axes[2], columns["inside"].shape)
    maps["z_mm"] = ("height of the platform", "mm", heights - shift[2])
    cells = of_grid(axes, columns["inside"], maps, shift)
    if not len(cells.centres):
        raise ProductError(f"{path.name}: no pose is inside.", file=path.name)
    numbers = head.get("numbers", {})
    facts = {"inside": f"{100 * numbers['workspace_fraction']:.1f} %"} if "workspace_fraction" in numbers else {}
    return Scene(path.name, str(head.get("kind", "workspace")), facts, robot, cells=cells)


def _map_npz(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            columns = {name: file[name] for name in file.files}
        return json.loads(str(columns.pop("head"))), columns
    except (OSError, ValueError, KeyError) as error:
        words = f"{path.name} is not what `cabslice workspace -o` saves ({error})."
        raise ProductError(words, file=path.name) from error


def _map_csv(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Rows of nodes in grid order, back into arrays (X, Y, Z)."""
    head: dict[str, Any] = {}
    with path.open() as file:
        for line in file:
            if not line.startswith("#"):
                names = line.strip().split(",")
                break
            key, _, value = line[2:].partition(": ")
            head[key] = json.loads(value)
        rows = dict(zip(names, np.loadtxt(file, delimiter=",", ndmin=2).T, strict=True))
    axes = {name: np.unique(rows[name]) for name in ("x_mm", "y_mm", "z_mm")}
    shape = tuple(len(axis) for axis in axes.values())
    maps = {name: column.reshape(shape) for name, column in rows.items() if name not in axes}
    return head, axes | maps | {"inside": maps["inside"] > 0}
