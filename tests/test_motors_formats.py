"""Motor files: what was written comes back, damage is found and placed, nothing half-written stays."""

import csv as text
import dataclasses
import importlib.util
import struct
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motors_fakes import Turn, noisy_stream, sample_turn, smooth_stream, whole
from robots import cabfab_optim

from cabslice.errors import ImpossibleError, OutputError, ProductError, UsageError
from cabslice.motors import formats
from cabslice.motors.formats import FORMATS, binary, csv
from cabslice.motors.statistics import statistics
from cabslice.motors.stream import MotorStream, make_stream, rechunk

HALF = 0.5 + 1e-6        # of a quantum: rounding to the nearest
ARROW = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow")
NAMES = [pytest.param(name, marks=ARROW) if name == "parquet" else name for name in FORMATS]
EACH = pytest.mark.parametrize("name", NAMES)
EXACT = pytest.mark.parametrize("name", ["stream", "csv", NAMES[-1]])     # every column stands in the file


def quanta(name, stream):
    if name == "stream":
        return binary.quanta(stream.header)
    if name == "parquet":
        return dict.fromkeys((*csv.PLACES, "move"), 0.0)
    places = {column: 10.0**-digits for column, digits in csv.PLACES.items()}
    return {**places, "torque": places["torque"] * 1e3, "move": 0.0}


def there_and_back(stream, path):
    form = formats.format_for(path)
    numbers = form.write(stream, path, overwrite=True)
    return formats.read(path), numbers


def assert_same(found, wanted, quantum):
    for name in vars(found):
        miss = np.abs(getattr(found, name) - getattr(wanted, name)).max()
        size = np.abs(getattr(wanted, name)).max()
        assert miss <= HALF * quantum[name] + 4e-16 * size, name


# ---- there and back

@EXACT
@given(
    rows=st.integers(1, 40), cables=st.integers(1, 9), seed=st.integers(0, 99),
    scale=st.sampled_from([0.0, 1e-9, 1.0, 90.0]),
)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_columns_come_back_within_half_a_quantum(name, tmp_path, rows, cables, seed, scale):
    stream = noisy_stream(rows, cables=cables, seed=seed, scale=scale, move=name != "csv")
    found, _ = there_and_back(stream, tmp_path / f"a{FORMATS[name].suffix}")
    assert dict(found.header) == dict(stream.header)
    assert_same(whole(found), whole(stream), quanta(name, stream))


