"""Figures of one grain, of none, of thousands and of nothing but lost ones, and axes that do not fit."""

import warnings
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawn_grains import moved

import few_grains
from grainmotion import plot
from grainmotion.analysis.residual_images import residual_images
from grainmotion.errors import InputError
from grainmotion.mechanics.strains import strains
from grainmotion.model.detector_response import Response
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.sequences.series import Series

LOST = replace(
    moved(), statuses=np.array(["not-fitted"] * 4), translations=np.full((4, 3), np.nan),
    covariances=np.full((4, 6, 6), np.nan),
)  # fmt: skip
ONE = moved().for_grains(np.array([3]), np.array([[0.0, 0, 0]]))
NONE = Motions.identity(np.array([], dtype=np.int64), np.zeros((0, 3)))
MANY = Motions.identity(np.arange(2000), np.random.default_rng(0).uniform(-5, 5, (2000, 3)))
FIGURES = {
    "motions": plot.motions,
    "motions_3d": plot.motions_3d,
    "statuses": plot.grain_map,
    "values": lambda motions: plot.grain_map(motions, "uz", moved=True),
    "sd_ellipses": plot.sd_ellipses,
    "gains": plot.gains,
    "history": lambda motions: plot.history(Series.of({"a": motions, "b": motions})),
}


@pytest.mark.parametrize("motions", [ONE, NONE, LOST, MANY], ids=["one", "none", "lost", "many"])
@pytest.mark.parametrize("figure", FIGURES)
def test_any_motions_are_drawn_without_a_warning(figure, motions):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ax = FIGURES[figure](motions)
        ax.figure.canvas.draw()
    assert np.isfinite([*ax.get_xlim(), *ax.get_ylim()]).all()


def test_one_arrow_is_in_the_middle_of_its_box():
    ax = plot.motions_3d(replace(ONE, translations=np.array([[0.1, 0.2, 0.3]])), scale=1)
    middle = [np.mean(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())]
    assert middle == pytest.approx([0.05, 0.1, 0.15])


def test_an_upright_arrow_has_room_beside_it():
    ax = plot.motions(replace(ONE, translations=np.array([[0.0, 0.0, 3.0]])))
    assert np.ptp(ax.get_xlim()) > 0.5 * np.ptp(ax.get_ylim())


def test_axes_in_space_are_refused_where_the_figure_is_plane():
    with pytest.raises(InputError, match="the figure has two"):
        plot.motions(moved(), ax=plt.figure().add_subplot(projection="3d"))


@pytest.mark.parametrize("figure", [plot.motions, plot.motions_3d, plot.sd_ellipses])
@pytest.mark.parametrize("scale", [0, -2.0, np.inf])
def test_a_scale_that_hides_or_turns_arrows_is_refused(figure, scale):
    with pytest.raises(InputError, match=r"scale: it is .*give a positive number"):
        figure(moved(), scale=scale)


def test_strains_have_a_map_by_default():
    centers = np.random.default_rng(1).uniform(-1, 1, (9, 3))
    still = replace(Motions.identity(np.arange(9), centers), statuses=["converged"] * 9)
    assert plot.grain_map(strains(still)).figure.axes[1].get_ylabel() == "volumetric"


def test_a_scan_of_another_number_of_views_is_refused():
    grains, geometry = few_grains.smooth_grains(), few_grains.geometry()
    scan = Scan(np.zeros((len(geometry), *geometry.shape)), geometry)
    fitted = replace(few_grains.motions(grains), fit=StateFit(response=Response.identity(2)))
    for draw in (residual_images, plot.residual, plot.simulated):
        with pytest.raises(InputError, match=f"scan: {len(geometry)} views, but these motions were fitted to 2"):
            draw(grains, fitted, scan)


def test_values_that_are_texts_are_refused():
    with pytest.raises(InputError, match=r"grain_map\(values\): got list, wants an array"):
        plot.grain_map(moved(), ["a", "b", "c", "d"])


def test_an_empty_volume_is_black_and_labels_are_integers():
    volume = Volume.zeros((4, 5, 6), 0.1)
    low, high = plot.volume_slice(volume).images[0].get_clim()
    assert (low, high) == (0, 1)
    with pytest.raises(InputError, match="labels: they are float64; give integers"):
        plot.volume_slice(volume, np.zeros((4, 5, 6)))
