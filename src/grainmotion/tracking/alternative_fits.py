"""Fits of single grains from other poses, their neighbours fixed, and whether the radiographs contradict the results.

With D the change of the simulated radiographs from the pose found to the alternative, and r the residual of the former,

    contradicted = (‖r − D‖² − ‖r‖²) / ‖D‖² = 1 − 2 r·D / ‖D‖²,

as in `uncertainty.rotation_identifiability`: 1 if the radiographs hold the difference, 0 if it is only the reference's
own noise, which the alternative rotates, and −1 if they hold the alternative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Projector
from grainmotion.backends.cpu import CPU
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.normal_matrix import PatchNormalMatrix
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays, ball_directions
from grainmotion.projection.grain_tasks import mapper_of
from grainmotion.projection.grains import differentiate_patches, project_patches
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.projection.patch_products import products_by_grain
from grainmotion.rotations import rotation_matrix
from grainmotion.solvers.semidefinite import pseudo_inverse

STEPS, COARSE_STEPS = 4, 2
"""Gauss–Newton steps of an alternative, and how many of them are on the reference's voxels where there are finer ones:
rays through these take more than twice as long."""
TOLD_APART_SHARE, TOLD_APART_DEVIATIONS = 0.7, 16.0
"""Contradicted share and standard deviations of ‖r‖² on the reference's voxels, from which an alternative is told apart
without steps on finer ones."""
ALIKE_DEVIATIONS = (-1.0, 2.0)
"""Standard deviations between which it is as good there, and needs none either if no grain is to move to it: of 1,235
of ellipsoids 10 are told apart after all.  Those of a cube that was 12 degrees off are −2 to −3 there, −4 to −5 in the
end."""
MAX_STEP_VOXELS = 2.0
"""Largest displacement of a grain's surface in one of them."""
BALL_MARGIN_VOXELS = 4.0
"""How far beyond the ball around a grain an alternative may reach."""
CANDIDATES_PER_BATCH = 64
"""Alternatives fitted together, so that memory does not grow with their number."""


