"""The D-DPC residual of one state, and its normal equations, for the solver.

Eq. 22 of Khalili et al. (2017), filtered:  r = F(b − a P(motions) − o), with F a Gaussian on each
radiograph (residual and derivatives alike) and gain a, offset o global or fixed at 1, 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion import motion
from grainmotion.kernels import normal
from grainmotion.packed import PackedGrains, Pose
from grainmotion.project import Patches, Projector, assemble, difference_patches, differentiate_patches, shadows
from grainmotion.scan import Scan
from grainmotion.solve import Linearization

Float = NDArray[np.float64]
Image = NDArray[np.floating]
Derivatives = Literal["analytic", "differences"]
Basis = Callable[[PackedGrains, Pose], Float]
"""From grains and pose to T ``(6n, m)``: the increments (u, δ) of all grains per unit of m parameters."""


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted: radiographs, what of them does not move, and how they are compared.

    ``fixed`` is the background's line integrals; ``gain`` says whether a and o are unknowns;
    ``derivatives`` says how those of P are taken.
    """

    scan: Scan
    fixed: Image
    projector: Projector
    sigma: float
    gain: bool
    derivatives: Derivatives = "analytic"

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision of the arithmetic: that of what is simulated."""
        return self.fixed.dtype

    @cached_property
    def weights(self) -> Image:
        """Half of the Gaussian's kernel, cut at 3σ, of unit sum."""
        return gaussian(self.sigma).astype(self.precision)

    @cached_property
    def valid(self) -> Image:
        """1 where a pixel counts, 0 where not."""
        if self.scan.valid is None:
            return np.ones(self.scan.line_integrals.shape, self.precision)
        return self.scan.valid.astype(self.precision)

    @cached_property
    def measured(self) -> Image:
        """Filtered radiographs."""
        return self.filtered(self.scan.line_integrals.astype(self.precision))

    @cached_property
    def flat(self) -> Image:
        """Filtered radiograph of ones: what a unit of offset adds."""
        return self.filtered(np.ones_like(self.valid))

    def unfiltered(self) -> Target:
        """The same comparison pixel by pixel."""
        return replace(self, sigma=0.0)

    def filtered(self, images: Image) -> Image:
        """Mask and filter a stack of radiographs."""
        out = images * self.valid
        if len(self.weights) > 1:
            normal.filter_images(out, self.weights)
        return out


@dataclass(frozen=True, eq=False)
class Seen:
    """Everything that one evaluation at a pose yields."""

    patches: Patches
    values: Image
    derivatives: Image
    residual: Image
    simulated: Image
    gain: float
    offset: float


@dataclass(frozen=True, eq=False)
class StateProblem:
    """The residual of one state as `solve.Problem`; ``basis`` ties the grains' motions together (None: all free)."""

    grains: PackedGrains
    target: Target
    basis: Basis | None = None

    def look(self, pose: Pose) -> Seen:
        """Simulate, compare and differentiate at a pose."""
        target, geometry = self.target, self.target.scan.geometry
        patches = shadows(self.grains, pose, geometry, margin=len(target.weights) - 1)
        differentiate = differentiate_patches if target.derivatives == "analytic" else difference_patches
        values, derivatives = differentiate(self.grains, pose, geometry, patches, target.projector)
        simulated = target.filtered(assemble(values, patches, geometry) + target.fixed)
        normal.filter_patches(derivatives, patches.boxes, patches.offsets, target.valid, target.weights)
        gain, offset = best_gain(target.measured, simulated, target.flat) if target.gain else (1.0, 0.0)
        residual = target.measured - gain * simulated - offset * target.flat
        return Seen(patches, values, derivatives, residual, simulated, gain, offset)

    def linearize(self, state: Pose) -> Linearization:
        """Cost ½‖r‖², gradient and block-sparse normal matrix at a pose."""
        seen = self.look(state)
        n = len(self.grains)
        hessian = normal_matrix(seen.derivatives, seen.patches, n) * seen.gain**2
        gradient = -seen.gain * self._dot(seen, seen.residual)
        border, corner = np.zeros((6 * n, 0)), np.zeros((0, 0))
        if self.target.gain:
            columns = (seen.simulated, self.target.flat)
            border = seen.gain * np.stack([self._dot(seen, c) for c in columns], axis=1)
            corner = np.array([[np.vdot(a, b) for a in columns] for b in columns], dtype=float)
        cost = 0.5 * float(np.vdot(seen.residual, seen.residual))
        if self.basis is None:
            return Linearization(cost, gradient, hessian, border, corner)
        tie = self.basis(self.grains, state)
        return Linearization(cost, tie.T @ gradient, tie.T @ (hessian @ tie), tie.T @ border, corner)

    def retract(self, state: Pose, step: Float) -> Pose:
        """Add translations; turn on the group, Ω ← exp[δ]ₓ Ω."""
        each = self._each(state, step)
        return Pose(state.translations + each[:, :3], motion.exp(each[:, 3:]) @ state.matrices)

    def size(self, state: Pose, step: Float) -> float:
        """Largest displacement of any grain's surface, in voxels."""
        each = self._each(state, step)
        moved = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * self.grains.radii
        return float(moved.max()) / self.grains.voxel_size

    def _each(self, state: Pose, step: Float) -> Float:
        full = step if self.basis is None else self.basis(self.grains, state) @ step
        return full.reshape(-1, 6)

    def _dot(self, seen: Seen, images: Image) -> Float:
        """Jᵀ images, ``(6n,)``, for the filtered ∂P of every grain."""
        parts = np.zeros((len(seen.patches.boxes), 6))
        normal.gradients(seen.derivatives, seen.patches.boxes, seen.patches.offsets, images, parts)
        out = np.zeros((len(self.grains), 6))
        np.add.at(out, seen.patches.boxes[:, 0], parts)
        return out.ravel()


