"""`check_plausible` refuses geometry in another unit than the volume, and views that do not see the volume."""

import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.inputs import check_plausible
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from tiny_experiment import PANEL, geometry


class TestPlausible:
    GRID = Volume.zeros((28, 36, 36), 0.1)

    def test_consistent_geometry_is_accepted(self):
        check_plausible("reference", geometry([0, 90]), self.GRID)

    @pytest.mark.parametrize("factor", [1e-3, 1e3])
    def test_geometry_in_another_unit_is_refused(self, factor):
        views = geometry([0, 90])
        wrong = Geometry(views.vectors * factor, views.shape, "cone")
        with pytest.raises(InputError, match=r"units|unit, mm"):
            check_plausible("reference", wrong, self.GRID)

    @pytest.mark.parametrize("factor", [1e-3, 1e3])
    def test_volume_in_another_unit_is_refused(self, factor):
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", geometry([0, 90]), Volume.zeros((28, 36, 36), 0.1 * factor))

    @pytest.mark.parametrize(
        "change",
        [
            {"pixel_size": 400.0},
            {"pixel_size": 0.0004},
            {"source_to_axis": 0.05, "source_to_detector": 0.2},
            {"source_to_axis": 0.05},
            {"source_to_detector": 200_000.0},
        ],
    )
    def test_one_length_in_another_unit_is_refused(self, change):
        lengths = {"pixel_size": 0.4, "source_to_axis": 50.0, "source_to_detector": 200.0, **change}
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", Geometry.cone([0, 90], PANEL, **lengths), self.GRID)

    def test_detector_outside_the_projected_sample_is_refused(self):
        views = geometry([0, 90]).vectors.copy()
        views[1, 3:6] += 60 * views[1, 6:9]
        with pytest.raises(InputError, match=r"states.one.geometry, view 1: the sample never shadows"):
            check_plausible("states.one", Geometry(views, PANEL, "cone"), self.GRID)

    def test_volume_outside_the_field_of_view_is_refused(self):
        grid = Volume.zeros((28, 36, 36), 0.1, (0.0, 0.0, 100.0))
        with pytest.raises(InputError, match="never shadows"):
            check_plausible("reference", geometry([0, 90]), grid)

    def test_pixel_size_of_a_parallel_beam_is_checked(self):
        check_plausible("reference", Geometry.parallel([0, 90], PANEL, 0.1), self.GRID)
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", Geometry.parallel([0, 90], PANEL, 100.0), self.GRID)
