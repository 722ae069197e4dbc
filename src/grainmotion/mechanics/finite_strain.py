"""Measures of a finite deformation F: rotation, strains, volumetric and deviatoric part, and their uncertainty.

F = ∂x/∂X carries a material line of the reference to the later state; F = R U with the rotation R and the right stretch
U (polar decomposition), C = FᵀF = U².  All strains are in the frame of the reference, positive where lines get longer:

    small           ε = ½(F + Fᵀ) − I       wrong as soon as there is rotation: by 1 − cos θ
    Green–Lagrange  E = ½(C − I)
    logarithmic     H = ln U                 adds up over steps along fixed axes
    volumetric      det F − 1                relative change of volume, positive for dilation
    deviatoric      ‖U (det F)^(−1/3) − I‖   Frobenius norm of what is left of the stretch at constant volume

The last two are the definitions of spam (`spam.deformation.decomposeF`), so that values compare one to one.  For small
strains they are tr ε and ‖ε − ⅓ tr ε I‖.  Soil mechanics counts compression as positive: change the sign for that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.strain import components
from grainmotion.model.summary import Summarised
from grainmotion.rotations import rotation_vector

STRAIN_STEP = 1e-6
"""Step of central differences by components of F: rounding and curvature both stay below 1e-9."""


@dataclass(frozen=True, eq=False, repr=False)
class Deformation(Summarised):
    """Deformation gradients and what follows from them; a gradient that is NaN or not invertible gives NaN.

    Attributes
    ----------
    gradients : (n, 3, 3) array
        F, row i and column j: ∂x_i/∂X_j.

    Examples
    --------
    A stretch of 1 % along z:

    >>> deformation = gm.Deformation(np.diag([1.0, 1.0, 1.01])[None])
    >>> deformation.volumetric.round(6).tolist()
    [0.01]
    >>> deformation.small.round(6).tolist()  # xx, yy, zz, yz, xz, xy
    [[0.0, 0.0, 0.01, 0.0, 0.0, 0.0]]
    """

    gradients: Float

    @property
    def volumetric(self) -> Float:
        """Relative change of volume det F − 1, ``(n,)``."""
        return _determinants(self.gradients) - 1

    @property
    def deviatoric(self) -> Float:
        """Frobenius norm of U (det F)^(−1/3) − I, ``(n,)``: the change of shape at constant volume."""
        values, _ = _principal_stretches(self.gradients)
        isochoric = values / np.cbrt(values.prod(axis=1, keepdims=True))
        return np.asarray(np.sqrt(((isochoric - 1) ** 2).sum(axis=1)))

    @property
    def small(self) -> Float:
        """Small strain ε = ½(F + Fᵀ) − I, six components ``(n, 6)``: xx, yy, zz, yz, xz, xy."""
        return components((self.gradients + np.swapaxes(self.gradients, 1, 2)) / 2 - np.eye(3))

    @property
    def green_lagrange(self) -> Float:
        """Green–Lagrange strain E = ½(FᵀF − I), six components ``(n, 6)``."""
        return components((np.swapaxes(self.gradients, 1, 2) @ self.gradients - np.eye(3)) / 2)

    @property
    def logarithmic(self) -> Float:
        """Logarithmic strain ln U, six components ``(n, 6)``."""
        values, axes = _principal_stretches(self.gradients)
        return components(np.einsum("nik,nk,njk->nij", axes, np.log(values), axes))

    @property
    def rotations(self) -> Float:
        """Rotation vectors of R in F = R U, radians, ``(n, 3)``."""
        return _rotation_vectors(self.gradients)


def propagated(measure: Callable[[Deformation], Float], gradients: Float, covariances: Float) -> Float:
    """Covariances ``(n, k, k)`` of a measure with k components, from those of F ``(n, 9, 9)``, by linearisation.

    A component without a variance (NaN) makes the whole result NaN.
    """
    columns = []
    for entry in range(9):
        step = np.zeros(9)
        step[entry] = STRAIN_STEP
        ahead, behind = (
            np.atleast_2d(measure(Deformation(gradients + sign * step.reshape(3, 3))).T).T for sign in (1.0, -1.0)
        )
        columns.append((ahead - behind) / (2 * STRAIN_STEP))
    jacobian = np.stack(columns, axis=-1)  # (n, k, 9)
    return np.asarray(jacobian @ covariances @ np.swapaxes(jacobian, 1, 2))


def standard_deviations(covariances: Float) -> Float:
    """Square roots of the diagonals ``(n, k)`` of covariances ``(n, k, k)``."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0)))


def deviatoric_noise(covariances: Float) -> Float:
    """Root mean square of the deviatoric strain that the noise of F alone would show without any strain, ``(n,)``.

    A norm is never negative, so a deviatoric strain that is not clearly above this is no sign of a change of shape.
    """
    to_small = np.zeros((6, 9))  # εxx … εxy of F − I, row by row
    for row, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
        to_small[row, 3 * i + j] += 0.5
        to_small[row, 3 * j + i] += 0.5
    off_trace = np.eye(6)
    off_trace[:3, :3] -= 1 / 3
    part = off_trace @ to_small
    weights = np.array([1.0, 1, 1, 2, 2, 2])  # each shear component is in the tensor twice
    return np.asarray(np.sqrt(np.einsum("k,ki,nij,kj->n", weights, part, covariances, part)))


def _determinants(gradients: Float) -> Float:
    """det F; NaN where a grain would be turned inside out, which no deformation does."""
    finite = np.asarray(np.isfinite(gradients).all(axis=(1, 2)))
    determinants = np.linalg.det(np.where(finite[:, None, None], gradients, 0.0))
    return np.where(determinants > 0, determinants, np.nan)


def _usable(gradients: Float) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(_determinants(gradients)))


def _principal_stretches(gradients: Float) -> tuple[Float, Float]:
    """Stretches ``(n, 3)`` in ascending order and their axes, columns of ``(n, 3, 3)``."""
    usable = _usable(gradients)
    values, axes = np.full((len(gradients), 3), np.nan), np.full((len(gradients), 3, 3), np.nan)
    _, stretches, right = np.linalg.svd(gradients[usable])
    values[usable], axes[usable] = stretches[:, ::-1], np.swapaxes(right, 1, 2)[:, :, ::-1]
    return values, axes


def _rotation_vectors(gradients: Float) -> Float:
    usable = _usable(gradients)
    rotations = np.full(gradients.shape, np.nan)
    left, _, right = np.linalg.svd(gradients[usable])
    rotations[usable] = left @ right
    return rotation_vector(rotations)
