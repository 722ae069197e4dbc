"""Values of the grains over the states of a series."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_grains import PLACES, moved

from grainmotion import plot
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.sequences.series import Series


def series(times=None) -> Series:
    first = moved()
    return Series.of({"a": first, "b": replace(first, translations=3 * first.translations)}, times)


def test_each_grain_has_a_line_from_the_reference_on():
    ax = plot.history(series(), "ux")
    assert [line.get_label() for line in ax.lines] == ["grain 3", "grain 5", "grain 7", "grain 9"]
    assert ax.lines[1].get_xydata() == pytest.approx(np.array([[0, 0], [1, 0.02], [2, 0.06]]))
    assert np.isnan(ax.lines[3].get_ydata()[1:]).all()  # no result to use
    assert [t.get_text() for t in ax.get_xticklabels()] == ["reference", "a", "b"]


def test_known_times_are_the_axis():
    ax = plot.history(series({"a": 60.0, "b": 90.0}), "w", labels=[7])
    assert ax.lines[0].get_xydata() == pytest.approx(np.array([[0, 0], [60, 3], [90, 3]]))
    assert "time" in ax.get_xlabel()


def test_increments_begin_with_the_first_state():
    ax = plot.history(series(), "dux", labels=[3])
    assert ax.lines[0].get_ydata() == pytest.approx([0.01, 0.02])
    assert ax.get_ylabel() == "dux (mm)"


def test_many_grains_are_a_median_and_a_range():
    n = 30
    start = Motions.identity(np.arange(1, n + 1), np.repeat(PLACES[:1], n, axis=0) + np.arange(n)[:, None])
    u = np.zeros((n, 3))
    u[:, 0] = np.arange(n)
    many = replace(start, translations=u, statuses=np.full(n, "converged", dtype="<U20"))
    ax = plot.history(Series.of({"a": many}), "ux")
    middle = next(line for line in ax.lines if line.get_label() == "median")
    assert middle.get_ydata() == pytest.approx([0, 14.5])


def test_unknown_values_and_grains_are_named():
    with pytest.raises(InputError, match="use one of u, w"):
        plot.history(series(), "speed")
    with pytest.raises(InputError, match="no grain 4"):
        plot.history(series(), labels=[4])
    with pytest.raises(InputError, match="Series"):
        plot.history({"a": moved()})
