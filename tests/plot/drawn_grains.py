"""Four grains on a square of the plane y = 0 that moved, with standard deviations, for tests of figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.motions import Motions

PLACES = np.array([[0.0, 0, 0], [4, 0, 0], [0, 0, 4], [4, 0, 4]])


def moved() -> Motions:
    """u along x by 0.01, 0.02, 0.03, 0.04 mm; the last grain has no result to use."""
    start = Motions.identity(np.array([3, 5, 7, 9]), PLACES)
    translations = np.zeros((4, 3))
    translations[:, 0] = [0.01, 0.02, 0.03, 0.04]
    return replace(
        start,
        translations=translations,
        rotations=np.deg2rad(100 * translations),
        covariances=np.tile(np.diag([4.0, 1, 1, 1, 1, 9]) * 1e-6, (4, 1, 1)),
        statuses=np.array(["converged", "converged", "converged", "left-field"], dtype="<U20"),
    )
