"""Maps of values at the grains' centres, and ellipses of standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_grains import PLACES, moved
from matplotlib.collections import EllipseCollection, PathCollection
from matplotlib.colors import to_rgba

from grainmotion import plot
from grainmotion.errors import InputError
from grainmotion.mechanics.strains import strains
from grainmotion.model.motions import Motions
from grainmotion.model.status import STATUS_COLOURS


def points(ax) -> list[PathCollection]:
    return [c for c in ax.collections if isinstance(c, PathCollection)]


def test_a_column_colours_the_grains_whose_motion_is_a_result():
    unknown, known = points(plot.grain_map(moved(), "ux"))
    assert np.asarray(known.get_array()) == pytest.approx([0.01, 0.02, 0.03])
    assert np.asarray(known.get_offsets()) == pytest.approx(PLACES[:3][:, [0, 2]])
    assert np.asarray(unknown.get_offsets()) == pytest.approx(PLACES[3:][:, [0, 2]])


def test_the_colour_bar_names_column_and_unit():
    bar = plot.grain_map(moved(), "sd_wx").figure.axes[1]
    assert bar.get_ylabel() == "sd_wx (°)"
    bar = plot.grain_map(moved(), np.arange(4.0), label="height (mm)").figure.axes[1]
    assert bar.get_ylabel() == "height (mm)"


def test_colours_of_values_of_both_signs_are_symmetric_about_zero():
    drawn = points(plot.grain_map(moved(), np.array([-1.0, 2, 3, 4])))[-1]
    assert drawn.get_clim() == (-4, 4)


def test_each_status_has_its_colour_and_its_name():
    ax = plot.grain_map(moved(), "status", moved=True)
    drawn = {c.get_label(): tuple(c.get_facecolor()[0]) for c in points(ax)}
    assert drawn == {s: to_rgba(STATUS_COLOURS[s]) for s in ("converged", "left-field")}
    assert np.asarray(points(ax)[0].get_offsets())[:, 0] == pytest.approx(PLACES[:3, 0] + [0.01, 0.02, 0.03])


def test_unknown_columns_and_wrong_lengths_are_named():
    with pytest.raises(InputError, match="use one of label"):
        plot.grain_map(moved(), "speed")
    with pytest.raises(InputError, match="one number for each of 4 grains"):
        plot.grain_map(moved(), np.zeros(3))


def test_ellipses_have_the_standard_deviations_as_radii():
    ax = plot.sd_ellipses(moved(), plane="xz", scale=100)
    (drawn,) = (c for c in ax.collections if isinstance(c, EllipseCollection))
    assert drawn.get_widths() == pytest.approx(np.full(4, 2 * 0.2))  # the larger radius, 100 × 0.002 mm
    assert drawn.get_heights() == pytest.approx(np.full(4, 2 * 0.1))
    assert np.abs(np.cos(np.deg2rad(drawn.get_angles()))) == pytest.approx(np.ones(4))  # along x


def test_far_larger_ellipses_are_drawn_smaller_and_dashed():
    covariances = moved().covariances.copy()
    covariances[0] *= 1e4
    ax = plot.sd_ellipses(replace(moved(), covariances=covariances))
    drawn = [c for c in ax.collections if isinstance(c, EllipseCollection)]
    assert [len(c.get_offsets()) for c in drawn] == [3, 1]
    assert drawn[1].get_widths()[0] == pytest.approx(4 * drawn[0].get_widths()[0])
    assert "1 larger than drawn" in ax.get_title()


def test_unknown_standard_deviations_are_marked():
    ax = plot.sd_ellipses(replace(moved(), covariances=np.full((4, 6, 6), np.nan)), rotation=True)
    assert len(ax.lines[0].get_xdata()) == 4
    assert "4 without sd" in ax.get_title()


def test_strains_are_drawn_by_their_columns():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    motions = replace(
        Motions.identity(np.arange(1, 6), corners), translations=0.1 * corners, statuses=["converged"] * 5
    )
    found = strains(motions)
    assert found.volumetric == pytest.approx(1.1**3 - 1)
    drawn = points(plot.grain_map(found, "volumetric"))[-1]
    assert np.asarray(drawn.get_array()) == pytest.approx(found.volumetric)
    with pytest.raises(InputError, match="strains do not hold"):
        plot.grain_map(found, "volumetric", moved=True)
    with pytest.raises(InputError, match="use one of label"):
        plot.grain_map(found, "status")
