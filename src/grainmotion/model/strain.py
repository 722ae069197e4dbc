"""Strain of a grain: six numbers, its stretch, and other measures of it.

A strained grain carries X to x = Ω U (X − c) + u + c.  Ω is its rotation, and U = I + e its right stretch, in the frame
of the reference: the deformation gradient is F = Ω U, by polar decomposition.  ``strains (n, 6)`` are the components
of Biot's strain e = U − I, in the order xx, yy, zz, yz, xz, xy; shear components are those of the tensor, half of the
change of angle.  An eigenvalue of e is the relative change of length along its axis, at any size of strain.
"""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float

STRAIN_NAMES = ("exx", "eyy", "ezz", "eyz", "exz", "exy")
_ROWS, _COLUMNS = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])
_UNITS = np.zeros((6, 3, 3))
_UNITS[range(6), _ROWS, _COLUMNS] = _UNITS[range(6), _COLUMNS, _ROWS] = 1.0


def tensors(strains: Float) -> Float:
    """Symmetric tensors ``(..., 3, 3)`` of six components ``(..., 6)`` each."""
    return np.asarray(np.einsum("...k,kij->...ij", strains, _UNITS))


def components(symmetric: Float) -> Float:
    """The six components ``(..., 6)`` of symmetric tensors ``(..., 3, 3)``."""
    return np.asarray(symmetric[..., _ROWS, _COLUMNS])


def stretches(strains: Float) -> Float:
    """Right stretches U = I + e, ``(n, 3, 3)``."""
    return np.eye(3) + tensors(strains)


def bounded(strains: Float, limit: float) -> Float:
    """The nearest strains whose principal values are at most ``limit`` in size, ``(n, 6)``."""
    values, axes = np.linalg.eigh(tensors(strains))
    if (np.abs(values) <= limit).all():
        return strains
    return components(np.einsum("nij,nj,nkj->nik", axes, np.clip(values, -limit, limit), axes))


def polar_decomposition(gradients: Float) -> tuple[Float, Float]:
    """Rotations Ω ``(n, 3, 3)`` and Biot strains ``(n, 6)`` of deformation gradients F = Ω U (det F > 0)."""
    left, values, right = np.linalg.svd(gradients)
    stretch = np.swapaxes(right, -1, -2) * values[..., None, :] @ right
    return left @ right, components(stretch - np.eye(3))


def green_lagrange(strains: Float) -> Float:
    """Green–Lagrange strains E = ½(U² − I) = e + ½ e², ``(n, 6)``."""
    e = tensors(strains)
    return components(e + 0.5 * e @ e)
