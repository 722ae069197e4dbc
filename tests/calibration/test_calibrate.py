"""Self-calibration (`calibration.calibrate`) on a simulated reference scan, against the true alignment."""

import numpy as np
import pytest

from grainmotion.calibration.calibrate import CalibrateSettings, calibrate
from grainmotion.calibration.corrections import corrected, in_table_unit
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.simulate import scenarios
from grainmotion.simulate.detector import record_line_integrals

SHIFT, ROTATION = 0.25, np.deg2rad(0.5)  # mm, half a pixel; radians
PIXEL = 0.5
GAUGES = ("shift_v", "pitch", "axis_offset")


@pytest.fixture(scope="module")
def case():
    return scenarios.small()


def recorded(case, nominal, **misalignment):
    """A scan whose true geometry differs from the nominal one by the given corrections."""
    images = record_line_integrals(case.sample, corrected(nominal, misalignment), case.physics, 1).line_integrals
    return Scan(images, nominal)


@pytest.fixture(scope="module")
def misaligned(case):
    nominal = case.scanner.geometry()
    return calibrate(recorded(case, nominal, shift_u=SHIFT, turn=ROTATION), case.scanner.grid)


def errors(calibration, **truth):
    """Measured − true, and sd, by name, mm and degrees."""
    rows = ((c, c.in_unit, in_table_unit(c.name, truth.get(c.name, 0))) for c in calibration.corrections)
    return {c.name: (amount - true, sd) for c, (amount, sd), true in rows}


class TestMisalignedScanner:
    def test_shift_and_rotation_are_determined(self, misaligned):
        errors_and_sds = errors(misaligned, shift_u=SHIFT, turn=ROTATION)
        assert abs(errors_and_sds["shift_u"][0]) < 0.05 * PIXEL
        assert abs(errors_and_sds["turn"][0]) < 0.05
        assert all(abs(error) < 2.5 * sd for error, sd in errors_and_sds.values())

    def test_the_residual_is_halved(self, misaligned):
        before, after = misaligned.residuals
        assert after < 0.5 * before

    def test_views_of_a_state_are_corrected_alike(self, case, misaligned):
        views = case.scanner.geometry((10.0, 77.0))
        truth = corrected(views, {"shift_u": SHIFT, "turn": ROTATION})
        corners = np.array([[1.0, 1.0, 2.0], [-1.0, 2.0, -2.0]])
        nominal, corrected_views, true = (g.project_points(corners) for g in (views, misaligned.apply(views), truth))
        assert np.abs(nominal - true).max() > 0.5
        # The axis tilt and the panel's shift along v are not determined; they shift all rows alike.
        assert np.abs(corrected_views - true)[..., 1].max() < 0.05
        assert np.abs(corrected_views - true)[..., 0].max() < 0.1


class TestAlignedScanner:
    def test_corrections_are_small(self, case):
        nominal = case.scanner.geometry()
        calibration = calibrate(recorded(case, nominal), case.scanner.grid)
        assert all(abs(error) < 2 * sd for error, sd in errors(calibration).values())
        assert abs(calibration.amounts["shift_u"]) < 0.02 * PIXEL
        assert abs(np.rad2deg(calibration.amounts["turn"])) < 0.03

    def test_gauges_of_a_parallel_beam_are_not_determined(self, case):
        nominal = Geometry.parallel(np.arange(90) * 4.0, (96, 72), 0.125)
        scan = recorded(case, nominal, shift_u=0.125)
        calibration = calibrate(
            scan, case.scanner.grid, CalibrateSettings(parameters=("shift_u", "turn", *GAUGES), columns=24)
        )
        assert [c.name for c in calibration.corrections if c.determined] == ["shift_u", "turn"]
        assert calibration.amounts["shift_u"] == pytest.approx(0.125, abs=0.05 * 0.125)
        assert all(calibration.amounts[name] == 0 for name in GAUGES)
        assert "axis_offset not determined" in str(calibration)

    def test_masked_pixels_do_not_count(self, case):
        nominal = case.scanner.geometry()
        scan = recorded(case, nominal)
        valid = np.ones(scan.line_integrals.shape, bool)
        valid[:, 40:44, 10:60] = False
        images = np.where(valid, scan.line_integrals, 9.0)
        settings = CalibrateSettings(parameters=("shift_u",), iterations=2)
        calibration = calibrate(Scan(images, nominal, valid), case.scanner.grid, settings)
        assert abs(calibration.amounts["shift_u"]) < 0.05 * PIXEL


class TestLargeMisalignment:
    def test_a_shift_by_a_ninth_of_the_panel_is_determined(self, case):
        nominal = case.scanner.geometry()
        scan = recorded(case, nominal, shift_u=-8 * PIXEL)
        calibration = calibrate(scan, case.scanner.grid, CalibrateSettings(parameters=("shift_u",), columns=36))
        assert calibration.amounts["shift_u"] == pytest.approx(-8 * PIXEL, abs=0.05 * PIXEL)


class TestInput:
    def test_two_views_are_refused(self, case):
        with pytest.raises(InputError, match="2 views"):
            calibrate(case.reference().select([0, 9]), case.scanner.grid)

    def test_empty_radiographs_are_refused(self):
        nominal = Geometry.parallel(np.arange(20) * 9.0, (8, 20), 1.0)
        with pytest.raises(InputError, match="empty"):
            calibrate(Scan(np.zeros((20, 8, 20), np.float32), nominal), Volume.zeros((8, 20, 20), 1.0))
