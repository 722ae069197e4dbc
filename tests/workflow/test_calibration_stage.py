"""The calibration stage of a run: its results correct the reference and all states, and are reused."""

import json
import shutil

import numpy as np
import pytest

from grainmotion.calibration.corrections import corrected
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.motions_csv import read_motions
from grainmotion.workflow import run as workflow
from tiny_experiment import SHIFTS, TOML, VIEWS, geometry, write_tiny

DETECTOR_SHIFT = 0.2  # mm, half a pixel: true offset of the detector, which the given geometry lacks
CALIBRATED = TOML.replace("[reconstruct]", '[calibrate]\ngeometry = ["shift_u"]\nhardening = 2\n\n[reconstruct]')


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A complete run of an experiment whose nominal geometry is half a pixel off."""
    toml = CALIBRATED.replace("pixel_size = 0.4\n", f"pixel_size = 0.4\ndetector_offset = [{-DETECTOR_SHIFT}, 0.0]\n")
    path = write_tiny(tmp_path_factory.mktemp("calibrated") / "tiny", toml)
    for name, angles in (("reference", np.arange(VIEWS) * 360 / VIEWS), ("one", [0.0, 45.0, 90.0])):
        write_geometry(path.parent / f"{name}.csv", corrected(geometry(angles), {"shift_u": -DETECTOR_SHIFT}))
    return path, workflow.run(read_experiment(path))


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished run's folder, which a test may change."""
    shutil.copytree(finished[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


class TestResults:
    def test_calibration_is_the_first_stage(self, finished):
        assert finished[1].done[:3] == ("calibrate", "reconstruct", "segment")

    def test_motions_are_fitted_with_the_corrected_geometry(self, finished):
        for name, shift in SHIFTS.items():
            motions = read_motions(finished[0].parent / "results" / name / "motions.csv")
            np.testing.assert_allclose(motions.translations, np.tile(shift, (3, 1)), atol=0.02)

    def test_estimates_are_written(self, finished):
        stored = json.loads((finished[0].parent / "results" / "calibration.json").read_text())
        (shift,) = stored["geometry"]["corrections"]
        assert (shift["name"], shift["unit"]) == ("shift_u", "mm")
        assert shift["value"] == pytest.approx(DETECTOR_SHIFT, abs=0.05 * 0.4)
        assert 0 < shift["sd"] < 0.04
        assert stored["geometry"]["residual_after"] < stored["geometry"]["residual_before"]
        assert stored["hardening"]["coefficients"] == [1.0]

    def test_report_shows_the_calibration(self, finished):
        text = finished[1].report.read_text()
        assert "Calibrated: shift_u" in text
        assert "no beam hardening" in text


class TestResume:
    def test_finished_run_does_nothing(self, copied):
        result = workflow.run(read_experiment(copied))
        assert result.done == ()
        assert result.reused[0] == "calibrate"

    def test_deleted_calibration_is_repeated_without_later_stages(self, copied):
        (copied.parent / "results" / "calibration.json").unlink()
        result = workflow.run(read_experiment(copied), until="segment")
        assert result.done == ("calibrate",)
        assert set(result.reused) == {"reconstruct", "segment"}

    def test_changed_calibration_repeats_later_stages(self, copied):
        copied.write_text(copied.read_text().replace("hardening = 2", "hardening = 0"))
        result = workflow.run(read_experiment(copied), until="segment")
        assert result.done == ("calibrate", "reconstruct", "segment")
        assert json.loads((copied.parent / "results" / "calibration.json").read_text())["hardening"] is None


class TestInput:
    def test_calibration_of_a_given_volume_is_refused(self, tmp_path):
        path = write_tiny(tmp_path, CALIBRATED.replace("[reference]", '[reference]\nvolume = "one.tif"'))
        with pytest.raises(InputError, match="calibrate"):
            workflow.run(read_experiment(path))

    @pytest.mark.parametrize(("old", "new"), [('"shift_u"', '"shift_w"'), ("hardening = 2", "hardening = 1")])
    def test_unknown_corrections_and_orders_are_refused(self, tmp_path, old, new):
        path = tmp_path / "experiment.toml"
        path.write_text(CALIBRATED.replace(old, new))
        with pytest.raises(InputError, match="calibrate"):
            read_experiment(path)
