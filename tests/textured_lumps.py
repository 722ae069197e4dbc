"""Four textured grains, radiographs of them and their data term: for tests of the objective."""

import numpy as np
from scipy import ndimage

from few_grains import GAIN_AND_OFFSET
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.objective.data_term import Target
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels

PANEL = (34, 46)


VOXEL = 0.1


GEOMETRY = Geometry.cone([0.0, 55.0, 100.0], PANEL, 0.4, source_to_axis=30, source_to_detector=120)


def lumps():
    """Four textured cubes; the last one is away from the others."""
    rng = np.random.default_rng(0)
    array = np.zeros((26, 12, 34), np.float32)
    labels = np.zeros(array.shape, np.int32)
    for label, (z, y, x) in enumerate([(3, 1, 2), (4, 2, 11), (2, 1, 20), (16, 3, 22)], start=1):
        array[z : z + 8, y : y + 8, x : x + 8] = ndimage.gaussian_filter(rng.uniform(0, 2, (8, 8, 8)), 0.8)
        labels[z : z + 8, y : y + 8, x : x + 8] = label
    return grains_from_labels(Volume(array, VOXEL), labels, reach=0, finer=1)


def smooth_lumps():
    """Two long Gaussian bodies side by side, smooth from voxel to voxel."""
    z, y, x = np.mgrid[:24, :20, :36].astype(float)
    left = 2 * np.exp(-(((x - 10) / 2.5) ** 2 + ((y - 10 - 0.3 * (x - 10)) / 1.8) ** 2 + ((z - 12) / 3) ** 2) / 2)
    right = 2 * np.exp(-(((x - 25) / 2) ** 2 + ((y - 9) / 2.5) ** 2 + ((z - 12 + 0.4 * (x - 25)) / 2) ** 2) / 2)
    both = [np.where(lump > 1e-3, lump, 0) for lump in (left, right)]
    labels = np.where(both[0] > both[1], 1, np.where(both[1] > 0, 2, 0))
    return grains_from_labels(Volume(both[0] + both[1], VOXEL), labels, reach=0, finer=1)


GRAINS = GrainArrays.of(lumps())


POSE = Pose(
    0.05 * np.random.default_rng(1).normal(size=(4, 3)),
    rotation_matrix(0.3 * np.random.default_rng(2).normal(size=(4, 3))),
)


def mask():
    valid = np.random.default_rng(3).uniform(size=(3, *PANEL)) > 0.05
    valid[:, 17] = False
    return valid


def measured(gain=1.0, offset=0.0, noise=0.0, pose=POSE):
    patches = footprint_patches(GRAINS, pose, GEOMETRY)
    images = gain * assemble(project_patches(GRAINS, pose, GEOMETRY, patches, "trilinear"), patches, GEOMETRY) + offset
    return images + (noise * np.random.default_rng(4).standard_normal(images.shape)).astype(np.float32)


def target(sigma=0.0, gain=False, valid=None, images=None, **changes):
    scan = Scan(measured(noise=0.02) if images is None else images, GEOMETRY, valid)
    response_model = GAIN_AND_OFFSET if gain else ResponseModel()
    return Target(scan, np.zeros((3, *PANEL), np.float32), "trilinear", sigma, response_model, **changes)


def by_scipy(images, weights):
    """Convolution of every radiograph with the whole kernel, zero beyond its edges."""
    kernel = np.concatenate([weights[:0:-1], weights]).astype(float)
    images = images.astype(float)
    for axis in (1, 2):
        images = ndimage.convolve1d(images, kernel, axis=axis, mode="constant")
    return images
