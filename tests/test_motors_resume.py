"""A run that was killed: the next one goes on with its whole blocks and writes the same bytes."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import nullcontext

import numpy as np
import pytest
from motors_fakes import Turn, sample_turn, smooth_stream
from robots import cabfab_optim

from cabslice import files
from cabslice.errors import OutputError
from cabslice.files import Unfinished
from cabslice.motors.formats import FORMATS
from cabslice.motors.statistics import statistics
from cabslice.motors.stream import MotorStream, make_stream

RESUMED = pytest.mark.parametrize("name", [name for name in FORMATS if name != "parquet"])


class Killed(BaseException):
    pass


def failing(stream, after, error=Killed):
    """The stream, stopped after some rows; a pass begun later goes on to the end."""
    def blocks():
        for block in stream:
            if block.row >= after:
                raise error
            yield block

    return MotorStream(stream.header, blocks, stream.later)


def killed(monkeypatch, name, stream, path, after):
    """Leave what a run leaves that is killed."""
    with monkeypatch.context() as patched:
        patched.setattr(Unfinished, "kept", (BaseException,))
        with pytest.raises(Killed):
            FORMATS[name].write(failing(stream, after), path, resume=True)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@RESUMED
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("named", [0, 1, 2])
def test_a_run_killed_while_its_files_get_their_names(name, named, half, tmp_path, monkeypatch):
    """After none, one or two of the renames, or in mid-rename: the next run ends the job, or says that it was done."""
    stream = smooth_stream(9_000, cables=3, move=False)
    path = tmp_path / "a" / f"a{FORMATS[name].suffix}"
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    FORMATS[name].write(stream, tmp_path / "b" / path.name)
    rename, finish, left = files._rename, Unfinished.finish, [named]

    def renamed(part, path, overwrite):
        if not left[0]:
            if half:
                os.link(part, path)
            raise Killed
        left[0] -= 1
        rename(part, path, overwrite)

    def finished(self, parts):
        finish(self, parts)
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(Unfinished, "kept", (BaseException,))
        patched.setattr(files, "_rename", renamed)
        patched.setattr(Unfinished, "finish", finished)
        with pytest.raises(Killed):
            FORMATS[name].write(stream, path, resume=True)
    assert ".journal" in "".join(contents(tmp_path / "a"))
    with pytest.raises(OutputError, match="exists already") if path.exists() else nullcontext():
        FORMATS[name].write(stream, path, resume=True)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


@RESUMED
@pytest.mark.parametrize("after", [0, 3_000, 9_000, 20_000])
def test_a_resumed_file_is_the_same_bytes(name, after, tmp_path, monkeypatch):
    stream = smooth_stream(26_000, cables=3, move=False)
    path = tmp_path / "a" / f"a{FORMATS[name].suffix}"
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    wanted = FORMATS[name].write(stream, tmp_path / "b" / path.name)
    killed(monkeypatch, name, stream, path, after)
    assert not path.exists()
    started = []
    found = FORMATS[name].write(stream, path, resume=True, progress=started.append)
    assert started[0] == max(after // 8192 - 1, 0) * 8192, "the last whole block that a row was seen after"
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert json.dumps(found.as_dict()) == json.dumps(wanted.as_dict())


def test_only_the_rest_is_computed_again(tmp_path, monkeypatch):
    turn = Turn(120.0, turns=8, radius=60.0, rise=40.0)
    stream = make_stream(turn, cabfab_optim(), period_s=0.002, header={}, sample=sample_turn)
    path = tmp_path / "a.stream"
    killed(monkeypatch, "stream", stream, path, 40_000)
    asked = []

    def later(row, squares):
        asked.append((row, squares))
        return stream.later(row, squares)

    found = FORMATS["stream"].write(MotorStream(stream.header, None, later), path, resume=True)
    ((row, squares),) = asked
    assert row == 3 * 8192
    torque = np.concatenate([block.torque for block in stream])[:row]
    np.testing.assert_allclose(squares, (torque**2).sum(axis=0), rtol=1e-12)
    assert json.dumps(found.as_dict()) == json.dumps(statistics(stream).as_dict())
    FORMATS["stream"].write(stream, tmp_path / "b.stream")
    assert path.read_bytes() == (tmp_path / "b.stream").read_bytes()


@pytest.mark.parametrize("hurt", ["cut", "flip", "journal", "torn line", "key", "none"])
def test_what_is_left_is_not_trusted(hurt, tmp_path, monkeypatch):
    """Bytes that a power loss took or turned are written again; the work of another job is not taken for this one."""
    stream = smooth_stream(40_000, cables=3)
    path, part, journal = tmp_path / "a.stream", tmp_path / ".a.stream.part", tmp_path / ".a.stream.journal"
    killed(monkeypatch, "stream", stream, path, 36_000)
    data, lines = part.read_bytes(), journal.read_bytes()
    if hurt == "cut":
        part.write_bytes(data[: len(data) // 2])
    elif hurt == "flip":
        part.write_bytes(data[:9000] + bytes([data[9000] ^ 4]) + data[9001:])
    elif hurt == "journal":
        journal.write_bytes(b"\xff\x00" * 40)
    elif hurt == "torn line":
        journal.write_bytes(lines[:-30])
    elif hurt == "key":
        stream = smooth_stream(40_000, cables=3, seed=5)
        stream = MotorStream({**stream.header, "part": "another"}, stream.blocks)
    else:
        part.unlink()
    FORMATS["stream"].write(stream, path, resume=True)
    FORMATS["stream"].write(stream, tmp_path / "b.stream")
    assert path.read_bytes() == (tmp_path / "b.stream").read_bytes()
    assert sorted(contents(tmp_path)) == ["a.stream", "b.stream"]


def test_without_resume_a_run_begins_anew(tmp_path, monkeypatch):
    stream, started = smooth_stream(20_000), []
    killed(monkeypatch, "csv", stream, tmp_path / "a.csv", 15_000)
    FORMATS["csv"].write(stream, tmp_path / "a.csv", progress=started.append)
    assert started[0] == 0
    assert list(contents(tmp_path)) == ["a.csv"]


@pytest.mark.parametrize(("error", "resume", "stays"), [
    (KeyboardInterrupt, True, True), (KeyboardInterrupt, False, False),
    (OutputError("full"), True, True), (ValueError, True, False),
])
def test_what_stays_of_a_run_that_was_stopped(error, resume, stays, tmp_path):
    stream = failing(smooth_stream(20_000), 15_000, error)
    with pytest.raises(error if isinstance(error, type) else type(error)):
        FORMATS["stream"].write(stream, tmp_path / "a.stream", resume=resume)
    assert sorted(contents(tmp_path)) == ([".a.stream.journal", ".a.stream.part"] if stays else [])


def test_a_limit_of_the_whole_print_holds_for_a_resumed_one(tmp_path, monkeypatch):
    """The torque of the rows written by the killed run counts: also where it was killed after the last row."""
    import dataclasses

    turn, robot = Turn(40.0, turns=3, radius=60.0, rise=40.0), cabfab_optim()
    rms = statistics(make_stream(turn, robot, period_s=0.002, header={}, sample=sample_turn)).torque_rms
    tight = dataclasses.replace(robot.winders, continuous_torque=rms * (1 - 1e-9))
    stream = make_stream(turn, dataclasses.replace(robot, winders=tight), period_s=0.002, header={}, sample=sample_turn)

    def without_the_end():
        blocks = iter(stream)
        rows = 0
        while rows < stream.rows:
            yield (block := next(blocks))
            rows += len(block)
        raise Killed

    for path, cut in ((tmp_path / "a.stream", False), (tmp_path / "b.stream", True)):
        with monkeypatch.context() as patched:
            patched.setattr(Unfinished, "kept", (BaseException,))
            source = MotorStream(stream.header, without_the_end)
            with pytest.raises(Killed):
                FORMATS["stream"].write(failing(stream, 9_000) if cut else source, path, resume=True)
        with pytest.raises(Exception, match="root mean square"):
            FORMATS["stream"].write(stream, path, resume=True)
    assert not contents(tmp_path)


def test_two_runs_do_not_write_one_file(tmp_path):
    path = tmp_path / "a.stream"

    def blocks():
        for block in smooth_stream(20_000):
            if block.row == 10_000:
                with pytest.raises(OutputError, match="being written by another run") as caught:
                    FORMATS["stream"].write(smooth_stream(20_000), path)
                assert caught.value.exit_code == 5
            yield block

    FORMATS["stream"].write(MotorStream(smooth_stream(20_000).header, blocks), path)
    assert list(contents(tmp_path)) == ["a.stream"]
    FORMATS["stream"].write(smooth_stream(20_000), tmp_path / "b.stream")
    assert path.read_bytes() == (tmp_path / "b.stream").read_bytes()


CHILD = """
import sys, time
sys.path[:0] = {folder!r}, {root!r}
from motors_fakes import smooth_stream
from cabslice.motors.formats import FORMATS
print("begun", flush=True)
FORMATS[{name!r}].write(smooth_stream(400_000, cables=4), {path!r}, resume={resume})
"""


def child(name, path, *, resume):
    root = os.path.dirname(os.path.dirname(__file__))
    code = CHILD.format(folder=os.path.dirname(__file__), root=root, name=name, path=str(path), resume=resume)
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs kill -9")
@pytest.mark.parametrize("name", ["stream", "twincat-fifo"])
def test_killed_at_random_moments(name, tmp_path):
    """kill -9 ten times, each later; every next run goes on; the end is the same bytes."""
    path = tmp_path / "a" / f"a{FORMATS[name].suffix}"
    path.parent.mkdir(), (tmp_path / "b").mkdir()
    rng, reached = np.random.default_rng(7), 0
    for _ in range(10):
        if path.exists():
            break
        run = child(name, path, resume=True)
        run.stdout.readline()
        time.sleep(rng.uniform(0.2, 0.7))
        run.send_signal(signal.SIGKILL)
        run.wait()
        journal = path.with_name(f".{path.name}.journal")
        steps = journal.read_bytes().count(b'"note"') if journal.exists() else 0
        assert steps >= reached or path.exists(), "what was whole stays"
        reached = steps
    stream = smooth_stream(400_000, cables=4)
    with pytest.raises(OutputError, match="exists already") if path.exists() else nullcontext():
        FORMATS[name].write(stream, path, resume=True)
    FORMATS[name].write(stream, tmp_path / "b" / path.name)
    assert contents(path.parent) == contents(tmp_path / "b")


@pytest.mark.skipif(importlib.util.find_spec("resource") is None, reason="needs limits of the system")
def test_a_full_disk_ends_in_a_sentence_and_resume_goes_on(tmp_path):
    """A limit on the size of files stands for a full disk; then there is room again."""
    import resource

    path, stream = tmp_path / "a.stream", smooth_stream(100_000, cables=4)
    FORMATS["stream"].write(stream, tmp_path / "b.stream")
    size, limits = (tmp_path / "b.stream").stat().st_size, resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, limits[1]))
        with pytest.raises(OutputError, match=r"a\.stream could not be written"):
            FORMATS["stream"].write(stream, path)
        assert list(contents(tmp_path)) == ["b.stream"]
        with pytest.raises(OutputError, match=r"a\.stream could not be written"):
            FORMATS["stream"].write(stream, path, resume=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert not path.exists()
    started = []
    FORMATS["stream"].write(stream, path, resume=True, progress=started.append)
    assert started[0] > 0
    assert path.read_bytes() == (tmp_path / "b.stream").read_bytes()


UNSHARE = ["unshare", "--map-root-user", "--mount", "sh", "-c"]
FULL = """
import sys
sys.path[:0] = [{folder!r}, {root!r}]
from motors_fakes import smooth_stream
from cabslice.errors import OutputError
from cabslice.motors.formats import FORMATS
try:
    FORMATS["stream"].write(smooth_stream(400_000, cables=4), "a.stream")
except OutputError as error:
    print(error.sentence, flush=True)
"""


def test_a_full_file_system_ends_in_a_sentence(tmp_path):
    """A file system of 1 MB in memory, of a user without rights to mount anything else."""
    probe = subprocess.run([*UNSHARE, f"mount -t tmpfs none {tmp_path}"], capture_output=True) \
        if shutil.which("unshare") else None
    if probe is None or probe.returncode:
        pytest.skip("needs unshare and tmpfs")
    root = os.path.dirname(os.path.dirname(__file__))
    script = tmp_path.with_name("full.py")
    script.write_text(FULL.format(folder=os.path.dirname(__file__), root=root))
    small = f"mount -t tmpfs -o size=1m none {tmp_path} && cd {tmp_path} && {sys.executable} {script} && ls -A"
    done = subprocess.run([*UNSHARE, small], capture_output=True, text=True)
    assert done.stdout == "a.stream could not be written: the disk is full.\n", done.stderr
