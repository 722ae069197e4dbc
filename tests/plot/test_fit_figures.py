"""Figures of a fit: convergence by stage, gains, corrections of views."""

import numpy as np
import pytest
from drawn_grains import moved

from grainmotion import plot
from grainmotion.errors import InputError
from grainmotion.model.detector_response import Response
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.state_fit import StateFit

COSTS = (("body", 0.5), ("body", 0.2), ("all", 0.05), ("all", 0.02), ("all", 0.01))


def test_each_stage_has_its_line():
    ax = plot.convergence(StateFit(costs=COSTS))
    assert [line.get_label() for line in ax.lines] == ["body", "all"]
    assert ax.lines[1].get_xydata() == pytest.approx(np.array([[3, 0.05], [4, 0.02], [5, 0.01]]))
    assert ax.get_yscale() == "log"


def test_residuals_of_a_reconstruction_are_one_line():
    assert plot.convergence((0.3, 0.1)).lines[0].get_ydata() == pytest.approx([0.3, 0.1])


def test_motions_without_residuals_are_refused():
    with pytest.raises(InputError, match="no residuals"):
        plot.convergence(moved())


def test_gains_by_view():
    fit = StateFit(response=Response(np.array([[1.1], [0.9]]), np.array([[0.01], [0.02]])))
    heights = [bar.get_height() for bar in plot.gains(fit).patches]
    assert heights == pytest.approx([0.1, -0.1, 0.01, 0.02])


def test_shifts_and_angles_of_views_with_their_sd():
    known = ViewCorrections(np.array([[1.0, 2.0], [3.0, 4.0]]), np.deg2rad([0.5, 0.25]))
    sd = ViewCorrections(np.full((2, 2), 0.1), np.deg2rad([0.01, 0.02]))
    fit = StateFit(view_corrections=known, view_corrections_sd=sd)
    shifts = plot.view_corrections(fit)
    assert [c.get_label() for c in shifts.containers] == ["along u, columns", "along v, rows"]
    assert [list(c.lines[0].get_ydata()) for c in shifts.containers] == [[1, 3], [2, 4]]
    angles = plot.view_corrections(fit, quantity="angle")
    assert angles.containers[0].lines[0].get_ydata() == pytest.approx([0.5, 0.25])
    with pytest.raises(InputError, match="no corrections"):
        plot.view_corrections(StateFit())


def test_a_fit_of_some_views_holds_their_response_and_corrections():
    columns = np.arange(9.0).reshape(3, 3)
    whole = StateFit(
        response=Response(np.array([[1.0], [2.0], [3.0]]), np.zeros((3, 1))),
        view_corrections=ViewCorrections.of(columns),
    )
    part = whole.of_views([2, 0])
    assert part.response is not None
    assert part.view_corrections is not None
    assert part.response.polynomial[:, 0] == pytest.approx([3, 1])
    assert part.view_corrections.columns == pytest.approx(columns[[2, 0]])
    assert part.view_corrections_sd is None
    assert StateFit().of_views([0]).response is None
