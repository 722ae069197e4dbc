"""Realisations of the pixels' noise, and the errors of all unknowns that they cause.

Each is drawn from given variances, filtered and weighted as the residual is, and put through the normal equations that
the fit solves: of grains and of the few unknowns beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import Columns
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.block_cg import conjugate_gradients
from grainmotion.solvers.gauss_newton import Linearization, schur_complement

NOISE_DRAWS = 16
"""Realisations of noise."""
NOISE_SOLVE_TOLERANCE = 3e-3
"""Relative residual to which the equations of each realisation are solved."""


@dataclass(frozen=True, eq=False)
class NoiseDraws:
    """K realisations of noise in a linearised fit.

    Attributes
    ----------
    scores : (K, patches, 6) array
        Jᵀ noise of each patch.
    errors : (K, n, 6) array
        What the noise does to the grains' unknowns.
    border_errors : (m, K) array
        What it does to the unknowns of the columns.
    """

    scores: Float
    errors: Float
    border_errors: Float

    @classmethod
    def of(
        cls, target: Target, jacobian: PatchJacobian, columns: Columns, at: Linearization, variances: Float
    ) -> NoiseDraws:
        """Draw from the ``variances`` of the pixels, and solve for each."""
        product, corner_inverse, blocks = schur_complement(at, 0.0)
        noise = drawn_noise(target, variances)
        scores = jacobian.vjp(noise.stacks)
        on_grains = np.stack([jacobian.by_grain(parts).ravel() for parts in scores], axis=1)
        on_columns = np.array([columns.dot(images) for images in noise.stacks]).T
        right = on_grains - at.border @ (corner_inverse @ on_columns)
        errors = conjugate_gradients(product, blocks, right, NOISE_SOLVE_TOLERANCE)
        border_errors = corner_inverse @ (on_columns - at.border.T @ errors)
        return cls(scores, errors.T.reshape(len(scores), -1, 6), border_errors)

    def left_scores(self, jacobian: PatchJacobian, columns: Columns) -> Float:
        """Jᵀ of what the fit leaves of the noise, ``(K, patches, 6)``: those of each grain add up to zero."""
        fitted = jacobian.vjp(jacobian.jvp(self.errors)) + columns.on_patches(jacobian, self.border_errors)
        return self.scores - fitted


def drawn_noise(target: Target, variances: Float, seed: int = 0) -> Columns:
    """Filtered and weighted stacks of noise of given variances."""
    rng, spreads = np.random.default_rng(seed), np.sqrt(variances)
    noise = Columns()
    for _ in range(NOISE_DRAWS):
        drawn = spreads * rng.standard_normal(spreads.shape)
        noise.add(target.filtered(drawn.astype(target.precision)), shared=True)
    return noise
