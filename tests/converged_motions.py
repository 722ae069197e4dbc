"""Motions as a tracked state has them, all converged, for tests of exchange with spam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grainmotion.model.motions import Motions


def converged(labels: Sequence[int], centers: np.ndarray, u: np.ndarray, degrees: np.ndarray) -> Motions:
    """Converged motions with translations u (mm) and rotation vectors in degrees."""
    n = len(labels)
    return replace(
        Motions.identity(np.array(labels), centers),
        translations=u,
        rotations=np.deg2rad(degrees),
        statuses=np.full(n, "converged", dtype="<U20"),
        residuals=np.linspace(0.01, 0.02, n),
        iterations=np.arange(5, 5 + n),
    )
