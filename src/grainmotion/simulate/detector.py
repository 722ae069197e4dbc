"""Detector model: from line integrals to counts, with photon noise, blur, dark level, flat field and drift."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field
from scipy.ndimage import gaussian_filter

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised
from grainmotion.simulate.radiograph import Averaging, transmission
from grainmotion.simulate.sample import Sample


@validated
class Physics:
    """Beam and detector: how line integrals become counts.

    The defaults, but for ``photons``, are those of a perfect detector.  Effects apply in this order: line integrals,
    spectrum, average over the pixel, blur, the pixel's gain, Poisson noise, conversion to counts, dark level.

    Examples
    --------
    >>> gm.simulate.Physics(photons=1e4).photons
    10000.0
    """

    photons: Annotated[float, Field(gt=0, description="photons a pixel detects without the sample")] = 20_000.0
    counts_per_photon: Annotated[float, Field(gt=0, description="counts that one detected photon makes")] = 1.0
    dark: Annotated[float, Field(ge=0, description="counts without the beam")] = 0.0
    dark_noise: Annotated[float, Field(ge=0, description="standard deviation of the dark counts")] = 0.0
    flat_variation: Annotated[
        float, Field(ge=0, lt=1, description="standard deviation over pixels of the detector's gain, of 1")
    ] = 0.0
    detector_seed: Annotated[int, Field(ge=0, description="which detector: its pattern of gains")] = 57
    flats: Annotated[int, Field(ge=1, description="flat fields recorded")] = 20
    darks: Annotated[int, Field(ge=1, description="dark fields recorded")] = 20
    blur: Annotated[float, Field(ge=0, description="standard deviation of the detector's blur, pixels")] = 0.0
    gain_drift: Annotated[
        float, Field(ge=0, lt=1, description="standard deviation of each state's beam intensity, of 1")
    ] = 0.0
    spectrum: Annotated[
        tuple[tuple[float, float], ...],
        Field(min_length=1, description="energies: (share of the photons, attenuation over the sample's)"),
    ] = ((1.0, 1.0),)
    subsamples: Annotated[int, Field(ge=1, description="rays along each side of a pixel")] = 3
    averaging: Annotated[Averaging, Field(description="what a pixel averages over its area")] = "intensity"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Recording(Summarised):
    """Raw radiographs as a detector saves them.

    Attributes
    ----------
    counts : (views, rows, columns) float32 array
        Radiographs.
    flats, darks : (frames, rows, columns) float32 arrays
        Images without the sample, and without the beam.
    geometry : Geometry
        The views.

    Examples
    --------
    >>> recording = case.state_counts(truth, (0, 90))
    >>> recording.counts.shape, recording.flats.shape[1:]
    ((2, 96, 72), (96, 72))
    """

    counts: NDArray[np.float32]
    flats: NDArray[np.float32]
    darks: NDArray[np.float32]
    geometry: Geometry


@checked_arguments
def record(sample: Sample, geometry: Geometry, physics: Physics, seed: int, beam: ArrayLike = 1.0) -> Recording:
    """Radiographs of a sample as counts, with flats and darks of the same detector.

    Parameters
    ----------
    sample, geometry, physics : Sample, Geometry, Physics
        The sample, the views, and the beam and detector.
    seed : int
        Seed of the noise and of this state's drift; flats are taken before the beam drifts.
    beam : float or (views,) array_like
        Intensity of the beam in each view over that of the flats, in addition to the drift.

    Returns
    -------
    Recording
        Counts, flats and darks.

    Raises
    ------
    InputError
        If ``beam`` is not one positive number, or one a view.

    Examples
    --------
    >>> recording = gm.simulate.record(case.sample, case.scanner.geometry((0, 90)), case.physics, 0)
    >>> recording.counts.shape
    (2, 96, 72)
    """
    rng = np.random.default_rng(seed)
    fraction = _levels(beam, geometry) * _transmission(sample, geometry, physics)
    gain = detector_gain(geometry.shape, physics)
    drift = 1 + physics.gain_drift * rng.standard_normal()
    bright = np.broadcast_to(gain, (physics.flats, *geometry.shape))
    return Recording(
        _counts(drift * gain * fraction, physics, rng),
        _counts(bright, physics, rng),
        _counts(np.zeros((physics.darks, *geometry.shape)), physics, rng),
        geometry,
    )


@checked_arguments
def record_line_integrals(
    sample: Sample, geometry: Geometry, physics: Physics, seed: int, beam: ArrayLike = 1.0
) -> Scan:
    """Radiographs of a sample as line integrals with photon noise, after a perfect flat-field correction.

    Dark level and flat field cancel and are left out; blur, spectrum, drift and ``beam`` are kept.

    Parameters
    ----------
    sample, geometry, physics : Sample, Geometry, Physics
        The sample, the views, and the beam and detector.
    seed, beam : int, float or (views,) array_like
        As in `record`.

    Returns
    -------
    Scan
        Noisy line integrals, dimensionless.

    Examples
    --------
    >>> scan = gm.simulate.record_line_integrals(case.sample, case.scanner.geometry((0, 90)), case.physics, 0)
    >>> len(scan)
    2
    """
    rng = np.random.default_rng(seed)
    drift = 1 + physics.gain_drift * rng.standard_normal()
    fraction = drift * _levels(beam, geometry) * _transmission(sample, geometry, physics)
    photons = rng.poisson(physics.photons * fraction)
    return Scan((-np.log(np.maximum(photons, 0.5) / physics.photons)).astype(np.float32), geometry)


@checked_arguments
def detector_gain(shape: tuple[int, int], physics: Physics) -> Float:
    """Relative gain of each pixel, the same in every state.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the panel.
    physics : Physics
        Its ``flat_variation`` and ``detector_seed``.

    Returns
    -------
    (rows, columns) array
        1 in the mean, at least 0.2.

    Examples
    --------
    >>> gm.simulate.detector_gain((96, 72), case.physics).shape
    (96, 72)
    """
    if physics.flat_variation == 0:
        return np.ones(shape)
    rng = np.random.default_rng(physics.detector_seed)
    rough = rng.standard_normal(shape)
    smooth = gaussian_filter(rng.standard_normal(shape), min(shape) / 6)
    field = rough / rough.std() + smooth / smooth.std()
    return np.clip(1 + physics.flat_variation * field / field.std(), 0.2, None)


@checked_arguments
def photons_for_snr(line_integrals: ArrayLike, snr: float) -> float:
    """Photons a pixel that give a signal-to-noise ratio ‖b‖/‖noise‖ of line integrals b.

    A line integral b measured with N photons in the open beam has the variance e^b / N.

    Parameters
    ----------
    line_integrals : array_like of any shape
        b without noise, dimensionless.
    snr : float
        Eq. 24 of Khalili et al. (2017), which `grainmotion.model.scan.snr` measures.

    Returns
    -------
    float
        Photons that a pixel detects without the sample, N.

    Raises
    ------
    InputError
        If ``snr`` is not positive.

    Examples
    --------
    >>> clean = gm.simulate.line_integrals(case.sample, state.geometry, subsamples=1)
    >>> gm.simulate.photons_for_snr(clean, 50.0) < gm.simulate.photons_for_snr(clean, 100.0)
    True
    """
    if not snr > 0:
        raise InputError("snr", f"must be > 0, got {snr}", "the paper has about 50")
    b = np.asarray(line_integrals, dtype=float)
    return float(snr**2 * np.exp(b).sum() / (b**2).sum())


def _levels(beam: ArrayLike, geometry: Geometry) -> Float:
    """Intensity of the beam of each view ``(views, 1, 1)``."""
    levels = np.asarray(beam, dtype=float)
    if levels.shape not in ((), (len(geometry),)) or not (np.isfinite(levels) & (levels > 0)).all():
        fact = f"{beam!r} is not one intensity a view"
        raise InputError("beam", fact, f"give a number > 0, or {len(geometry)} of them")
    return np.broadcast_to(levels, len(geometry))[:, None, None]


def _transmission(sample: Sample, geometry: Geometry, physics: Physics) -> Float:
    rays, averaging = physics.subsamples, physics.averaging
    fraction = transmission(sample, geometry, subsamples=rays, averaging=averaging, spectrum=physics.spectrum)
    return gaussian_filter(fraction, (0, physics.blur, physics.blur), mode="nearest") if physics.blur > 0 else fraction


def _counts(intensity: Float, physics: Physics, rng: np.random.Generator) -> NDArray[np.float32]:
    counts = physics.counts_per_photon * rng.poisson(physics.photons * intensity) + physics.dark
    if physics.dark_noise > 0:
        counts = counts + physics.dark_noise * rng.standard_normal(counts.shape)
    return counts.astype(np.float32)
