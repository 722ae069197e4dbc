"""Projection of a volume to any view: forward and adjoint are one matrix and its transpose."""

import numba
import numpy as np
import pytest

from grainmotion.kernels import volume_projection
from volume_views import cone, volume

VIEWS = np.array(
    [  # source or direction, detector, u, v: rays that run mostly along x, y and z
        [-9, 0.1, 0.2, 20, -0.3, -0.4, 0.02, 0.3, 0, 0, 0.03, 0.31],
        [0.1, -9, 0.2, -0.2, 20, -0.4, 0.3, 0.02, 0, 0, 0.03, 0.31],
        [0.1, 0.2, -9, -0.2, -0.5, 20, 0.3, 0.05, 0, -0.04, 0.3, 0.01],
    ]
)
VIEWS.setflags(write=False)  # as those of a geometry
PANEL = (10, 12)
ORIGIN, VOXEL = np.array([-0.9, -0.95, -0.85]), 0.3
PADDED = (7, 6, 7)  # of 3 × 2 × 3 voxels


def dense(cone, exact):
    """A as a matrix, a column for each voxel that is not padding."""
    columns = []
    for index in np.ndindex(3, 2, 3):
        image, out = np.zeros(PADDED), np.full((3, *PANEL), np.nan)
        image[tuple(np.add(index, 2))] = 1
        volume_projection.forward(image, ORIGIN, VOXEL, VIEWS, cone, exact, out)
        columns.append(out.ravel())
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("exact", [False, True], ids=["trilinear", "exact"])
@pytest.mark.parametrize("cone", [True, False], ids=["cone", "parallel"])
def test_adjoint_is_the_transpose_and_is_added(cone, exact):
    matrix = dense(cone, exact)
    assert (matrix.sum(axis=0) > 0).all()
    images = np.random.default_rng(0).normal(size=(3, *PANEL))
    out = np.ones(PADDED)
    volume_projection.adjoint(images, ORIGIN, VOXEL, VIEWS, cone, exact, out)
    np.testing.assert_allclose(out[2:-2, 2:-2, 2:-2].ravel() - 1, matrix.T @ images.ravel(), atol=1e-13)


def test_adjoint_does_not_depend_on_the_number_of_threads():
    geometry, body = cone(), volume()
    images = np.random.default_rng(1).normal(size=(len(geometry), *geometry.shape)).astype(np.float32)
    results = []
    before = numba.get_num_threads()
    for threads in (1, before):
        numba.set_num_threads(threads)
        out = np.zeros(tuple(n + 4 for n in body.shape), np.float32)
        volume_projection.adjoint(images, body.origin - 2 * body.voxel_size, body.voxel_size, geometry.vectors, True,
                                  False, out)  # fmt: skip
        results.append(out)
    numba.set_num_threads(before)
    np.testing.assert_array_equal(*results)
