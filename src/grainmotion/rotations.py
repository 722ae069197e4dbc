"""Rotations and rigid motions: exponential map, logarithm, action on points, change of centre.

A motion carries X to x = Ω (X − c) + u + c, with Ω = exp[ω]ₓ a rotation matrix, u a translation and
c a fixed centre.  Everything works on stacks: rotation vectors are ``(..., 3)``, matrices
``(..., 3, 3)``, translations and points ``(..., 3)``, in x y z order; angles are radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from grainmotion._typing import Float


def rotation_matrix(rotation_vector: ArrayLike) -> Float:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (right-hand rule)."""
    w = np.asarray(rotation_vector, dtype=float)
    return Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(*w.shape[:-1], 3, 3)


def rotation_vector(matrix: ArrayLike) -> Float:
    """Rotation vectors ``(..., 3)`` in radians, of length at most π, of matrices ``(..., 3, 3)``; NaN of NaN."""
    m = np.asarray(matrix, dtype=float)
    flat = m.reshape(-1, 3, 3)
    finite = np.isfinite(flat).all(axis=(1, 2))
    out = np.full((len(flat), 3), np.nan)
    out[finite] = Rotation.from_matrix(flat[finite]).as_rotvec()
    return out.reshape(*m.shape[:-2], 3)


def skew_matrix(vector: ArrayLike) -> Float:
    """Matrices [v]ₓ ``(..., 3, 3)`` such that [v]ₓ w = v × w."""
    v = np.asarray(vector, dtype=float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def apply_motion(matrix: ArrayLike, translation: ArrayLike, center: ArrayLike, points: ArrayLike) -> Float:
    """Carry points ``(..., 3)`` by one motion a row: x = Ω (X − c) + u + c."""
    c = np.asarray(center, dtype=float)
    relative = np.asarray(points, dtype=float) - c
    return np.einsum("...ij,...j->...i", np.asarray(matrix, dtype=float), relative) + translation + c


def recenter(matrix: ArrayLike, translation: ArrayLike, old: ArrayLike, new: ArrayLike) -> Float:
    """Translation of the same motion when its centre is ``new`` instead of ``old``."""
    return apply_motion(matrix, translation, old, new) - np.asarray(new, dtype=float)
