"""Fisher information of a view on the motions of the grains.

A pixel whose line integral is p, made of N e^−p photons, has the variance e^p/N.  That of the model, whose voxels
blur every surface, is added to it: (κ μ h)² with h the voxel, μ the grains' mean attenuation and κ a number near 1,
so that the weight is w = 1/(e^p/N + (κ μ h)²).  With J the derivatives of the line integrals by (u, δ) of all grains
in the reference state, and K = [p, 1] those by gain and offset, a view's information is

    ⎡ Jᵀ w J   Jᵀ w K ⎤
    ⎣ Kᵀ w J   Kᵀ w K ⎦

and that of a set of views is the sum of theirs.  Its inverse bounds the covariance of every unbiased estimate
(Cramér and Rao).  A prior on each grain, of its own diameter and a quarter turn, keeps the variance of what no view
determines finite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.planning.settings import PlanSettings
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, GrainArrays, planar
from grainmotion.projection.grains import assemble, differentiate_patches
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.projection.volumes import project
from grainmotion.solvers.block_cg import diagonal_blocks

MAX_EXACT_UNKNOWNS = 3000
"""Unknowns up to which the full matrix of a set of views is inverted."""
COUPLED_NEIGHBOURS = 40
"""Grains whose coupling is kept around each, beyond that."""


@dataclass(frozen=True, eq=False)
class ViewInformation:
    """One view's information: ``matrix (6n, 6n)``, ``border (6n, 2)`` and ``corner (2, 2)`` of gain and offset."""

    matrix: sparse.bsr_array
    border: Float
    corner: Float

    def __add__(self, other: ViewInformation) -> ViewInformation:
        """Information is additive over views."""
        total = sparse.bsr_array(self.matrix + other.matrix)
        return ViewInformation(total, self.border + other.border, self.corner + other.corner)

    def dense(self, gain: bool) -> Float:
        """The whole matrix, ``(6n + 2, 6n + 2)`` with gain and offset, ``(6n, 6n)`` without."""
        motions: Float = self.matrix.toarray()
        return np.block([[motions, self.border], [self.border.T, self.corner]]) if gain else motions


