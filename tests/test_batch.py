"""Many parts at once: nothing that happens to one job reaches another, and however they are made the result is one."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from cli_cases import COARSE, PRINTER, SETS, answered, run, write_box

import cabslice
from cabslice.batch import jobs as asked
from cabslice.batch import local, manifest
from cabslice.batch import make as make_py
from cabslice.errors import ProfileError, UsageError
from cabslice.motors import formats

ROOT = str(Path(cabslice.__file__).parents[1])


def parts_of(folder, boxes=3, broken=1, size=(4.0, 4.0, 0.6)):
    """Boxes of different sizes, and files that are no mesh."""
    folder.mkdir(exist_ok=True)
    good = [write_box(folder / f"box{i:03}.stl", (size[0] + i % 7 / 4, size[1], size[2])) for i in range(boxes)]
    bad = [folder / f"broken{i:03}.stl" for i in range(broken)]
    for path in bad:
        path.write_bytes(b"solid nothing\nendsolid nothing\n")
    return [*good, *bad]


def bytes_of(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Three boxes, one broken, one part that stands off the bed: made one after the other in this process."""
    folder = tmp_path_factory.mktemp("batch")
    parts = parts_of(folder / "parts")
    assert run("batch", *parts, *PRINTER, *SETS, "-o", folder / "out", "-j", 1, "-q") == 3
    return folder, parts


def test_every_part_has_its_record_and_its_file(alone, tmp_path, capsys):
    folder, parts = alone
    told = manifest.read(folder / "out" / "manifest.json")
    assert [record["part"]["file"] for record in told["jobs"]] == [part.name for part in parts]
    assert told["counts"] == {"made": 3, "wrong": 1}
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "box000.stream", "box001.stream", "box002.stream", "manifest.csv", "manifest.json"]
    for record in told["jobs"][:3]:
        stream = formats.read(folder / "out" / record["files"][0]["file"])
        assert record["files"] == [manifest.hashed(folder / "out" / f"{record['name']}.stream")]
        assert record["part"]["sha256"] == stream.header["part"]["sha256"]
        assert record["numbers"]["duration_s"] == pytest.approx(stream.header["numbers"]["duration_s"])
        assert record["profiles"] == stream.header["profiles"]
    assert run("export", parts[0], *PRINTER, *SETS, "-o", tmp_path / "one.stream", "-q") == 0
    assert (tmp_path / "one.stream").read_bytes() == (folder / "out" / "box000.stream").read_bytes()
    lines = (folder / "out" / "manifest.csv").read_text().splitlines()
    assert len(lines) == 5
    assert lines[1].startswith("box000,box000.stl,cabfab-optim,made,0,")
    assert str(folder) not in (folder / "out" / "manifest.json").read_text()


def test_several_processes_give_the_same_bytes(alone, tmp_path):
    folder, parts = alone
    assert run("batch", *parts, *PRINTER, *SETS, "-o", tmp_path / "out", "-j", 2, "-q") == 3
    assert bytes_of(tmp_path / "out") == bytes_of(folder / "out")


def test_a_batch_does_not_replace_unless_told(alone, capsys):
    folder, parts = alone
    before = bytes_of(folder / "out")
    code, told = answered(capsys, "batch", *parts, *PRINTER, *SETS, "-o", folder / "out")
    assert code == 5
    assert "--resume goes on with it" in told["error"]["sentence"]
    assert bytes_of(folder / "out") == before


def test_resume_makes_only_what_is_not_there(alone, tmp_path, monkeypatch):
    """A part that changed, hurt or gone is made again; the rest, refusals too, is kept."""
    _, parts = alone
    words = ["batch", *parts, *PRINTER, *SETS, "-o", tmp_path / "out", "-q", "--resume"]
    assert run(*words, "-j", 1) == 3
    whole = bytes_of(tmp_path / "out")
    made = []
    make = local.make
    monkeypatch.setattr(local, "make", lambda job, *more: made.append(job.name) or make(job, *more))
    assert run(*words, "-j", 1) == 3
    assert made == []
    (tmp_path / "out" / "box001.stream").unlink()
    hurt = bytearray(whole["box002.stream"])
    hurt[100] ^= 1
    (tmp_path / "out" / "box002.stream").write_bytes(hurt)
    assert run(*words, "-j", 1) == 3
    assert made == ["box001", "box002"]
    assert bytes_of(tmp_path / "out") == whole
    asked_for = []
    monkeypatch.setattr(local, "make", lambda job, *more: asked_for.append(job.name) or (make_py.failed(job, ""), ""))
    assert run(*words, "-s", "walls=2", "-j", 1) == 1
    assert len(asked_for) == 4, "another setting makes other jobs"


