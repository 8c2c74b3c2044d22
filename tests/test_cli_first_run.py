"""What the first run compiles ahead is what a real job needs."""

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from cabslice import pipeline
from cabslice.cli import first_run

CUBE = Path(__file__).parents[1] / "samples" / "cube.stl"
COUNT = """
import sys
from numba.core import event
from cabslice.cli.main import run
compiled = []
class Listener(event.Listener):
    def on_start(self, begun): compiled.append(begun.data["dispatcher"].py_func)
    def on_end(self, ended): pass
event.register("numba:compile", Listener())
sys.argv = ["cabslice", *sys.argv[1:]]
try: run()
except SystemExit as end: assert not end.code
names = {f.__module__.split(".")[1] for f in compiled if f.__module__.startswith("cabslice.")}
print("COMPILED", *sorted(names))
"""


def origin():
    return pipeline.read(CUBE, pipeline.load_profiles("cabfab-optim", None, None), pipeline.Placement()).origin


def test_two_squares_go_all_the_way():
    path = first_run.squares(origin()).toolpath
    assert (path.filament.min(), path.filament.max()) == (-1, 1)
    first_run.compile_now(origin())


@pytest.mark.slow
def test_a_real_job_after_it_compiles_only_what_slicing_needs(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    subprocess.run(
        [sys.executable, "-m", "cabslice.cli.first_run"], input=json.dumps(asdict(origin())), text=True, check=True
    )
    words = ["export", str(CUBE), "-p", "cabfab-optim", "-o", str(tmp_path / "cube.stream")]
    done = subprocess.run([sys.executable, "-c", COUNT, *words], text=True, capture_output=True, check=True)
    assert done.stdout.splitlines()[-1].split() == ["COMPILED", "toolpath"]
