"""Fabric tensors and coordination of contacts that are known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.fabric import fabric
from known_contacts import contacts_along


def test_one_direction():
    """N = zz; D = 15/2 (zz − I/3), so that a = 15/2."""
    found = fabric(contacts_along(np.tile([0, 0, 1.0], (5, 1))))
    np.testing.assert_allclose(found.first_kind, np.diag([0, 0, 1]))
    np.testing.assert_allclose(np.diag(found.third_kind), [-2.5, -2.5, 5])
    np.testing.assert_allclose(np.diag(found.second_kind), [-1.5, -1.5, 6])
    assert found.anisotropy == pytest.approx(7.5)


def test_isotropic_directions():
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) / np.sqrt(3)
    found = fabric(contacts_along(corners))
    np.testing.assert_allclose(found.first_kind, np.eye(3) / 3, atol=1e-12)
    np.testing.assert_allclose(found.second_kind, np.eye(3), atol=1e-12)
    assert found.anisotropy == pytest.approx(0, abs=1e-12)
    random = np.random.default_rng(0)
    drawn = []
    for _ in range(300):
        vectors = random.normal(size=(60, 3))
        drawn.append(fabric(contacts_along(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))))
    rms = np.sqrt(np.mean([f.anisotropy**2 for f in drawn]))
    assert rms == pytest.approx(drawn[0].isotropic_anisotropy, rel=0.05)


def test_second_kind_is_the_density_of_directions():
    """Directions drawn with the density (1/4π)(1 + D n n), D along z, give D back as the third kind."""
    random = np.random.default_rng(1)
    z = random.uniform(-1, 1, 400_000)
    z = z[random.uniform(0, 1.7, len(z)) < 1 + 0.6 * (1.5 * z**2 - 0.5)]
    angle = random.uniform(0, 2 * np.pi, len(z))
    normals = np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])
    np.testing.assert_allclose(fabric(contacts_along(normals)).third_kind, np.diag([-0.3, -0.3, 0.6]), atol=0.02)


def test_coordination_numbers():
    """A chain 1-2-3 with a loop 2-3-4, grain 5 alone: contacts 1, 3, 2, 2, 0."""
    pairs = [[1, 2], [2, 3], [2, 4], [3, 4]]
    found = fabric(contacts_along(np.tile([1.0, 0, 0], (4, 1)), pairs, 5))
    assert found.coordination == pytest.approx(8 / 5)
    assert found.rattlers == 2
    assert found.mechanical_coordination == pytest.approx((8 - 1) / (5 - 1 - 1))
    kinds = np.array(["contact", "indeterminate", "open", "contact"], dtype="<U13")
    partly = fabric(contacts_along(np.tile([1.0, 0, 0], (4, 1)), pairs, 5, kinds=kinds))
    assert partly.coordination_bounds == (pytest.approx(4 / 5), pytest.approx(6 / 5))
    border = fabric(contacts_along(np.tile([1.0, 0, 0], (4, 1)), pairs, 5, at_border=np.arange(5) == 1))
    assert (border.grains, border.coordination) == (4, pytest.approx(5 / 4))


def test_nothing_to_count():
    found = fabric(contacts_along(np.zeros((0, 3)), count=0))
    assert (found.contacts, found.grains) == (0, 0)
    assert np.isnan(found.anisotropy)
    told = json.loads(json.dumps(found.to_dict()))
    assert told["anisotropy"] is None
    assert told["first_kind"] == [[None] * 3] * 3


def test_an_unknown_direction_is_named():
    with pytest.raises(InputError, match="'axes' is unknown"):
        fabric(contacts_along(np.zeros((0, 3))), directions="axes")


def test_its_line_tells_what_the_numbers_are_of():
    shown = repr(fabric(contacts_along(np.eye(3))))
    assert shown.startswith("<Fabric: 3 normals of 2 grains; anisotropy 0, by chance 4.33; ")
