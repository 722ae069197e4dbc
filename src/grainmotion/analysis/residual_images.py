"""Residual radiographs: measured minus simulated from the motions of a state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Image, Projector
from grainmotion.model.detector_response import Response
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import NuisanceMotion
from grainmotion.model.scan import Scan
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.projection.grains import simulate_radiographs


@checked_arguments
def residual_images(grains: GrainSet, motions: Motions, scan: Scan, *, projector: Projector = "trilinear") -> Image:
    """Measured − m(simulated) of each view, with m the fitted gain, offset and hardening.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference.
    motions : Motions
        Of the state, with its fit.  Grains with unknown motions are left out of what is simulated.
    scan : Scan
        Radiographs of the state, as they were given to `track`.
    projector : {"trilinear", "exact"}
        As in `track`.

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless; NaN where a pixel is masked.
    """
    scan, fit, views = grains.scene.hardening.apply(scan), motions.fit, len(scan)
    nuisance = NuisanceMotion.still(views)
    if fit.view_corrections is not None:
        nuisance = replace(nuisance, views=fit.view_corrections)
    geometry = corrected_geometry(scan.geometry, nuisance)
    simulated = simulate_radiographs(grains, motions, geometry, projector=projector)
    response = fit.response or Response(np.full((views, 1), fit.gain), np.full((views, 1), fit.offset))
    residual = scan.line_integrals - response.apply(simulated)
    if scan.valid is not None:
        residual[~scan.valid] = np.nan
    return residual
