"""What a report tells of a path, a plan or a motor file: the answer, the curve it draws, the part's picture."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice import __version__
from cabslice.cli.options import Placing
from cabslice.cli.report import Tick
from cabslice.errors import UsageError

if TYPE_CHECKING:
    from cabslice.robot.model import Robot
    from cabslice.view.picture import Curve

PICTURE = 640, 440


def told_of(path: Path, checked: bool, jobs: int, tick: Tick) -> tuple[dict[str, Any], Curve, bytes | None]:
    """The answer that --json prints. `numbers` are those of inspect. Raises UsageError for what has no motion."""
    from cabslice.cli.opened import opened
    from cabslice.view.report import figures

    seen = opened(str(path), Placing("mm", 1.0, (0.0, 0.0, 0.0), None))
    if seen.kind in ("part", "layers", "gcode"):
        raise UsageError(f"{path.name} has no robot's motion to report: give a .path, a .plan or a motor file.")
    tick("look", 0, 2)
    robot, more, picture = _more(path, checked, jobs, tick)
    curve = seen.curve()
    tick("look", 1, 2)
    part = seen.about.get("part", path.name)
    about = {key: seen.about[key] for key in ("profiles", "placement", "repairs") if key in seen.about}
    name = part if isinstance(part, str) else part["name"]
    digest = seen.about.get("sha256") or (part.get("sha256") if isinstance(part, dict) else None)
    answer: dict[str, Any] = {"ok": True, "command": "report", "kind": seen.kind, "version": __version__, "part": name}
    answer |= ({"sha256": digest} if digest else {}) | about | {"numbers": seen.numbers} | more
    answer |= figures(curve, robot, seen.numbers)
    tick("look", 2, 2)
    return answer, curve, picture


def _more(path: Path, checked: bool, jobs: int, tick: Tick) -> tuple[Robot | None, dict[str, Any], bytes | None]:
    """Robot; verdict, settings and cost; PNG."""
    from cabslice import pipeline, store

    if not store.is_product(path):
        return _of_stream(path)
    from cabslice.toolpath.thumbnail import thumbnail
    from cabslice.view.report import by_layer

    product = store.load(path)[1]
    assert isinstance(product, (store.Laid, store.Planned))
    profiles = pipeline.profiles_of(product.origin)
    more: dict[str, Any] = {"settings": profiles.process.model_dump(mode="json", by_alias=True, exclude_none=True)}
    price = profiles.material.price_per_kg
    if price is not None:
        numbers = pipeline.numbers_of(store.Laid(product.origin, product.toolpath))
        more["cost"] = numbers["mass_g"] / 1e3 * price
    if checked:
        verdict = pipeline.check(product, tick, jobs=jobs)
        more["verdict"] = verdict.as_dict()
        air = pipeline.part_clearance(product, verdict)
        if air is not None:
            more["part_clearance_by_layer"] = by_layer(product.toolpath.layer, air)
    return pipeline.robot_of(product), more, thumbnail(product.toolpath, *PICTURE)


def _of_stream(path: Path) -> tuple[Robot | None, dict[str, Any], bytes | None]:
    from cabslice.motors.formats import read
    from cabslice.motors.machine import robot_of

    header = dict(read(path).header)
    verdict, picture = header.get("verdict"), header.get("thumbnail")
    content = base64.b64decode(picture["png_base64"]) if picture else None
    return robot_of(header), {"verdict": verdict} if verdict else {}, content


def charts_of(answer: dict[str, Any], curve: Curve) -> list[tuple[str, str]]:
    """Titles and drawings, as SVG."""
    import numpy as np

    from cabslice.view import charts

    over = "time, s" if curve.timed else "path, m"
    found = []
    if by_feature := answer["numbers"].get("duration_s_by_feature"):
        minutes = {name.replace("_", " "): seconds / 60 for name, seconds in by_feature.items()}
        found.append(("time by feature", charts.bars(minutes, "time, min")))
    asked = "nozzle speed, mm/s" if curve.timed else "speed asked, mm/s"
    found.append(("speed along the print", charts.over_time(curve.along, {"speed": curve.speed}, asked, xlabel=over)))
    if curve.tension is not None:
        bounds = () if curve.bounds is None else tuple(float(bound) for bound in curve.bounds)
        found.append(("cable tensions", charts.tensions(curve.along, curve.tension, bounds)))
    labels = {"speed_mm_s": ("speeds", "nozzle speed, mm/s"), "highest_tension_n": ("highest tensions", "tension, N"),
              "lowest_tension_n": ("lowest tensions", "tension, N"),
              "speed_change_mm_s2": ("changes of speed", "change of speed, mm/s²")}
    for key, row in answer["histograms"].items():
        title, label = labels[key]
        found.append((f"how often: {title}", charts.histogram(row["edges"], row["share"], label)))
    for key, title, label in (("first_mode_hz", "first mode along the print", "first mode, Hz"),
                              ("nozzle_stiffness_kn_m", "stiffness along the print", "softest direction, kN/m"),
                              ("cable_gap_mm", "air between the nearest cables", "air, mm")):
        if key in answer.get("along", {}):
            values = np.array(answer["along"][key], float)
            places = np.array(answer["along"]["along"])
            found.append((title, charts.over_time(places, {key: values}, label, xlabel=over)))
    if "part_clearance_by_layer" in answer:
        row = {key: np.array(column, float) for key, column in answer["part_clearance_by_layer"].items()}
        title = "air between cables and the part, layer by layer"
        found.append((title, charts.over_time(row["layer"], {"air": row["least_mm"]}, "at least, mm", xlabel="layer")))
    return [(title, charts.svg(figure)) for title, figure in found]
