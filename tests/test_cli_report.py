"""cabslice report: every number of the page is the one in --json, and what inspect says is said here too."""

import base64
import html
import json
import re

import numpy as np
import pytest
from cli_cases import PRINTER, SETS, answered, run, write_box

from cabslice import store
from cabslice.motors.formats import read
from cabslice.toolpath.thumbnail import thumbnail
from cabslice.view import report as room


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    part = write_box(folder / "box.stl")
    assert run("slice", part, *PRINTER, *SETS, "-o", folder / "box.path", "-q") == 0
    assert run("plan", folder / "box.path", "-o", folder / "box.plan", "-q") == 0
    assert run("export", folder / "box.plan", "-o", folder / "box.stream", "-q") == 0
    return folder


def shown(text):
    """(key, exact value, words) of every number on a page."""
    rows = re.findall(r'<data value="([^"]*)" data-key="([^"]*)">([^<]*)</data>', text)
    return [(key, json.loads(html.unescape(value)), html.unescape(words)) for value, key, words in rows]


@pytest.mark.parametrize("name", ["box.path", "box.plan", "box.stream"])
def test_every_number_is_the_one_in_json_and_in_inspect(made, capsys, name):
    page = made / f"{name}.html"
    code, answer = answered(capsys, "report", made / name, "-o", page)
    assert code == 0
    numbers = answered(capsys, "inspect", made / name)[1]["numbers"]
    assert answer["numbers"] == numbers
    rows = shown(page.read_text())
    keys = [key for key, _, _ in rows]
    assert len(set(keys)) == len(keys)
    for key, value, words in rows:
        assert room.at(answer, key) == value, key
        assert re.search(r"\d", words), words
    told = {key.removeprefix("numbers.") for key in keys if key.startswith("numbers.")}
    assert {"duration_s", "rows", "max_tension_n.7"} <= told or name == "box.path"
    assert {"filament_mm", "moves", "layers"} <= told


def test_what_stands_on_a_page_of_a_plan(made, capsys):
    page = made / "plan.html"
    answer = answered(capsys, "report", made / "box.plan", "-o", page)[1]
    text = page.read_text()
    assert not re.search(r'(src|href)="(?!data:|#)', text)
    assert text.count("<svg") >= 8
    for heading in ("time by feature", "cables and motors", "what was checked", "made with", "how often: speeds"):
        assert f">{heading}<" in text, heading
    for row in answer["profiles"].values():
        assert row["sha256"] in text
    for sentence in answer["verdict"]["checked"]:
        assert html.escape(sentence) in text
    assert answer["verdict"]["ok"] is True
    for row in answer["histograms"].values():
        assert sum(row["share"]) == pytest.approx(1)
        assert len(row["edges"]) == len(row["share"]) + 1
    gap = [value for value in answer["along"]["cable_gap_mm"] if value is not None]
    slabs = [row["least_cable_gap_mm"] for row in answer["clearance_by_height"]]
    assert answer["min_cable_gap_mm"] == min(gap) == min(slabs)
    assert answer["min_first_mode_hz"] == min(answer["along"]["first_mode_hz"])
    assert np.ptp(answer["along"]["z_mm"]) <= 1.5 + 1e-6
    air = answer["part_clearance_by_layer"]
    assert air["layer"] == sorted(set(store.load(made / "box.plan")[1].toolpath.layer.tolist()))
    assert min(air["least_mm"]) >= answer["verdict"]["margins"]["cable_part_mm"]


def test_a_motor_file_carries_the_picture_of_its_part(made, capsys):
    picture = read(made / "box.stream").header["thumbnail"]
    wanted = thumbnail(store.load(made / "box.plan")[1].toolpath, picture["width"], picture["height"])
    assert base64.b64decode(picture["png_base64"]) == wanted
    assert run("report", made / "box.stream", "-o", made / "s.html", "-q") == 0
    assert picture["png_base64"] in (made / "s.html").read_text()


def test_same_product_same_bytes_and_nothing_is_replaced_unasked(made, capsys):
    for name in ("a.html", "b.html"):
        assert run("report", made / "box.path", "-o", made / name, "--no-check", "-q") == 0
    assert (made / "a.html").read_bytes() == (made / "b.html").read_bytes()
    assert run("report", made / "box.path", "-o", made / "a.html") == 5
    assert run("report", made / "box.stl", "-o", made / "c.html") == 2
    assert "box.stl has no robot's motion to report" in capsys.readouterr().err
