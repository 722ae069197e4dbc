"""Surfaces of the grains on the page: shape, size on the page, and what is drawn instead of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from many_grains_report import VOXEL_SIZE, packing

from grainmotion.model.volume import Volume
from grainmotion.report import surfaces
from grainmotion.report.surfaces import Meshes, ellipsoids, grain_meshes, surface_record, triangle_budget

CENTER = np.array([0.37, -0.12, 0.21])  # mm


def ball(across: int, axes: tuple[float, float, float] = (1, 1, 1)) -> tuple[np.ndarray, Volume]:
    """Labels with one ellipsoid, label 4, about `CENTER`; semi-axes x y z in halves of ``across`` voxels."""
    n = 2 * across + 9
    grid = Volume(np.zeros((n, n, n), np.float32), VOXEL_SIZE)
    z, y, x = np.indices(grid.shape)
    places = np.stack([x, y, z], axis=-1) * VOXEL_SIZE + grid.origin - CENTER
    inside = np.linalg.norm(places / (np.array(axes) * across * VOXEL_SIZE / 2), axis=-1) < 1
    return np.where(inside, 4, 0).astype(np.int32), grid


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume within outward triangles."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.mark.parametrize("across", [8, 20, 45])
def test_few_triangles_follow_a_ball_within_half_a_voxel(across, monkeypatch):
    monkeypatch.setattr(surfaces, "GRAIN_TRIANGLES", (120, 120))
    labels, grid = ball(across)
    meshes = grain_meshes(labels, grid, np.array([4]), CENTER[None])
    vertices, triangles = meshes.of_row(0)
    radius = across * VOXEL_SIZE / 2
    assert len(triangles) <= 120
    assert volume(vertices, triangles) == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)
    middles = vertices[triangles].mean(axis=1)
    off = np.concatenate([np.linalg.norm(vertices, axis=1), np.linalg.norm(middles, axis=1)]) - radius
    assert np.sqrt(np.mean(off**2)) < max(0.4 * VOXEL_SIZE, 0.05 * radius)


def test_surfaces_are_closed_and_face_outwards():
    packed = packing(12, 16)
    meshes = grain_meshes(packed.labels, packed.volume, np.arange(1, 13), packed.centers)
    for row in range(12):
        vertices, triangles = meshes.of_row(row)
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
        there, back = (set(map(tuple, e)) for e in (edges, edges[:, ::-1]))
        assert there == back
        voxels = np.count_nonzero(packed.labels == row + 1) * VOXEL_SIZE**3
        assert volume(vertices, triangles) == pytest.approx(voxels, rel=0.02)


def test_grains_without_voxels_or_centre_have_no_surface():
    labels, grid = ball(10)
    meshes = grain_meshes(labels, grid, np.array([4, 9, 4]), np.array([CENTER, CENTER, [np.nan] * 3]))
    assert meshes.triangle_counts[0] > 0
    assert list(meshes.triangle_counts[1:]) == list(meshes.vertex_counts[1:]) == [0, 0]


def test_a_slice_has_surfaces_too():
    labels, grid = ball(20)
    middle = len(labels) // 2
    flat = Volume(grid.array[middle : middle + 1], VOXEL_SIZE)
    meshes = grain_meshes(labels[middle : middle + 1], flat, np.array([4]), CENTER[None] * [1, 1, 0])
    vertices, _ = meshes.of_row(0)
    assert np.ptp(vertices[:, 2]) < 4 * VOXEL_SIZE
    assert np.ptp(vertices[:, 0]) == pytest.approx(20 * VOXEL_SIZE, rel=0.2)


def test_packed_numbers_give_the_meshes_back():
    packed = packing(7, 12)
    meshes = grain_meshes(packed.labels, packed.volume, np.array([1, 2, 99, 4, 5, 6, 7]), packed.centers)
    steps = surfaces._differences(meshes.vertices, meshes.vertex_counts)
    codes = surfaces._below_highest(meshes.triangles, meshes.triangle_counts)
    back = decoded(meshes, steps, codes)
    np.testing.assert_array_equal(back[0], meshes.vertices)
    np.testing.assert_array_equal(back[1], meshes.triangles)
    assert np.count_nonzero(codes == 0) == len(meshes.vertices)


def decoded(meshes: Meshes, steps: np.ndarray, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles, as ``assets/viewer_shapes.js`` undoes the packing."""
    vertices, triangles, v, t = steps.copy(), codes.astype(np.int64).ravel(), 0, 0
    for points, faces in zip(meshes.vertex_counts.astype(int), meshes.triangle_counts.astype(int)):
        for i in range(v + 1, v + points):
            vertices[i] += vertices[i - 1]
        highest = 0
        for k in range(t, t + 3 * faces):
            triangles[k] = highest - triangles[k]
            highest += codes.ravel()[k] == 0
        v, t = v + points, t + 3 * faces
    return vertices, triangles.reshape(-1, 3)


def test_ellipsoids_have_the_axes_of_the_labels():
    labels, grid = ball(24, (1.3, 1.0, 0.7))
    matrix = ellipsoids(labels, grid, np.array([4, 5]))[0]
    lengths = np.sort(np.linalg.norm(matrix, axis=0))
    np.testing.assert_allclose(lengths, np.array([0.7, 1.0, 1.3]) * 12 * VOXEL_SIZE, rtol=0.02)
    assert np.linalg.det(matrix) > 0


def test_any_number_of_grains_takes_less_than_six_megabytes():
    """By what a triangle takes in a sample of a hundred grains."""
    packed = packing(100, 12)
    record = surface_record(packed.labels, packed.volume, np.arange(1, 101), packed.centers)
    triangles = json.loads(json.dumps(record))["triangles"]["shape"][0]
    assert record["kind"] == "meshes"
    assert triangle_budget(5000) == 90
    assert len(json.dumps(record)) / triangles * surfaces.MAX_TRIANGLES < 6e6


def test_beyond_many_grains_ellipsoids_are_drawn(monkeypatch):
    monkeypatch.setattr(surfaces, "MAX_MESHES", 5)
    packed = packing(6, 10)
    record = surface_record(packed.labels, packed.volume, np.arange(1, 7), packed.centers)
    assert record["kind"] == "ellipsoids"
