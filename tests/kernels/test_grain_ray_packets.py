"""Eight rays at once: each is what one ray alone is, whichever rays are beside it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from grainmotion.kernels.cuda import grain_ray_tracing as one_ray
from grainmotion.kernels.grain_ray_tracing import between, row_of_rays
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import differentiate_patches, project_patches
from grainmotion.rotations import rotation_matrix
from three_lumps import VOXEL

GEOMETRIES = {
    "cone": Geometry.cone((0.0, 90.0, 47.0), (30, 34), 4 * 0.6 * VOXEL, source_to_axis=4.0, source_to_detector=16.0),
    "parallel": Geometry.parallel((0.0, 45.0, 90.0), (30, 34), 0.6 * VOXEL),
}


def grain(precision=np.float64):
    inner = np.random.default_rng(1).uniform(0.5, 1.5, (7, 11, 9))
    array = np.pad(inner, 2).astype(precision)
    return GrainArrays.of(GrainSet((Grain(1, Volume(array, VOXEL), np.array([0.02, 0.01, -0.03])),)))


def pose(rotation):
    return Pose(np.array([[0.4, -0.7, 0.2]]) * VOXEL, rotation_matrix([rotation]))


def ray_by_ray(arrays, at, geometry, patches, exact):
    """Line integrals along all rays of the patches, by the functions of one ray, and the axes that are dominant."""
    found, axes = [], set()
    table = arrays.table(at)
    middle = (np.array(geometry.shape) - 1) / 2
    for p, row, c0, c1 in patches.jobs:
        view, cone = geometry.vectors[patches.boxes[p, 1]], geometry.beam == "cone"
        rays = row_of_rays(
            view, cone, row - middle[0], table.positions[0], table.rotations[0], table.corners[0], 1 / VOXEL
        )
        span = np.empty((2, c1 - c0), np.float32)
        between(table.extents[0], *rays, c0 - middle[1], span)
        for c, (low, high) in zip(range(c0, c1), span.T, strict=True):
            x = c - middle[1]
            o, d = (tuple(np.array(rays[k]) + x * np.array(rays[k + 1])) for k in (0, 2))
            ray = (table.voxels, table.shapes[0], o, d, low, high)
            found.append(one_ray.value_at(*ray, VOXEL, exact) if low <= high else 0.0)
            axes.add(int(np.argmax(np.abs(d))))
    return np.array(found), axes


def traced(patches):
    """Where the pixels of all runs lie in the flat arrays."""
    places = []
    for p, row, c0, c1 in patches.jobs:
        box = patches.boxes[p]
        places.append(patches.offsets[p] + (row - box[2]) * (box[5] - box[4]) + np.arange(c0, c1) - box[4])
    return np.concatenate(places)


@pytest.mark.parametrize("projector", ["trilinear", "exact"])
@pytest.mark.parametrize("beam", GEOMETRIES)
def test_eight_rays_have_the_integrals_of_each(beam, projector):
    arrays, geometry, seen = grain(), GEOMETRIES[beam], set()
    for rotation in ([0.0, 0.0, 0.0], [0.3, -1.1, 0.4]):
        at = pose(rotation)
        patches = footprint_patches(arrays, at, geometry)
        values, derivatives = differentiate_patches(arrays, at, geometry, patches, projector)
        expected, axes = ray_by_ray(arrays, at, geometry, patches, projector == "exact")
        np.testing.assert_allclose(values[traced(patches)], expected, atol=1e-12)
        np.testing.assert_allclose(project_patches(arrays, at, geometry, patches, projector), values, atol=1e-12)
        assert expected.any()
        assert derivatives.any()
        seen |= axes
    assert seen == {0, 1, 2}


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("projector", ["trilinear", "exact"])
@pytest.mark.parametrize("beam", GEOMETRIES)
def test_results_do_not_depend_on_the_rays_beside(beam, projector, precision):
    """Runs of pixels cut anywhere give the same bits."""
    arrays, geometry = grain(precision), GEOMETRIES[beam]
    rng = np.random.default_rng(2)
    for rotation in ([0, 0, 0], [0, 0, np.pi / 4], [0.3, -1.1, 0.4]):
        at = pose(rotation)
        patches = footprint_patches(arrays, at, geometry)
        pieces = []
        for p, row, c0, c1 in patches.jobs:
            cuts = [c0, *np.unique(rng.integers(c0, c1, 3)), c1]
            pieces += [(p, row, a, b) for a, b in pairwise(cuts) if a < b]
        cut = replace(patches, jobs=rng.permutation(np.array(pieces)))
        whole = traced(patches)
        for run in (differentiate_patches, project_patches):
            first, second = (run(arrays, at, geometry, q, projector) for q in (patches, cut))
            first, second = (np.concatenate([np.atleast_2d(a) for a in (x if isinstance(x, tuple) else (x,))])[:, whole]
                             for x in (first, second))  # fmt: skip
            assert first.any()
            assert np.array_equal(first, second)