def test_a_batch_that_was_stopped_is_gone_on_with(alone, tmp_path, monkeypatch, capsys):
    folder, parts = alone
    words = ["batch", *parts, *PRINTER, *SETS, "-o", tmp_path / "out", "-q", "-j", 1]
    make, made = local.make, []

    def stopped(job, *more):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(job.name)
        return make(job, *more)

    with monkeypatch.context() as patched:
        patched.setattr(local, "make", stopped)
        assert run(*words[:-3], "-j", 1) == 130
    assert "go on with --resume" in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        ".manifest.journal", "box000.stream", "box001.stream"]
    with (tmp_path / "out" / ".manifest.journal").open("ab") as file:
        file.write(b'{"key": "torn')
    assert run(*words) == 5, "neither --resume nor --overwrite"
    again = []
    monkeypatch.setattr(local, "make", lambda job, *more: again.append(job.name) or make(job, *more))
    assert run(*words, "--resume") == 3
    assert again == ["box002", "broken000"]
    assert bytes_of(tmp_path / "out") == bytes_of(folder / "out")


def test_two_batches_do_not_write_one_folder(tmp_path):
    with manifest.Journal(tmp_path, resume=False):
        part = write_box(tmp_path / "box.stl")
        assert run("batch", part, *PRINTER, "-o", tmp_path, "--resume", "-q") == 5


def test_every_part_for_every_printer_and_what_is_impossible(tmp_path, capsys):
    """A box beside the bed is refused by one robot, with the reason; the other part is made for both."""
    (tmp_path / "jobs.toml").write_text(f"""
        [defaults]
        printers = ["cabfab-optim", "cabfab-init-x"]
        set = {json.dumps(COARSE)}
        format = "csp"

        [[job]]
        part = "bo*.stl"

        [[job]]
        part = "box.stl"
        name = "aside"
        printers = ["cabfab-optim"]
        at_mm = [300, 0]

        [[job]]
        part = "none.stl"
        printers = ["no-such-printer"]
    """)
    write_box(tmp_path / "box.stl", (4.0, 4.0, 0.6))
    code, told = answered(capsys, "batch", tmp_path / "jobs.toml", "-o", tmp_path / "out", "-j", 1)
    assert (code, told["exit_code"], told["ok"]) == (4, 4, False)
    assert [(job["name"], job["verdict"]) for job in told["jobs"]] == [
        ("box-cabfab-optim", "made"), ("box-cabfab-init-x", "made"), ("aside", "impossible"), ("none", "wrong")]
    assert [file["file"] for file in told["jobs"][0]["files"]] == ["box-cabfab-optim.csp", "box-cabfab-optim.csp.json"]
    assert told["jobs"][2]["findings"][0]["code"] == "bed"
    assert told["counts"] == {"impossible": 1, "made": 2, "wrong": 1}
    assert "none.stl" in told["jobs"][3]["sentence"]


