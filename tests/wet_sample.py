"""A few stones in a liquid, with radiographs by the voxel-free simulator and a reference on voxels without noise."""

from __future__ import annotations

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import Particle, Sample, Tube, line_integrals, random
from grainmotion.simulate.stone_shapes import stone
from grainmotion.simulate.voxelise import attenuation_volume, label_volume

VOXEL, RADIUS, EXCESS, LIQUID = 0.1, 2.5, 0.6, 0.4
SHAPE = (56, 56, 56)


def stones():
    """Two layers of three stones, 14 voxels across, with a gap at z = 0."""
    out = []
    for k in range(6):
        angle = np.deg2rad(120 * k + 40 * (k // 3))
        place = (1.2 * np.cos(angle), 1.2 * np.sin(angle), 1.1 * (k // 3) * 2 - 1.1)
        particle = Particle(stone(k + 3, 14 * VOXEL, 4), EXCESS)
        out.append(particle.moved(np.eye(3), place - particle.center))
    return Sample(tuple(out))


def in_liquid(sample, attenuation, level=None):
    """The stones with their excess over a liquid in a tube."""
    return Sample(sample.particles, Tube(0.0, RADIUS, attenuation, -10.0, 10.0 if level is None else level))


def solid(sample, level):
    """Solid stones (1/mm: excess + liquid) in a liquid up to a level that cuts none of them."""
    out = []
    for particle in sample.particles:
        dry = particle.shape.vertices[:, 2].min() > level
        out.append(Particle(particle.shape, EXCESS + LIQUID * dry))
    return in_liquid(Sample(tuple(out)), LIQUID, level)


def reference(sample, level=None):
    """Grains of the wet reference, from noise-free voxels and true labels."""
    grid = Volume.zeros(SHAPE, VOXEL)
    z, y, x = (grid.origin[k] + VOXEL * np.arange(SHAPE[2 - k]) for k in (2, 1, 0))
    wet = np.clip((RADIUS - np.hypot(y[:, None], x)) / VOXEL + 0.5, 0, 1)[None]
    if level is not None:
        wet = wet * np.clip((level - z) / VOXEL + 0.5, 0, 1)[:, None, None]
    array = attenuation_volume(sample, grid).array + LIQUID * wet
    return grains_from_labels(Volume(array.astype(np.float32), VOXEL), label_volume(sample, grid).astype(np.int32))


def radiographs(sample, angles=(0.0, 60.0, 120.0)):
    """Noise-free line integrals of a few views."""
    views = Geometry.cone(angles, (48, 60), 4 * VOXEL, source_to_axis=60, source_to_detector=240)
    return Scan(line_integrals(sample, views, subsamples=2).astype(np.float32), views)


def moved(sample, seed=1):
    """Random motions of up to 1.5 voxels and 5°, and the stones after them."""
    truth = random(sample, 1.5 * VOXEL, 5.0, seed)
    return truth, sample.moved(truth)
