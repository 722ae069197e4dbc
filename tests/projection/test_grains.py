"""`simulate_radiographs`: undetermined motions, other labels, other centres of rotation, and finer voxels."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.rotations import recenter
from three_lumps import PANEL, scanner, three_grains


class TestSimulatedRadiographs:
    def test_grains_without_a_motion_are_left_out(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.translations[1] = np.nan
        others = GrainSet((grains.grains[0], grains.grains[2]))
        expected = simulate_radiographs(others, Motions.identity(others.labels, others.centers), scanner())
        np.testing.assert_allclose(simulate_radiographs(grains, motions, scanner()), expected, atol=1e-6)
        motions.translations[:] = np.nan
        assert not simulate_radiographs(grains, motions, scanner()).any()

    def test_grains_of_other_labels_or_order_are_refused(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels[::-1].copy(), grains.centers[::-1].copy())
        with pytest.raises(InputError, match="labels"):
            simulate_radiographs(grains, motions, scanner())
        with pytest.raises(InputError, match="labels"):
            simulate_radiographs(grains, Motions.identity(grains.labels[:2], grains.centers[:2]), scanner())

    def test_centre_of_rotation_does_not_matter(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.rotations[:], motions.translations[:] = 0.3, 0.1
        elsewhere = Motions.identity(grains.labels, grains.centers + 0.07)
        elsewhere.rotations[:] = 0.3
        elsewhere.translations[:] = recenter(motions.matrices, motions.translations, motions.centers, elsewhere.centers)
        one, other = (simulate_radiographs(grains, m, scanner()) for m in (motions, elsewhere))
        np.testing.assert_allclose(one, other, atol=2e-6)

    def test_finer_voxels_are_projected_with_the_same_mass(self):
        """Grains have finer voxels by default; the sum of their radiographs is the same."""
        unmoved = Motions.identity(three_grains().labels, three_grains().centers)
        coarse, fine = (simulate_radiographs(three_grains(finer, 3), unmoved, scanner()) for finer in (1, 2))
        assert np.abs(fine - coarse).max() > 1e-3
        np.testing.assert_allclose(fine.sum(axis=(1, 2)), coarse.sum(axis=(1, 2)), rtol=2e-3)
        exact = [simulate_radiographs(three_grains(finer), unmoved, scanner(), projector="exact") for finer in (1, 2)]
        np.testing.assert_array_equal(*exact)

    def test_radiographs_are_in_single_precision(self):
        grains = three_grains()
        computed = simulate_radiographs(
            grains, Motions.identity(grains.labels, grains.centers), scanner((0.0, 1.0, 2.0))
        )
        assert computed.dtype == np.float32
        assert computed.shape == (3, *PANEL)

    def test_strained_grains_are_projected_strained(self):
        """A strain about another centre is the same motion, and differs from none."""
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        strains = np.array([[0.1, -0.05, 0.0, 0.02, 0.0, 0.03]] * 3)
        strained = replace(motions, strains=strains, strain_covariances=np.zeros((3, 6, 6)))
        image = simulate_radiographs(grains, strained, scanner())
        assert np.abs(image - simulate_radiographs(grains, motions, scanner())).max() > 0.01
        elsewhere = replace(strained, centers=grains.centers + 0.07)
        shifts = recenter(strained.gradients, strained.translations, strained.centers, elsewhere.centers)
        elsewhere = replace(elsewhere, translations=shifts)
        np.testing.assert_allclose(simulate_radiographs(grains, elsewhere, scanner()), image, atol=2e-6)
