"""The Eulerian projector, which the paper's §3 argues against: move the voxels, then project them.

Each grain's voxels are rotated and shifted onto the sample's grid by trilinear resampling, afresh at each
evaluation, and that image is projected.  It plugs into the package's solver in place of the Lagrangian
projector, which pulls rays back into voxels that stay as they are.  As projection is linear, each grain is
resampled into a box of its own, cut from the sample's grid: the sum is that of the whole sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.kernels import resample
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Derivatives, Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import project_patches
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping

STEP_VOXELS = 0.01  # of a voxel: the same finite differences as the Lagrangian projector's
RESAMPLING_MARGIN = 2  # voxels by which resampling widens a grain: √3, rounded up


class EulerianProblem(StateProblem):
    """The residual of one state, its grains resampled onto the sample's grid; derivatives are differences."""

    def simulate(self, pose: Pose, geometry: Geometry) -> tuple[Patches, Image, Image]:
        """Patches of resampled grains, their line integrals, and differences of these."""
        patches = footprint_patches(_widened(self.grains), pose, geometry, margin=len(self.target.kernel) - 1)
        values = self._project(pose, patches)
        derivatives = np.empty((6, len(values)), values.dtype)
        shift = STEP_VOXELS * self.grains.voxel_size
        rotation = shift / float(self.grains.radii.max())
        for k, step in enumerate([shift] * 3 + [rotation] * 3):
            moved = self.retract(pose, np.tile(step * np.eye(6)[k], len(self.grains)))
            derivatives[k] = (self._project(moved, patches) - values) / step
        return patches, values, derivatives

    def _project(self, pose: Pose, patches: Patches) -> NDArray[np.floating]:
        """Resample all grains, then project their images without any further motion."""
        still = Pose(pose.translations, np.broadcast_to(np.eye(3), pose.matrices.shape).copy())
        images = resampled(self.grains, pose)
        return project_patches(images, still, self.target.scan.geometry, patches, self.target.projector)


def resampled(grains: GrainArrays, pose: Pose) -> GrainArrays:
    """The grains' images in the sample's grid at a pose; their corners are relative to the moved centres."""
    h = grains.voxel_size
    images, corners = [], np.empty_like(grains.corners)
    for k, (shape, corner) in enumerate(zip(grains.shapes, grains.corners, strict=True)):
        source = grains.images[grains.starts[k] :][: np.prod(shape)].reshape(shape)
        # Voxels of the grid are counted from the grain's own first one, which lies on the grid.
        reach = (grains.hulls[k] @ pose.matrices[k].T + pose.translations[k] - corner) / h
        low = np.floor(reach.min(axis=0)).astype(np.int64) - RESAMPLING_MARGIN - PADDING
        size = np.ceil(reach.max(axis=0)).astype(np.int64) + RESAMPLING_MARGIN + PADDING + 1 - low
        back = np.ascontiguousarray(pose.matrices[k].T)
        corners[k] = corner + h * low - pose.translations[k]
        image = np.zeros(size[::-1], source.dtype)
        edge = np.full(3, PADDING, np.int64)
        resample.add_moved(source, back, (back @ corners[k] - corner) / h, edge, size - edge, image)
        images.append(image)
    sizes = [image.size for image in images]
    return replace(
        grains,
        images=np.concatenate([image.ravel() for image in images]),
        starts=np.cumsum([0, *sizes[:-1]]).astype(np.int64),
        shapes=np.array([image.shape for image in images], dtype=np.int64),
        corners=corners,
    )


def track_by_filters(
    problem: type[StateProblem],
    grains: GrainSet,
    scan: Scan,
    start: Motions,
    filters: tuple[float, ...] = (6.0, 2.0, 0.7),
    derivatives: Derivatives = "analytic",
) -> Motions:
    """All grains free from a start, filter by filter and nothing else, by the problem given.

    Every grain gets the status *converged*; only the comparison with the truth can fail it.
    """
    packed = GrainArrays.of(grains)
    fixed = np.zeros(scan.line_integrals.shape, packed.images.dtype)
    pose = Pose(start.translations, rotation_matrix(start.rotations))
    iterations = 0
    for width in filters:
        target = Target(scan, fixed, "trilinear", sigma=width, derivatives=derivatives)
        tolerance = 2e-3 if width == filters[-1] else 0.02
        solution = gauss_newton(problem(packed, target), pose, Stopping(30, tolerance))
        pose, iterations = solution.state, iterations + solution.iterations
    n = len(grains)
    return replace(
        start,
        translations=pose.translations,
        rotations=rotation_vector(pose.matrices),
        statuses=np.full(n, Status.CONVERGED.value, dtype="<U20"),
        iterations=np.full(n, iterations),
    )


def _widened(grains: GrainArrays) -> GrainArrays:
    """The same with hulls widened by the resampling, so that footprints contain all of it."""
    lengths = np.linalg.norm(grains.hulls, axis=2, keepdims=True)
    return replace(grains, hulls=grains.hulls * (1 + RESAMPLING_MARGIN * grains.voxel_size / np.maximum(lengths, 1e-9)))
