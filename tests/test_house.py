"""The floors of the house: imports go down only, and the two wings do not know each other."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "cabslice"
FLOORS = {
    "errors": 0, "arrays": 0, "files": 0, "compiled": 0, "stl": 0, "profile": 0,
    "mesh": 1, "slicing": 1, "robot": 1,
    "toolpath": 2,
    "feasibility": 3,
    "timing": 4,
    "motors": 5,
    "simulation": 6, "calibration": 6, "optimization": 6, "view": 6,
    "store": 7, "pipeline": 7,
    "batch": 8, "advice": 8,
    "cli": 9,
}
GROUND = {"errors", "arrays", "files", "compiled", "stl"}  # anyone may use these, also rooms of the ground floor
DOORWAYS = {
    "trimesh": "mesh", "manifold3d": "slicing", "toppra": "timing", "shapely": "feasibility", "matplotlib": "view",
    "click": "cli", "rich": "cli", "dask": "batch", "distributed": "batch",
}


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> list[str]:
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.append(node.module or "")
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


APART = {PACKAGE / "__init__.py", PACKAGE / "__main__.py"}
FILES = [path for path in sorted(PACKAGE.rglob("*.py")) if path not in APART]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_only(path):
    here = room(path)
    assert here in FLOORS, f"{here} has no floor"
    for name in imports(path):
        if name.startswith("cabslice."):
            there = name.split(".")[1]
            if there in ("__version__", here):
                continue
            lower = FLOORS[there] < FLOORS[here] or there in GROUND or (here == "pipeline" and there == "store")
            assert lower, f"{path.relative_to(PACKAGE)} imports {name}, which is not on a lower floor"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_each_outside_library_has_one_doorway(path):
    for name in imports(path):
        owner = DOORWAYS.get(name.split(".")[0])
        assert owner in (None, room(path)), f"{path.relative_to(PACKAGE)} imports {name}: only {owner}/ may"


def test_the_wings_do_not_know_each_other():
    for path in FILES:
        here, seen = room(path), {name.split(".")[1] for name in imports(path) if name.startswith("cabslice.")}
        if here in ("mesh", "slicing", "toolpath"):
            assert "robot" not in seen, f"{path}: the slicer wing must not know the robot"
            assert not any("profile.printer" in name for name in imports(path)), f"{path}: it is handed bed and nozzle"
        if here == "robot":
            assert not seen & {"mesh", "slicing", "toolpath"}, f"{path}: the robot wing must not know the slicer"


def test_only_the_command_line_prints():
    for path in FILES:
        if room(path) != "cli":
            calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
            assert not any(isinstance(call.func, ast.Name) and call.func.id == "print" for call in calls), path


def test_help_imports_no_numpy():
    code = (
        "import sys\nfrom cabslice.cli.main import cli\n"
        "try:\n    cli(['--help'])\nexcept SystemExit as stop:\n    assert not stop.code\n"
        "assert 'numpy' not in sys.modules, 'numpy was imported for --help'"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
