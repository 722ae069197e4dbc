"""Estimators of F that are linear in the displacements: weights, gradients and their covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from grainmotion._typing import Float


@dataclass(frozen=True, eq=False)
class GradientWeights:
    """Weights of m estimates of F from the displacements u of n grains: F_ij = δ_ij + Σ_a axes[j][m, a] u_i[a].

    Attributes
    ----------
    axes : tuple of 3 sparse arrays (m, n)
        Weights for derivatives along x, y and z, 1/mm.
    """

    axes: tuple[csr_array, csr_array, csr_array]

    def gradients(self, displacements: Float) -> Float:
        """F ``(m, 3, 3)`` from displacements ``(n, 3)``, mm."""
        return np.eye(3) + np.stack([weights @ displacements for weights in self.axes], axis=-1)

    def covariances(self, of_displacements: Float) -> Float:
        """Covariances ``(m, 9, 9)`` of F, row by row, from those of the displacements ``(n, 3, 3)``, mm².

        Errors of different grains are taken as independent.
        """
        flat = of_displacements.reshape(-1, 9)
        found = np.zeros((self.axes[0].shape[0], 3, 3, 3, 3))  # i, j, k, l: of F_ij and F_kl
        for j in range(3):
            for k in range(j, 3):
                product = (self.axes[j] * self.axes[k]).tocsr()
                block = (product @ flat).reshape(-1, 3, 3)
                found[:, :, j, :, k] = block
                found[:, :, k, :, j] = block
        return found.reshape(-1, 9, 9)

    def combined(self, matrix: csr_array) -> GradientWeights:
        """Weights of averages of these estimates: ``matrix (k, m)`` has a row an average."""
        x, y, z = (csr_array(matrix @ weights) for weights in self.axes)
        return GradientWeights((x, y, z))


def weights_from_entries(
    rows: np.ndarray, columns: np.ndarray, entries: Float, shape: tuple[int, int]
) -> GradientWeights:
    """Weights from their entries ``(k, 3)`` at ``rows`` and ``columns``; entries at one place add up."""
    x, y, z = (csr_array((entries[:, axis], (rows, columns)), shape=shape) for axis in range(3))
    return GradientWeights((x, y, z))
