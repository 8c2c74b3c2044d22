"""Small pictures of toolpaths: the PNG is one, what is seen is where geometry says, the lines of G-code carry it."""

import base64
import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import image
from toolpath_samples import PLA, block, process

from cabslice.slicing.layer import Role
from cabslice.toolpath import thumbnail as room
from cabslice.toolpath.order import lay_toolpath
from cabslice.toolpath.thumbnail import comment, png, thumbnail


def laid(layers=20, half=6.0):
    return lay_toolpath(block(layers, half), process(), PLA, filament_diameter_mm=1.75)


def seen(path, width=160, height=120):
    return image.imread(io.BytesIO(thumbnail(path, width, height)))


@pytest.mark.parametrize("channels", [3, 4])
def test_another_reader_reads_the_same_pixels(channels):
    pixels = np.random.default_rng(1).integers(0, 256, (7, 5, channels), np.uint8)
    read = image.imread(io.BytesIO(png(pixels)))
    np.testing.assert_array_equal(np.rint(read * 255), pixels)


def test_a_block_covers_what_a_block_covers_from_there():
    """Area seen along n of a box a x b x c is b c |n_x| + a c |n_y| + a b |n_z|, in pixels of the one scale."""
    path = laid()
    pixels = seen(path)
    covered = np.argwhere(pixels[..., 3] > 0.5)
    right, up, near = room._eye()
    np.testing.assert_allclose(np.stack((right, up, near)) @ np.stack((right, up, near)).T, np.eye(3), atol=1e-12)
    assert np.linalg.det(np.stack((right, up, near))) == pytest.approx(1)
    sides = np.array([12.0, 12.0, 20 * 0.2])
    area = sum(np.prod(np.delete(sides, i)) * abs(near[i]) for i in range(3))
    low, high = covered.min(0), covered.max(0)
    millimetre = (high - low + 1)[1] / (np.abs(right) @ sides)
    assert len(covered) / millimetre**2 == pytest.approx(area, rel=0.06)
    assert max((high - low + 1) / np.array([120, 160])) == pytest.approx(1 - 2 * room.BORDER, abs=0.03)
    middle = (low + high) / 2
    np.testing.assert_allclose(middle, [59.5, 79.5], atol=2)


def test_the_top_is_brighter_than_the_sides():
    pixels = seen(laid(60))
    covered = np.argwhere(pixels[..., 3] == 1)
    low, high = covered.min(0), covered.max(0)
    middle = (low[1] + high[1]) // 2
    top, front = pixels[low[0] + 15, middle, :3], pixels[high[0] - 20, middle - 8, :3]
    right = pixels[high[0] - 25, high[1] - 8, :3]
    assert top.sum() > 1.05 * front.sum() > 1.2 * right.sum()


def test_travel_skirt_and_what_is_hidden_are_not_drawn():
    path = laid()
    between = np.flatnonzero((path.role[1:-1] == Role.TRAVEL) & (path.role[2:] == Role.TRAVEL)) + 1
    xyz = path.xyz.copy()
    xyz[between] += (500, 0, 0)                     # detours of travel moves
    assert thumbnail(replace(path, xyz=xyz), 64, 64) == thumbnail(path, 64, 64)
    plain = seen(path)
    assert plain[0, 0, 3] == 0
    walls_only = replace(path, role=np.where(path.role == Role.SKIRT, Role.TRAVEL, path.role).astype(np.uint8))
    np.testing.assert_array_equal(seen(walls_only), plain)


def test_a_path_of_inner_beads_alone_and_an_empty_one():
    path = laid(3)
    inner = replace(path, role=np.where(path.role == Role.TRAVEL, path.role, Role.SPARSE_INFILL).astype(np.uint8))
    assert (seen(inner)[..., 3] > 0).mean() > 0.1
    nothing = replace(path, role=np.zeros_like(path.role))
    assert not seen(nothing, 8, 4).any()
    with pytest.raises(ValueError, match="0 x 8 pixels"):
        thumbnail(path, 0, 8)


def test_same_bytes_again_and_the_comment_carries_them():
    path = laid(4)
    first = thumbnail(path, 48, 32)
    assert first == thumbnail(path, 48, 32)
    lines = list(comment(first, 48, 32))
    begin, *body, end = lines
    text = "".join(line.removeprefix("; ") for line in body)
    assert begin == f"; thumbnail begin 48x32 {len(text)}"
    assert end == "; thumbnail end"
    assert max(map(len, lines)) <= 80
    assert base64.b64decode(text) == first
