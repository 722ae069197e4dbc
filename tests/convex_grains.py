"""A numpy phantom of convex grains: its voxels and its radiographs, without the package's projector or simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix

SHAPE = (48, 46, 46)  # voxels, z y x
VOXEL = 0.125
PANEL = (56, 56)
SPACING = 1.55  # mm between grains of about 1.4 mm
DISTANCES = {"source_to_axis": 120.0, "source_to_detector": 480.0}
STATE_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


@dataclass
class ConvexGrains:
    """Grains {x: normals · (x - center) <= offsets} with attenuations, 1/mm."""

    normals: list[np.ndarray]
    offsets: list[np.ndarray]
    centers: np.ndarray
    attenuations: np.ndarray

    @classmethod
    def random(cls, seed: int, count: int = 15) -> ConvexGrains:
        """A random choice of places on a jittered lattice of 3 x 3 x 3."""
        rng = np.random.default_rng(seed)
        lattice = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        places = SPACING * rng.permutation(lattice)[:count] + rng.uniform(-0.12, 0.12, (count, 3))
        normals = [rng.normal(size=(14, 3)) for _ in range(count)]
        normals = [n / np.linalg.norm(n, axis=1)[:, None] for n in normals]
        boxes = np.concatenate([np.eye(3), -np.eye(3)])
        return cls(
            [np.concatenate([n, boxes]) for n in normals],
            [np.concatenate([rng.uniform(0.5, 0.85, 14), np.full(6, 0.8)]) for _ in range(count)],
            places,
            np.full(count, 0.15),
        )

    def moved(self, seed: int, translation: float, rotation_deg: float) -> ConvexGrains:
        """Each grain moved at random, uniform up to a translation, mm, and a rotation along each axis."""
        rng = np.random.default_rng(seed)
        shifts = rng.uniform(-translation, translation, self.centers.shape)
        matrices = rotation_matrix(np.radians(rng.uniform(-rotation_deg, rotation_deg, self.centers.shape)))
        normals = [n @ m.T for n, m in zip(self.normals, matrices, strict=True)]
        return ConvexGrains(normals, self.offsets, self.centers + shifts, self.attenuations)

    def voxels(self) -> tuple[Volume, np.ndarray]:
        """Attenuation and labels on the grid, with partial voxels from 2 x 2 x 2 points."""
        array, labels = np.zeros(SHAPE), np.zeros(SHAPE, np.int32)
        axes = [((np.arange(2 * n) + 0.5) / 2 - n / 2) * VOXEL for n in SHAPE]
        points = np.stack(np.meshgrid(*axes, indexing="ij")[::-1], axis=-1)
        for k, (normals, offsets) in enumerate(zip(self.normals, self.offsets, strict=True)):
            near = [np.abs(axis - c) < 0.9 for axis, c in zip(axes, self.centers[k][::-1], strict=True)]
            box = np.ix_(*near)
            inside = np.zeros(tuple(2 * n for n in SHAPE), bool)
            inside[box] = ((points[box] - self.centers[k]) @ normals.T <= offsets).all(axis=-1)
            nz, ny, nx = SHAPE
            share = inside.reshape(nz, 2, ny, 2, nx, 2).mean(axis=(1, 3, 5))
            array += self.attenuations[k] * share
            labels[share >= 0.5] = k + 1
        return Volume(array.astype(np.float32), VOXEL), labels

    def scan(
        self,
        angles_deg: tuple[float, ...] = STATE_ANGLES_DEG,
        photons: float = 20000,
        seed: int = 0,
        geometry: Geometry | None = None,
    ) -> Scan:
        """Radiographs with the noise of photons, in a geometry or at angles."""
        geometry = geometry or Geometry.cone(angles_deg, PANEL, 0.5, **DISTANCES)
        images = np.zeros((len(geometry), *PANEL))
        for view in range(len(geometry)):
            source = geometry.source[view]
            rays = geometry.pixel_positions(view).reshape(-1, 3) - source
            rays = rays / np.linalg.norm(rays, axis=1)[:, None]
            for k, (normals, offsets) in enumerate(zip(self.normals, self.offsets, strict=True)):
                slopes = rays @ normals.T
                with np.errstate(divide="ignore"):
                    ends = (offsets - normals @ (source - self.centers[k])) / slopes
                far = np.where(slopes > 0, ends, np.inf).min(axis=1)
                near = np.where(slopes < 0, ends, -np.inf).max(axis=1)
                images[view] += self.attenuations[k] * np.maximum(far - near, 0).reshape(PANEL)
        counts = np.random.default_rng(seed).poisson(photons * np.exp(-images))
        return Scan(-np.log(np.maximum(counts, 1) / photons), geometry)
