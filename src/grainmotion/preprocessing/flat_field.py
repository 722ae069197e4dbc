"""Flat-field correction: line integrals from counts, flats and darks, or from transmissions.

The line integral of a pixel is −ln((I − dark)/(flat − dark)).  Pixels for which it is undefined (dead, NaN, without any
transmission, saturated) or that contradict their neighbours (`preprocessing.outliers`) are marked in `Scan.valid`,
carry no weight in any fit, and hold the mean of their good neighbours, as filters need finite values; `PixelReport`
counts them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.preprocessing.beam_images import BeamImage, mean_beam_images
from grainmotion.preprocessing.image_checks import (
    beam_stack,
    check_counts,
    check_missing,
    check_shape,
    is_floating,
    typical_value,
)
from grainmotion.preprocessing.masked_pixels import PixelReport, View, masked_scan
from grainmotion.preprocessing.outliers import PanelFacts, panel_facts

MAX_BAD_FLAT_SHARE = 0.05
"""Largest share of the flat at or below the dark; more means that the files are mixed up."""
FLAT_RATIOS = (0.05, 3.0)
"""Flat of a pixel over that of the 7 x 7 pixels around it; others are dead or stuck.  Gains differ by some 20 %."""
MAX_MEDIAN = 20.0
"""Largest median of transmissions and of line integrals; above it they are counts."""


@checked_arguments
def line_integrals_from_counts(
    counts: ArrayLike,
    flats: ArrayLike,
    darks: ArrayLike | None,
    geometry: Geometry,
    *,
    saturation: float | None = None,
    panel: PanelFacts | None = None,
) -> tuple[Scan, PixelReport]:
    """Turn camera counts into line integrals.

    Parameters
    ----------
    counts : (views, rows, columns) array
        Raw radiographs.
    flats, darks : (n, rows, columns) or (rows, columns) array
        Images of the open beam and of no beam, averaged; ``darks = None`` is a dark of zero.  Frames that clearly do
        not belong to the others are left out.
    geometry : Geometry
        One view a radiograph.
    saturation : float, optional
        Counts from this level on are saturated; by default the largest value of an integer type, or the top of a
        camera's range where many pixels have it.
    panel : PanelFacts, optional
        What is known from the whole scan, of which these may be some views; by default it is found in ``counts``.

    Returns
    -------
    scan : Scan
        Line integrals, with the mask of good pixels and the open beam.
    report : PixelReport
        Numbers of masked pixels.

    Raises
    ------
    InputError
        If shapes disagree, counts are negative, more than 10 % of an image is NaN, more than 5 % of the flat is not
        above the dark, or a view has no good pixel.  `InputError.where` is "counts", "flats" or "darks".

    Examples
    --------
    >>> recording = case.state_counts(truth, (0, 90))
    >>> scan, pixels = gm.line_integrals_from_counts(
    ...     recording.counts, recording.flats, recording.darks, recording.geometry
    ... )
    >>> len(scan), pixels.dead
    (2, 0)
    """
    images = np.asarray(counts)
    check_counts("counts", images)
    check_shape("counts", images, geometry)
    flat_stack = beam_stack("flats", flats, geometry)
    dark_stack = None if darks is None else beam_stack("darks", darks, geometry)
    panel = panel_facts(images, flat_stack) if panel is None else panel
    top = saturation if saturation is not None else panel.top
    flat, dark = mean_beam_images(flat_stack, dark_stack, _saturation_level(flat_stack.dtype, top))
    dark_level = np.zeros(geometry.shape) if dark is None else dark.mean
    open_beam, dead, odd_flat = _open_beam(flat, dark_level)
    top = _saturation_level(images.dtype, top)
    stuck = panel.stuck | odd_flat
    missing = flat.missing if dark is None else flat.missing | dark.missing

    def prepared(image: NDArray) -> View:
        signal = image.astype(np.float32) - dark_level.astype(np.float32)
        lost = missing | ~np.isfinite(image) if is_floating(image) else missing
        saturated = flat.saturated if top is None else (image >= top) | flat.saturated
        masks = {"dead": dead, "missing": lost, "saturated": saturated, "dark": signal <= 0, "stuck": stuck}
        return View(signal / open_beam, masks)

    scan, report = masked_scan("counts", images, geometry, prepared, top)
    report = replace(
        report,
        flats_left_out=flat.left_out,
        darks_left_out=() if dark is None else dark.left_out,
        values_left_out=flat.values + (0 if dark is None else dark.values),
    )
    beam = np.maximum(open_beam / open_beam[~(dead | flat.missing)].mean(), 0.01)
    return replace(scan, open_beam=beam), report


def _open_beam(flat: BeamImage, dark_level: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray, NDArray]:
    """Flat minus dark, 1 where it is dead; pixels that are dead, and those that are far brighter than the others."""
    dead = (flat.mean <= dark_level) & ~flat.missing
    if dead.mean() > MAX_BAD_FLAT_SHARE:
        raise InputError(
            "flats",
            f"{100 * dead.mean():.0f} % of the mean flat is at or below the mean dark",
            "flats below darks: exchange them if they are swapped, check that the shutter was open for the flats "
            "and closed for the darks, or turn inverted grey values round (65535 - counts)",
        )
    beam = flat.mean - dark_level
    typical = ndimage.uniform_filter(np.clip(beam, 0, FLAT_RATIOS[1] * np.median(beam)), 7)
    dead |= (beam < FLAT_RATIOS[0] * typical) & ~flat.missing
    return np.where(dead | flat.missing, 1.0, beam).astype(np.float32), dead, beam > FLAT_RATIOS[1] * typical


def line_integrals_from_transmission(
    transmission: ArrayLike, geometry: Geometry, *, panel: PanelFacts | None = None
) -> tuple[Scan, PixelReport]:
    """Turn transmissions I/I₀, already flat-field corrected, into line integrals −ln(I/I₀).

    Values at or below zero are masked and counted as dark, NaN as missing; ``panel`` as in
    `line_integrals_from_counts`.
    """
    images = np.asarray(transmission, dtype=np.float32)
    check_shape("transmission", images, geometry)
    check_missing("transmission", images)
    typical = typical_value(images)
    if typical > MAX_MEDIAN:
        raise InputError(
            "transmission",
            f"the median is {typical:.4g}, where I/I0 is about 0 to 1",
            'if these are camera counts, set kind = "counts" and give flats and darks; if they are transmissions '
            "times a factor, divide them by it",
        )
    panel = panel_facts(images) if panel is None else panel

    def prepared(image: NDArray) -> View:
        return View(image, {"missing": ~np.isfinite(image), "dark": image <= 0, "stuck": panel.stuck})

    return masked_scan("transmission", images, geometry, prepared)


def checked_line_integrals(
    images: ArrayLike, geometry: Geometry, *, panel: PanelFacts | None = None
) -> tuple[Scan, PixelReport]:
    """Take line integrals as they are; NaN is masked and counted, values that can only be counts are an error."""
    values = np.asarray(images, dtype=np.float32)
    check_shape("line-integrals", values, geometry)
    check_missing("line-integrals", values)
    refuse_counts(values)
    panel = panel_facts(values) if panel is None else panel

    def prepared(image: NDArray) -> View:
        transmission = np.exp(-np.clip(image, -MAX_MEDIAN, None))
        return View(transmission, {"missing": ~np.isfinite(image), "stuck": panel.stuck}, image)

    return masked_scan("line-integrals", values, geometry, prepared)


def refuse_counts(line_integrals: NDArray) -> None:
    """An error where what should be line integrals can only be counts."""
    typical = typical_value(line_integrals)
    if typical > MAX_MEDIAN:
        raise InputError(
            "line-integrals",
            f"the median is {typical:.4g}, and exp(-{typical:.4g}) of the beam reaches no camera",
            'if these are camera counts, set kind = "counts" and give flats and darks; arrays of counts become line '
            "integrals by gm.line_integrals_from_counts",
        )


def _saturation_level(dtype: np.dtype, saturation: float | None) -> float | None:
    if saturation is not None:
        return saturation
    return float(np.iinfo(dtype).max) if np.issubdtype(dtype, np.integer) else None
