"""Three random lumps side by side along x, and a scanner that has them on its panel."""

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels

PANEL = (30, 44)
VOXEL = 0.1


def scanner(angles=(0.0, 60.0), shape=PANEL):
    return Geometry.cone(angles, shape, 4 * VOXEL, source_to_axis=30, source_to_detector=120)


def three_grains(finer=1, reach=0):
    """Labels 5, 2 and 9 in this volume: three lumps side by side along x."""
    rng = np.random.default_rng(0)
    array = np.zeros((12, 12, 32), np.float32)
    labels = np.zeros(array.shape, np.int32)
    for label, x in ((5, 2), (2, 12), (9, 22)):
        array[2:10, 2:10, x : x + 8] = rng.uniform(0.5, 1, (8, 8, 8))
        labels[2:10, 2:10, x : x + 8] = label
    return grains_from_labels(Volume(array, VOXEL, (0.1, 0.0, 0.05)), labels, reach=reach, finer=finer)


def unmoved(grains):
    n = len(grains)
    return Pose(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))


def shifted(grains, *translation):
    pose = unmoved(grains)
    pose.translations[:] = translation
    return pose
