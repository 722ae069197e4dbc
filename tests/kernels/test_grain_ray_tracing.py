"""Ray tracing through a grain: planes without filled voxels are skipped, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.kernels import grain_ray_tracing
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import differentiate_patches, project_patches
from grainmotion.rotations import rotation_matrix
from three_lumps import VOXEL


def whole_box(arrays):
    """The same grains as if every voxel of their crops were filled."""
    faces = np.array([[np.zeros(3), shape[::-1] - 1] for shape in arrays.shapes])
    corners = np.stack(np.meshgrid(*[(0, 1)] * 3), -1).reshape(-1, 3)
    positions = np.array([np.where(corners, high, low) for low, high in faces]) @ grain_ray_tracing.DIRECTIONS.T.astype(
        float
    )
    return replace(arrays, extents=np.stack([positions.min(axis=1), positions.max(axis=1)], axis=1).astype(np.float32))


class TestExtents:
    """The extents of a grain restrict rays to its filled voxels."""

    @staticmethod
    def grain(kind, rng):
        array = np.zeros((9, 12, 10))
        inner = array[2:-2, 2:-2, 2:-2]
        if kind == "full":
            inner[:] = rng.uniform(-1, 1, inner.shape)
        elif kind == "few voxels":
            inner[tuple(rng.integers(0, n, 6) for n in inner.shape)] = 1
        elif kind == "one voxel":
            inner[2, 5, 1] = 1
        elif kind == "plate":
            inner[2] = rng.uniform(size=inner.shape[1:])
        elif kind == "oblique rod":
            for k in range(5):
                inner[k, k + 1, k] = inner[k, k, k] = 1
        return array

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    @pytest.mark.parametrize("kind", ["full", "few voxels", "one voxel", "plate", "oblique rod", "empty"])
    def test_skipped_planes_are_empty(self, kind, beam, projector):
        rng = np.random.default_rng(3)
        angles = (0.0, 45.0, 90.0, 200.0)
        geometry = (
            Geometry.cone(angles, (34, 34), 4 * 0.6 * VOXEL, source_to_axis=30, source_to_detector=120)
            if beam == "cone"
            else Geometry.parallel(angles, (34, 34), 0.6 * VOXEL)
        )
        grain = Grain(1, Volume(self.grain(kind, rng), VOXEL), np.array([0.03, 0.0, -0.05]))
        arrays = GrainArrays.of(GrainSet((grain,)))
        for rotation in ([0, 0, 0], [0, 0, np.pi / 4], *rng.uniform(-3, 3, (6, 3))):
            pose = Pose(rng.uniform(-1, 1, (1, 3)) * VOXEL, rotation_matrix([rotation]))
            patches = footprint_patches(arrays, pose, geometry)
            computed = differentiate_patches(arrays, pose, geometry, patches, projector)
            expected = differentiate_patches(whole_box(arrays), pose, geometry, patches, projector)
            for one, other in zip(computed, expected, strict=True):
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * max(1.0, np.abs(other).max()))
            np.testing.assert_allclose(
                project_patches(arrays, pose, geometry, patches, projector), computed[0], rtol=0, atol=1e-12
            )
            assert computed[0].any() == (kind != "empty")