def test_copies_and_blockers_of_a_row_are_those_of_export(tmp_path, capsys):
    """The same bytes; another mesh makes another job; what only a part can have is refused for G-code."""
    folder = parts_of(tmp_path / "parts", boxes=1, broken=0, size=(3.0, 3.0, 0.4))[0].parent
    more = ["skirt_loops=0", "support.kind=straight"]
    write_box(folder / "mesh.stl", (1.0, 1.0, 0.4))
    (folder / "jobs.toml").write_text(f"""
        [defaults]
        printers = ["cabfab-optim"]
        set = {json.dumps([*COARSE, *more])}
        [[job]]
        part = "box000.stl"
        name = "two"
        copies = 2
        gap_mm = 4
        [[job]]
        part = "box000.stl"
        name = "kept"
        support_blockers = ["mesh.stl"]
    """)
    assert answered(capsys, "batch", folder / "jobs.toml", "-o", tmp_path / "out", "-j", 1)[0] == 0
    sets = [*SETS, *(word for one in more for word in ("-s", one))]
    for name, words in (("two", ("--copies", 2, "--gap", 4)), ("kept", ("--support-blocker", folder / "mesh.stl"))):
        alone = tmp_path / f"{name}.stream"
        assert run("export", folder / "box000.stl", *PRINTER, *sets, *words, "-o", alone, "-q") == 0
        assert alone.read_bytes() == (tmp_path / "out" / f"{name}.stream").read_bytes()
    wanted = asked.of_file(folder / "jobs.toml")[1]
    before = asked.ready(wanted).key
    write_box(folder / "mesh.stl", (1.0, 2.0, 0.4))
    assert asked.ready(wanted).key != before
    (folder / "a.gcode").write_text("G1 X1")
    with pytest.raises(UsageError, match=r"a\.gcode is G-code: copies is for a part"):
        asked.ready(replace(wanted, part=str(folder / "a.gcode"), row=asked.Row(copies=2)))


@pytest.mark.parametrize(("text", "wanted"), [
    ("[[job]]\npart = 'a.stl'\nprinter = 'x'\n", "line 3): unknown key; did you mean printers?"),
    ("[[job]]\nscale = -1\n", "job.part"),
    ("[[job]]\npart = 'a.stl'\nscale = -1\n", "job.scale (line 3): Input should"),
    ("[defaults]\nscale = 2\n", "expected [[job]] tables"),
    ("jobs = 1\n", "jobs: unknown key"), ("[[job", "is no TOML"),
    ("[defaults]\npart = 'a'\n[[job]]\npart = 'a.stl'\n", "defaults.part (line 2): unknown key"),
])
def test_a_wrong_jobs_file_names_key_and_line(tmp_path, text, wanted):
    path = tmp_path / "jobs.toml"
    path.write_text(text)
    with pytest.raises(ProfileError) as error:
        asked.of_file(path)
    assert wanted in error.value.sentence


def test_no_two_jobs_have_one_name():
    row = asked.Row(printers=("cabfab-optim", "cabfab-init-x"))
    names = [wanted.name for wanted in asked.of_parts(["a/x.stl", "b/x.stl"], row)]
    assert names == ["x-cabfab-optim", "x-cabfab-init-x", "x-cabfab-optim-2", "x-cabfab-init-x-2"]
    with pytest.raises(UsageError, match="Several jobs would be called x-2"):
        asked.of_parts(["a/x.stl", "b/x.stl", "x-2.stl"], asked.Row(printers=("cabfab-optim",)))


def test_a_jobs_file_is_given_alone(tmp_path, capsys):
    assert answered(capsys, "batch", "jobs.toml", "-p", "cabfab-optim")[0] == 2
    assert answered(capsys, "batch", "jobs.toml", "a.stl")[0] == 2
    assert answered(capsys, "batch", tmp_path / "jobs.toml")[0] == 3
    assert answered(capsys, "batch", "a.stl", *PRINTER, "--format", "nonsense")[0] == 2


# ---- killed

def _killed(job, folder, resume):
    """Kills its own process the first time, and always for one of the parts."""
    once = Path(folder) / f"{job.name}.once"
    if job.name == "box001" or not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return local_make(job, folder, resume)


def local_make(job, folder, resume):
    return {"name": job.name, "verdict": "made"}, ""


def test_a_job_whose_process_is_killed_is_made_again(tmp_path, monkeypatch):
    """Each job takes its first process with it, one always: that one is given up and told, the others are made."""
    monkeypatch.setattr(local, "make", _killed)
    wanted = asked.of_parts(parts_of(tmp_path / "parts", boxes=2, broken=0), asked.Row(printers=("cabfab-optim",)))
    jobs = [asked.ready(one) for one in wanted]
    records = {number: record for number, record, _ in local.run(jobs, str(tmp_path), processes=2)}
    assert sorted(records) == [0, 1]
    assert records[1]["verdict"] == "failed"
    assert "killed 3 times" in records[1]["sentence"]
    assert records[0] == {"name": "box000", "verdict": "made"}


