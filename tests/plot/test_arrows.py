"""Arrows of motions: where they start, how long they are, which grains have none."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawn_grains import PLACES, moved
from matplotlib.quiver import Quiver
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from grainmotion import plot
from grainmotion.errors import InputError
from grainmotion.plot.arrows import arrow_scale, arrow_vectors


def arrows(ax) -> Quiver:
    return next(c for c in ax.collections if isinstance(c, Quiver))


def test_arrows_of_usable_grains_start_at_their_centres():
    drawn = arrows(plot.motions(moved(), plane="xz", scale=10))
    assert np.array(drawn.XY) == pytest.approx(PLACES[:3][:, [0, 2]])
    assert np.array(drawn.U) == pytest.approx([0.1, 0.2, 0.3])
    assert np.array(drawn.V) == pytest.approx([0, 0, 0])


def test_colours_tell_the_whole_length_also_where_the_arrow_is_seen_end_on():
    drawn = arrows(plot.motions(moved(), plane="yz"))
    assert np.array(drawn.U) == pytest.approx([0, 0, 0])
    assert np.asarray(drawn.get_array()) == pytest.approx([0.01, 0.02, 0.03])


def test_grains_without_a_result_are_marked_and_counted():
    ax = plot.motions(moved())
    assert ax.lines[0].get_xydata() == pytest.approx(PLACES[3:][:, [0, 2]])
    assert "1 without a result" in ax.get_title()


def test_given_axes_are_used_and_returned():
    _, axes = plt.subplots(1, 2)
    assert plot.motions(moved(), ax=axes[1]) is axes[1]
    assert not axes[0].collections


def test_fluctuations_have_no_mean():
    vectors, used = arrow_vectors(moved(), "fluctuation")
    assert vectors[used].mean(axis=0) == pytest.approx(np.zeros(3))
    assert np.isnan(vectors[~used]).all()


def test_the_longest_arrow_spans_about_a_fifth_of_the_sample():
    factor = arrow_scale(PLACES, np.array([0.001, 0.03]))
    assert factor == 20  # 0.2 × 4 mm / 0.03 mm = 26.7
    assert arrow_scale(PLACES, np.array([np.nan, 0.7])) == 1
    assert arrow_scale(PLACES, np.zeros(4)) == 1


def test_arrows_in_three_dimensions():
    ax = plot.motions_3d(moved(), quantity="rotation", scale=0.5)
    (drawn,) = (c for c in ax.collections if isinstance(c, Line3DCollection))
    shafts = np.array([np.asarray(line) for line in drawn._segments3d][:3])
    lengths = np.linalg.norm(shafts[:, 1] - shafts[:, 0], axis=1)
    assert lengths == pytest.approx(0.5 * np.array([1, 2, 3]))  # degrees
    with pytest.raises(InputError, match="two dimensions"):
        plot.motions_3d(moved(), ax=plt.figure().add_subplot())


def test_unknown_planes_and_quantities_are_named():
    with pytest.raises(InputError, match="xy, xz, yz"):
        plot.motions(moved(), plane="zx")
    with pytest.raises(InputError, match="fluctuation"):
        plot.motions(moved(), quantity="speed")
