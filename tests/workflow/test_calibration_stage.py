"""A run whose machine is calibrated on the reference: states are corrected too, and nothing is done twice."""

import json
import shutil

import numpy as np
import pytest

from grainmotion.calibration.corrections import corrected
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.motions_csv import read_motions
from grainmotion.workflow import run as pipeline
from tiny_experiment import SHIFTS, TOML, VIEWS, geometry, write_tiny

OFF = 0.2  # mm, half a pixel: the panel's true shift, which the files do not tell
CALIBRATED = TOML.replace("[reconstruct]", '[calibrate]\ngeometry = ["shift_u"]\nhardening = 2\n\n[reconstruct]')


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A whole run of an experiment whose files tell a panel half a pixel off."""
    toml = CALIBRATED.replace("pixel_size = 0.4\n", f"pixel_size = 0.4\ndetector_offset = [{-OFF}, 0.0]\n")
    path = write_tiny(tmp_path_factory.mktemp("calibrated") / "tiny", toml)
    for name, angles in (("reference", np.arange(VIEWS) * 360 / VIEWS), ("one", [0.0, 45.0, 90.0])):
        write_geometry(path.parent / f"{name}.csv", corrected(geometry(angles), {"shift_u": -OFF}))
    return path, pipeline.run(read_experiment(path))


@pytest.fixture
def copied(finished, tmp_path):
    """The same run's folder, to be changed."""
    shutil.copytree(finished[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


class TestResults:
    def test_calibration_comes_first(self, finished):
        assert finished[1].done[:3] == ("calibrate", "reconstruct", "segment")

    def test_states_are_seen_by_the_true_panel(self, finished):
        for name, shift in SHIFTS.items():
            motions = read_motions(finished[0].parent / "results" / name / "motions.csv")
            np.testing.assert_allclose(motions.translations, np.tile(shift, (3, 1)), atol=0.02)

    def test_what_was_found_is_written(self, finished):
        found = json.loads((finished[0].parent / "results" / "calibration.json").read_text())
        (shift,) = found["geometry"]["corrections"]
        assert (shift["name"], shift["unit"]) == ("shift_u", "mm")
        assert shift["value"] == pytest.approx(OFF, abs=0.05 * 0.4)
        assert 0 < shift["sd"] < 0.04
        assert found["geometry"]["residual_after"] < found["geometry"]["residual_before"]
        assert found["hardening"]["coefficients"] == [1.0]

    def test_the_report_says_so(self, finished):
        text = finished[1].report.read_text()
        assert "Calibrated: shift_u" in text
        assert "no beam hardening" in text


class TestResume:
    def test_a_finished_run_does_nothing(self, copied):
        result = pipeline.run(read_experiment(copied))
        assert result.done == ()
        assert result.reused[0] == "calibrate"

    def test_a_lost_calibration_is_made_again_alone(self, copied):
        (copied.parent / "results" / "calibration.json").unlink()
        result = pipeline.run(read_experiment(copied), until="segment")
        assert result.done == ("calibrate",)
        assert set(result.reused) == {"reconstruct", "segment"}

    def test_another_calibration_redoes_what_follows(self, copied):
        copied.write_text(copied.read_text().replace("hardening = 2", "hardening = 0"))
        result = pipeline.run(read_experiment(copied), until="segment")
        assert result.done == ("calibrate", "reconstruct", "segment")
        assert json.loads((copied.parent / "results" / "calibration.json").read_text())["hardening"] is None


class TestInput:
    def test_a_given_volume_tells_nothing_of_the_machine(self, tmp_path):
        path = write_tiny(tmp_path, CALIBRATED.replace("[reference]", '[reference]\nvolume = "one.tif"'))
        with pytest.raises(InputError, match="calibrate"):
            pipeline.run(read_experiment(path))

    @pytest.mark.parametrize(("old", "new"), [('"shift_u"', '"shift_w"'), ("hardening = 2", "hardening = 1")])
    def test_what_is_unknown_is_refused(self, tmp_path, old, new):
        path = tmp_path / "experiment.toml"
        path.write_text(CALIBRATED.replace(old, new))
        with pytest.raises(InputError, match="calibrate"):
            read_experiment(path)
