"""A print in figures, as one HTML page: what it takes, how hard it works the robot, what was checked.

Every number of the page stands in the answer that `--json` prints, under the key that its `data-key` names; the exact
value is in its `value`. Charts are drawn from the same columns.

    figures   the answer: what the motion is along the print, layer by layer, as histograms
    page      the same as HTML
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import PoseError
from cabslice.robot.clearance import cable_gaps
from cabslice.robot.held import hold, softest
from cabslice.robot.model import Robot, nozzle_poses
from cabslice.robot.winder import layer as winder_layer
from cabslice.view.page import filled, own
from cabslice.view.picture import Curve

PLACES = 400      # along the print at which the robot is asked how stiff it is
BINS = 24
Show = Callable[[Any], str]


# ---- figures

def figures(curve: Curve, robot: Robot | None, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Histograms over the curve; stiffness, first mode and air between cables along the print; winder layers used."""
    found: dict[str, Any] = {"histograms": histograms(curve)}
    if robot is not None and robot.nozzle is not None and robot.bed_origin is not None:
        bounds = numbers.get("bounds_mm")
        found |= along(curve, robot, top=bounds[1][2] if bounds else np.inf)
    if robot is not None and robot.winders is not None and "min_angle_rad" in numbers:
        angles = np.array([numbers["min_angle_rad"], numbers["max_angle_rad"]])
        with suppress(PoseError):
            found["winder_layers"] = winder_layer(robot.winders, angles).T.tolist()
    return found


def histograms(curve: Curve) -> dict[str, Any]:
    """Share of the samples (of the time, or of the way) in bins: edges (n + 1) and shares (n)."""
    columns = {"speed_mm_s": curve.speed}
    if curve.timed and len(curve.along) > 2:
        change = np.abs(np.diff(curve.speed)) / np.maximum(np.diff(curve.along), 1e-9)
        columns["speed_change_mm_s2"] = change
    if curve.tension is not None:
        columns |= {"highest_tension_n": curve.tension.max(axis=1), "lowest_tension_n": curve.tension.min(axis=1)}
    return {key: _histogram(column) for key, column in columns.items()}


def _histogram(column: Array) -> dict[str, list[float]]:
    count, edges = np.histogram(column, BINS)
    return {"edges": edges.tolist(), "share": (count / max(count.sum(), 1)).tolist()}


def along(curve: Curve, robot: Robot, *, top: float = np.inf) -> dict[str, Any]:
    """At PLACES evenly along the curve, at rest: first mode, softest stiffness of the nozzle, air between cables.

    Of places not above `top` mm: the ways from and to home are no part of the print.
    """
    low = np.flatnonzero(curve.xyz[:, 2] <= top + 1e-6)
    if not len(low):
        return {}
    chosen = low[np.unique(np.linspace(0, len(low) - 1, PLACES).astype(np.int64))]
    poses = nozzle_poses(robot, curve.xyz[chosen])
    try:
        held = hold(robot, poses)
    except PoseError:
        return {}
    columns = {
        "first_mode_hz": held.modes_hz[:, 0], "nozzle_stiffness_kn_m": softest(robot, held),
        "cable_gap_mm": cable_gaps(robot, poses).min(axis=1),
    }
    found: dict[str, Any] = {"along": {"along": curve.along[chosen].tolist(), "z_mm": curve.xyz[chosen, 2].tolist()}}
    for key, column in columns.items():
        known = np.where(np.isfinite(column), column, np.nan)
        found["along"][key] = [float(value) if np.isfinite(value) else None for value in column]
        if np.isfinite(known).any():
            found |= {f"min_{key}": float(np.nanmin(known)), f"mean_{key}": float(np.nanmean(known))}
    return found | _by_height(curve.xyz[chosen, 2], columns["cable_gap_mm"])


def _by_height(z: Array, gap: Array) -> dict[str, Any]:
    """Least air between cables in ten slabs of height."""
    edges = np.linspace(z.min(), z.max() + 1e-9, 11)
    slab = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, 9)
    rows = []
    for k in range(10):
        here = gap[slab == k]
        if len(here) and np.isfinite(here).all():
            ends = {"from_mm": float(edges[k]), "to_mm": float(edges[k + 1])}
            rows.append(ends | {"least_cable_gap_mm": float(here.min())})
    return {"clearance_by_height": rows}


def by_layer(layer: Array, air: Array) -> dict[str, list[float]]:
    """Layers in order, and the least `air` (N,) mm of the moves in each."""
    layers, place = np.unique(layer, return_inverse=True)
    least = np.full(len(layers), np.inf)
    np.minimum.at(least, place, air)
    return {"layer": layers.tolist(), "least_mm": least.tolist()}


# ---- page

def page(
    answer: Mapping[str, Any], sections: Sequence[Section], cables: Sequence[tuple[str, str, Show]],
    charts: Sequence[tuple[str, str]], picture: bytes | None,
) -> bytes:
    """`answer` is what --json prints; `cables` are heads, keys and formats of per-cable lists; charts (title, SVG)."""
    body = [_picture(picture), *(_section(answer, one) for one in sections), cable_section(answer, cables)]
    body += [_charts(charts), _verdict(answer), _settings(answer)]
    return filled("report.html", {
        "TITLE": html.escape(f"{answer['part']}: report"), "STYLE": own("report.css"),
        "HEAD": _head(answer), "BODY": "\n".join(filter(None, body)),
    })


