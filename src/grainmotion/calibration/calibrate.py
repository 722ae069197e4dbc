"""Self-calibration of panel and axis on a full scan.

A full scan is redundant: radiographs of a wrong geometry contradict each other, whatever the sample is.
The sample is eliminated (variable projection) and cross-validated.  With γ the corrections, E and O the
even and odd views, and x(γ; b) a short SART of radiographs b in the geometry γ,

    r(γ) = [b_O − A_O(γ) x(γ; b_E),  b_E − A_E(γ) x(γ; b_O)]

is the residual of each half of the views in a reconstruction of the other half.  Gauss–Newton minimises ‖r‖, with
derivatives by central differences of r itself.  A correction that a change of the sample imitates therefore has no
derivative, and is reported as not determined; no list of rules is needed.  Radiographs are binned to a few dozen
columns, where a reconstruction costs little and a shift is determined to some hundredths of a pixel.

Each correction is expressed in the frame of a view's own panel, so that the same numbers correct any other scan
of that scanner.  Golub and Pereyra (1973) for variable projection; figures in
`docs/decisions/0007-calibration-on-the-reference.md`.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Progress
from grainmotion._validation import validated
from grainmotion.calibration.corrections import (
    DEFAULT_PARAMETERS,
    LENGTHS,
    Calibration,
    Correction,
    Parameter,
    from_table_unit,
    in_table_unit,
)
from grainmotion.calibration.cross_validation import Trial
from grainmotion.errors import InputError
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binning_factor

SEARCHED: tuple[Parameter, ...] = ("shift_u", "axis_offset")
"""Corrections whose initial value is searched for; only the first of them that is asked for."""
COARSE_COLUMNS = (20, 40)
"""Columns of the radiographs in the search for a start, and in the first Gauss-Newton steps."""
SEARCH_RANGE = 0.25
"""Largest shift that is searched, either way, over the panel's width."""
MAX_STEP = 2.0
"""Longest Gauss-Newton step of a correction, in its unit (see `Trial`)."""
MIN_STEP = 0.01
"""A step shorter than this is the last one, units."""
NEW_DERIVATIVES_STEP = 0.03
"""A step longer than this takes new derivatives, units."""
MODEL_ERROR_SHARE = 0.03
"""Share of the residual, which is mostly voxelisation, that may look like any one correction."""
MAX_SD = 0.1
"""A correction with a larger standard deviation is not determined, units."""
MIN_EIGENVALUE = 1e-6
"""Of the correlations of corrections: below it two corrections do the same to the data."""
MIN_CALIBRATION_VIEWS = 12
"""Fewer views have no two halves that reconstruct the sample."""


@validated
class CalibrateSettings:
    """Which corrections of panel and axis to estimate, and how finely.

    Examples
    --------
    >>> gm.CalibrateSettings(sweeps=2).sweeps
    2
    """

    parameters: Annotated[tuple[Parameter, ...], Field(min_length=1, description="corrections to estimate")] = (
        DEFAULT_PARAMETERS
    )
    columns: Annotated[
        int, Field(ge=16, description="columns to which radiographs are binned at most; more is finer and slower")
    ] = 64
    sweeps: Annotated[int, Field(ge=1, description="SART sweeps of each trial reconstruction")] = 2
    iterations: Annotated[int, Field(ge=1, description="most Gauss-Newton steps on one scale")] = 6


@checked_arguments
def calibrate(
    scan: Scan, grid: Volume, settings: CalibrateSettings | None = None, *, progress: Progress | None = None
) -> Calibration:
    """Estimate how panel and axis depart from the nominal geometry of a full scan.

    Parameters
    ----------
    scan : Scan
        Line integrals of the full scan, with its nominal geometry.
    grid : Volume
        Where the sample is; its values do not matter.
    settings : CalibrateSettings, optional
        Corrections asked for.  For a parallel beam ``shift_u`` and ``axis_offset`` have the same effect, and
        ``shift_v``, ``pitch`` and ``yaw`` have none; for a cone beam ``shift_v`` and ``pitch`` have hardly any.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Calibration
        The corrected geometry and its corrections, with standard deviations.

    Raises
    ------
    InputError
        If the scan has too few views, or its radiographs are empty.

    Examples
    --------
    The panel is given a pixel, 0.5 mm, beside its place:

    >>> scan = case.reference()
    >>> given = gm.simulate.misaligned(scan.geometry, shift_pixels=(1.0, 0.0))
    >>> settings = gm.CalibrateSettings(parameters=("shift_u",))
    >>> found = gm.calibrate(gm.Scan(scan.line_integrals, given), case.scanner.grid, settings)
    >>> {name: round(amount, 1) for name, amount in found.amounts.items()}  # mm
    {'shift_u': -0.5}
    """
    settings = settings or CalibrateSettings()
    names = tuple(dict.fromkeys(settings.parameters))
    if len(scan) < MIN_CALIBRATION_VIEWS:
        raise InputError(
            "calibrate", f"{len(scan)} views", f"give the full scan, {MIN_CALIBRATION_VIEWS} views at least"
        )
    if not scan.line_integrals.any():
        raise InputError("calibrate", "the radiographs are empty", "give a scan of a sample")
    widths = (min(n, settings.columns) for n in (*COARSE_COLUMNS, settings.columns))
    factors = dict.fromkeys(binning_factor(scan.geometry.shape, width) for width in widths)
    trials = [Trial.of(scan, grid, factor, names, settings.sweeps) for factor in factors]
    progress = progress or (lambda message, done, total: None)
    progress("start", 0, len(trials))
    values = _search(trials[0], np.zeros(len(names)))
    sd = np.full(len(names), np.inf)
    for done, trial in enumerate(trials[1:] or trials, start=1):
        values, sd = _gauss_newton(trial, values, settings.iterations)
        progress(_summary(names, values), done, len(trials))
    before, after = each(trials[-1].relative, [np.zeros(len(names)), values])
    if after > before:  # the nominal geometry is the better one
        values, after = np.zeros(len(names)), before
    progress(_summary(names, values), len(trials), len(trials))
    return Calibration.of(scan.geometry, _corrections(names, values, sd), (before, after))


