"""`ReportData` and `StateReport` refuse inconsistent data."""

import example
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.report import ReportData, StateReport


class TestBadInput:
    def test_different_shapes_are_refused(self):
        images = np.zeros((2, 4, 5))
        with pytest.raises(InputError, match="simulated"):
            StateReport("s", images, images[:1], example.motions(), 0.1)
        with pytest.raises(InputError, match="3 captions for 2 views"):
            StateReport("s", images, images, example.motions(), 0.1, views=("a", "b", "c"))

    def test_two_states_of_one_name_are_refused(self):
        with pytest.raises(InputError, match="appear twice"):
            ReportData("x", states=(example.state("s"), example.state("s")))

    def test_labels_without_a_volume_are_refused(self):
        with pytest.raises(InputError, match="labels"):
            ReportData("x", labels=np.zeros((2, 2, 2), int))
