"""Motions of four grains, rigid or strained, with values that are hard to store: NaN, separators, non-ASCII text."""

from dataclasses import replace

import numpy as np

from grainmotion.model.motions import Motions, Status
from grainmotion.model.state_fit import StateFit


def motions() -> Motions:
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(4, 6, 6))
    covariances = roots @ roots.transpose(0, 2, 1) * 1e-4
    translations = rng.normal(size=(4, 3))
    covariances[2], translations[2] = np.nan, np.nan
    statuses = [Status.CONVERGED, Status.POORLY_DETERMINED, Status.LEFT_FIELD, Status.NOT_CONVERGED]
    return Motions(
        labels=np.array([3, 1, 7, 12]),
        centers=rng.normal(size=(4, 3)),
        translations=translations,
        rotations=rng.normal(size=(4, 3)),
        covariances=covariances,
        statuses=np.array([s.value for s in statuses]),
        residuals=rng.uniform(size=4),
        iterations=np.array([4, 5, 0, 30]),
        reasons=("", "seen from one side; add a view", "it left; widen the panel", "µ – ε; look"),
        fit=StateFit(1.01, -0.002, (("rigid", 0.2), ("free", 0.01))),
        ok_translation=np.array([True, True, False, False]),
        ok_rotation=np.array([True, False, False, False]),
    )


def strained() -> Motions:
    """The same with strains; one is unknown."""
    rng = np.random.default_rng(4)
    strains, roots = 0.05 * rng.normal(size=(4, 6)), rng.normal(size=(4, 6, 6))
    covariances = roots @ roots.transpose(0, 2, 1) * 1e-6
    strains[2], covariances[2] = np.nan, np.nan
    return replace(motions(), strains=strains, strain_covariances=covariances)
