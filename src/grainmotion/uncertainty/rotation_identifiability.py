"""Identifiability of rotations: which rotations of a grain the radiographs confirm.

A ball may rotate freely, yet derivatives do not show it: its voxel image is never quite round, and the pattern of its
voxels (partial volumes, noise of the reconstruction) rotates with it in the simulation.  H then holds information
about rotations that the radiographs do not hold, and its covariance is a fraction of a degree where nothing is known.
So each grain is rotated by ±θ, its rim moving by four voxels, about the principal axes of its own rotations in H.
With ΔP the simulated change after a least-squares fit of translations, and r the residual,

    D = ‖ΔP‖²,    confirmed = (‖r − ΔP‖² − ‖r‖²) / D = 1 − 2 r·ΔP / D,    coherent = D / (θ² H).

``confirmed`` is the share of the change that the radiographs contradict, as they should: 1 for a shape that they hold
too, 0 for a pattern that only the reference has.  ``coherent`` is 1 for a quadratic minimum and falls to 0 for a
pattern finer than the rotation.  Gravel has 0.9 to 1.1 and 0.5 to 1, balls −0.2 to 0.5 and 0.02 to 0.1 (45 and 20
voxels across, 4 views).
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
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grain_tasks import mapper_of
from grainmotion.projection.grains import differentiate_patches, project_patches
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.projection.patch_products import products_by_grain
from grainmotion.rotations import rotation_matrix
from grainmotion.solvers.semidefinite import pseudo_inverse

TRIAL_RIM_SHIFT, MAX_TRIAL_ROTATION = 4.0, 0.5
"""Voxels that a trial rotation moves the rim of a grain by; radians at most."""
CONFIRMED_SHARE = 0.9
"""Confirmed share from which a rotation is identifiable."""
UNCONFIRMED_SHARE, INCOHERENT_SHARE = 0.5, 0.3
"""A rotation is not identifiable below this confirmed share, nor below `CONFIRMED_SHARE` if less coherent than this."""
GRAINS_PER_BATCH = 256
"""Grains treated together, so that memory does not grow with their number."""
UNIFORM_ANGLE_VARIANCE = np.pi**2 / 3
"""Variance of an angle that may have any value."""


def unconfirmed_rotations(
    problem: StateProblem, pose: Pose, evaluation: Evaluation, rows: NDArray[np.int64] | None = None
) -> Float:
    """Covariance ``(n, 3, 3)``, rad², of rotations that the radiographs do not confirm; zero where they do.

    Only those of the grains of ``rows`` are found if they are given.
    """
    target, grains = problem.target, problem.grains
    factor = target.root_weights * evaluation.response.derivative(evaluation.line_integrals)
    views = corrected_geometry(target.scan.geometry, pose.nuisance)
    setup = _ProjectionSetup(views, target.projector, target.kernel, grains.centers.mean(axis=0))
    images = factor, evaluation.residual
    if rows is not None:
        grains, pose = grains.select(rows), pose.moved(pose.translations[rows], pose.matrices[rows])
        if not len(rows):
            return np.zeros((0, 3, 3))
    return mapper_of(grains)(_unconfirmed_in_batches, grains, pose, images, setup)


def shifts_by_rotations(unconfirmed: Float, blocks: Float) -> Float:
    """Covariances ``(n, 3, 3)``, mm², of translations by rotations that the radiographs do not confirm.

    The centre of mass of a ball's voxels is off its middle by some vector e, which the radiographs do not show either:
    where the ball is rotated by R and its voxels are not, they put the centre at (R − 1) e from its place.  The
    information ``blocks (n, 6, 6)`` of the grains tell e, as a rotation δ about the centre moves the middle by δ × e.
    A uniform R gives (R − 1) e a variance of |e|²/3 across e, and so a third of that of δ × e for δ of variance 1.
    """
    across = pseudo_inverse(blocks[:, :3, :3]) @ blocks[:, :3, 3:]
    levers = (across - np.swapaxes(across, 1, 2)) / 2
    largest = np.linalg.eigvalsh(unconfirmed)[:, -1]
    shares = unconfirmed / np.maximum(largest, UNIFORM_ANGLE_VARIANCE)[:, None, None]
    return np.asarray(levers @ shares @ np.swapaxes(levers, 1, 2)) / 3


@dataclass(frozen=True, eq=False)
class _ProjectionSetup:
    """How grains are projected; ``middle (3,)`` is the mean centre of all grains, so that batches do not matter."""

    geometry: Geometry
    projector: Projector
    kernel: Image
    middle: Float


def _unconfirmed_in_batches(
    grains: GrainArrays, pose: Pose, images: tuple[Image, ...], setup: _ProjectionSetup
) -> Float:
    """`unconfirmed_rotations` of some grains, batch by batch."""
    n, (factor, residual) = len(grains), images
    out = np.zeros((n, 3, 3))
    for k in counted(range(0, n, GRAINS_PER_BATCH)):
        rows = np.arange(k, min(k + GRAINS_PER_BATCH, n))
        out[rows] = _unconfirmed(grains, pose, factor, residual, setup, rows)
    return out


def _unconfirmed(
    grains: GrainArrays, pose: Pose, factor: Image, residual: Image, setup: _ProjectionSetup, rows: NDArray[np.int64]
) -> Float:
    """Those of ``rows``.  Rotations to one side confirm most grains; both sides are tried for the others."""
    trials = _TrialRotations.of(grains, pose, factor, setup, rows)
    squares, dots = trials.changes_and_products(1, residual)
    with np.errstate(divide="ignore", invalid="ignore"):
        identifiable = (1 - 2 * dots / squares >= CONFIRMED_SHARE).all(axis=1)
    doubtful = np.nonzero(~identifiable)[0]
    out = np.zeros((len(rows), 3, 3))
    if not len(doubtful):
        return out
    if len(doubtful) < len(rows):
        trials = trials.select(doubtful)
    others = trials.changes_and_products(-1, residual)
    squares, dots = squares[doubtful] + others[0], dots[doubtful] + others[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        confirmed = 1 - 2 * dots / squares
        coherent = squares / (2 * trials.angles[:, None] ** 2 * trials.information)
    free = (confirmed < UNCONFIRMED_SHARE) | ((confirmed < CONFIRMED_SHARE) & (coherent < INCOHERENT_SHARE))
    out[doubtful] = UNIFORM_ANGLE_VARIANCE * np.einsum("nia,na,nja->nij", trials.axes, free.astype(float), trials.axes)
    return out


@dataclass(frozen=True, eq=False)
class _TrialRotations:
    """Some grains that are to be rotated by ``angles (n,)`` about their ``axes (n, 3, 3)`` (columns).

    ``derivatives`` are filtered, in ``patches``, ``normal (n, 6, 6)`` is H of each grain alone, ``information (n, 3)``
    that of its rotations about the axes.
    """

    setup: _ProjectionSetup
    factor: Image
    grains: GrainArrays
    pose: Pose
    angles: Float
    patches: Patches
    values: Image
    derivatives: Image
    normal: Float
    axes: Float
    information: Float

    @classmethod
    def of(
        cls, all_grains: GrainArrays, pose: Pose, factor: Image, setup: _ProjectionSetup, rows: NDArray[np.int64]
    ) -> _TrialRotations:
        grains = all_grains.select(rows)
        here = pose.moved(pose.translations[rows], pose.matrices[rows])
        angles = np.minimum(TRIAL_RIM_SHIFT * grains.unit / grains.radii, MAX_TRIAL_ROTATION)
        patches = _patches(grains, here, angles, setup)
        values, derivatives = differentiate_patches(grains, here, setup.geometry, patches, setup.projector)
        CPU.filter_patches(derivatives, patches.table, factor, setup.kernel)
        normal = PatchNormalMatrix(PatchJacobian(derivatives, patches)).blocks()
        information, axes = np.linalg.eigh(_rotations(normal))
        return cls(setup, factor, grains, here, angles, patches, values, derivatives, normal, axes, information)

    def select(self, which: NDArray[np.int64]) -> _TrialRotations:
        """Some of the grains."""
        grains, pose = self.grains.select(which), self.pose
        here, angles = pose.moved(pose.translations[which], pose.matrices[which]), self.angles[which]
        starts = self.patches.grain_offsets
        pixels = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in which])
        return _TrialRotations(
            self.setup, self.factor, grains, here, angles, _patches(grains, here, angles, self.setup),
            self.values[pixels], self.derivatives.take(pixels, axis=1), self.normal[which], self.axes[which],
            self.information[which],
        )  # fmt: skip

    def changes_and_products(self, sign: int, residual: Image) -> tuple[Float, Float]:
        """D and r·ΔP of rotations about each axis to one side, ``(n, 3)`` each."""
        setup, patches = self.setup, self.patches
        changes = np.zeros_like(self.derivatives)  # three of six are used: kernels take six
        for axis in range(3):
            rotations = rotation_matrix(sign * self.angles[:, None] * self.axes[:, :, axis])
            pose = self.pose.moved(self.pose.translations, rotations @ self.pose.matrices)
            changes[axis] = project_patches(self.grains, pose, setup.geometry, patches, setup.projector) - self.values
        CPU.filter_patches(changes[:3], patches.table, self.factor, setup.kernel)
        self._remove_translations(changes[:3])
        squares = np.diagonal(products_by_grain(changes[:3], changes[:3], patches), axis1=1, axis2=2)
        return squares, PatchJacobian(changes, patches).gradient(residual)[:, :3]

    def _remove_translations(self, changes: Image) -> None:
        """Take the best fit by translations of the grain from the changes, in place."""
        derivatives, starts = self.derivatives, self.patches.grain_offsets
        shifts = pseudo_inverse(self.normal[:, :3, :3]) @ products_by_grain(derivatives[:3], changes, self.patches)
        for shift, start, end in zip(shifts, starts, starts[1:], strict=False):
            changes[:, start:end] -= shift.T.astype(derivatives.dtype) @ derivatives[:3, start:end]


def _patches(grains: GrainArrays, pose: Pose, angles: Float, setup: _ProjectionSetup) -> Patches:
    """Footprints of grains that hold those of all trial rotations."""
    hulls = _with_rotated_hulls(grains, angles)
    return footprint_patches(hulls, pose, setup.geometry, len(setup.kernel) - 1, setup.middle)


def _with_rotated_hulls(grains: GrainArrays, angles: Float) -> GrainArrays:
    """The same grains with hulls that hold those of all trial rotations."""
    radii = np.linalg.norm(grains.hulls, axis=2, keepdims=True)
    margin = angles[:, None, None] * radii.max(axis=1, keepdims=True)
    return replace(grains, hulls=grains.hulls * (1 + margin / np.maximum(radii, grains.unit)))


def _rotations(matrices: Float) -> Float:
    """Schur complement ``(n, 3, 3)`` of each grain's 6×6 block on its rotations."""
    across = pseudo_inverse(matrices[:, :3, :3]) @ matrices[:, :3, 3:]
    complement = matrices[:, 3:, 3:] - matrices[:, 3:, :3] @ across
    return (complement + complement.transpose(0, 2, 1)) / 2
