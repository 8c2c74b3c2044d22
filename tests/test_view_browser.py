"""The page in a real browser: no network, no error, and what it shows is what the values say."""

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from browser import chromium, needs_browser
from robots import cabfab_optim

from cabslice.feasibility.findings import Finding
from cabslice.slicing.layer import Role
from cabslice.view.page import save_page
from cabslice.view.scene import Field, Mesh, Moves, Scene, of_grid, of_mesh

pytestmark = needs_browser
LAYERS, SIDE = 12, 20.0
SLIDE = """const slider = document.getElementById(arguments[0]);
slider.value = arguments[1];
slider.dispatchEvent(new Event('input'));"""
PIXEL, PROJECT = "return cabslice.pixel(arguments[0], arguments[1])", "return cabslice.project(arguments[0])"
MARK = """const box = document.querySelector('#marks button').getBoundingClientRect();
return [box.x + box.width / 2, box.y + box.height / 2]"""


@pytest.fixture(scope="module")
def page():
    with chromium() as found:
        yield found


def moves(layers=LAYERS, per_side=5):
    """A square tower, walls of straight moves, each faster than the one before; a travel up to every layer."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * SIDE / 2
    sides = [np.linspace(a, b, per_side, endpoint=False) for a, b in pairwise(corners)]
    ring = np.concatenate([*sides, corners[-1:]])
    xyz = np.concatenate([np.column_stack((ring, np.full(len(ring), 0.5 * (k + 1)))) for k in range(layers)])
    layer = np.repeat(np.arange(layers), len(ring))
    role = np.where(np.tile(np.arange(len(ring)), layers) == 0, Role.TRAVEL, Role.OUTER_WALL)
    laid = role != Role.TRAVEL
    speed = np.linspace(10, 110, len(xyz))
    tension = Field("tension_2_n", "tension of cable 2", "N", 120 - speed, "far", 2)
    fields = Field("speed_mm_s", "speed", "mm/s", speed), tension
    return Moves(xyz, role, layer, 2.0 * laid, 0.5 * laid, np.arange(len(xyz)) * 0.25, "planned", fields)


FINDING = Finding("cable-part", 6, (5.0, -10.0, 3.5), 2, -1.25, 2.0, "mm", "layer 6: cable 2 is too near.", "Turn it.")


def scene(**more):
    given = {"title": "tower <b>&amp;", "kind": "plan", "facts": {"print time": "1 min"}, "robot": cabfab_optim(),
             "moves": moves(), "findings": (FINDING, replace(FINDING, layer=2, xyz=(0.0, 10.0, 1.5)))}
    return Scene(**given | more)


@pytest.fixture(scope="module")
def opened(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "tower.html"
    save_page(scene(), path)
    page.open(path)
    return page


@pytest.fixture
def tower(opened):
    """The page as it is when it has been opened."""
    opened.run("cabslice.colourBy('feature'); cabslice.state.finding = -1; cabslice.setLayer(99)")
    opened.settle()
    return opened


def test_it_opens_without_network_and_without_a_word_on_the_console(tower):
    assert tower.run("return navigator.onLine") is False
    assert tower.run("return performance.getEntriesByType('resource').map((row) => row.name)") == []
    assert tower.log() == []
    assert tower.text("#title") == "tower <b>&amp;"
    assert "cabfab-optim" in tower.text("#kind")


def test_the_slider_shows_that_layer_and_no_more(tower):
    everything = moves()
    for index in (0, 5, LAYERS - 1):
        tower.run(SLIDE, "layer", index)
        tower.settle()
        assert tower.text("#layername").split() == ["layer", str(index + 1), f"{0.5 * (index + 1):.2f}", "mm"]
        shown = tower.run("return [cabslice.state.first, cabslice.state.at]")
        rows = np.flatnonzero(everything.layer == index)
        assert shown == [1, rows[-1]]


def test_layers_above_the_slider_are_not_in_the_picture(tower):
    tower.run("cabslice.setLayer(11); cabslice.camera.lift = 0; cabslice.camera.turn = 0; cabslice.redraw()")
    tower.settle()
    high, low = [tower.run(PROJECT, [0.0, -SIDE / 2, z]) for z in (5.3, 0.8)]
    orange = [0xD5, 0x5E, 0x00]

    def seen(place):
        colour = np.array(tower.run(PIXEL, *place[:2]), float)
        return np.dot(colour, orange) / np.linalg.norm(colour) / np.linalg.norm(orange) > 0.999

    assert seen(high)
    assert seen(low)
    tower.run("cabslice.setLayer(3)")
    tower.settle()
    assert not seen(high)
    assert seen(low)
    tower.run("cabslice.look(-0.6, 0.5)")


@pytest.mark.parametrize("key", ["speed_mm_s", "tension_2_n"])
def test_a_move_seen_from_above_has_the_colour_that_the_legend_gives_its_value(tower, key):
    tower.run("cabslice.colourBy(arguments[0]); cabslice.look(0, Math.PI / 2)", key)
    tower.settle()
    every = moves()
    field = next(one for one in every.fields if one.key == key)
    tower.run("document.getElementById('robot').click()")
    tower.settle()
    top = np.flatnonzero((every.layer == LAYERS - 1) & (every.role == Role.OUTER_WALL))
    for row in top[2::4]:
        middle = (every.xyz[row] + every.xyz[row - 1]) / 2
        x, y, _ = tower.run(PROJECT, middle.tolist())
        seen = tower.run(PIXEL, x, y)
        wanted = tower.run("return cabslice.legend(arguments[0])", float(field.values[row]))
        np.testing.assert_allclose(seen, wanted, atol=8)
        assert tower.run("return cabslice.pick(arguments[0], arguments[1])", x, y) == row
    laid = field.values[every.role == Role.OUTER_WALL]
    low, high = laid.min(), laid.max()
    assert tower.run("return [cabslice.state.low, cabslice.state.high]") == pytest.approx([low, high], rel=1e-3)
    ends = tower.text("#legend .ends").split()
    assert [float(ends[1]), float(ends[3])] == pytest.approx([low, high], abs=0.06)
    assert field.unit in tower.text("#legend")
    tower.run("document.getElementById('robot').click(); cabslice.look(-0.6, 0.5)")


def test_the_pointer_tells_the_values_of_the_move_under_it(tower):
    from selenium.webdriver.common.action_chains import ActionChains

    every, row = moves(), 245
    tower.run("cabslice.colourBy('speed_mm_s'); cabslice.look(0, Math.PI / 2)")
    tower.settle()
    middle = (every.xyz[row] + every.xyz[row - 1]) / 2
    x, y, _ = tower.run(PROJECT, middle.tolist())
    canvas = tower.driver.find_element("id", "canvas")
    ActionChains(tower.driver).move_to_element_with_offset(
        canvas, round(x - canvas.size["width"] / 2), round(y - canvas.size["height"] / 2)).perform()
    tower.until("return cabslice.state.hovered > 0")
    told = tower.text("#values")
    assert f"{row}, outer wall" in told
    speed = float(told.split("speed\n")[1].split()[0])
    assert speed == pytest.approx(every.fields[0].values[row], abs=0.05)
    assert f"{every.time[row]:.2f} s" in told
    assert "mm/s" in tower.text("#tip")
    tower.run("cabslice.look(-0.6, 0.5)")


def test_a_click_on_a_finding_flies_there_and_chooses_its_layer_and_cable(tower):
    before = tower.run("return cabslice.camera.target")
    assert tower.run("return document.querySelectorAll('#findings button, #marks button').length") == 4
    assert "cable 2 is too near" in tower.text("#findings")
    tower.run("document.querySelector('#findings button').click()")
    tower.settle()
    after = tower.run("return cabslice.camera.target")
    assert after == pytest.approx(list(FINDING.xyz), abs=1e-6)
    assert np.linalg.norm(np.subtract(after, before)) > 5
    assert tower.run("return cabslice.state.at") == np.flatnonzero(moves().layer == FINDING.layer)[-1]
    assert tower.run("return cabslice.state.pose") == list(FINDING.xyz)
    x, y, _ = tower.run(PROJECT, list(FINDING.xyz))
    mark = tower.run(MARK)
    assert mark == pytest.approx([x, y], abs=1.5)


def test_the_time_slider_stands_for_the_time_of_the_moves(tower):
    every = moves()
    for share in (0.1, 0.5, 0.83):
        tower.run(SLIDE, "time", share)
        wanted = share * every.time[-1]
        row = int(np.searchsorted(every.time, wanted))
        at, part = tower.run("return [cabslice.state.at, cabslice.state.part]")
        assert at == row
        assert every.time[row - 1] + part * (every.time[row] - every.time[row - 1]) == pytest.approx(wanted, abs=2e-3)
    tower.settle()


def test_keys_move_through_layers_and_moves(tower):
    from selenium.webdriver.common.keys import Keys

    body = tower.driver.find_element("tag name", "body")
    tower.run("document.activeElement.blur(); cabslice.setLayer(5)")
    body.send_keys(Keys.ARROW_UP)
    assert tower.text("#layername").startswith("layer 7")
    at = tower.run("return cabslice.state.at")
    body.send_keys(Keys.ARROW_LEFT)
    assert tower.run("return cabslice.state.at") == at - 1
    body.send_keys("c")
    tower.until("return cabslice.state.field.key === 'speed_mm_s'")
    body.send_keys("?")
    assert "next finding" in tower.text("#help")
    body.send_keys(Keys.ESCAPE)
    assert tower.run("return document.getElementById('help').hidden")
    tower.settle()


def test_play_goes_through_the_print_and_stops_at_its_end(tower):
    tower.run("cabslice.setTime(0); cabslice.state.pace = 200; document.getElementById('play').click()")
    assert tower.run("return cabslice.state.playing")
    tower.until("return !cabslice.state.playing")
    tower.settle()
    assert tower.run("return cabslice.state.at") == len(moves().xyz) - 1


def test_coarser_levels_keep_the_extremes(tower):
    """Whatever is joined, the greatest value of all moves is among the painted ones, and the ends are the same."""
    found = tower.run("""
        const values = Float32Array.from(cabslice.moves.time);
        values[123] = 1e6;
        return cabslice.stage.levels.map((level) => {
          let most = -1;
          for (let i = 1; i < level.count; i++) {
            const to = level.rows ? level.rows[i] : i, from = level.rows ? level.rows[i - 1] + 1 : i;
            for (let j = from; j <= to; j++) most = Math.max(most, values[j]);
          }
          return [level.count, level.tolerance, most, level.rows ? level.rows[level.count - 1] : level.count - 1];
        });""")
    counts = [row[0] for row in found]
    assert counts[0] == len(moves().xyz)
    assert counts[-1] < counts[0] / 2
    assert all(most == 1e6 and last == counts[0] - 1 for _, _, most, last in found)


def test_parts_and_workspaces_have_pages_too(page, tmp_path):
    corners = np.array([[x, y, z] for x in (0, 20.0) for y in (0, 20.0) for z in (0, 20.0)])
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                      [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    mesh = of_mesh(corners, faces)
    assert isinstance(mesh, Mesh)
    axis = np.linspace(-100, 100, 9)
    inside = np.add.outer(np.add.outer(axis**2, axis**2), axis**2) < 100**2
    maps = {"margin_n": ("tension margin", "N", np.broadcast_to(axis, inside.shape))}
    cells = of_grid((axis, axis, axis), inside, maps, np.zeros(3))
    bare = scene(moves=None)
    for name, one in (("part", replace(bare, mesh=mesh)), ("cells", replace(bare, cells=cells)), ("none", bare)):
        path = tmp_path / f"{name}.html"
        save_page(one, path)
        page.open(path)
        assert page.log() == []
        assert page.run("return cabslice.state.failed") == ""
        colours = {tuple(page.run(PIXEL, x, y)) for x in (250, 300, 350) for y in (250, 300)}
        assert len(colours) > 1 or name == "none"


@pytest.mark.slow
def test_a_million_moves_load_in_seconds_and_scroll_without_freezing(page, tmp_path):
    """CPU time of the page itself: what loads it, and the longest single task while the layers are gone through."""
    rng = np.random.default_rng(0)
    count, layers = 1_000_000, 500
    angle = np.linspace(0, 2 * np.pi * 20 * layers, count)
    radius = 60 + 20 * np.sin(5 * angle) + rng.normal(0, 0.01, count)
    layer = np.arange(count) * layers // count
    xyz = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), 0.2 * (layer + 1)))
    speed = Field("speed_mm_s", "speed", "mm/s", 50 + 40 * np.sin(angle / 7))
    full = np.full(count, 0.4)
    many = Moves(xyz, np.where(np.arange(count) % 2000 == 0, 0, 1), layer, full, full / 2, np.arange(count) * 0.01,
                 "planned", (speed,))
    path = tmp_path / "many.html"
    save_page(scene(moves=many, findings=()), path)
    page.driver.get(path.as_uri())
    page.until("return window.cabslice && (cabslice.state.ready || cabslice.state.failed)")
    ready = page.run("return cabslice.state.opened")
    assert ready < 5000
    assert page.run("return cabslice.moves.count") == count
    page.run("""window.longest = 0; window.seen = 0;
        new PerformanceObserver((list) => list.getEntries().forEach((one) => {
          window.longest = Math.max(window.longest, one.duration); })).observe({ type: 'longtask' });""")
    for index in range(0, layers, 50):
        page.run(SLIDE, "layer", index)
        time.sleep(0.05)
    page.run("cabslice.camera.turn += 0.5; cabslice.redraw()")
    page.settle()
    assert page.run("return window.longest") < 500
    assert page.log() == []
