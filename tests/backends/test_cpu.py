"""Every operation of a backend, on the CPU, for a few overlapping patches."""

import numpy as np
import pytest

import few_grains
from grainmotion.backends.cpu import CPU
from grainmotion.kernels.layout import ViewTable
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from patch_tables import BOXES, DERIVATIVES, GRAINS, SHAPE, TABLE, dense_jacobian, pairs_of

ARRAYS = GrainArrays.of(few_grains.smooth_grains())
POSE = Pose(np.array([[0.03, -0.02, 0.01], [0.0, 0.05, -0.04]]), np.tile(np.eye(3), (2, 1, 1)))


def test_voxels_and_patches_are_not_copied():
    backend, placed = CPU.place_voxels(ARRAYS.images, ARRAYS.starts, ARRAYS.centers[:, 2], 1.0)
    assert backend is CPU
    assert placed is ARRAYS.images
    assert CPU.place_patches(TABLE) is TABLE
    assert not CPU.places_coarse_grains


@pytest.mark.parametrize("exact", [False, True], ids=["trilinear", "exact"])
def test_projections_have_the_precision_of_the_voxels(exact):
    geometry = few_grains.geometry([10.0, 75.0])
    tables = (
        ARRAYS.table(POSE),
        ViewTable(geometry.vectors, True, np.array(geometry.shape)),
        footprint_patches(ARRAYS, POSE, geometry).table,
    )
    values = CPU.project(*tables, exact)
    same, derivatives = CPU.project_with_derivatives(*tables, exact)
    assert values.dtype == same.dtype == derivatives.dtype == ARRAYS.precision
    assert derivatives.shape == (6, len(values))
    np.testing.assert_allclose(same, values, atol=1e-6 * values.max())
    assert values.any()
    assert derivatives.any(axis=1).all()


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_sum_of_patches(precision):
    """The image that a patch's derivative alone makes is a column of J; the sum has the patches' precision."""
    values = DERIVATIVES[2].astype(precision)
    expected = dense_jacobian().reshape(*SHAPE, GRAINS, 6)[..., 2].sum(axis=-1)
    images = CPU.add_patches(values, TABLE, SHAPE)
    assert images.dtype == precision
    np.testing.assert_allclose(images, expected, atol=10 * np.finfo(precision).eps)


def test_filters_of_images_and_patches_agree():
    """A patch that is the whole radiograph is filtered as the radiograph is, once it is masked."""
    kernel = np.array([0.5, 0.25])
    images = CPU.add_patches(DERIVATIVES[0], TABLE, SHAPE)
    mask = (np.random.default_rng(0).uniform(size=SHAPE) < 0.8).astype(float)
    patch = images[1].reshape(1, -1).copy()
    masked = images * mask
    CPU.filter_images(masked, kernel)
    whole = TABLE._replace(boxes=np.array([[0, 1, 0, SHAPE[1], 0, SHAPE[2]]]), offsets=np.array([0, patch.size]))
    CPU.filter_patches(patch, whole, mask, kernel)
    np.testing.assert_allclose(patch.reshape(SHAPE[1:]), masked[1], atol=1e-14)


def test_products_of_several_stacks():
    rng = np.random.default_rng(1)
    increments, stacks = rng.normal(size=(2, GRAINS, 6)), rng.normal(size=(3, *SHAPE))
    images = CPU.jvp(DERIVATIVES, TABLE, increments, SHAPE)
    assert len(images) == 2
    expected = increments.reshape(2, -1) @ dense_jacobian().T
    np.testing.assert_allclose(np.reshape(images, (2, -1)), expected, atol=1e-13)
    parts = CPU.vjp(DERIVATIVES, TABLE, list(stacks))
    assert parts.shape == (3, len(BOXES), 6)
    gradients = np.zeros((3, GRAINS, 6))
    np.add.at(gradients, (slice(None), BOXES[:, 0]), parts)
    np.testing.assert_allclose(gradients.reshape(3, -1), stacks.reshape(3, -1) @ dense_jacobian(), atol=1e-13)


def test_images_have_the_precision_of_the_derivatives():
    (images,) = CPU.jvp(DERIVATIVES.astype(np.float32), TABLE, np.ones((1, GRAINS, 6)), SHAPE)
    assert images.dtype == np.float32


def test_gram_blocks():
    pairs = [pairs_of(0, 1), pairs_of(1, 1)]
    first = np.cumsum([0, *(len(p) for p in pairs)])
    blocks = CPU.gram_blocks(DERIVATIVES, TABLE, np.concatenate(pairs), first)
    gram = dense_jacobian().T @ dense_jacobian()
    np.testing.assert_allclose(blocks, [gram[:6, 6:12], gram[6:12, 6:12]], atol=1e-12)


def test_grains_are_mapped_in_this_process():
    def volumes(grains, pose, images, settings):
        return settings * grains.shapes.prod(axis=1) + images[0].sum() + pose.translations[:, 1]

    rows = CPU.map_grains(volumes, ARRAYS, POSE, (np.ones(3),), 2.0)
    np.testing.assert_allclose(rows, 2.0 * ARRAYS.shapes.prod(axis=1) + 3 + [-0.02, 0.05])