def _gauss_newton(trial: Trial, values: Float, iterations: int) -> tuple[Float, Float]:
    """Minimum of ‖r‖ from ``values``, and standard deviations, infinite for corrections that are not determined."""
    r = trial.residual(values)
    outdated, sd = True, np.zeros(0)
    for _ in counted(range(iterations)):
        if outdated:
            j = trial.derivatives(values)
            sd = _deviations(j, r, len(trial.scan))
        determined = np.isfinite(sd)
        values = np.where(determined, values, 0)
        if not determined.any():
            break
        step = np.zeros(len(values))
        step[determined] = -np.linalg.lstsq(j[:, determined], r, rcond=None)[0]
        step *= min(1.0, MAX_STEP / max(np.abs(step).max(), 1e-12))
        new = trial.residual(values + step * trial.units)
        while np.linalg.norm(new) > np.linalg.norm(r) and np.abs(step).max() > MIN_STEP:
            step /= 2
            new = trial.residual(values + step * trial.units)
        if np.linalg.norm(new) > np.linalg.norm(r):
            break
        values, r = values + step * trial.units, new
        longest = np.abs(step).max()
        if longest < MIN_STEP:
            break
        outdated = longest > NEW_DERIVATIVES_STEP
    return values, sd * trial.units


def _deviations(j: Float, r: Float, views: int) -> Float:
    """Standard deviation of each correction, units; the worst ones are infinite until all others are determined.

    They follow from the residual after a step, so that a start far off is not taken for noise.  Noise and errors
    that vary from view to view are estimated from the scatter of the gradients of views; errors that all views have
    in common, above all voxelisation, are taken as `MODEL_ERROR_SHARE` of the residual.
    """
    sd = np.full(j.shape[1], np.inf)
    kept = [k for k in range(j.shape[1]) if np.linalg.norm(j[:, k]) > 1e-6 * np.linalg.norm(r)]
    while kept:
        sizes = np.linalg.norm(j[:, kept], axis=0)
        part = j[:, kept] / sizes
        eigenvalues, vectors = np.linalg.eigh(part.T @ part)
        inverse = (vectors / np.maximum(eigenvalues, MIN_EIGENVALUE)) @ vectors.T
        remainder = r - part @ (inverse @ (part.T @ r))
        gradients = np.einsum("vpk,vp->vk", part.reshape(views, -1, len(kept)), remainder.reshape(views, -1))
        noise = np.diag(inverse @ (gradients.T @ gradients) @ inverse)
        deviations = np.sqrt(noise + (MODEL_ERROR_SHARE * np.linalg.norm(remainder)) ** 2 * np.diag(inverse)) / sizes
        if deviations.max() < MAX_SD:
            sd[kept] = deviations
            break
        kept.pop(int(np.flatnonzero(deviations > 0.9 * deviations.max())[-1]))  # of equally bad ones the last
    return sd


def _search(trial: Trial, values: Float) -> Float:
    """Initial values: the best of evenly spaced shifts along u."""
    index = next((k for k, name in enumerate(trial.names) if name in SEARCHED), None)
    if index is None:
        return values
    steps = int(SEARCH_RANGE * trial.scan.geometry.shape[1])
    starts = [values + k * trial.units * (np.arange(len(values)) == index) for k in range(-steps, steps + 1)]
    return starts[int(np.argmin(each(trial.relative, starts)))]


def _corrections(names: tuple[Parameter, ...], values: Float, sd: Float) -> tuple[Correction, ...]:
    """Records of values and deviations, rounded as in tables so that a file gives back the same numbers."""
    rows = zip(names, values.tolist(), sd.tolist(), strict=True)
    return tuple(Correction(n, *(from_table_unit(n, in_table_unit(n, x)) for x in pair)) for n, *pair in rows)


def _summary(names: tuple[Parameter, ...], values: Float) -> str:
    units = ((n, "mm" if n in LENGTHS else "°") for n in names)
    return ", ".join(f"{n} {in_table_unit(n, v):.3f} {u}" for (n, u), v in zip(units, values, strict=True))
