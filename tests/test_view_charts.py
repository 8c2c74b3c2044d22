"""Charts from plain arrays: what is drawn is what was given, extremes survive thinning, the same bytes again."""

import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matplotlib import image

from cabslice.errors import OutputError, UsageError
from cabslice.view import charts

TIME = np.linspace(0, 100, 20_000)


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(3, 5000), st.integers(4, 200), st.integers(0, 2**32 - 1))
def test_a_thinned_curve_keeps_its_extremes_and_its_order(count, most, seed):
    values = np.random.default_rng(seed).normal(size=count)
    along, kept = charts.thinned(np.arange(count), values, most)
    assert len(kept) <= max(most + 2, min(count, most))
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert (np.diff(along) > 0).all()
    np.testing.assert_array_equal(values[along], kept)


def drawings():
    angle = np.linspace(0, 2 * np.pi, 400)
    x = np.linspace(-200, 200, 21)
    volcano = np.where(np.hypot(x[:, None], x) < 180, 400 - np.hypot(x[:, None], x), np.nan)
    tension = 20 + np.sin(TIME[:, None] + np.arange(8))
    return {
        "tensions": charts.tensions(TIME, tension, (1, 90)), "profile": charts.velocity_profile(TIME, TIME, 2 * TIME),
        "map": charts.error_map(np.random.default_rng(0).normal(size=(500, 2)), np.arange(500.0)),
        "ballbar": charts.ballbar({"one": (angle, 100 + 0.02 * np.cos(2 * angle))}, 100.0),
        "volcano": charts.height_map(x, x, volcano),
        "histogram": charts.histogram([0, 1, 2], [0.25, 0.75], "speed, mm/s"),
        "bars": charts.bars({"a": 1.0, "b": 3.0}, "time, min"),
    }


def test_every_chart_names_its_axes_with_units_and_is_the_same_again(tmp_path):
    again = drawings()
    for name, figure in drawings().items():
        axes = figure.axes[0]
        if name != "ballbar":
            assert ", " in axes.get_xlabel(), name
        assert charts.svg(figure) == charts.svg(again[name])
        charts.save(figure, tmp_path / f"{name}.png")
        pixels = image.imread(io.BytesIO((tmp_path / f"{name}.png").read_bytes()))
        assert (pixels[..., :3].min(axis=2) < 0.9).mean() > 0.01, name


def test_what_is_drawn_is_what_was_given():
    found = drawings()
    lines = found["tensions"].axes[0].get_lines()
    assert [line.get_label() for line in lines[:8]] == [str(k) for k in range(1, 9)]
    assert [line.get_ydata()[0] for line in lines[8:]] == [1, 90]
    assert [bar.get_height() for bar in found["histogram"].axes[0].patches] == [25, 75]
    assert [bar.get_width() for bar in found["bars"].axes[0].patches] == [1, 3]
    assert "499" in found["map"].axes[0].get_title()
    polar = found["ballbar"].axes[0]
    assert "circularity 40 µm" in polar.get_title()
    np.testing.assert_allclose(np.abs(polar.get_lines()[1].get_ydata()).max(), 20, rtol=1e-6)
    mesh = found["volcano"].axes[0].collections[0].get_array()
    assert np.ma.count(mesh) == (np.hypot(*np.meshgrid(*[np.linspace(-200, 200, 21)] * 2)) < 180).sum()


def test_another_suffix_and_an_existing_file_are_refused(tmp_path):
    figure = charts.bars({"a": 1.0}, "time, s")
    with pytest.raises(UsageError, match=r"x\.pdf"):
        charts.save(figure, tmp_path / "x.pdf")
    charts.save(figure, tmp_path / "x.svg")
    with pytest.raises(OutputError, match="exists"):
        charts.save(figure, tmp_path / "x.svg")
