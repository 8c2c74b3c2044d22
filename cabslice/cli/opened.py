"""What a file holds, whatever it is: for inspect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice.cli.options import Placing
from cabslice.errors import ModelError, UsageError

if TYPE_CHECKING:
    from cabslice.view.picture import Curve


@dataclass(frozen=True)
class Seen:
    kind: str                       # "part", "layers", "path", "plan", or the format of a motor file
    title: str
    about: dict[str, Any]           # names, hashes, placement
    numbers: dict[str, Any]
    notes: str
    curve: Callable[[], Curve]      # raises UsageError where there is nothing to draw


def opened(file: str, placing: Placing) -> Seen:
    """Raises ModelError or ProductError, and UsageError for a placing of what has its place."""
    path = Path(file)
    if not path.is_file():
        raise ModelError(f"{file}: there is no such file.", file=file)
    seen = _seen(path, placing)
    if placing.given and seen.kind != "part":
        raise UsageError(f"{file} is no mesh: --unit, --scale, --turn and --at place a part that is not sliced yet.")
    return seen


def _seen(path: Path, placing: Placing) -> Seen:
    from cabslice import pipeline, store
    from cabslice.motors.formats import FORMATS, format_of

    if store.is_product(path) or path.suffix.removeprefix(".") in store.KINDS:
        return _product(path)
    format = format_of(path)
    if path.suffix.lower() in pipeline.GCODE and format is None:
        return _gcode(path)
    format = format or next((row for row in FORMATS.values() if path.name.endswith(row.suffix)), None)
    return _stream(path, format) if format else _part(path, placing)


def _part(path: Path, placing: Placing) -> Seen:
    from cabslice.mesh.load import load_mesh
    from cabslice.mesh.place import place
    from cabslice.view import numbers

    part = place(load_mesh(path, unit=placing.unit, scale=placing.scale), turn_deg=placing.turn, at_mm=placing.at)
    about = {"part": part.name, "sha256": part.sha256, "repairs": part.repairs, "warnings": part.warnings}
    return Seen("part", part.name, about, numbers.of_part(part), "\n".join((*part.repairs, *part.warnings)), _nothing)


def _gcode(path: Path) -> Seen:
    from cabslice.toolpath.gcode_read import read_gcode
    from cabslice.toolpath.summary import summary
    from cabslice.view import picture

    reading = read_gcode(path)
    about = {"warnings": reading.warnings}
    return Seen("gcode", path.name, about, summary(reading.toolpath), "\n".join(reading.warnings),
                lambda: picture.curve_of_path(reading.toolpath, path.name))


def _product(path: Path) -> Seen:
    from cabslice import pipeline, store
    from cabslice.view import numbers, picture

    kind, product = store.load(path)
    names = pipeline.profile_names(product.origin)
    about = {"part": product.origin.part, "sha256": product.origin.sha256, "profiles": names,
             "placement": pipeline.placement_of(product.origin), "repairs": product.origin.repairs}
    title = ", ".join([product.origin.part, *(f"{what} {row['name']}" for what, row in names.items())])
    curve: Callable[[], Curve] = _nothing
    if isinstance(product, store.Sliced):
        found = numbers.of_layers(product.layers)
    elif isinstance(product, store.Laid):
        found, curve = pipeline.numbers_of(product), lambda: picture.curve_of_path(product.toolpath, title)
    else:
        found = _planned_numbers(product)
        curve = lambda: picture.curve_of_motion(product.trajectory, pipeline.robot_of(product), title)  # noqa: E731
    return Seen(kind, title, about, found, "\n".join(product.origin.repairs), curve)


def _planned_numbers(product: Any) -> dict[str, Any]:
    from cabslice import pipeline
    from cabslice.view import numbers

    period = pipeline.period_of(product)
    return numbers.of_stream(pipeline.stream_of(product, {"numbers": pipeline.numbers_of(product)}, period))


def _stream(path: Path, format: Any) -> Seen:
    from cabslice.motors.machine import robot_of
    from cabslice.view import numbers, picture

    stream = format.read(path)
    header = dict(stream.header)
    about = {key: header[key] for key in ("part", "profiles", "placement", "repairs", "version") if key in header}
    title = f"{header.get('part', {}).get('name', path.name)}: motor file for {header['robot']}"
    notes = "\n".join(["checked:", *(f"  {line}" for line in header.get("verdict", {}).get("checked", ()))])
    return Seen(format.name, title, about, numbers.of_stream(stream), notes,
                lambda: picture.curve_of_stream(stream, robot_of(header), title))


def _nothing() -> Curve:
    raise UsageError("--png draws a .path, a .plan or a motor file.")
