"""Displacement bases of the early stages: a rigid body, affine and quadratic fields that carry all grains.

A basis is a matrix T ``(6n, m)``, the increments (u, δ) of all grains per unit of each parameter, at the grains'
present places x = c + u relative to their mean.
"""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import skew_matrix


def rigid(grains: GrainArrays, pose: Pose) -> Float:
    """All grains move as one body: 3 translations, 3 rotations about their mean place."""
    x, _ = _places(grains, pose)
    n = len(grains)
    basis = np.zeros((n, 6, 6))
    basis[:, :3, :3] = basis[:, 3:, 3:] = np.eye(3)
    basis[:, :3, 3:] = -skew_matrix(x)
    return basis.reshape(6 * n, 6)


def affine(grains: GrainArrays, pose: Pose) -> Float:
    """u = t + A x, and each grain rotates with the skew part of A: 12 parameters, scaled by the sample's size."""
    x, size = _places(grains, pose)
    return _field(np.concatenate([np.ones((len(x), 1)), x / size], axis=1), _constant_gradients(len(x), size))


def quadratic(grains: GrainArrays, pose: Pose) -> Float:
    """u a quadratic polynomial of x, and each grain rotates with half the curl of u: 30 parameters."""
    x, size = _places(grains, pose)
    s = x / size
    i, j = np.triu_indices(3)
    values = np.concatenate([np.ones((len(s), 1)), s, s[:, i] * s[:, j]], axis=1)
    gradients = np.zeros((len(s), 10, 3))
    gradients[:, :4] = _constant_gradients(len(s), size)
    for k, (a, b) in enumerate(zip(i, j, strict=True), start=4):
        gradients[:, k, a] += s[:, b] / size
        gradients[:, k, b] += s[:, a] / size
    return _field(values, gradients)


def _places(grains: GrainArrays, pose: Pose) -> tuple[Float, float]:
    """Places relative to their mean ``(n, 3)``, and the sample's size, mm."""
    places = grains.centers + pose.translations
    x = places - places.mean(axis=0)
    return x, max(float(np.sqrt((x**2).mean())), grains.voxel_size)


def _constant_gradients(n: int, size: float) -> Float:
    """Gradients ``(n, 4, 3)`` of 1, x, y and z over the sample's size."""
    gradients = np.zeros((n, 4, 3))
    gradients[:, 1:4] = np.eye(3) / size
    return gradients


def _field(values: Float, gradients: Float) -> Float:
    """T of u_k = Σ q_km f_m(x), with δ = ½ curl u, from f ``(n, m)`` and ∇f ``(n, m, 3)``."""
    n, m = values.shape
    basis = np.zeros((n, 6, 3, m))
    for k in range(3):
        basis[:, k, k] = values
        axis = np.zeros(3)
        axis[k] = 1.0
        # ½ curl(f e_k) = ½ ∇f × e_k
        basis[:, 3:, k] = 0.5 * np.cross(gradients, axis).transpose(0, 2, 1)
    return basis.reshape(6 * n, 3 * m)
