"""Kernels of resampling: exact for linear images, zero outside, and labels of the largest sample."""

import numpy as np

from grainmotion.kernels import resample
from grainmotion.rotations import rotation_matrix

ROTATION = rotation_matrix([0.2, -0.1, 0.4])
OFFSET = np.array([4.0, 2.0, 3.0])


def ramp(shape):
    z, y, x = np.indices(shape, dtype=np.float32)
    return (1 + 0.5 * x - 0.25 * y + 2 * z).astype(np.float32)


def test_linear_image_is_resampled_exactly():
    total = np.zeros((5, 5, 5), np.float32)
    resample.add_moved(ramp((14, 14, 14)), ROTATION, OFFSET, np.zeros(3, np.int64), np.full(3, 5), total)
    z, y, x = np.indices(total.shape).reshape(3, -1)
    qx, qy, qz = ROTATION @ np.array([x, y, z]) + OFFSET[:, None]
    inside = np.all([qx >= 0, qy >= 0, qz >= 0], axis=0)
    assert inside.sum() > 100
    expected = 1 + 0.5 * qx - 0.25 * qy + 2 * qz
    np.testing.assert_allclose(total.ravel()[inside], expected[inside], rtol=1e-5)


def test_image_decreases_to_zero_over_one_voxel():
    source = np.ones((3, 3, 3), np.float32)
    values = [resample.sample(source, x, 1.0, 1.0) for x in (-1.0, -0.5, 0.0, 2.0, 2.5, 3.0)]
    np.testing.assert_allclose(values, [0, 0.5, 1, 1, 0.5, 0])


def test_label_is_that_of_the_largest_sample():
    total, best, labels = (
        np.zeros((1, 1, 4), np.float32),
        np.zeros((1, 1, 4), np.float32),
        np.zeros((1, 1, 4), np.int32),
    )
    box = np.zeros(3, np.int64), np.array([4, 1, 1])
    for label, values in ((1, [0.2, 0.9, 0.6, 0.05]), (2, [0.3, 0.4, 0.0, 0.0])):
        source = np.array(values, np.float32).reshape(1, 1, 4)
        resample.add_moved_label(
            source, np.eye(3), np.zeros(3), *box, total, np.int32(label), np.float32(0.1), best, labels
        )
    assert labels.ravel().tolist() == [2, 1, 1, 0]
    np.testing.assert_allclose(total.ravel(), [0.5, 1.3, 0.6, 0.05], rtol=1e-6)
