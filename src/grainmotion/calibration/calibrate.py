"""Self-calibration: Scan → Calibration, what the reference scan itself tells of the panel and the axis.

A full scan is redundant: radiographs of a wrong geometry contradict each other, whatever the sample is.
The sample is eliminated (variable projection) and cross-validated.  With γ the corrections, E and O the
even and odd views, and x(γ; b) a short SART of radiographs b in the geometry γ,

    r(γ) = [b_O − A_O(γ) x(γ; b_E),  b_E − A_E(γ) x(γ; b_O)]

is what one half of the views says against the other.  Gauss–Newton makes ‖r‖ least, with derivatives by
central differences of r itself, so that what the sample can take up instead of γ has no derivative:
that, and no list of rules, says what cannot be determined.  All is done on radiographs binned to a few
dozen columns, where a reconstruction costs little and a shift is found to some hundredths of a pixel.

The corrections are a machine's: each is expressed in the frame of a view's own panel, so that the same
numbers correct any other scan of that machine.  Golub and Pereyra (1973) for variable projection;
`docs/decisions/0007-calibration-on-the-reference.md` for the measure.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from grainmotion._typing import Float, Progress
from grainmotion._validation import validated
from grainmotion.calibration.corrections import (
    DEFAULT,
    LENGTHS,
    Calibration,
    Correction,
    Parameter,
    from_table_unit,
    in_table_unit,
)
from grainmotion.calibration.cross_validation import Trial
from grainmotion.errors import InputError
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binning_factor

SIDEWAYS: tuple[Parameter, ...] = ("shift_u", "axis_offset")  # what the search for a start moves
COARSE = (20, 40)  # columns of the search for a start, and of the first Gauss-Newton steps
SEARCH = 0.25  # of the panel's width: how far off the start may be, either way
LONGEST = 2.0  # units in one Gauss-Newton step
SETTLED = 0.01  # units: the last step
STALE = 0.03  # units: a step after which derivatives are taken anew
MODEL_SHARE = 0.03  # of the residual, which is mostly the voxels' fault, may look like any one correction
LOOSE = 0.1  # units: what is known no better than this is not determined
SAME = 1e-6  # 1 − correlation of two corrections that are one thing to the data
FEWEST_VIEWS = 12


@validated
class CalibrateSettings:
    """Which corrections of panel and axis to find, and how finely."""

    parameters: Annotated[tuple[Parameter, ...], Field(min_length=1, description="corrections to find")] = DEFAULT
    columns: Annotated[
        int, Field(ge=16, description="columns to which radiographs are binned at most; more is finer and slower")
    ] = 64
    sweeps: Annotated[int, Field(ge=1, description="SART sweeps of each trial reconstruction")] = 2
    iterations: Annotated[int, Field(ge=1, description="most Gauss-Newton steps on one scale")] = 6


def calibrate(
    scan: Scan,
    grid: Volume,
    settings: CalibrateSettings | None = None,
    *,
    progress: Progress | None = None,
) -> Calibration:
    """Find how panel and axis depart from the geometry of a full scan.

    Parameters
    ----------
    scan : Scan
        Line integrals of the full scan, with the geometry that was told.
    grid : Volume
        Where the sample is; only its place and size count.
    settings : CalibrateSettings, optional
        Corrections asked for.  For a parallel beam ``shift_u`` and ``axis_offset`` are one thing, and
        ``shift_v``, ``pitch`` and ``yaw`` cannot be seen; for a cone beam ``shift_v`` and ``pitch`` hardly.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If the scan has too few views, or radiographs of nothing.
    """
    settings = settings or CalibrateSettings()
    names = tuple(dict.fromkeys(settings.parameters))
    if len(scan) < FEWEST_VIEWS:
        raise InputError("calibrate", f"{len(scan)} views", f"give the full scan, {FEWEST_VIEWS} views at least")
    if not scan.line_integrals.any():
        raise InputError("calibrate", "the radiographs are empty", "give a scan of a sample")
    widths = (min(n, settings.columns) for n in (*COARSE, settings.columns))
    factors = dict.fromkeys(binning_factor(scan.geometry.shape, width) for width in widths)
    trials = [Trial.of(scan, grid, factor, names, settings.sweeps) for factor in factors]
    tell = progress or (lambda message, done, total: None)
    tell("start", 0, len(trials))
    values = _search(trials[0], np.zeros(len(names)))
    sd = np.full(len(names), np.inf)
    for done, trial in enumerate(trials[1:] or trials, start=1):
        values, sd = _gauss_newton(trial, values, settings.iterations)
        tell(_said(names, values), done, len(trials))
    before, after = (trials[-1].relative(v) for v in (np.zeros(len(names)), values))
    if after > before:  # nothing gained: the machine is as it was told
        values, after = np.zeros(len(names)), before
    tell(_said(names, values), len(trials), len(trials))
    return Calibration.of(scan.geometry, _corrections(names, values, sd), (before, after))


def _gauss_newton(trial: Trial, values: Float, iterations: int) -> tuple[Float, Float]:
    """Minimum of ‖r‖ from ``values``, and standard deviations, infinite for what is not determined."""
    r = trial.residual(values)
    stale, sd = True, np.zeros(0)
    for _ in range(iterations):
        if stale:
            j = trial.derivatives(values)
            sd = _deviations(j, r, len(trial.scan))
        known = np.isfinite(sd)
        values = np.where(known, values, 0)
        if not known.any():
            break
        step = np.zeros(len(values))
        step[known] = -np.linalg.lstsq(j[:, known], r, rcond=None)[0]
        step *= min(1.0, LONGEST / max(np.abs(step).max(), 1e-12))
        new = trial.residual(values + step * trial.units)
        while np.linalg.norm(new) > np.linalg.norm(r) and np.abs(step).max() > SETTLED:
            step /= 2
            new = trial.residual(values + step * trial.units)
        if np.linalg.norm(new) > np.linalg.norm(r):
            break
        values, r = values + step * trial.units, new
        longest = np.abs(step).max()
        if longest < SETTLED:
            break
        stale = longest > STALE
    return values, sd * trial.units


def _deviations(j: Float, r: Float, views: int) -> Float:
    """Standard deviation of each correction, units; infinite for the worst ones until all others are known.

    The residual that counts is what a step would leave, so that a start far off is not taken for noise.

    Noise and what varies from view to view come from the scatter of each view's gradient; what all views have in
    common, above all the voxels' coarseness, is taken as `MODEL_SHARE` of the residual.
    """
    sd = np.full(j.shape[1], np.inf)
    known = [k for k in range(j.shape[1]) if np.linalg.norm(j[:, k]) > 1e-6 * np.linalg.norm(r)]
    while known:
        sizes = np.linalg.norm(j[:, known], axis=0)
        part = j[:, known] / sizes
        eigenvalues, vectors = np.linalg.eigh(part.T @ part)
        inverse = (vectors / np.maximum(eigenvalues, SAME)) @ vectors.T
        left = r - part @ (inverse @ (part.T @ r))
        gradients = np.einsum("vpk,vp->vk", part.reshape(views, -1, len(known)), left.reshape(views, -1))
        noise = np.diag(inverse @ (gradients.T @ gradients) @ inverse)
        here = np.sqrt(noise + (MODEL_SHARE * np.linalg.norm(left)) ** 2 * np.diag(inverse)) / sizes
        if here.max() < LOOSE:
            sd[known] = here
            break
        known.pop(int(np.flatnonzero(here > 0.9 * here.max())[-1]))  # of twins, the one asked for last
    return sd


def _search(trial: Trial, values: Float) -> Float:
    """A start: the best of a row of shifts along u."""
    index = next((k for k, name in enumerate(trial.names) if name in SIDEWAYS), None)
    if index is None:
        return values
    reach = int(SEARCH * trial.scan.geometry.shape[1])
    tried = [values + k * trial.units * (np.arange(len(values)) == index) for k in range(-reach, reach + 1)]
    return min(tried, key=trial.relative)


def _corrections(names: tuple[Parameter, ...], values: Float, sd: Float) -> tuple[Correction, ...]:
    """Records of values and deviations, rounded as in tables so that a file gives back the same numbers."""
    rows = zip(names, values.tolist(), sd.tolist(), strict=True)
    return tuple(Correction(n, *(from_table_unit(n, in_table_unit(n, x)) for x in pair)) for n, *pair in rows)


def _said(names: tuple[Parameter, ...], values: Float) -> str:
    units = ((n, "mm" if n in LENGTHS else "°") for n in names)
    return ", ".join(f"{n} {in_table_unit(n, v):.3f} {u}" for (n, u), v in zip(units, values, strict=True))
