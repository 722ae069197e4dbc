"""Residual of a tracked state beside that of the reconstruction: what grains that fit by their motions leave over.

Rigid grains in their places leave less of the radiographs than their own reconstruction did, which noise and sharp
edges disturb as well.  If all grains fit and yet more is left, the geometry of the state is wrong in a way that motions
take up in part, or the grains are not those of the reference.
"""

from __future__ import annotations

import numpy as np

from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.uncertainty.noise_model import noise_level

RESIDUAL_NOTE = "the fit leaves"
"""Beginning of the note."""
MAX_OVER_REFERENCE = 1.2
"""Residual over that of the reconstruction from which it is told.

A hundred states in which all grains converged (hard cases, laboratory cases) gave 0.16 to 1.01, beam hardening the
most; a camera rolled by 3 degrees in the state 1.43, views out of place 1.95.  Containers gave up to 1.86: with a
background nothing is told.
"""
FILTERED_NOISE = 0.4
"""Share of the noise that is left after the last filter of the fit, a Gaussian of 0.7 pixel."""


def residual_notes(grains: GrainSet, motions: Motions, scan: Scan, of_reference: float) -> tuple[str, ...]:
    """A sentence if all grains fit, and yet more of the radiographs is left over than the reconstruction leaves.

    Parameters
    ----------
    grains : GrainSet
        As tracked; with a background nothing is told, as it leaves a residual of its own.
    motions : Motions
        One a grain.
    scan : Scan
        Radiographs of the state.
    of_reference : float
        Relative residual of the reconstruction.

    Returns
    -------
    tuple of str
        At most one.
    """
    if grains.background is not None or not motions.fit.costs or not motions.usable.all():
        return ()
    residual = motions.fit.costs[-1][1]
    images = scan.line_integrals if scan.valid is None else scan.line_integrals[scan.valid > 0]
    noise = FILTERED_NOISE * noise_level(scan) / max(float(np.sqrt(np.mean(images.astype(float) ** 2))), 1e-12)
    if residual**2 - noise**2 < (MAX_OVER_REFERENCE * of_reference) ** 2:
        return ()
    return (
        f"{RESIDUAL_NOTE} {residual:.3f} of the radiographs, more than the reconstruction of the reference, "
        f"{of_reference:.3f}, though all grains fit: the camera is rolled or tilted, its pixels are not square, "
        "the energy is another one, or the grains are strained; the motions may be wrong by more than their standard "
        "deviations",
    )
