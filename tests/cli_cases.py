"""A small box and coarse settings: the whole chain in a second or two."""

import json
import struct
from pathlib import Path

import numpy as np

from cabslice.cli.main import main

COARSE = (
    "layer_mm=0.3", "first_layer_mm=0.3", "walls=1", "top_layers=1", "bottom_layers=1", "infill=0.1", "skirt_loops=0",
    "min_layer_s=0",
)
SETS = [word for row in COARSE for word in ("-s", row)]
PRINTER = ["-p", "cabfab-optim"]
MODELS = Path(__file__).parents[2] / "shared" / "models"


def write_box(path, size=(6.0, 5.0, 1.5)):
    """A binary STL of a box."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [corner[[a, b, c]] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    Path(path).write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + rows)
    return path


def run(*words):
    """The exit code of a command line in this process."""
    return main([str(word) for word in words])


def answered(capsys, *words):
    """(exit code, the one JSON object that --json printed)."""
    capsys.readouterr()
    code = run(*words, "--json")
    return code, json.loads(capsys.readouterr().out)


def planned_box(folder):
    """The .plan of the box."""
    part, plan = write_box(folder / "box.stl"), folder / "box.plan"
    assert run("plan", part, *PRINTER, *SETS, "-o", plan, "-q") == 0
    return plan
