"""The figure of a comparison: errors of each grain in voxels, rms, failed and missing grains."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_grains import moved

from grainmotion import plot
from grainmotion.analysis.validation import compare
from grainmotion.model.motions import Motions


def truth() -> Motions:
    return replace(moved(), statuses=np.full(4, "converged", dtype="<U20"))


def measured() -> Motions:
    return replace(moved(), translations=truth().translations + np.array([0.01, 0, 0]))


def test_errors_are_drawn_in_voxels_with_their_rms():
    ax = plot.comparison(compare(measured(), truth(), 0.1))
    along_x = next(line for line in ax.lines if line.get_label() == "ux")
    assert along_x.get_ydata() == pytest.approx(np.full(3, 0.1))
    band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert band.ymax == pytest.approx(0.1 / np.sqrt(3))
    assert ax.get_ylabel() == "error (voxel)"


def test_failed_grains_are_hollow_and_counted():
    ax = plot.comparison(compare(measured(), truth(), 0.1))
    hollow = [line for line in ax.lines if line.get_markerfacecolor() == "none"]
    assert [len(line.get_xdata()) for line in hollow] == [1, 1, 1]
    assert "1 failed" in ax.get_title()


def test_rotations_are_in_degrees_and_unknown_voxels_in_mm():
    assert plot.comparison(compare(measured(), truth()), rotation=True).get_ylabel() == "error (°)"
    assert plot.comparison(compare(measured(), truth())).get_ylabel() == "error (mm)"
