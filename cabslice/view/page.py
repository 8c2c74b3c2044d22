"""A scene as one HTML file that needs nothing else: our own page (web/), the values packed into it.

The page asks nothing of the network; it draws with WebGL 2 and unpacks with DecompressionStream, which every browser
of the last years has.
"""

from __future__ import annotations

import html
import importlib.resources
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cabslice import __version__
from cabslice.arrays import Array
from cabslice.files import atomic
from cabslice.slicing.layer import Role
from cabslice.view.machine import machine
from cabslice.view.packing import packed
from cabslice.view.scene import Cells, Field, Mesh, Moves, Scene

PARTS = ("unpack", "camera", "shaders", "levels", "stage", "machine", "panel", "main")    # web/*.js, in this order
PLACE, BEAD, CLOCK = 2e-3, 1e-3, 1e-3        # steps of what is kept: mm, mm, s
ROLES = {     # what it is called; colours after Okabe & Ito 2008 and Tol 2021, told apart also by the colour-blind
    Role.TRAVEL: ("travel", "#9aa5b1"), Role.OUTER_WALL: ("outer wall", "#d55e00"),
    Role.INNER_WALL: ("inner wall", "#e69f00"), Role.SOLID_INFILL: ("solid infill", "#0072b2"),
    Role.TOP_SKIN: ("top skin", "#cc79a7"), Role.SPARSE_INFILL: ("sparse infill", "#56b4e9"),
    Role.BRIDGE: ("bridge", "#f0e442"), Role.GAP_FILL: ("gap fill", "#7a5195"), Role.SKIRT: ("skirt", "#8c6d46"),
    Role.SUPPORT: ("support", "#009e73"), Role.SUPPORT_INTERFACE: ("support interface", "#66c2a4"),
    Role.IRONING: ("ironing", "#e7a6c9"), Role.OVERHANG_WALL: ("overhang wall", "#a3001f"),
    Role.CUSTOM: ("laid", "#0072b2"),
}


def save_page(scene: Scene, path: str | Path, *, overwrite: bool = False) -> int:
    """Write the page; bytes written. Raises OutputError."""
    content = page(scene)
    with atomic(path, overwrite) as file:
        file.write(content)
    return len(content)


def page(scene: Scene) -> bytes:
    """The same scene gives the same bytes."""
    text = json.dumps(_content(scene), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return filled("page.html", {
        "TITLE": html.escape(scene.title), "STYLE": own("style.css"), "DATA": text,
        "SCRIPT": "\n".join(own(f"{name}.js") for name in PARTS),
    })


def own(name: str) -> str:
    """A file of web/."""
    return importlib.resources.files("cabslice.view").joinpath("web", name).read_text(encoding="utf-8")


def filled(name: str, values: dict[str, str]) -> bytes:
    """A page of web/ with its places {{NAME}} filled in."""
    text = own(name)
    for key, value in values.items():
        text = text.replace("{{" + key + "}}", value)
    return text.encode()


def _content(scene: Scene) -> dict[str, Any]:
    return {
        "title": scene.title, "kind": scene.kind, "facts": dict(scene.facts), "version": __version__,
        "machine": machine(scene.robot) if scene.robot is not None else None,
        "moves": _moves(scene.moves) if scene.moves is not None else None,
        "mesh": _mesh(scene.mesh) if scene.mesh is not None else None,
        "cells": _cells(scene.cells) if scene.cells is not None else None,
        "findings": [finding.as_dict() for finding in scene.findings], "notes": list(scene.notes),
        "roles": [{"name": name, "colour": colour} for name, colour in ROLES.values()],
    }


def _moves(moves: Moves) -> dict[str, Any]:
    return {
        "xyz": _vectors(moves.xyz), "role": packed(moves.role, 1), "layer": packed(moves.layer, 1),
        "width": packed(moves.width, BEAD), "height": packed(moves.height, BEAD), "time": packed(moves.time, CLOCK),
        "clock": moves.clock, "fields": _fields(moves.fields), "heights": _heights(moves),
    }


def _heights(moves: Moves) -> list[list[float]]:
    """Number and height of the nozzle, mm, of each layer that something is laid in."""
    laid = moves.role != Role.TRAVEL
    layers, first = np.unique(moves.layer[laid], return_index=True)
    return [[int(layer), round(float(z), 4)] for layer, z in zip(layers, moves.xyz[laid, 2][first], strict=True)]


def _mesh(mesh: Mesh) -> dict[str, Any]:
    return {"vertices": _vectors(mesh.vertices), "faces": packed(mesh.faces.ravel(), 1), "fields": _fields(mesh.fields)}


def _cells(cells: Cells) -> dict[str, Any]:
    return {"centres": _vectors(cells.centres), "size": cells.size.tolist(), "fields": _fields(cells.fields)}


def _vectors(places: Array) -> list[dict[str, Any]]:
    return [packed(column, PLACE) for column in places.T]


def _fields(fields: Sequence[Field]) -> list[dict[str, Any]]:
    return [{"key": one.key, "label": one.label, "unit": one.unit, "worst": one.worst, "cable": one.cable,
             "values": packed(one.values)} for one in fields]
