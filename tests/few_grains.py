"""A few small grains and radiographs of them by the package's own projector, for tests that measure no accuracy."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.rotations import rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels

VOXEL = 0.1
PANEL = (52, 64)
ANGLES = (0.0, 50.0, 95.0, 140.0)
PLACES = ((-1.3, -0.5, -0.6), (0.2, 0.9, -0.5), (1.5, -0.4, -0.4), (-0.5, 0.2, 1.1), (1.0, 0.1, 1.2))  # x y z, mm
RADIUS = 0.7  # mm, of grains about 14 voxels across
GAIN_AND_OFFSET = ResponseModel("global")  # a and b of Eq. 22, unknown


def geometry(angles_deg=ANGLES, shape=PANEL) -> Geometry:
    """The scanner: a pixel at the axis is a voxel."""
    return Geometry.cone(angles_deg, shape, 4 * VOXEL, source_to_axis=40, source_to_detector=160)


@cache
def grain_set(count: int = 5, sphere: int | None = None, seed: int = 0, finer: int = 2) -> GrainSet:
    """Convex polyhedra with soft faces and a dense corner, labels 1 … count; grain ``sphere`` is a uniform ball.

    Tests share them and leave their arrays as they are.
    """
    rng = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * VOXEL for n in (46, 44, 52)), indexing="ij")
    volume, labels = np.zeros(x.shape, np.float32), np.zeros(x.shape, np.int32)
    for label, place in enumerate(PLACES[:count], start=1):
        offsets = np.stack([x - place[0], y - place[1], z - place[2]], axis=-1)
        normals = rng.normal(size=(9, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        distances = rng.uniform(0.6, 1.0, 9) * RADIUS
        ball = np.linalg.norm(offsets, axis=-1) - RADIUS
        if label == sphere:
            outside, texture = ball, 1.0
        else:
            outside = np.maximum((offsets @ normals.T - distances).max(axis=-1), ball)
            texture = 1 + 0.8 * (np.linalg.norm(offsets - 0.3 * RADIUS * normals[0], axis=-1) < 0.3 * RADIUS)
        attenuation = texture * np.clip(0.5 - outside / VOXEL, 0, 1)
        labels[attenuation > volume] = label
        volume = np.maximum(volume, attenuation)
    return grains_from_labels(Volume(volume, VOXEL), labels, reach=0, finer=finer)


def blob(x0, y0, z0, a, b, c) -> np.ndarray:
    """A smooth oblique body on its own grid: finite differences of its radiographs are close to the derivatives."""
    z, y, x = np.mgrid[:46, :44, :52].astype(float)
    across = y - y0 - 0.3 * (x - x0)
    array = np.exp(-(((x - x0) / a) ** 2 + (across / b) ** 2 + ((z - z0) / c) ** 2) / 2)
    return np.where(array > 1e-4, array, 0)


def smooth_grains() -> GrainSet:
    """Two smooth bodies, one behind the other in some views."""
    both = [blob(16, 20, 20, 3.5, 3, 3.5), blob(33, 24, 25, 3, 3.5, 3)]
    labels = np.where(both[0] > both[1], 1, np.where(both[1] > 0, 2, 0))
    return grains_from_labels(Volume(both[0] + both[1], VOXEL), labels, reach=0, finer=1)


def motions(grains: GrainSet, translations=0.0, rotations_deg=0.0) -> Motions:
    """Given motions: a number, one row for all grains, or one row per grain."""
    n = len(grains)
    return dataclasses.replace(
        Motions.identity(grains.labels, grains.centers),
        translations=np.broadcast_to(np.asarray(translations, float), (n, 3)).copy(),
        rotations=np.deg2rad(np.broadcast_to(np.asarray(rotations_deg, float), (n, 3))).copy(),
    )


def small_motions(grains: GrainSet, voxels: float = 1.5, degrees: float = 4.0, seed: int = 1) -> Motions:
    """Random motions, uniform up to these limits, independent for every grain."""
    rng = np.random.default_rng(seed)
    n = len(grains)
    return motions(grains, voxels * VOXEL * rng.uniform(-1, 1, (n, 3)), degrees * rng.uniform(-1, 1, (n, 3)))


def radiographs(grains: GrainSet, truth: Motions, *, views=None, noise=0.01, gain=1.0, offset=0.0, seed=2) -> Scan:
    """Line integrals of the moved grains with white noise."""
    views = views or geometry()
    images = gain * simulate_radiographs(grains, truth, views) + offset
    images = images + noise * np.random.default_rng(seed).standard_normal(images.shape)
    return Scan(images.astype(np.float32), views)


def errors(measured: Motions, truth: Motions) -> tuple[np.ndarray, np.ndarray]:
    """Translation errors in voxels and rotation errors in degrees, ``(n, 3)`` each."""
    rotations = rotation_vector(measured.matrices @ truth.matrices.transpose(0, 2, 1))
    return (measured.translations - truth.translations) / VOXEL, np.rad2deg(rotations)
