"""Spheres voxelised by their exact radius, and motions that are known: for tests of mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels


def known_motions(
    centers: np.ndarray,
    translations: np.ndarray,
    rotations: np.ndarray | None = None,
    *,
    sd: float = 0.0,
    statuses: list[str] | None = None,
) -> Motions:
    """Converged motions of grains 1 … n with equal, independent standard deviations (mm, radians)."""
    n = len(centers)
    return replace(
        Motions.identity(np.arange(1, n + 1), centers),
        translations=np.asarray(translations, dtype=float),
        rotations=np.zeros((n, 3)) if rotations is None else np.asarray(rotations, dtype=float),
        covariances=np.tile(np.eye(6) * sd**2, (n, 1, 1)),
        statuses=np.array(statuses or ["converged"] * n, dtype="<U20"),
    )


def voxelised(centers: np.ndarray, radii: np.ndarray, shape: tuple[int, int, int], *, blur: float = 0.0) -> tuple:
    """Attenuation and labels of spheres 1 … n, in voxels of edge 1 about the origin, blurred by a Gaussian."""
    places = [np.arange(n) - (n - 1) / 2 for n in shape]
    z, y, x = np.meshgrid(*places, indexing="ij", sparse=True)
    array, labels, nearest = np.zeros(shape), np.zeros(shape, np.int32), np.full(shape, np.inf)
    for label, (center, radius) in enumerate(zip(centers, radii, strict=True), start=1):
        depth = np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2) - radius
        array = np.maximum(array, np.clip(0.5 - depth, 0, 1))
        labels[depth < nearest] = label
        nearest = np.minimum(nearest, depth)
    if blur:
        array = ndimage.gaussian_filter(array, blur)
    return array, np.where(array > 0.5, labels, 0)


def sphere_grains(
    centers: np.ndarray, radii: np.ndarray, shape: tuple[int, int, int], *, blur: float = 0.0, finer: int = 2
) -> GrainSet:
    """The grains of voxelised spheres."""
    array, labels = voxelised(np.asarray(centers, dtype=float), np.asarray(radii, dtype=float), shape, blur=blur)
    return grains_from_labels(Volume(array, 1.0), labels, finer=finer)
