"""Residual radiographs: measured minus simulated from the motions of a state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Image, Projector
from grainmotion.errors import InputError
from grainmotion.model.detector_response import Response
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import NuisanceMotion
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
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

    Raises
    ------
    InputError
        If the motions were fitted to another number of views, or are of other grains.

    Examples
    --------
    >>> left = gm.residual_images(grains, motions, state)
    >>> bool(np.abs(left).mean() < 0.05 * state.line_integrals.max())
    True
    """
    check_views(motions.fit, scan)
    scan, fit, views = grains.scene.hardening.apply(scan), motions.fit, len(scan)
    geometry = fitted_geometry(scan.geometry, fit)
    simulated = simulate_radiographs(grains, motions, geometry, projector=projector)
    response = fit.response or Response(np.full((views, 1), fit.gain), np.full((views, 1), fit.offset))
    residual = scan.line_integrals - response.apply(simulated)
    if scan.valid is not None:
        residual[~scan.valid] = np.nan
    return residual


def check_views(fit: StateFit, scan: Scan) -> None:
    """Refuse a scan of another number of views than the fit has gains or corrections for."""
    response, corrections = fit.response, fit.view_corrections
    fitted = len(response.polynomial) if response is not None else len(scan)
    fitted = len(corrections.angles) if corrections is not None else fitted
    if fitted != len(scan):
        fact = f"{len(scan)} views, but these motions were fitted to {fitted}"
        raise InputError("scan", fact, "give the radiographs of the state, as they were given to track")


def fitted_geometry(geometry: Geometry, fit: StateFit) -> Geometry:
    """The views of a state with the corrections that its fit found.

    Parameters
    ----------
    geometry : Geometry
        As it was given to `track`.
    fit : StateFit
        What was fitted beside the motions.

    Returns
    -------
    Geometry
        Views in which the grains appear where their motions say.
    """
    if fit.view_corrections is None:
        return geometry
    return corrected_geometry(geometry, replace(NuisanceMotion.still(len(geometry)), views=fit.view_corrections))