def wait_for(seen, process=None, seconds=120):
    end = time.monotonic() + seconds
    while not seen():
        assert process is None or process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture
def dask(tmp_path):
    """Starts a scheduler and, as often as asked, workers; ends them all."""
    pytest.importorskip("distributed")
    env = {**os.environ, "PYTHONPATH": ROOT, "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "20s"}
    started = []

    def start(*words):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        started.append(subprocess.Popen([sys.executable, "-m", *words], env=env, cwd=tmp_path, **quiet))
        return started[-1]

    file = tmp_path / "scheduler.json"
    start("distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    wait_for(file.exists, started[0])
    address = json.loads(file.read_text())["address"]
    alone = "--nthreads", "1", "--no-nanny", "--no-dashboard"
    yield address, lambda: start("distributed.cli.dask_worker", address, *alone)
    for process in started:
        process.kill()
        process.wait()


def on_cluster(dask, parts, out, *, kill_after):
    """A batch on two workers, one of which is killed once `kill_after` files are there; its exit code."""
    address, worker = dask
    lost, _ = worker(), worker()
    words = ["batch", *map(str, parts), *PRINTER, *SETS, "-o", str(out), "-q", "--scheduler", address]
    env = {**os.environ, "PYTHONPATH": ROOT}
    client = subprocess.Popen([sys.executable, "-m", "cabslice", *words], env=env, stdout=subprocess.DEVNULL)
    try:
        wait_for(lambda: len(list(out.glob("*.stream"))) >= kill_after, client, 600)
        lost.kill()
        return client.wait(1200)
    finally:
        client.kill()


def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(alone, dask, tmp_path):
    folder, parts = alone
    assert on_cluster(dask, parts, tmp_path / "out", kill_after=1) == 3
    assert bytes_of(tmp_path / "out") == bytes_of(folder / "out")


def test_a_worker_of_another_version_does_not_make_anything(tmp_path):
    wanted = asked.of_parts(parts_of(tmp_path / "parts", boxes=1, broken=0), asked.Row(printers=("cabfab-optim",)))
    job = replace(asked.ready(wanted[0]), version="0.0.1")
    (_, record, _), = local.run([job], str(tmp_path / "out"), processes=1)
    assert (record["verdict"], record["exit_code"]) == ("wrong", 2)
    assert "the job is for 0.0.1" in record["sentence"]


def test_no_scheduler_is_a_sentence(tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    from cabslice.batch import cluster

    monkeypatch.setattr(cluster, "PATIENCE_S", 1)
    part = write_box(tmp_path / "box.stl")
    words = ["batch", part, *PRINTER, "-o", tmp_path / "out", "--scheduler"]
    code, told = answered(capsys, *words, "tcp://127.0.0.1:1")
    assert code == 2
    assert "dask scheduler" in told["error"]["sentence"]


@pytest.mark.slow
def test_two_hundred_parts_with_twenty_broken_ones_and_a_killed_worker(dask, tmp_path):
    """Acceptance 5: the manifest is complete, nothing is lost, and all is as this machine makes it alone."""
    parts = parts_of(tmp_path / "parts", boxes=180, broken=20, size=(3.0, 3.0, 0.6))
    parts = [parts[(7 * i) % 200] for i in range(200)]          # the broken ones among the others
    assert on_cluster(dask, parts, tmp_path / "out", kill_after=20) == 3
    told = manifest.read(tmp_path / "out" / "manifest.json")
    assert told["counts"] == {"made": 180, "wrong": 20}
    assert [record["part"]["file"] for record in told["jobs"]] == [part.name for part in parts]
    assert run("batch", *parts, *PRINTER, *SETS, "-o", tmp_path / "alone", "-j", 2, "-q") == 3
    assert bytes_of(tmp_path / "out") == bytes_of(tmp_path / "alone")
