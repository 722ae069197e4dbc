"""Meshes of grains and for display: size, place and volume, on an ellipsoid whose surface is known."""

import numpy as np
import pytest
from skimage.measure import marching_cubes

from grainmotion.analysis.grain_mesh import DISPLAY_CELLS, GrainMesh, display_mesh, grain_mesh
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels


def ellipsoid(voxels: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (mm) and outward triangles of an ellipsoid with semi-axes 1, 0.8 and 0.6 mm about (3, 2, 1)."""
    axes = [np.linspace(-1.1, 1.1, voxels)] * 3
    x, y, z = np.meshgrid(*axes, indexing="ij")
    values = np.sqrt(x**2 + (y / 0.8) ** 2 + (z / 0.6) ** 2)
    vertices, faces, _, _ = marching_cubes(values, 1.0, spacing=[2.2 / (voxels - 1)] * 3)
    return vertices - 1.1 + [3, 2, 1], faces[:, ::-1] if volume(vertices, faces) < 0 else faces


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("voxels", [20, 120])
def test_surface_stays_in_place_with_few_triangles(voxels):
    vertices, faces = ellipsoid(voxels)
    mesh = display_mesh(GrainMesh(vertices, faces), 2.2 / (voxels - 1))
    assert len(mesh.faces) < 2.5 * np.pi * DISPLAY_CELLS**2
    assert len(mesh.faces) < len(faces)
    u = (mesh.vertices - [3, 2, 1]) / [1, 0.8, 0.6]
    assert np.abs(np.sqrt((u**2).sum(axis=1)) - 1).max() < 0.03
    assert volume(mesh.vertices - [3, 2, 1], mesh.faces) == pytest.approx(4 / 3 * np.pi * 0.48, rel=0.03)


def test_triangles_face_outwards_and_refer_to_vertices():
    vertices, faces = ellipsoid(60)
    mesh = display_mesh(GrainMesh(vertices, faces), 0.04)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    outwards = (np.cross(b - a, c - a) * ((a + b + c) / 3 - [3, 2, 1])).sum(axis=1) > 0
    assert outwards.mean() > 0.99
    assert np.unique(mesh.faces).tolist() == list(range(len(mesh.vertices)))


def test_mesh_of_a_grain_is_where_its_attenuation_is():
    h, center = 0.05, np.array([3.0, 2.0, 1.0])
    z, y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * h for n in (40, 44, 52)), indexing="ij")
    depth = (1 - np.sqrt(x**2 + (y / 0.8) ** 2 + (z / 0.6) ** 2)) * 0.75  # mm, near the surface
    array = np.clip(depth / h + 0.5, 0, 1)
    grains = grains_from_labels(Volume(array, h, tuple(center)), (array > 0.5).astype(np.int32))
    mesh = grain_mesh(grains.grains[0], h)
    u = (mesh.vertices - center) / [1, 0.8, 0.6]
    assert np.abs(np.sqrt((u**2).sum(axis=1)) - 1).max() < 0.5 * h
    assert volume(mesh.vertices - center, mesh.faces) == pytest.approx(4 / 3 * np.pi * 0.48, rel=0.03)


def test_grain_without_attenuation_has_no_mesh():
    grain = Grain(1, Volume.zeros((6, 6, 6), 0.1), np.zeros(3))
    assert grain_mesh(grain, 0.1) is None


def test_a_grain_of_one_layer_has_no_surface():
    """A slice is padded by empty layers like any grain."""
    array = np.zeros((1, 14, 14))
    array[0, 4:10, 4:10] = 1
    grain = grains_from_labels(Volume(array, 1.0), (array > 0).astype(int)).grains[0]
    assert grain.volume.shape[0] > 1
    assert grain_mesh(grain, 1.0) is None
