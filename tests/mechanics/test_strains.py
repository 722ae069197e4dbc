"""Strains from centres: closed forms, uncertainty against draws, grains without a motion, poor input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.finite_strain import Deformation
from grainmotion.mechanics.strains import strains
from grainmotion.mechanics.tetrahedra import tessellate
from grainmotion.model.motions import Motions
from grainmotion.rotations import rotation_matrix
from spheres import known_motions

CENTERS = np.random.default_rng(3).uniform(-5, 5, (80, 3))
ESTIMATORS = ("cells", "neighbours")
TURN = rotation_matrix(np.deg2rad([10.0, -25.0, 40.0]))


def moved_by(gradient: np.ndarray, **options: float) -> Motions:
    """Motions whose centres follow x = F X + b, and whose grains turn with F's rotation."""
    vector = np.zeros(3) if np.allclose(gradient, np.eye(3)) else Deformation(gradient[None]).rotations[0]
    shift = CENTERS @ (gradient - np.eye(3)).T + [0.3, -2.0, 1.0]
    return known_motions(CENTERS, shift, np.tile(vector, (len(CENTERS), 1)), **options)


@pytest.mark.parametrize("estimator", ESTIMATORS)
class TestClosedForms:
    @pytest.mark.parametrize("rotation", [np.eye(3), TURN])
    def test_a_rigid_motion_has_no_strain(self, estimator, rotation):
        found = strains(moved_by(rotation), estimator=estimator)
        assert np.abs(found.gradients - rotation).max() < 1e-12
        assert np.abs(found.deformation.green_lagrange).max() < 1e-12
        assert np.abs(found.volumetric).max() < 1e-12
        assert found.deviatoric.max() < 1e-12
        assert np.nanmax(np.abs(found.relative_rotations)) < 1e-12

    def test_uniform_dilation(self, estimator):
        found = strains(moved_by(1.02 * TURN), estimator=estimator)
        np.testing.assert_allclose(found.volumetric, 1.02**3 - 1, atol=1e-12)
        np.testing.assert_allclose(found.deviatoric, 0, atol=1e-12)
        np.testing.assert_allclose(found.deformation.logarithmic[:, :3], np.log(1.02), atol=1e-12)

    def test_compression_along_z_is_negative(self, estimator):
        found = strains(moved_by(np.diag([1, 1, 0.9])), estimator=estimator)
        np.testing.assert_allclose(found.deformation.small[:, 2], -0.1, atol=1e-12)
        np.testing.assert_allclose(found.volumetric, -0.1, atol=1e-12)

    def test_pure_shear_keeps_the_volume(self, estimator):
        """Stretches λ along x, 1/λ along y: the deviatoric part is √((λ−1)² + (1/λ−1)²)."""
        found = strains(moved_by(TURN @ np.diag([1.1, 1 / 1.1, 1])), estimator=estimator)
        np.testing.assert_allclose(found.volumetric, 0, atol=1e-12)
        np.testing.assert_allclose(found.deviatoric, np.hypot(0.1, 1 / 1.1 - 1), atol=1e-12)
        np.testing.assert_allclose(found.deformation.logarithmic[:, 0], np.log(1.1), atol=1e-12)
        np.testing.assert_allclose(found.deformation.rotations, strains(moved_by(TURN)).grain_rotations, atol=1e-9)

    def test_simple_shear(self, estimator):
        """x gains γ y: E_xy = γ/2, E_yy = γ²/2, and the continuum turns by −atan(γ/2) about z."""
        shear = np.eye(3)
        shear[0, 1] = 0.2
        found = strains(replace(moved_by(shear), rotations=np.zeros((80, 3))), estimator=estimator)
        expected = [0, 0.02, 0, 0, 0, 0.1]
        np.testing.assert_allclose(found.deformation.green_lagrange, np.tile(expected, (80, 1)), atol=1e-12)
        np.testing.assert_allclose(found.deformation.rotations[:, 2], -np.arctan(0.1), atol=1e-12)
        np.testing.assert_allclose(found.relative_rotations[:, 2], np.arctan(0.1), atol=1e-12)

    def test_standard_deviations_are_those_of_draws(self, estimator):
        gradient = TURN @ np.diag([1.05, 0.97, 1.0])
        clean = moved_by(gradient, sd=0.01)
        random, found = np.random.default_rng(0), strains(clean, estimator=estimator)
        draws = []
        for _ in range(100):
            noise = random.normal(0, 0.01, CENTERS.shape)
            drawn = strains(replace(clean, translations=clean.translations + noise), estimator=estimator)
            draws.append([drawn.volumetric, *drawn.deformation.rotations.T, drawn.deviatoric])
        inner = ~found.at_hull
        spread = np.std(draws, axis=0)[:, inner]
        table = found.to_dataframe()[inner]
        told = [table["sd_volumetric"], *(np.deg2rad(table[f"sd_continuum_w{a}"]) for a in "xyz")]
        np.testing.assert_allclose(spread[:4] / np.array(told), 1, atol=0.25)
        assert np.mean(spread[:4] / np.array(told)) == pytest.approx(1, abs=0.03)

    def test_deviatoric_noise_is_what_a_rigid_motion_shows(self, estimator):
        clean = moved_by(np.eye(3), sd=0.01)
        random, told = np.random.default_rng(1), strains(clean, estimator=estimator).deviatoric_noise
        squares = [
            strains(
                replace(clean, translations=clean.translations + random.normal(0, 0.01, CENTERS.shape)),
                estimator=estimator,
            ).deviatoric
            ** 2
            for _ in range(100)
        ]
        assert np.median(np.sqrt(np.mean(squares, axis=0)) / told) == pytest.approx(1, abs=0.05)

    def test_grains_without_a_translation_are_left_out_and_told(self, estimator):
        motions = moved_by(np.diag([1.0, 1.0, 0.95]))
        statuses, shifts = motions.statuses.copy(), motions.translations.copy()
        statuses[[4, 7]], shifts[4], shifts[7] = ["absent", "not-converged"], np.nan, 100.0
        found = strains(replace(motions, translations=shifts, statuses=statuses), estimator=estimator)
        assert np.isnan(found.gradients[[4, 7]]).all()
        assert found.reasons[4] == "translation not to use: absent"
        assert found.reasons[7] == "translation not to use: not-converged"
        others = np.delete(np.arange(80), [4, 7])
        np.testing.assert_allclose(found.deformation.small[others, 2], -0.05, atol=1e-12)
        np.testing.assert_allclose(found.mean_gradient, np.diag([1, 1, 0.95]), atol=1e-12)

    @pytest.mark.parametrize("count", [0, 1, 3])
    def test_too_few_grains_give_no_strain(self, estimator, count):
        found = strains(known_motions(CENTERS[:count], np.zeros((count, 3))), estimator=estimator)
        assert len(found.to_dataframe()) == count
        assert np.isnan(found.gradients).all()
        assert all(found.reasons)
        assert np.isnan(found.mean_gradient).all()

    def test_a_slice_is_strained_in_its_plane(self, estimator):
        flat = CENTERS * [1, 1, 0]
        gradient = np.array([[1.1, 0.05, 0], [0, 0.9, 0], [0, 0, 1]])
        found = strains(known_motions(flat, flat @ (gradient - np.eye(3)).T), estimator=estimator)
        known = np.isfinite(found.volumetric)
        assert known.sum() > 70
        np.testing.assert_allclose(found.gradients[known], np.tile(gradient, (known.sum(), 1, 1)), atol=1e-12)

    def test_grains_in_a_tilted_plane_have_no_strain(self, estimator):
        flat = (CENTERS * [1, 1, 0]) @ TURN.T
        found = strains(known_motions(flat, np.zeros((80, 3))), estimator=estimator)
        assert (
            np.isnan(found.gradients).all() or np.abs(found.deformation.small[np.isfinite(found.volumetric)]).max() < 1
        )


