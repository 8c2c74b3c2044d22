"""Pictures of maps and poses: what is drawn, in which colour, where."""

import numpy as np
import pytest
from matplotlib import colormaps, image
from robots import cabfab_init_x, gt_planar

from cabslice.errors import OutputError
from cabslice.robot import held, workspace
from cabslice.view import plots, plots_poses
from cabslice.view.stiffness import of_held

GREY = np.array([0xDD] * 3) / 255


def chart(values, inside=None, *, low=-500.0, high=500.0, **more):
    axes = [np.linspace(low, high, count) for count in np.shape(values)]
    return plots.Chart("first_mode_hz", workspace.Grid(*axes, turn=np.zeros(3)), values, inside, **more)


def drawn(path, charts, robot=None):
    plots.save_picture(robot or cabfab_init_x(bed_origin=None), charts, path, title="a title")
    return image.imread(path)[..., :3]


def share_of(pixels, colour, tolerance=0.02):
    return (np.abs(pixels - colour).max(axis=-1) < tolerance).mean()


def test_a_map_of_one_value_has_its_colour_and_what_is_outside_is_grey(tmp_path):
    """A quarter of every slice is outside: grey takes the place of the colour in the middle of the scale."""
    values, inside = np.full((20, 20, 20), 3.0), np.zeros((20, 20, 20), bool)
    inside[:10, :, :] = inside[:, :10, :] = inside[:, :, :10] = True
    inside[10:, 10:, :], inside[10:, :, 10:], inside[:, 10:, 10:] = False, False, False
    whole = drawn(tmp_path / "whole.png", [chart(values)])
    part = drawn(tmp_path / "part.png", [chart(values, inside, through=(-100.0, -100.0, -100.0))])
    colour = np.array(colormaps["plasma"](0.5)[:3])
    assert share_of(whole, colour) > 0.3
    assert share_of(part, colour) == pytest.approx(0.75 * share_of(whole, colour), rel=0.03)
    assert share_of(part, GREY) - share_of(whole, GREY) == pytest.approx(0.25 * share_of(whole, colour), rel=0.03)


def test_values_that_are_not_finite_are_outside():
    values = np.arange(27.0).reshape(3, 3, 3)
    values[0, 0, 0], values[1, 1, 1] = np.nan, np.inf
    inside = np.ones((3, 3, 3), bool)
    inside[2] = False
    shown = chart(values, inside).shown
    np.testing.assert_array_equal(np.isnan(shown), ~inside | ~np.isfinite(values))
    np.testing.assert_array_equal(shown[:2][np.isfinite(shown[:2])], values[:2][np.isfinite(values[:2])])


def test_rising_values_run_through_the_scale_from_left_to_right(tmp_path):
    values = np.broadcast_to(np.linspace(0, 1, 40)[:, None, None], (40, 40, 40)).copy()
    pixels = drawn(tmp_path / "rise.png", [chart(values)])
    before = 0.0
    for place in (0.1, 0.5, 0.9):
        colour = np.array(colormaps["plasma"](place)[:3])
        found = np.argwhere(np.abs(pixels - colour).max(axis=-1) < 0.02)
        left = found[found[:, 1] < pixels.shape[1] * 0.33, 1]      # the view from above
        assert len(left) > 20
        assert np.ptp(left) < 30
        assert left.mean() > before + 50
        before = left.mean()


def test_an_empty_map_and_a_robot_in_a_plane_can_be_drawn(tmp_path):
    empty = drawn(tmp_path / "empty.png", [chart(np.full((5, 5, 5), np.nan))])
    assert share_of(empty, GREY) > 0.15
    robot = gt_planar()
    grid = workspace.frame_grid(robot, count=9)
    gap = workspace.survey(robot, grid, workspace.least_gap).value
    pixels = drawn(tmp_path / "plane.png", [plots.Chart("cable_gap_mm", grid, gap)], robot)
    assert share_of(pixels, np.ones(3)) < 0.9


def test_same_maps_same_bytes_and_nothing_is_replaced_unasked(tmp_path):
    charts = [chart(np.arange(64.0).reshape(4, 4, 4))]
    for name in ("a.png", "b.png"):
        drawn(tmp_path / name, charts)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with pytest.raises(OutputError, match=r"a\.png exists"):
        drawn(tmp_path / "a.png", charts)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_maps_of_another_shape_than_their_outline_are_refused():
    with pytest.raises(ValueError, match="expected Z = 3"):
        chart(np.zeros((3, 3, 3)), np.ones((3, 3, 2), bool))


@pytest.mark.parametrize("count", [1, 12])
def test_bars_of_any_number_of_poses(tmp_path, count):
    robot, poses = cabfab_init_x(), np.zeros((count, 6))
    poses[:, 2] = -10.0 * np.arange(count)
    columns = of_held(robot, held.hold(robot, poses))
    for name in ("a.png", "b.png"):
        plots_poses.save_picture(robot, columns, [f"pose {i}" for i in range(count)], tmp_path / name, title="bars")
    pixels = image.imread(tmp_path / "a.png")[..., :3]
    bars = share_of(pixels, np.array([0x00, 0x72, 0xB2]) / 255)
    assert 0.1 < bars < 0.6
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_negative_part_hangs_below_the_axis(tmp_path):
    """The parts of a stiffness stacked: those above add up, those below hang from zero."""
    from matplotlib.figure import Figure

    columns = {"k_trans_kn_m": np.array([[3.0, 1, 0]]), "k_cable_trans_kn_m": np.array([[4.0, 3, 2]]),
               "k_lat_trans_kn_m": np.array([[1.0, 0, 1]]), "k_force_trans_kn_m": np.array([[-2.0, -2, -3]])}
    axes = Figure().add_subplot()
    plots_poses._stiffness(axes, columns, "trans_kn_m", "xyz", "kN/m")
    boxes = [(bar.get_y(), bar.get_height()) for bar in axes.patches]
    assert boxes == [(0, 4), (0, 3), (0, 2), (4, 1), (3, 0), (2, 1), (0, -2), (0, -2), (0, -3)]