@dataclass(frozen=True, eq=False)
class AlternativeFits:
    """Alternatives after their fits.

    ``owners (k,)`` are the rows of their grains, ``translations (k, 3)`` (mm) and ``matrices (k, 3, 3)`` their poses;
    ``contradicted (k,)`` as at the top of this module, and ``deviations (k,)`` the increase of ‖r‖² over its standard
    deviation.
    """

    owners: NDArray[np.int64]
    translations: Float
    matrices: Float
    contradicted: Float
    deviations: Float

    def select(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> AlternativeFits:
        """Some of them."""
        return AlternativeFits(*(each[which] for each in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Setup:
    """How alternatives are projected and compared, and the steps to take; ``middle (3,)`` as in `footprint_patches`."""

    geometry: Geometry
    projector: Projector
    kernel: Image
    middle: Float
    steps: int


def fit_alternatives(
    problem: StateProblem,
    pose: Pose,
    evaluation: Evaluation,
    owners: NDArray[np.int64],
    matrices: Float,
    coarse: GrainArrays,
    wanted: NDArray[np.bool_],
) -> AlternativeFits:
    """Fit each of some alternatives of grains ``owners (k,)``, which start rotated to ``matrices (k, 3, 3)``.

    Those of a grain follow each other.  ``coarse`` are the same grains as the problem's on coarser voxels, or the same;
    to those ``wanted (k,)`` a grain may move.
    """
    target, grains = problem.target, problem.grains
    images = target.root_weights * evaluation.response.derivative(evaluation.line_integrals), evaluation.residual
    views, middle = corrected_geometry(target.scan.geometry, pose.nuisance), grains.centers.mean(axis=0)
    start = AlternativeFits(owners, pose.translations[owners], matrices, np.zeros(len(owners)), np.zeros(len(owners)))

    def fitted(arrays: GrainArrays, fits: AlternativeFits, steps: int) -> AlternativeFits:
        # each alternative follows the pose found, so that both stay together on a cluster
        twice = np.repeat(fits.owners, 2)
        both = pose.moved(pose.translations[twice], pose.matrices[twice])
        both.translations[1::2], both.matrices[1::2] = fits.translations, fits.matrices
        setup = _Setup(views, target.projector, target.kernel, middle, steps)
        out = mapper_of(arrays)(_in_batches, arrays.select(twice), both, images, setup)[1::2]
        return AlternativeFits(fits.owners, out[:, :3], out[:, 3:12].reshape(-1, 3, 3), out[:, 12], out[:, 13])

    if coarse.voxel_size <= grains.voxel_size:
        return fitted(grains, start, STEPS)
    near = fitted(coarse, start, COARSE_STEPS)
    open_ = (near.contradicted < TOLD_APART_SHARE) | (near.deviations < TOLD_APART_DEVIATIONS)
    alike = (near.deviations > ALIKE_DEVIATIONS[0]) & (near.deviations < ALIKE_DEVIATIONS[1])
    open_ &= wanted | ~alike
    if open_.any():
        last = fitted(grains, near.select(open_), STEPS - COARSE_STEPS)
        for name in ("translations", "matrices", "contradicted", "deviations"):
            vars(near)[name][open_] = vars(last)[name]
    return near


def _in_batches(grains: GrainArrays, pose: Pose, images: tuple[Image, ...], setup: _Setup) -> Float:
    """Translation, matrix, contradicted share and deviations of each alternative ``(n, 14)``, of every second row."""
    size, n = 2 * CANDIDATES_PER_BATCH, len(grains)
    out = np.zeros((n, 14))
    for k in counted(range(0, n, size)):
        rows = np.arange(k, min(k + size, n))
        out[rows[1::2]] = _fit(grains, pose, images, setup, rows)
    return out


def _fit(grains: GrainArrays, pose: Pose, images: tuple[Image, ...], setup: _Setup, rows: NDArray[np.int64]) -> Float:
    """Those of a batch, ``(k, 14)``."""
    own = grains.select(rows[1::2])
    found = pose.moved(pose.translations[rows[::2]], pose.matrices[rows[::2]])
    factor, all_residuals = images
    patches = footprint_patches(_balls(own), found, setup.geometry, len(setup.kernel) - 1, setup.middle)
    residual = np.concatenate([all_residuals[v, a:b, c:d].ravel() for _, v, a, b, c, d in patches.boxes])
    before = _projected_once(own, found, setup)
    translations, matrices = pose.translations[rows[1::2]], pose.matrices[rows[1::2]]

    def change(values: Image) -> Image:
        images = (values - before)[None]
        CPU.filter_patches(images, patches.table, factor, setup.kernel)
        return images

    for _ in range(setup.steps):
        here = found.moved(translations, matrices)
        values, derivatives = differentiate_patches(own, here, setup.geometry, patches, setup.projector)
        CPU.filter_patches(derivatives, patches.table, factor, setup.kernel)
        left = residual - change(values).astype(float)
        normal = PatchNormalMatrix(PatchJacobian(derivatives, patches)).blocks()
        gradient = products_by_grain(derivatives, left, patches)[:, :, 0]
        steps = np.einsum("nij,nj->ni", pseudo_inverse(normal), gradient)
        size = np.linalg.norm(steps[:, :3], axis=1) + np.linalg.norm(steps[:, 3:], axis=1) * own.radii
        steps *= np.minimum(1.0, MAX_STEP_VOXELS * own.unit / np.maximum(size, 1e-300))[:, None]
        translations, matrices = translations + steps[:, :3], rotation_matrix(steps[:, 3:]) @ matrices
    here = found.moved(translations, matrices)
    difference = change(project_patches(own, here, setup.geometry, patches, setup.projector))
    squares, products = products_by_grain(difference, np.concatenate([difference, residual[None]]), patches)[:, 0].T
    shaded = (before > 0)[None].astype(residual.dtype)
    count, total = products_by_grain(shaded, np.stack([shaded[0], residual**2]), patches)[:, 0].T
    spread = np.sqrt(total / np.maximum(count, 1)) / _white_share(setup.kernel)
    increase = squares - 2 * products
    return np.column_stack([
        translations, matrices.reshape(-1, 9), increase / np.maximum(squares, 1e-300),
        increase / np.maximum(2 * spread * np.sqrt(squares), 1e-300),
    ])  # fmt: skip


def _projected_once(grains: GrainArrays, found: Pose, setup: _Setup) -> Image:
    """The line integrals of grains where they were found, of which those of one follow each other and are the same."""
    first = np.diff(grains.starts, prepend=-1) != 0
    each, here = grains.select(np.flatnonzero(first)), found.moved(found.translations[first], found.matrices[first])
    patches = footprint_patches(_balls(each), here, setup.geometry, len(setup.kernel) - 1, setup.middle)
    values = project_patches(each, here, setup.geometry, patches, setup.projector)
    starts = patches.grain_offsets
    return np.concatenate([values[starts[k] : starts[k + 1]] for k in np.cumsum(first) - 1])


def _white_share(kernel: Image) -> float:
    """Standard deviation of filtered white noise over that of the noise."""
    return float(2 * (kernel.astype(float) ** 2).sum() - kernel[0] ** 2)


def _balls(grains: GrainArrays) -> GrainArrays:
    """The grains with hulls that hold them at any rotation, and a little beyond."""
    reach = np.linalg.norm(grains.hulls, axis=2).max(axis=1) + BALL_MARGIN_VOXELS * grains.unit
    return replace(grains, hulls=reach[:, None, None] * ball_directions())
