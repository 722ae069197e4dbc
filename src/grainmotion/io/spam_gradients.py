"""Gradients F of grains, as spam writes them, taken as rotations."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float

MIN_STRETCH = 0.1
"""Smallest stretch of a gradient; one that flattens a grain more has no rotation."""
MAX_STRAIN = 0.2
"""Largest strain of a grain that is still taken for a rigid motion; grains of stone strain by less than 0.01."""


def gradient_fault(gradient: Float) -> tuple[str, bool]:
    """What is wrong with F as a rotation, and whether it has none."""
    stretches = np.linalg.svd(gradient, compute_uv=False)
    if stretches[2] <= MIN_STRETCH:
        rank = int(np.count_nonzero(stretches > MIN_STRETCH))
        return f"its gradient F is singular (rank {rank}): no rotation", True
    determinant = float(np.linalg.det(gradient))
    if determinant < 0:
        return f"its gradient F is mirrored (det {determinant:.2f}): no rotation", True
    strain = float(np.abs(stretches - 1).max())
    return (f"its gradient F strains by {strain:.0%}: no rigid motion" if strain > MAX_STRAIN else "", False)


def nearest_rotations(matrices: Float) -> Float:
    """R of the polar decompositions F = R U."""
    left, _, right = np.linalg.svd(matrices)
    sign = np.sign(np.linalg.det(left @ right))
    left[..., -1] *= sign[..., None]
    return left @ right
