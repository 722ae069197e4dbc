"""Solids whose mass properties and distances are known in closed form, and their voxels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels

H = 0.1  # mm, edge of a voxel
TURN = rotation_matrix([0.4, -0.7, 0.9])  # from the axes of the solid to those of the voxels
PLACE = np.array([0.031, -0.022, 0.047])  # of the centre of the volume, mm


@dataclass(frozen=True)
class Solid:
    """A solid about its own centre, in own axes: signed distance, negative inside; volume, moments, Euler number."""

    distance: Callable[[np.ndarray], np.ndarray]
    volume: float
    moments: np.ndarray  # about x, y, z at density 1
    euler: int = 2

    def there(self, points: np.ndarray) -> np.ndarray:
        """Signed distances of points in the frame of the voxels."""
        return self.distance((points - PLACE) @ TURN)

    @property
    def inertia(self) -> np.ndarray:
        """Inertia tensor in the frame of the voxels."""
        return TURN @ np.diag(self.moments) @ TURN.T


def sphere(radius: float) -> Solid:
    volume = 4 / 3 * np.pi * radius**3
    return Solid(lambda p: np.linalg.norm(p, axis=-1) - radius, volume, np.full(3, 0.4 * volume * radius**2))


def box(a: float, b: float, c: float) -> Solid:
    half, volume = np.array([a, b, c]) / 2, a * b * c

    def distance(p: np.ndarray) -> np.ndarray:
        q = np.abs(p) - half
        return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)

    return Solid(distance, volume, volume / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b]))


def ellipsoid(a: float, b: float, c: float) -> Solid:
    """The distance is that along the ray from the centre, an upper bound; its sign is exact."""
    axes, volume = np.array([a, b, c]), 4 / 3 * np.pi * a * b * c

    def distance(p: np.ndarray) -> np.ndarray:
        scaled = np.linalg.norm(p / axes, axis=-1)
        return np.linalg.norm(p, axis=-1) * (1 - 1 / np.maximum(scaled, 1e-9))

    return Solid(distance, volume, volume / 5 * np.array([b * b + c * c, a * a + c * c, a * a + b * b]))


def torus(large: float, small: float) -> Solid:
    """About the z axis."""
    volume = 2 * np.pi**2 * large * small**2

    def distance(p: np.ndarray) -> np.ndarray:
        return np.hypot(np.hypot(p[..., 0], p[..., 1]) - large, p[..., 2]) - small

    axial, across = large**2 + 0.75 * small**2, 0.5 * large**2 + 0.625 * small**2
    return Solid(distance, volume, volume * np.array([across, across, axial]), 0)


def voxels(solid: Solid, samples: int = 4, margin: int = 6) -> Volume:
    """Share of each voxel that is in the solid: a uniform attenuation of 1/mm."""
    reach = 0.0
    directions = np.stack(np.meshgrid(*[np.linspace(-4, 4, 81)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    reach = np.abs(directions[solid.there(directions) < 0.1]).max()
    n = 2 * (int(np.ceil(reach / H)) + margin)
    t = (np.arange(n * samples) + 0.5) / samples * H - n * H / 2
    out = np.empty((n, n, n), np.float32)
    y, x = np.meshgrid(t, t, indexing="ij")
    for k in range(n):
        planes = [solid.there(np.stack([x, y, np.full_like(x, z)], axis=-1)) < 0 for z in t[k * samples :][:samples]]
        out[k] = np.mean(planes, axis=0).reshape(n, samples, n, samples).mean(axis=(1, 3))
    return Volume(out, H)


def grain(volume: Volume, *, finer: int = 1, reach: float = 2.0) -> Grain:
    """The grain of an image of one solid."""
    return grains_from_labels(volume, (volume.array > 0.5).astype(np.int32), reach=reach, finer=finer).grains[0]
