"""Corrections of panel and axis (`calibration.corrections`) and their units."""

import numpy as np
import pytest

from grainmotion.calibration.corrections import Correction, corrected, from_table_unit, in_table_unit
from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry


class TestCorrections:
    """For a perfect circular scan they equal the parameters of `DetectorAlignment`."""

    @pytest.mark.parametrize("first_row", ["bottom", "top"])
    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    def test_corrected_geometry_equals_a_constructed_one(self, beam, first_row):
        panel = DetectorAlignment((0.3, -0.2), (1.0, -2.0, 0.5), 0.4, (0.7, 0.0), first_row)
        corrections = {
            "shift_u": 0.3, "shift_v": -0.2, "pitch": np.deg2rad(1.0), "turn": np.deg2rad(-2.0),
            "yaw": np.deg2rad(0.5), "axis_offset": 0.4, "axis_tilt": np.deg2rad(0.7),
        }  # fmt: skip

        def constructed(panel):
            if beam == "parallel":
                return Geometry.parallel([0, 50, 200], (8, 9), 0.1, panel=panel)
            return Geometry.cone([0, 50, 200], (8, 9), 0.1, source_to_axis=20, source_to_detector=50, panel=panel)

        nominal = constructed(DetectorAlignment(first_row=first_row))
        np.testing.assert_allclose(corrected(nominal, corrections).vectors, constructed(panel).vectors, atol=1e-12)

    def test_axis_tilt_about_the_beam_is_the_opposite_in_plane_rotation(self):
        def constructed(panel):
            return Geometry.cone([0, 50], (8, 9), 0.1, source_to_axis=20, source_to_detector=50, panel=panel)

        rotated = corrected(constructed(None), {"turn": np.deg2rad(-1.5)})
        np.testing.assert_allclose(
            rotated.vectors, constructed(DetectorAlignment(axis_tilt_deg=(0.0, 1.5))).vectors, atol=1e-12
        )

    @pytest.mark.parametrize("degrees", [0.1, -2.0 / 3, 1e-5, 7.123456789012])
    def test_angles_survive_conversion_to_degrees_and_back(self, degrees):
        amount = from_table_unit("turn", in_table_unit("turn", np.deg2rad(degrees)))
        assert from_table_unit("turn", in_table_unit("turn", amount)) == amount
        assert amount == pytest.approx(np.deg2rad(degrees), abs=1e-13)

    def test_deprecated_names_are_in_degrees(self):
        turn = Correction("turn", np.deg2rad(0.5), np.deg2rad(0.1))
        with pytest.warns(DeprecationWarning, match="amount"):
            assert turn.value == pytest.approx(0.5)
        with pytest.warns(DeprecationWarning, match="amount_sd"):
            assert turn.sd == pytest.approx(0.1)
        assert str(turn) == "turn 0.5000 ± 0.1000 degrees"

    def test_an_unknown_correction_is_refused(self):
        nominal = Geometry.parallel([0], (4, 4), 1.0)
        with pytest.raises(InputError, match="no corrections"):
            corrected(nominal, {"shift": 1.0})
