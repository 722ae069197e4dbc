"""Level of the beam as the first step of a run: what it corrects, reports, keeps, and hands to workers."""

import dataclasses
import shutil

import numpy as np
import pytest

from grainmotion.calibration.beam_level import BeamLevels
from grainmotion.cluster.reconstruction_tasks import load_views
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.results import read_reference
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.finding import Level
from grainmotion.workflow import run as workflow
from grainmotion.workflow.beam_level_stage import finding
from tiny_experiment import TOML, VIEWS, write_tiny

BEAM = 1 + 0.05 * np.random.default_rng(4).normal(size=VIEWS)
OFF = TOML.replace("[reconstruct]", "[calibrate]\nbeam_level = false\n\n[reconstruct]").replace(
    "[volume]\n", '[volume]\noutline = "grid"\n', 1
)  # or the wrong level, taken for a sample at the panel's edge, would make the grid grow


@pytest.fixture(scope="module")
def unsteady(tmp_path_factory):
    """A tiny experiment whose beam varies by 5 % from view to view of the reference, and its first run."""
    path = write_tiny(tmp_path_factory.mktemp("unsteady") / "tiny")
    for k, beam in enumerate(BEAM):
        file = path.parent / "reference" / f"{k}.tif"
        counts = read_tiff(file)[0].astype(float)
        write_tiff(file, np.round(100 + beam * (counts - 100)).astype(np.uint16))
    return path, workflow.run(read_experiment(path), until="reconstruct")


@pytest.fixture
def copied(unsteady, tmp_path):
    """A copy of the experiment and its results, which a test may change."""
    shutil.copytree(unsteady[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


def volume_of(result):
    return read_reference(next(result.folder.glob("re*.h5"))).volume.array


class TestUnsteadyBeam:
    def test_volume_is_as_of_a_constant_beam(self, unsteady, tmp_path):
        steady = workflow.run(read_experiment(write_tiny(tmp_path)), until="reconstruct")
        assert steady.findings == ()
        expected = volume_of(steady)
        error = np.linalg.norm(volume_of(unsteady[1]) - expected) / np.linalg.norm(expected)
        assert error < 0.01

    def test_a_finding_tells_the_size(self, unsteady):
        (found,) = unsteady[1].findings
        assert (found.check, found.level, found.where) == ("beam-level", Level.WARNING, "reference")
        assert "air beside the sample" in found.fact
        assert f"view {np.argmax(np.abs(np.log(BEAM)))}" in found.evidence

    def test_a_repeated_run_shows_it_again_and_computes_nothing(self, copied):
        result = workflow.run(read_experiment(copied), until="reconstruct")
        assert result.done == ()
        assert [f.check for f in result.findings] == ["beam-level"]

    def test_it_can_be_turned_off(self, copied, unsteady):
        copied.write_text(OFF)
        result = workflow.run(read_experiment(copied), until="reconstruct")
        assert result.done == ("reconstruct",)
        assert "beam-level" not in [f.check for f in result.findings]
        assert np.abs(volume_of(result) - volume_of(unsteady[1])).max() > 0.05

    def test_air_that_is_named_takes_precedence(self, copied):
        copied.write_text(TOML.replace("[volume]", "air = { margin = 2 }\n\n[volume]", 1))
        result = workflow.run(read_experiment(copied), until="reconstruct")
        assert result.done == ("reconstruct",)
        assert result.findings == ()


def test_flats_of_another_beam_are_named(unsteady):
    source = find_inputs(read_experiment(unsteady[0])).reference
    found = finding(BeamLevels(np.full(VIEWS, np.log(0.7)), "air"), source)
    assert "brighter in all views than in the flats" in found.fact
    assert "42.9 %" in found.evidence


class TestWorkers:
    def test_views_that_workers_read_are_levelled_to_the_same_bits(self, unsteady):
        source = find_inputs(read_experiment(unsteady[0])).reference
        levels = -np.log(BEAM)
        whole = source.read()[0].levelled(levels)
        levelled = dataclasses.replace(source, levels=levels)
        views = np.array([7, 3, 20])
        np.testing.assert_array_equal(load_views(levelled, views).line_integrals, whole.line_integrals[views])