Section = tuple[str, Sequence[tuple[str, str, Show]]]     # heading; rows of words, key (dotted), how it is said


def at(answer: Any, key: str) -> Any:
    """The value under a dotted key; a number steps into a list. KeyError where there is none."""
    for word in key.split("."):
        try:
            answer = answer[int(word)] if isinstance(answer, (list, tuple)) else answer[word]
        except (IndexError, ValueError, TypeError) as error:
            raise KeyError(key) from error
    return answer


def number(answer: Mapping[str, Any], key: str, show: Show) -> str:
    value = at(answer, key)
    exact = html.escape(json.dumps(value), quote=True)
    return f'<data value="{exact}" data-key="{html.escape(key)}">{html.escape(show(value))}</data>'


def _section(answer: Mapping[str, Any], section: Section) -> str:
    heading, rows = section
    lines = []
    for words, key, show in rows:
        try:
            if at(answer, key) is not None:
                lines.append(f"<tr><th>{html.escape(words)}</th><td>{number(answer, key, show)}</td></tr>")
        except KeyError:
            continue
    return f"<section><h2>{html.escape(heading)}</h2><table>{''.join(lines)}</table></section>" if lines else ""


def cable_section(answer: Mapping[str, Any], columns: Sequence[tuple[str, str, Show]]) -> str:
    """A row a cable of the per-cable lists."""
    known = [one for one in columns if one[1] in answer["numbers"]]
    if not known:
        return ""
    count = len(answer["numbers"][known[0][1]])
    head = "".join(f"<th>{html.escape(words)}</th>" for words, _, _ in known)
    rows = ""
    for i in range(count):
        cells = "".join(f"<td>{number(answer, f'numbers.{key}.{i}', show)}</td>" for _, key, show in known)
        rows += f"<tr><th>{i + 1}</th>{cells}{_winder(answer, i)}</tr>"
    more = "<th>winder layers</th>" if "winder_layers" in answer else ""
    table = f"<table><tr><th>cable</th>{head}{more}</tr>{rows}</table>"
    return f'<section class="wide"><h2>cables and motors</h2>{table}</section>'


def _winder(answer: Mapping[str, Any], cable: int) -> str:
    if "winder_layers" not in answer:
        return ""
    low, high = (number(answer, f"winder_layers.{cable}.{k}", str) for k in (0, 1))
    return f"<td>{low} to {high}</td>"


def _head(answer: Mapping[str, Any]) -> str:
    names = " · ".join(html.escape(row["name"]) for row in answer.get("profiles", {}).values())
    verdict = answer.get("verdict")
    word = "" if verdict is None else (
        '<p class="good">check and audit found nothing against it</p>' if verdict["ok"] else
        f'<p class="bad">the robot cannot make it: {len(verdict["findings"])} findings</p>')
    return f"<h1>{html.escape(answer['part'])}</h1><p>{names}</p>{word}"


def _picture(content: bytes | None) -> str:
    if content is None:
        return ""
    text = base64.b64encode(content).decode()
    return f'<figure class="part"><img alt="the part" src="data:image/png;base64,{text}"></figure>'


def _charts(charts: Sequence[tuple[str, str]]) -> str:
    return "".join(f'<figure><figcaption>{html.escape(title)}</figcaption>{svg}</figure>' for title, svg in charts)


def _verdict(answer: Mapping[str, Any]) -> str:
    verdict = answer.get("verdict")
    if not verdict:
        return ""
    said = [f"{row['sentence']} {row['help']}" for row in verdict["findings"]]
    findings = "".join(f"<li class=bad>{html.escape(row)}</li>" for row in said)
    checked = "".join(f"<li>{html.escape(row)}</li>" for row in verdict["checked"])
    margins = "".join(f"<tr><th>{html.escape(key)}</th><td>{number(answer, f'verdict.margins.{key}', _four)}</td></tr>"
                      for key in verdict["margins"])
    return (f'<section class="wide"><h2>what was checked</h2><ul>{findings}{checked}</ul>'
            f'<details><summary>smallest margins</summary><table>{margins}</table></details></section>')


def _four(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _settings(answer: Mapping[str, Any]) -> str:
    rows = "".join(f"<tr><th>{what}</th><td>{html.escape(name)}</td><td><code>{html.escape(digest)}</code></td></tr>"
                   for what, name, digest in _hashes(answer))
    settings = "".join(f"<tr><th>{html.escape(key)}</th><td>{html.escape(json.dumps(value))}</td></tr>"
                       for key, value in answer.get("settings", {}).items())
    more = f"<details><summary>process settings</summary><table>{settings}</table></details>" if settings else ""
    return f'<section class="wide"><h2>made with</h2><table>{rows}</table>{more}</section>'


def _hashes(answer: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    if "sha256" in answer:
        yield "part", str(answer["part"]), str(answer["sha256"])
    for what, row in answer.get("profiles", {}).items():
        yield what, row["name"], row["sha256"]
    yield "cabslice", str(answer["version"]), ""