@dataclass(frozen=True, eq=False)
class Candidates:
    """The views to choose from, and the grains that they see in the reference state."""

    grains: GrainSet
    geometry: Geometry
    settings: PlanSettings

    @cached_property
    def grain_arrays(self) -> GrainArrays:
        """The grains as the kernels take them."""
        return GrainArrays.of(self.grains)

    @property
    def pose(self) -> Pose:
        """No motion."""
        n = len(self.grain_arrays)
        return Pose(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))

    @property
    def prior(self) -> Float:
        """Information ``(n, 6)`` before any view: standard deviations of a diameter and a quarter turn."""
        radii = self.grain_arrays.radii[:, None]
        rotations = np.full((len(radii), 3), 1 / (np.pi / 2) ** 2)
        return np.hstack([np.repeat(1 / (2 * radii) ** 2, 3, axis=1), rotations])

    @cached_property
    def attenuation(self) -> float:
        """Mean attenuation of the grains, weighted by attenuation, 1/mm."""
        images = self.grain_arrays.images
        return float(np.vdot(images, images) / images.sum(dtype=float))

    def information(self, view: int) -> ViewInformation:
        """The information of one candidate; only that view's derivatives are in memory."""
        geometry, pose, n = self.geometry[view], self.pose, len(self.grain_arrays)
        patches = footprint_patches(self.grain_arrays, pose, geometry)
        if not len(patches.boxes):
            nothing = sparse.bsr_array((6 * n, 6 * n), blocksize=(6, 6))
            return ViewInformation(nothing, np.zeros((6 * n, 2)), np.zeros((2, 2)))
        values, derivatives = differentiate_patches(self.grain_arrays, pose, geometry, patches, "trilinear")
        image = assemble(values, patches, geometry).astype(float)
        if self.grains.background is not None:
            image += project(self.grains.background, geometry)
        model = self.settings.model_error * self.attenuation * self.grain_arrays.voxel_size
        weights = 1 / (np.exp(image) / self.settings.photons + model**2)  # one over the variance of each pixel
        # In double precision, so that rounding in sums over pixels leaves the matrix positive definite.
        scaled = derivatives.astype(float)
        roots = np.sqrt(weights)[0]
        for box, start in zip(patches.boxes, patches.offsets, strict=False):
            _, _, r0, r1, c0, c1 = box
            scaled[:, start : start + (r1 - r0) * (c1 - c0)] *= roots[r0:r1, c0:c1].ravel()
        columns, jacobian = [image * np.sqrt(weights), np.sqrt(weights)], PatchJacobian(scaled, patches)
        border = np.stack([jacobian.gradient(column) for column in columns], axis=-1)
        corner = np.array([[np.vdot(a, b) for a in columns] for b in columns], dtype=float)
        return ViewInformation(normal_matrix(jacobian), border.reshape(-1, 2), corner)

    def covariances(self, views: Sequence[int]) -> Float:
        """Covariances ``(n, 6, 6)`` of (u, δ) from a set of views, coupling between grains included.

        Beyond `MAX_EXACT_UNKNOWNS` unknowns each grain is taken with the `COUPLED_NEIGHBOURS` grains that it is coupled
        to most; all others are fixed.
        """
        total = self.information(views[0])
        for view in views[1:]:
            total = total + self.information(view)
        n = len(self.grain_arrays)
        if 6 * n <= MAX_EXACT_UNKNOWNS:
            return self.clean(invert(total.dense(self.settings.gain), self.prior))
        matrix = sparse.csr_array(total.matrix)
        out = np.empty((n, 6, 6))
        for i, near in enumerate(_neighbourhoods(total)):
            rows = (6 * near[:, None] + np.arange(6)).ravel()
            part = matrix[rows][:, rows].toarray()
            if self.settings.gain:
                part = np.block([[part, total.border[rows]], [total.border[rows].T, total.corner]])
            out[i] = invert(part, self.prior[near])[0]
        return self.clean(out)

    def clean(self, covariances: Float) -> Float:
        """The same without the variances of motions out of the plane of a planar sample."""
        if planar(self.grain_arrays, self.geometry):
            covariances = covariances.copy()
            covariances[:, OUT_OF_PLANE, :] = covariances[:, :, OUT_OF_PLANE] = 0
        return covariances

    def surface_sd(self, covariances: Float) -> Float:
        """Root mean square displacement ``(n,)`` of each grain's surface per component, mm.

        A point y of a sphere of radius r moves by u + δ × y: on average over the sphere its mean square is
        tr cov(u) + ⅔ r² tr cov(δ), divided here by the three components.
        """
        spread = np.einsum("nkk->nk", covariances)
        return np.sqrt((spread[:, :3].sum(1) + 2 / 3 * self.grain_arrays.radii**2 * spread[:, 3:].sum(1)) / 3)


def invert(information: Float, prior: Float) -> Float:
    """Diagonal 6×6 blocks ``(n, 6, 6)`` of the inverse of ``(6n, 6n)`` or ``(6n + 2, 6n + 2)``, prior ``(n, 6)``."""
    n, size = len(prior), information.shape[-1]
    matrix = information.copy()
    diagonal = np.einsum("...kk->...k", matrix)
    diagonal[..., : 6 * n] += prior.ravel()
    if size > 6 * n:  # gain and offset are unknown to within 1, far more than any image leaves them
        diagonal[..., 6 * n :] += 1.0
    scale = 1 / np.sqrt(diagonal)
    inverse = np.linalg.inv(matrix * scale[..., :, None] * scale[..., None, :])
    inverse *= scale[..., :, None] * scale[..., None, :]
    motions = inverse[..., : 6 * n, : 6 * n].reshape(*inverse.shape[:-2], n, 6, n, 6)
    return np.moveaxis(np.diagonal(motions, axis1=-4, axis2=-2), -1, -3)


def _neighbourhoods(total: ViewInformation) -> list[NDArray[np.int64]]:
    """Each grain, first, with those whose coupling to it is strongest."""
    matrix, out = total.matrix, []
    own = np.sqrt(np.einsum("nkk->n", diagonal_blocks(total.matrix))) + 1e-300
    for i in range(len(own)):
        part = slice(matrix.indptr[i], matrix.indptr[i + 1])
        near = matrix.indices[part]
        strength = np.linalg.norm(matrix.data[part], axis=(1, 2)) / own[near]
        near = near[np.argsort(-strength, kind="stable")]
        out.append(np.concatenate([[i], near[near != i][:COUPLED_NEIGHBOURS]]).astype(np.int64))
    return out