@EXACT
def test_many_blocks_come_back_and_what_comes_back_is_written_the_same(name, tmp_path):
    stream = smooth_stream(20_001, move=name != "csv")
    suffix = FORMATS[name].suffix
    found, numbers = there_and_back(stream, tmp_path / f"a{suffix}")
    assert [block.row for block in found] == [0, 8192, 16384]
    assert_same(whole(found), whole(stream), quanta(name, stream))
    again, _ = there_and_back(found, tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    for column, values in vars(whole(again)).items():
        np.testing.assert_array_equal(values, getattr(whole(found), column))
    assert vars(numbers).keys() == vars(statistics(stream)).keys()
    np.testing.assert_array_equal(numbers.torque.value, statistics(stream).torque.value)


@EACH
def test_the_bytes_do_not_depend_on_how_the_rows_arrive(name, tmp_path):
    stream, path = smooth_stream(9_000), tmp_path / f"a{FORMATS[name].suffix}"
    there_and_back(stream, path)
    wanted = path.read_bytes()
    for size in (1, 4096, 10_000):
        if size == 1:
            few = smooth_stream(50)
            there_and_back(MotorStream(few.header, lambda: rechunk(smooth_stream(50), 1)), path)
            single = path.read_bytes()
            there_and_back(few, path)
            assert path.read_bytes() == single
        else:
            there_and_back(MotorStream(stream.header, lambda size=size: rechunk(stream, size)), path)
            assert path.read_bytes() == wanted


@EACH
def test_a_file_can_be_gone_through_again_and_again(name, tmp_path):
    found, _ = there_and_back(smooth_stream(100), tmp_path / f"a{FORMATS[name].suffix}")
    first, second = iter(found), iter(found)
    np.testing.assert_array_equal(next(first).angle, next(second).angle)
    np.testing.assert_array_equal(whole(found).angle, whole(found).angle)


@pytest.mark.parametrize("radius", [0.5, 60.27, 250.0, 2000.0])
def test_the_angle_quantum_moves_no_cable_by_more_than_two_nanometres(radius):
    quantum = binary.quanta({"largest_radius_mm": radius})["angle"]
    assert quantum / 2 * radius <= binary.CABLE_ERROR_MM < quantum * radius
    assert np.log2(quantum).is_integer()


def test_the_layout_is_the_one_described(tmp_path):
    """Read by hand from the description alone."""
    import json
    import zlib

    stream, path = noisy_stream(50, cables=2), tmp_path / "a.stream"
    there_and_back(stream, path)
    data = path.read_bytes()
    magic, version, size = struct.unpack_from("<8sII", data)
    assert (magic, version) == (b"\x89STREAM\n", 2)
    header = json.loads(data[16 : 16 + size])
    head, row, rows, packed = struct.unpack_from("<4sQII", data, 20 + size)
    assert (head, row, rows) == (b"ROWS", 0, 50)
    payload = data[40 + size : 40 + size + packed]
    column = header["layout"]["columns"][0]
    seeds, width = struct.unpack_from("<4q", payload), payload[32]      # 2 channels, one group of rows each
    word = int.from_bytes(payload[34 : 34 + 8 * width], "little")
    z = [word >> (width * i) & ((1 << width) - 1) for i in range(48)]
    assert word >> (width * 48) == 0
    x = list(seeds[:2])
    for value in z:
        x.append((value // 2 if value % 2 == 0 else -(value + 1) // 2) + 2 * x[-1] - x[-2])
    assert zlib.crc32(data[20 + size : 40 + size + packed]) == struct.unpack_from("<I", data, 40 + size + packed)[0]
    assert column["name"] == "angle"
    np.testing.assert_allclose(np.array(x) * column["quantum"], whole(stream).angle[:, 0], atol=column["quantum"] / 2)


def test_csv_is_what_other_programs_read(tmp_path):
    stream, path = noisy_stream(30, cables=2), tmp_path / "a.csv"
    there_and_back(stream, path)
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = list(text.DictReader(lines))
    assert list(rows[0]) == [
        "t_s", "q1_rad", "q2_rad", "qd1_rad_s", "qd2_rad_s", "tau1_n_m", "tau2_n_m", "f1_n", "f2_n", "e_mm",
    ]
    data = whole(stream)
    assert [row["t_s"] for row in rows[:2]] == ["0.000000", "0.002000"]
    for cable in (1, 2):
        assert [row[f"tau{cable}_n_m"] for row in rows] == [f"{x / 1e3:.6f}" for x in data.torque[:, cable - 1]]
        assert [row[f"q{cable}_rad"] for row in rows] == [f"{x:.9f}" for x in data.angle[:, cable - 1]]
    assert [row["e_mm"] for row in rows] == [f"{x:.5f}" for x in data.filament]


@given(st.lists(st.floats(-9e9, 9e9), min_size=1, max_size=20), st.integers(0, 6))
@settings(deadline=None)
def test_decimals_are_those_of_python(values, places):
    found = csv.decimals(np.array(values)[:, None], places).tobytes().translate(None, b"\0").decode()
    for value, word in zip(values, found.split(","), strict=False):
        exact = np.rint(value * 10.0**places)
        wanted = f"{abs(int(exact)):0{places + 1}d}"
        sign = "-" if exact < 0 else ""
        assert word == f"{sign}{wanted[: len(wanted) - places]}.{wanted[len(wanted) - places :]}"


@EXACT
def test_a_value_beyond_the_format_is_refused_and_nothing_is_left(name, tmp_path):
    if name == "parquet":
        pytest.skip("holds any number")
    with pytest.raises(OutputError, match="too large"):
        there_and_back(noisy_stream(5, scale=1e14), tmp_path / f"a{FORMATS[name].suffix}")
    assert not list(tmp_path.iterdir())


# ---- damage

@pytest.fixture(scope="module", params=NAMES)
def written(request, tmp_path_factory):
    """A format, the bytes of each of its files, and where to put them."""
    stream = smooth_stream(600, cables=2, move=False)
    path = tmp_path_factory.mktemp("written") / f"b{FORMATS[request.param].suffix}"
    FORMATS[request.param].write(MotorStream({**stream.header, "part": "benchy"}, stream.blocks), path)
    return FORMATS[request.param], {file: file.read_bytes() for file in path.parent.iterdir()}, path


def go_through(written, changed):
    form, good, path = written
    for file, data in {**good, **changed}.items():
        file.write_bytes(data)
    return whole(form.read(path))


@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_a_flipped_bit_is_found(written, data):
    """In any of its files; of Parquet's own head and foot not every byte is looked at: then the rows are right."""
    form, good, _ = written
    file = data.draw(st.sampled_from(sorted(good)))
    at, bit = data.draw(st.integers(0, len(good[file]) - 1)), data.draw(st.integers(0, 7))
    bad = bytearray(good[file])
    bad[at] ^= 1 << bit
    try:
        found = go_through(written, {file: bytes(bad)})
    except ProductError as error:
        assert "b." in error.sentence    # noqa: PT017
    else:
        assert form.name == "parquet"
        wanted = go_through(written, {})
        for name, values in vars(found).items():
            np.testing.assert_array_equal(values, getattr(wanted, name))


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_truncated_file_is_found(written, data):
    _, good, _ = written
    file = data.draw(st.sampled_from(sorted(good)))
    short = good[file][: data.draw(st.integers(0, len(good[file]) - 1))]
    with pytest.raises(ProductError, match=r"b\."):
        go_through(written, {file: short})


def test_bytes_after_the_end_are_found(written):
    _, good, _ = written
    for file in good:
        for more in (b"\0", good[file][-40:], b"1.0,2.0\n"):
            with pytest.raises(ProductError, match=r"damaged|not whole"):
                go_through(written, {file: good[file] + more})


def test_a_missing_file_is_named(written):
    form, good, path = written
    for file in sorted(good):
        go_through(written, {})
        file.unlink()
        with pytest.raises(ProductError, match=file.name.replace(".", r"\.")):
            whole(form.read(path))


def test_the_place_of_the_damage_is_named(tmp_path):
    path = tmp_path / "a.stream"
    there_and_back(smooth_stream(20_000), path)
    good = path.read_bytes()
    second = good.index(b"ROWS", good.index(b"ROWS") + 4)
    (tmp_path / "b.stream").write_bytes(good[: second + 100] + bytes([good[second + 100] ^ 1]) + good[second + 101 :])
    blocks = iter(formats.read(tmp_path / "b.stream"))
    assert len(next(blocks)) == 8192
    with pytest.raises(ProductError, match=rf"block 1 of rows \(from row 8192, byte {second}\)"):
        next(blocks)
    (tmp_path / "c.stream").write_bytes(good[:-1])
    with pytest.raises(ProductError, match="cut short"):
        formats.read(tmp_path / "c.stream")


def test_blocks_that_changed_places_are_found(tmp_path):
    """Each block whole, the file wrong: two files of the same size, a block of one in the other."""
    parts = []
    for name, seed in (("a", 1), ("b", 1)):
        path = tmp_path / f"{name}.stream"
        there_and_back(smooth_stream(16_384, seed=seed), path)
        parts.append(path.read_bytes())
    first = parts[0].index(b"ROWS")
    second = parts[0].index(b"ROWS", first + 4)
    end = parts[0].rindex(b"DONE")
    swapped = parts[0][:first] + parts[0][second:end] + parts[0][first:second] + parts[0][end:]
    (tmp_path / "c.stream").write_bytes(swapped)
    with pytest.raises(ProductError, match="block"):
        whole(formats.read(tmp_path / "c.stream"))


def test_csv_names_the_lines_of_the_damage(tmp_path):
    path = tmp_path / "a.csv"
    there_and_back(smooth_stream(20, cables=2), path)
    lines = path.read_bytes().splitlines(keepends=True)
    start = next(i for i, line in enumerate(lines) if line.startswith(b"t_s"))
    bad = [*lines[: start + 3], lines[start + 3].replace(b",", b",x", 1), *lines[start + 4 :]]
    path.write_bytes(b"".join(bad))
    with pytest.raises(ProductError, match=rf"of its 20 lines from {start + 2} on"):
        whole(formats.read(path))
    path.write_bytes(b"".join(lines[:-2]))
    with pytest.raises(ProductError, match="cut short: it ends after 19 of 20 rows"):
        whole(formats.read(path))


def test_another_layout_schema_or_kind_of_file_is_named(tmp_path):
    path = tmp_path / "a.stream"
    there_and_back(smooth_stream(20), path)
    good = path.read_bytes()
    path.write_bytes(good[:8] + b"\x07" + good[9:])
    with pytest.raises(ProductError, match="layout 7"):
        formats.read(path)
    newer = smooth_stream(20)
    binary.write(MotorStream({**newer.header, "schema": 9}, newer.blocks), path, overwrite=True)
    with pytest.raises(ProductError, match="schema 9"):
        formats.read(path)
    path.write_bytes(b"solid cube\n")
    with pytest.raises(ProductError, match="cannot be read as a motor stream"):
        formats.read(path)
    with pytest.raises(ProductError, match="cannot be read"):
        formats.read(tmp_path / "none.stream")


# ---- writing that does not end well

@EACH
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ImpossibleError("no")], ids=["ctrl-c", "impossible"])
def test_an_interrupted_write_leaves_nothing(name, stop, tmp_path):
    def blocks():
        for number, block in enumerate(smooth_stream(30_000)):
            if number == 20:
                raise stop
            yield block

    with pytest.raises(stop if isinstance(stop, type) else type(stop)):
        there_and_back(MotorStream(smooth_stream(30_000).header, blocks), tmp_path / f"a{FORMATS[name].suffix}")
    assert not list(tmp_path.iterdir())


@EACH
def test_no_file_where_a_limit_is_broken(name, tmp_path):
    robot = cabfab_optim()
    slow = dataclasses.replace(robot, winders=dataclasses.replace(robot.winders, continuous_torque=np.full(8, 100.0)))
    stream = make_stream(Turn(1.0, turns=0.2), slow, period_s=0.002, header={}, sample=sample_turn)
    with pytest.raises(ImpossibleError, match="root mean square"):
        there_and_back(stream, tmp_path / f"a{FORMATS[name].suffix}")
    assert not list(tmp_path.iterdir())


@EACH
def test_an_existing_file_stays_unless_told_otherwise(name, tmp_path):
    path = tmp_path / f"a{FORMATS[name].suffix}"
    path.write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        FORMATS[name].write(smooth_stream(10), path)
    assert path.read_bytes() == b"mine"


@EACH
def test_progress_is_told_the_rows_so_far(name, tmp_path):
    seen = []
    FORMATS[name].write(smooth_stream(20_000), tmp_path / "a", progress=seen.append)
    assert seen[-1] == 20_000
    assert seen == sorted(seen)


@EACH
def test_the_registry_knows_suffixes_names_and_first_bytes(name, tmp_path):
    form = FORMATS[name]
    assert formats.format_for(f"a/B{form.suffix.upper()}").name == formats.format_for("-", name).name == name
    path = tmp_path / "named-otherwise.bin"
    form.write(smooth_stream(10), path)
    assert formats.format_of(path) == form


def test_an_unknown_format_lists_those_there_are(tmp_path):
    with pytest.raises(UsageError, match=r"\.stream \(stream\), \.csv \(csv\)"):
        formats.format_for("a.gcode")
    with pytest.raises(UsageError, match="there are stream, csv"):
        formats.format_for("a.stream", "beckhoff")
    assert formats.format_of(tmp_path / "none") is None


# ---- size, speed, memory

@EACH
def test_memory_does_not_grow_with_the_length_of_the_file(name, tmp_path):
    def peak(rows):
        tracemalloc.start()
        try:
            found, _ = there_and_back(smooth_stream(rows, cables=4), tmp_path / f"a{FORMATS[name].suffix}")
            for _ in found:
                pass
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(9_000)
    assert peak(120_000) < 1.1 * peak(60_000)


def test_binary_is_small_and_quick(tmp_path):
    """Measured: 4 M rows/s, 22 bytes a row. The bounds leave room for a busy machine."""
    stream = smooth_stream(200_000)
    blocks = list(stream)
    start = time.process_time()
    binary.write(MotorStream(stream.header, lambda: blocks), tmp_path / "a.stream")
    assert 200_000 / (time.process_time() - start) > 500_000
    assert (tmp_path / "a.stream").stat().st_size < 30 * 200_000


@given(start=st.integers(0, 20_001), count=st.integers(0, 9_000))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rows_are_read_from_anywhere(tmp_path, start, count):
    path = tmp_path / "a.stream"
    if not path.exists():
        binary.write(smooth_stream(20_001, cables=2), path)
    wanted = whole(formats.read(path)).angle[start : start + count]
    found = list(binary.rows(path, start, start + count))
    assert [block.row for block in found[:1]] == [start][: len(found)]
    np.testing.assert_array_equal(np.concatenate([np.zeros((0, 2)), *(block.angle for block in found)]), wanted)


def test_other_blocks_need_not_be_whole_to_read_rows(tmp_path):
    path = tmp_path / "a.stream"
    binary.write(smooth_stream(20_000, cables=2), path)
    data = bytearray(path.read_bytes())
    second = data.index(b"ROWS", data.index(b"ROWS") + 4)
    data[second + 100] ^= 1
    path.write_bytes(data)
    assert sum(map(len, binary.rows(path, 0, 8192))) == 8192
    with pytest.raises(ProductError, match="block 1 of rows"):
        list(binary.rows(path, 0, 8193))
