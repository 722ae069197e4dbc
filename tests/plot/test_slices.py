"""Slices of volumes: which voxels, where they lie, outlines around labels."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from grainmotion import plot
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume

SHAPE = (4, 5, 6)


def numbered() -> Volume:
    return Volume(np.arange(120.0).reshape(SHAPE), 0.5, (1.0, 2.0, 3.0))


@pytest.mark.parametrize(("axis", "across"), [("z", 0), ("y", 1), ("x", 2)])
def test_the_layer_at_a_place_is_drawn_where_it_lies(axis, across):
    volume = numbered()
    first = volume.origin[2 - across]
    ax = plot.volume_slice(volume, axis=axis, at=first + 0.5 * 2 + 0.2)
    (image,) = ax.images
    assert np.asarray(image.get_array()) == pytest.approx(np.take(volume.array, 2, across))
    right, up = ("xyz".index(name) for name in {"z": "xy", "y": "xz", "x": "yz"}[axis])
    low = [volume.origin[k] - 0.25 for k in (right, up)]
    high = [low[0] + 0.5 * SHAPE[2 - right], low[1] + 0.5 * SHAPE[2 - up]]
    assert image.get_extent() == pytest.approx([low[0], high[0], low[1], high[1]])
    assert image.origin == "lower"


def test_outlines_run_around_each_label():
    labels = np.zeros(SHAPE, int)
    labels[2, 1:3, 2] = 7  # two voxels high, one wide
    ax = plot.volume_slice(numbered(), labels, axis="z")
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
    ends = np.array(lines.get_segments()).reshape(-1, 2)
    assert len(ends) == 2 * 6
    x, y, _ = numbered().origin - 0.25
    assert [*ends.min(axis=0), *ends.max(axis=0)] == pytest.approx([x + 1, y + 0.5, x + 1.5, y + 1.5])
    assert ax.texts[0].get_text() == "7"
    assert ax.texts[0].get_position() == pytest.approx((x + 1.25, y + 1))


def test_a_label_that_fills_the_slice_is_outlined_at_its_edge():
    ax = plot.volume_slice(numbered(), np.ones(SHAPE, int))
    assert len(ax.collections[0].get_segments()) == 2 * (5 + 6)


def test_slices_outside_and_labels_of_another_grid_are_refused():
    with pytest.raises(InputError, match="outside the volume"):
        plot.volume_slice(numbered(), at=9.0)
    with pytest.raises(InputError, match="the volume's is"):
        plot.volume_slice(numbered(), np.ones((2, 2, 2), int))
    with pytest.raises(InputError, match="'t' is unknown"):
        plot.volume_slice(numbered(), axis="t")