def gaussian(sigma: float) -> Float:
    """Half of a Gaussian kernel (σ in pixels), cut at 3σ, of unit sum over both halves; [1] for σ = 0."""
    if sigma <= 0:
        return np.ones(1)
    k = np.exp(-0.5 * (np.arange(int(np.ceil(3 * sigma)) + 1) / sigma) ** 2)
    return k / (2 * k.sum() - k[0])


def best_gain(measured: Image, simulated: Image, flat: Image) -> tuple[float, float]:
    """Gain a and offset o that minimise ‖measured − a simulated − o flat‖; (1, 0) if nothing is simulated."""
    columns = (simulated, flat)
    corner = np.array([[np.vdot(a, b) for a in columns] for b in columns], dtype=float)
    if np.linalg.matrix_rank(corner, tol=1e-9 * corner.max()) < 2:
        return 1.0, 0.0
    gain, offset = np.linalg.solve(corner, [float(np.vdot(c, measured)) for c in columns])
    return float(gain), float(offset)


def normal_matrix(derivatives: Image, patches: Patches, n: int) -> sparse.bsr_array:
    """JᵀJ ``(6n, 6n)`` of filtered patches: grains couple where their patches overlap in a view."""
    boxes = patches.boxes
    pairs = _overlaps(boxes)
    grains = np.sort(boxes[pairs, 0], axis=1)
    swap = boxes[pairs[:, 0], 0] > boxes[pairs[:, 1], 0]
    pairs[swap] = pairs[swap][:, ::-1]
    key = grains[:, 0] * n + grains[:, 1]
    order = np.argsort(key, kind="stable")
    unique, first = np.unique(key[order], return_index=True)
    out = np.zeros((len(unique), 6, 6))
    bounds = np.append(first, len(order)).astype(np.int64)
    normal.blocks(derivatives, boxes, patches.offsets, np.ascontiguousarray(pairs[order]), bounds, out)
    i, j = unique // n, unique % n
    off = i != j
    rows, columns = np.concatenate([i, j[off]]), np.concatenate([j, i[off]])
    data = np.concatenate([out, np.swapaxes(out[off], 1, 2)])
    order = np.lexsort((columns, rows))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return sparse.bsr_array((data[order], columns[order], indptr), shape=(6 * n, 6 * n))


def _overlaps(boxes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs (p, q), p <= q, of patches of one view that share pixels, each patch with itself included."""
    found = []
    for view in np.unique(boxes[:, 1]):
        index = np.nonzero(boxes[:, 1] == view)[0]
        index = index[np.argsort(boxes[index, 2], kind="stable")]
        b = boxes[index]
        ends = np.searchsorted(b[:, 2], b[:, 3], side="left")
        for k, end in enumerate(ends):
            other = np.arange(k, end)
            meets = (b[other, 4] < b[k, 5]) & (b[other, 5] > b[k, 4])
            meets[0] = True
            found.append(np.column_stack([np.full(meets.sum(), index[k]), index[other[meets]]]))
    return np.concatenate(found).astype(np.int64) if found else np.zeros((0, 2), np.int64)
