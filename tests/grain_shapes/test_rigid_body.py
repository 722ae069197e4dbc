"""Grains as rigid bodies: one frame for all shapes, and failures that are told instead of raised."""

import numpy as np
import pytest

from grainmotion.grain_shapes import level_set
from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.rigid_body import rigid_body
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from known_solids import PLACE, H, box, grain, torus, voxels

BOX = box(3.0, 2.4, 2.0)


@pytest.fixture(scope="module")
def body():
    return rigid_body(grain(voxels(BOX)), DemSettings(spheres=10, degree=6))


def test_shapes_are_about_the_centre_along_the_principal_axes(body):
    own = mass_properties(body.surface)
    np.testing.assert_allclose(own.center, 0, atol=1e-9)
    np.testing.assert_allclose(own.inertia, np.diag(own.principal_moments), atol=1e-9)
    np.testing.assert_allclose(own.principal_moments, np.sort(BOX.moments), rtol=0.01)
    extent = body.surface.vertices.max(axis=0)
    np.testing.assert_allclose(extent, [1.5, 1.2, 1.0], atol=0.6 * H)  # the long edge has the smallest moment
    half = np.array([1.5, 1.2, 1.0])
    q = np.abs(body.level_set.points) - half
    exact = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)
    assert np.quantile(np.abs(body.level_set.values - exact)[np.abs(exact) < 2 * H], 0.95) < 0.4 * H
    assert np.abs(body.clump.centers).max(axis=0)[0] < 1.5
    np.testing.assert_allclose(body.harmonics.radius(np.eye(3)), half, atol=0.15)
    assert body.reason == ""


def test_the_axes_carry_the_body_back_to_the_sample(body):
    back = body.surface.vertices @ body.axes.T + body.properties.center
    np.testing.assert_allclose(back, body.in_sample.vertices, atol=1e-9)
    np.testing.assert_allclose(body.properties.center, PLACE, atol=0.02 * H)


def test_what_cannot_be_made_is_said(monkeypatch):
    ring = rigid_body(grain(voxels(torus(1.2, 0.5))), DemSettings(shapes=("stl", "harmonics")))
    assert "not star-shaped" in ring.reason
    assert ring.surface is not None
    monkeypatch.setattr(level_set, "MAX_GRID_POINTS", 1000)
    large = rigid_body(grain(voxels(BOX)), DemSettings(shapes=("stl", "level-set", "clump")))
    assert "no level set" in large.reason
    assert "no clump" in large.reason
    assert large.surface is not None
    empty = rigid_body(Grain(4, Volume.zeros((5, 5, 5), H), np.zeros(3)), DemSettings())
    assert empty.reason.startswith("no surface")
    assert empty.axes is None
