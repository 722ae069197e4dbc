"""Measures of strain, and the polar decomposition of a deformation gradient."""

import numpy as np
import pytest

from grainmotion.model.strain import bounded, components, green_lagrange, polar_decomposition, stretches, tensors
from grainmotion.rotations import rotation_matrix

STRAINS = np.array([[0.05, -0.03, 0.01, 0.02, -0.04, 0.03], [0.0, 0.1, -0.05, 0.0, 0.01, -0.06]])


def test_components_are_those_of_the_tensor():
    e = tensors(STRAINS)
    np.testing.assert_array_equal(e, np.swapaxes(e, 1, 2))
    assert e[0, 1, 2] == STRAINS[0, 3]
    assert e[0, 0, 2] == STRAINS[0, 4]
    assert e[0, 0, 1] == STRAINS[0, 5]
    np.testing.assert_array_equal(components(e), STRAINS)


def test_a_gradient_is_its_rotation_after_its_stretch():
    rotations = rotation_matrix([[0.3, -0.2, 1.0], [2.0, 0.5, -1.0]])
    found, strains = polar_decomposition(rotations @ stretches(STRAINS))
    np.testing.assert_allclose(found, rotations, atol=1e-12)
    np.testing.assert_allclose(strains, STRAINS, atol=1e-12)


def test_a_principal_strain_is_a_change_of_length():
    longer = np.zeros((1, 6))
    longer[0, 2] = 0.2
    assert np.linalg.norm(stretches(longer)[0] @ [0, 0, 5.0]) == pytest.approx(6.0)
    assert green_lagrange(longer)[0, 2] == pytest.approx((1.2**2 - 1) / 2)


def test_bounded_strains_have_bounded_principal_values():
    large = 20 * STRAINS
    values = np.linalg.eigvalsh(tensors(bounded(large, 0.5)))
    assert np.abs(values).max() == pytest.approx(0.5)
    assert bounded(STRAINS, 0.5) is STRAINS
