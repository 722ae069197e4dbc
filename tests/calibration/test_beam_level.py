"""Level of the beam in each view (`calibration.beam_level`) on simulated full scans, against the true levels."""

import dataclasses

import numpy as np
import pytest

from grainmotion.calibration.beam_level import BeamLevels, beam_levels
from grainmotion.errors import InputError
from grainmotion.io.beam_level_json import read_beam_levels, write_beam_levels
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.simulate import scenarios
from grainmotion.simulate.detector import record_line_integrals
from grainmotion.simulate.sample import Sample, Tube

VIEWS = 48
SETTINGS = ReconstructSettings()


@pytest.fixture(scope="module")
def case():
    return scenarios.small()


@pytest.fixture(scope="module")
def scan(case):
    """Grains with air around them."""
    return recorded(case, case.sample)


@pytest.fixture(scope="module")
def filled(case):
    """Grains in a liquid that fills the panel, the sides of which it crosses."""
    rows, columns = case.scanner.panel
    radius = 0.6 * columns * case.scanner.voxel_size
    return cropped(recorded(case, Sample(case.sample.particles, Tube(0.0, radius, 0.03))), rows // 3, 2 * columns // 3)


def recorded(case, sample):
    geometry = case.scanner.geometry(tuple(np.arange(VIEWS) * 360 / VIEWS))
    return record_line_integrals(sample, geometry, case.physics, 1)


def cropped(scan, rows, columns):
    """The middle of the panel."""
    r0, c0 = (scan.geometry.shape[0] - rows) // 2, (scan.geometry.shape[1] - columns) // 2
    images = scan.line_integrals[:, r0 : r0 + rows, c0 : c0 + columns]
    return Scan(np.ascontiguousarray(images), scan.geometry.window((r0, c0), (rows, columns)))


def grid_of(case, scan):
    rows, columns = scan.geometry.shape
    return Volume.zeros((rows, columns, columns), case.scanner.voxel_size)


def estimated(case, scan, levels):
    """Estimated levels of a scan whose beam has the true ``levels``."""
    images = scan.line_integrals + levels[:, None, None].astype(np.float32)
    return beam_levels(Scan(images, scan.geometry, scan.valid), grid_of(case, scan), SETTINGS)


def drift(kind, seed=0):
    rng = np.random.default_rng(seed)
    return {
        "random": 0.05 * rng.normal(size=VIEWS),
        "ramp": np.linspace(0, 0.26, VIEWS),
        "rising": -np.linspace(0, 0.26, VIEWS),
        "one view": 0.25 * (np.arange(VIEWS) == 7),
    }[kind]


class TestAir:
    @pytest.mark.parametrize("kind", ["random", "ramp", "rising", "one view"])
    def test_levels_and_their_mean_are_found(self, case, scan, kind):
        found = estimated(case, scan, drift(kind))
        assert found.source == "air"
        np.testing.assert_allclose(found.levels, drift(kind), atol=0.001)

    def test_a_beam_brighter_than_the_flats_in_all_views_is_found(self, case, scan):
        np.testing.assert_allclose(estimated(case, scan, np.full(VIEWS, -0.1)).levels, -0.1, atol=0.001)

    @pytest.mark.parametrize("level", [0.007, 0.03, 0.1])
    def test_what_is_dark_in_all_views_alike_may_be_a_container(self, case, scan, level):
        assert estimated(case, scan, np.full(VIEWS, level)).source == "none"

    def test_a_thin_container_that_fills_the_panel_is_no_dim_beam(self, case, scan):
        walled = Scan(scan.line_integrals + np.float32(0.06), scan.geometry)
        found, true = estimated(case, walled, drift("random")), drift("random")
        assert found.source == "air"
        np.testing.assert_allclose(found.levels, true - np.median(true), atol=0.002)

    def test_masked_pixels_do_not_count(self, case, scan):
        valid = np.ones(scan.line_integrals.shape, bool)
        valid[:, ::7, ::5] = False
        bad = dataclasses.replace(scan, line_integrals=np.where(valid, scan.line_integrals, 9), valid=valid)
        np.testing.assert_allclose(estimated(case, bad, drift("random")).levels, drift("random"), atol=0.001)


class TestWithoutAir:
    @pytest.mark.parametrize("kind", ["random", "ramp", "one view"])
    def test_levels_are_found_up_to_a_constant(self, case, filled, kind):
        found, true = estimated(case, filled, drift(kind)), drift(kind)
        assert found.source == "reconstruction"
        assert np.median(found.levels) == pytest.approx(0, abs=1e-6)
        assert (found.levels - true).std() < 0.002

    def test_a_sample_wider_than_the_panel(self, case, scan):
        inner = cropped(scan, scan.geometry.shape[0] // 2, scan.geometry.shape[1] // 2)
        found, true = estimated(case, inner, drift("random")), drift("random")
        assert (found.levels - true).std() < 0.2 * true.std()


class TestConstantBeam:
    @pytest.mark.parametrize("name", ["scan", "filled"])
    def test_nothing_is_corrected(self, case, name, request):
        found = beam_levels(request.getfixturevalue(name), grid_of(case, request.getfixturevalue(name)), SETTINGS)
        assert found.source == "none"
        assert not found.levels.any()

    @pytest.mark.parametrize("name", ["scan", "filled"])
    def test_a_wrong_geometry_is_no_level(self, case, name, request):
        scan = request.getfixturevalue(name)
        shuffled = Scan(scan.line_integrals[np.random.default_rng(0).permutation(VIEWS)], scan.geometry)
        assert beam_levels(shuffled, grid_of(case, scan), SETTINGS).source == "none"

    def test_few_views_are_left_alone(self, case, scan):
        few = scan.select(slice(0, 8))
        assert estimated(case, few, drift("random")[:8]).source == "none"

    def test_an_empty_scan_is_left_alone(self, case, scan):
        empty = Scan(np.zeros_like(scan.line_integrals), scan.geometry)
        assert beam_levels(empty, grid_of(case, empty), SETTINGS).source == "none"


class TestFile:
    def test_levels_are_read_back_to_the_bit(self, tmp_path):
        levels = BeamLevels(np.random.default_rng(0).normal(size=9), "air")
        write_beam_levels(tmp_path / "a.json", levels)
        back = read_beam_levels(tmp_path / "a.json")
        assert back.source == "air"
        np.testing.assert_array_equal(back.levels, levels.levels)

    @pytest.mark.parametrize(
        "text", ["{", "[]", '{"levels": [1], "source": "sun"}', '{"levels": ["a"], "source": "air"}']
    )
    def test_another_file_is_refused(self, tmp_path, text):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(InputError, match="no levels"):
            read_beam_levels(tmp_path / "a.json")