def test_unknown_variances_give_no_standard_deviation():
    motions = moved_by(np.eye(3))
    found = strains(replace(motions, covariances=np.full((80, 6, 6), np.nan)))
    assert np.isnan(found.volumetric_sd).all()
    assert np.isfinite(found.volumetric).all()


def test_a_wrong_setting_is_named():
    motions = moved_by(np.eye(3))
    with pytest.raises(InputError, match="'delaunay' is unknown"):
        strains(motions, estimator="delaunay")
    with pytest.raises(InputError, match="reach: must be > 1"):
        strains(motions, estimator="neighbours", reach=float("nan"))
    with pytest.raises(InputError, match="wants Motions"):
        strains(CENTERS)


def test_what_is_not_affine_is_told():
    random = np.random.default_rng(0)
    noise = random.normal(0, 0.02, (400, 3))
    found = strains(known_motions(random.uniform(-8, 8, (400, 3)), noise), estimator="neighbours")
    assert np.nanmedian(found.non_affine) == pytest.approx(0.02 * np.sqrt(3), rel=0.25)


class TestTessellation:
    def test_flat_tetrahedra_of_a_lattice_are_left_out(self):
        lattice = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3)
        cells = tessellate(lattice)
        assert cells.volumes.sum() == pytest.approx(27)
        assert cells.volumes.min() > 0.1
        assert cells.at_hull.sum() == 64 - 8

    def test_a_hollow_at_the_hull_is_not_spanned(self):
        """A lattice cube with a corner block missing: long tetrahedra across the notch are taken off."""
        lattice = np.stack(np.meshgrid(*[np.arange(7.0)] * 3), axis=-1).reshape(-1, 3)
        random = np.random.default_rng(0)
        points = lattice[~(lattice >= 2).all(axis=1)] + random.uniform(-0.1, 0.1, (7**3 - 125, 3))
        cells = tessellate(points)
        middle = points[cells.simplices].mean(axis=1)
        assert not (middle > 3.0).all(axis=1).any()
        assert cells.volumes.sum() < 216 - 0.6 * 64

    def test_mean_ratio_of_known_shapes(self):
        regular = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
        assert tessellate(regular).shapes[0] == pytest.approx(1)
        assert tessellate(regular).volumes[0] == pytest.approx(8 / 3)


def test_a_sample_turned_inside_out_has_no_strain():
    found = strains(known_motions(CENTERS, -2 * CENTERS))
    assert np.isnan(found.gradients).all()
    assert all("inside out" in reason for reason in found.reasons)
