"""Whole or not at all: what happens to a file when writing it goes wrong."""

import errno
import io
import os
import subprocess
import sys
import threading

import pytest

from cabslice.errors import OutputError
from cabslice.files import BUFFER, atomic


def put(path, data=b"new", **more):
    with atomic(path, **more) as file:
        file.write(data)


def test_the_name_appears_when_the_file_is_whole(tmp_path):
    target = tmp_path / "a.bin"
    with atomic(target) as file:
        file.write(b"x" * 3 * BUFFER)
        assert not target.exists()
        (part,) = tmp_path.iterdir()
        assert part.name.startswith(".a.bin.")
    assert target.read_bytes() == b"x" * 3 * BUFFER
    assert list(tmp_path.iterdir()) == [target]


def test_the_file_has_ordinary_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    put(tmp_path / "ours")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_what_is_written_can_be_gone_back_to(tmp_path):
    with atomic(tmp_path / "a") as file:
        file.write(b"....abc")
        file.seek(0)
        file.write(b"1234")
        assert file.tell() == 4
    assert (tmp_path / "a").read_bytes() == b"1234abc"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError, SystemExit, OSError])
@pytest.mark.parametrize("size", [10, 3 * BUFFER])
def test_an_exception_leaves_nothing_new_and_keeps_the_old(tmp_path, stop, size):
    target = tmp_path / "a"
    target.write_bytes(b"old")


    def run():
        with atomic(target, overwrite=True) as file:
            file.write(b"x" * size)
            raise stop

    with pytest.raises(stop):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert target.read_bytes() == b"old"


def test_an_existing_file_is_refused_unless_told_otherwise(tmp_path):
    put(tmp_path / "a", b"old")
    with pytest.raises(OutputError, match=r"exists already.*--overwrite") as caught:
        put(tmp_path / "a")
    assert caught.value.exit_code == 5
    put(tmp_path / "a", overwrite=True)
    assert (tmp_path / "a").read_bytes() == b"new"


def test_a_file_that_came_meanwhile_is_not_replaced(tmp_path):
    def run():
        with atomic(tmp_path / "a") as file:
            file.write(b"slow")
            (tmp_path / "a").write_bytes(b"quick")

    with pytest.raises(OutputError, match="exists already"):
        run()
    assert (tmp_path / "a").read_bytes() == b"quick"
    assert len(list(tmp_path.iterdir())) == 1


def test_two_runs_writing_one_file_give_one_whole_file(tmp_path):
    barrier, target = threading.Barrier(4), tmp_path / "a"

    def run(letter):
        with atomic(target, overwrite=True) as file:
            barrier.wait()
            for _ in range(20):
                file.write(letter * 100_000)

    threads = [threading.Thread(target=run, args=(bytes([65 + i]),)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = target.read_bytes()
    assert len(found) == 2_000_000
    assert len(set(found)) == 1
    assert list(tmp_path.iterdir()) == [target]


def test_a_missing_folder_and_a_folder_as_a_name_are_sentences(tmp_path):
    with pytest.raises(OutputError, match="does not exist; make it first"):
        put(tmp_path / "no" / "a")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="exists already"):
        put(tmp_path / "folder")
    with pytest.raises(OutputError, match=r"folder could not be written: .* folder"):
        put(tmp_path / "folder", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


class Full(io.RawIOBase):
    """A disk with room for `room` bytes."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, data):
        if len(data) > self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= len(data)
        return self.file.write(data)

    def fileno(self):
        return self.file.fileno()

    def close(self):
        self.file.close()


@pytest.mark.parametrize("room", [0, BUFFER])
def test_a_full_disk_is_a_sentence_and_leaves_nothing(tmp_path, monkeypatch, room):
    monkeypatch.setattr("cabslice.files._create", lambda target, part: Full(part.open("xb", buffering=0), room))
    with pytest.raises(OutputError, match="the disk is full"):
        put(tmp_path / "a", b"x" * 3 * BUFFER if room else b"small")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_standard_output_onto_a_full_device_is_a_sentence():
    with open("/dev/full", "wb") as full:
        done = run_child("put('-', b'x' * 10)", stdout=full)
    assert done.returncode == 5
    assert b"standard output could not be written: the disk is full" in done.stderr


def run_child(code, **more):
    head = (
        "import sys\nfrom cabslice.errors import OutputError\nfrom cabslice.files import atomic\n"
        "def put(path, data):\n    with atomic(path) as file:\n        file.write(data)\n"
        "try:\n    {}\nexcept OutputError as error:\n    print(error, error.details['quiet'], file=sys.stderr)\n"
        "    sys.exit(5)\n"
    )
    return subprocess.run([sys.executable, "-c", head.format(code)], stderr=subprocess.PIPE, check=False, **more)


def test_a_dash_is_standard_output():
    done = run_child("put('-', bytes(range(256)) * 10_000)", stdout=subprocess.PIPE)
    assert done.returncode == 0
    assert done.stdout == bytes(range(256)) * 10_000


def test_a_closed_pipe_is_quiet():
    read, write = os.pipe()
    os.close(read)
    try:
        done = run_child("put('-', b'x' * 10_000_000)", stdout=write)
    finally:
        os.close(write)
    assert done.returncode == 5
    assert done.stderr.splitlines() == [b"standard output could not be written: the reader of the pipe has gone. True"]
