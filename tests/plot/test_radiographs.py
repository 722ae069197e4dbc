"""Radiographs, simulated images and residuals in figures: which pixels, and which way is up."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion import plot
from grainmotion.analysis.residual_images import residual_images
from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.detector_response import Response
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit


def scan(first_row: str = "bottom") -> Scan:
    views = Geometry.parallel([0, 90], (8, 10), 0.1, panel=DetectorAlignment(first_row=first_row))
    images = np.arange(160.0).reshape(2, 8, 10)
    valid = np.ones(images.shape, bool)
    valid[1, 3, 4] = False
    return Scan(images, views, valid)


def test_a_radiograph_is_drawn_with_its_masked_pixels_blank():
    image = plot.radiograph(scan(), view=-1).images[0].get_array()
    assert np.isnan(np.ma.filled(image, np.nan)[3, 4])
    assert np.nansum(np.ma.filled(image, np.nan)) == scan().line_integrals[1].sum() - scan().line_integrals[1, 3, 4]


@pytest.mark.parametrize(("first_row", "origin"), [("bottom", "lower"), ("top", "upper")])
def test_up_is_up(first_row, origin):
    assert plot.radiograph(scan(first_row)).images[0].origin == origin


def test_points_are_marked_where_they_are_seen():
    ax = plot.radiograph(scan(), points=np.array([[0.1, 0.0, 0.2]]))
    assert ax.lines[0].get_xydata()[0] == pytest.approx([4.5 + 1, 3.5 + 2])


def test_unknown_views_are_refused():
    with pytest.raises(InputError, match="give 0 to 1"):
        plot.radiograph(scan(), view=2)


def test_residual_and_simulated_image_add_up_to_the_measured_one():
    grains = few_grains.grain_set(2)
    truth = few_grains.small_motions(grains)
    state = few_grains.radiographs(grains, truth)
    gains = np.array([1.0, 1.1, 1.2, 1.3])
    fit = StateFit(response=Response(gains[:, None], np.zeros((4, 1))))
    found = replace(truth, fit=fit)
    left = plot.residual(grains, found, state, view=2).images[0].get_array()
    assert np.asarray(left) == pytest.approx(residual_images(grains, found, state)[2], abs=1e-6)
    model = plot.simulated(grains, found, state, view=2).images[0].get_array()
    assert np.asarray(model) + np.asarray(left) == pytest.approx(state.line_integrals[2], abs=1e-6)
    assert "rms" in plot.residual(grains, found, state, view=2).get_title()
