"""A block of many small grains and radiographs of it, by the package's own projector: for tests of memory and work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels

VOXEL, ACROSS = 0.1, 8


def block(side: int, seed: int = 0) -> GrainSet:
    """``side``³ soft convex grains 8 voxels apart, in double precision, without finer voxels."""
    rng = np.random.default_rng(seed)
    n = side * ACROSS + 4
    array, labels = np.zeros((n, n, n)), np.zeros((n, n, n), np.int32)
    z, y, x = np.mgrid[:ACROSS, :ACROSS, :ACROSS] - (ACROSS - 1) / 2
    for label, corner in enumerate(np.ndindex(side, side, side), start=1):
        normals = rng.normal(size=(9, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        outside = (np.stack([x, y, z], axis=-1) @ normals.T - rng.uniform(2.0, 3.2, 9)).max(axis=-1)
        outside = np.maximum(outside, np.sqrt(x**2 + y**2 + z**2) - 3.4)
        box = tuple(slice(2 + ACROSS * c, 2 + ACROSS * (c + 1)) for c in corner)
        array[box] = np.clip(0.5 - outside, 0, 1)
        labels[box] = np.where(array[box] > 0, label, 0)
    return grains_from_labels(Volume(array, VOXEL), labels, reach=0, finer=1)


def views(side: int) -> Geometry:
    """Four cone-beam views that contain the block."""
    pixels = int(1.6 * side * ACROSS) + 12
    size = VOXEL * side * ACROSS
    return Geometry.cone(
        [0.0, 40.0, 85.0, 130.0], (pixels, pixels), 4 * VOXEL, source_to_axis=20 * size, source_to_detector=80 * size
    )


def still(n: int) -> Pose:
    """No motion."""
    return Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)).copy())


def state(grains: GrainSet, geometry: Geometry, noise: float = 0.002, seed: int = 1) -> tuple[Scan, Pose]:
    """Radiographs of the grains moved by up to half a voxel and 2°, and their true pose."""
    rng = np.random.default_rng(seed)
    packed, n = GrainArrays.of(grains), len(grains)
    rotations = rotation_matrix(np.deg2rad(2) * rng.uniform(-1, 1, (n, 3)))
    pose = replace(still(n), translations=0.5 * VOXEL * rng.uniform(-1, 1, (n, 3)), matrices=rotations)
    patches = footprint_patches(packed, pose, geometry)
    images = assemble(project_patches(packed, pose, geometry, patches, "trilinear"), patches, geometry)
    return Scan(images + noise * rng.standard_normal(images.shape), geometry), pose
