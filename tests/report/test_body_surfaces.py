"""Surfaces of pistons and containers on the page."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.model.scene import Body
from grainmotion.model.volume import Volume
from grainmotion.report.body_surfaces import BODY_TRIANGLES, body_meshes

VOXEL_SIZE = 0.1  # mm
CENTER = (0.7, -0.3, 1.1)  # mm


def tube(shape: tuple[int, int, int], inner: float, outer: float, noise: float = 0.0) -> Body:
    """A tube about z (inner and outer radius, voxels) as long as its volume, as a scan gives it: with noise around."""
    _, y, x = np.indices(shape)
    r = np.hypot(x - (shape[2] - 1) / 2, y - (shape[1] - 1) / 2)
    array = np.clip(r - inner + 0.5, 0, 1) * np.clip(outer - r + 0.5, 0, 1) * 0.03
    array += np.random.default_rng(5).normal(0, noise, shape) * (r > inner - 3) * (r < outer + 3)
    return Body("wall", "wall", Volume(array.astype(np.float32), VOXEL_SIZE, CENTER))


def in_place(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, mm, and triangles."""
    vertices, triangles = body_meshes([body]).of_row(0)
    return vertices + body.center, triangles.astype(np.int64)


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume within outward triangles."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.mark.parametrize(
    ("shape", "inner", "outer"), [((60, 90, 90), 34, 42), ((160, 150, 150), 60, 70), ((8, 70, 70), -1, 33)]
)
def test_walls_and_pistons_are_where_their_attenuation_is(shape, inner, outer):
    vertices, triangles = in_place(tube(shape, inner, outer, noise=0.002))
    assert 100 < len(triangles) <= BODY_TRIANGLES
    offsets = (vertices - CENTER) / VOXEL_SIZE
    r, half = np.hypot(offsets[:, 0], offsets[:, 1]), shape[0] / 2
    off = np.minimum.reduce([np.abs(r - inner), np.abs(r - outer), np.abs(np.abs(offsets[:, 2]) - half)])
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert r.max() == pytest.approx(outer, abs=1.0)
    assert np.abs(offsets[:, 2]).max() == pytest.approx(half, abs=1.0)
    true = np.pi * (outer**2 - max(inner, 0) ** 2) * shape[0] * VOXEL_SIZE**3
    assert volume(vertices, triangles) == pytest.approx(true, rel=0.04)


def test_a_wall_thinner_than_a_cell_has_no_holes():
    """Every ray from the axis to the wall passes it, at its radius."""
    vertices, triangles = in_place(tube((150, 220, 220), 100, 102, noise=0.001))
    assert len(triangles) <= BODY_TRIANGLES
    offsets = (vertices - CENTER) / VOXEL_SIZE
    middles = offsets[triangles].mean(axis=1)
    middles = middles[np.abs(middles[:, 2]) < 70]
    assert np.hypot(middles[:, 0], middles[:, 1]) == pytest.approx(101, abs=4)
    sides = np.histogram2d(np.arctan2(middles[:, 1], middles[:, 0]), middles[:, 2], bins=[12, 2])[0]
    assert sides.min() > 0


def test_scattered_bodies_have_few_triangles_too():
    rng = np.random.default_rng(1)
    dust = Volume((rng.uniform(size=(80, 80, 80)) < 0.02).astype(np.float32), VOXEL_SIZE)
    assert 0 < body_meshes([Body("dust", "body", dust)]).triangle_counts[0] <= BODY_TRIANGLES


def test_nothing_that_attenuates_has_no_surface():
    nothing = Body("empty", "body", Volume(np.zeros((4, 5, 6), np.float32), VOXEL_SIZE))
    meshes = body_meshes([nothing, tube((8, 30, 30), -1, 12)])
    assert meshes.triangle_counts[0] == meshes.vertex_counts[0] == 0
    assert meshes.triangle_counts[1] > 0
