"""Flat-field correction: line integrals from counts, flats and darks, or from transmissions.

The line integral of a pixel is −ln((I − dark)/(flat − dark)).  Pixels for which it is undefined (dead,
without any transmission, saturated) are marked in `Scan.valid`, carry no weight in any fit, and hold the
mean of their good neighbours, as filters need finite values; `PixelReport` counts them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan

MAX_BAD_FLAT_SHARE = 0.05
"""Largest share of the flat at or below the dark; more means that the files are mixed up."""
MEDIAN_SAMPLE = 1 << 16
"""Pixels drawn at random for the median of a scan; the median of all takes as long as reading them."""
MAX_MEDIAN = 20.0
"""Largest median of transmissions and of line integrals; above it they are counts."""


@dataclass(frozen=True)
class PixelReport:
    """How many pixels of a scan carry no weight, and why; all views together.

    Attributes
    ----------
    total : int
        Pixels of all views.
    dead : int
        Pixels whose flat is not above the dark, counted once in each view.
    dark : int
        Other pixels without signal: counts at or below the dark, transmission at or below zero.
    saturated : int
        Other pixels at the top of the camera's range, in the radiograph or in the flat.
    """

    total: int
    dead: int = 0
    dark: int = 0
    saturated: int = 0

    @property
    def bad(self) -> int:
        """Pixels that carry no weight."""
        return self.dead + self.dark + self.saturated

    def __str__(self) -> str:
        kinds = f"{self.dead} dead, {self.dark} dark, {self.saturated} saturated"
        return f"{self.bad} of {self.total} pixels masked: {kinds}"


@checked_arguments
def line_integrals_from_counts(
    counts: ArrayLike, flats: ArrayLike, darks: ArrayLike | None, geometry: Geometry, *, saturation: float | None = None
) -> tuple[Scan, PixelReport]:
    """Turn camera counts into line integrals.

    Parameters
    ----------
    counts : (views, rows, columns) array
        Raw radiographs.
    flats, darks : (n, rows, columns) or (rows, columns) array
        Images of the open beam and of no beam, averaged; ``darks = None`` is a dark of zero.
    geometry : Geometry
        One view a radiograph.
    saturation : float, optional
        Counts from this level on are saturated; by default the largest value of an integer type.

    Returns
    -------
    scan : Scan
        Line integrals, with the mask of good pixels and the open beam.
    report : PixelReport
        Numbers of masked pixels.

    Raises
    ------
    InputError
        If shapes disagree, counts are NaN or negative, more than 5 % of the flat is not above the
        dark, or a view has no good pixel.  `InputError.where` is "counts", "flats" or "darks".
    """
    images = np.asarray(counts)
    _check_counts("counts", images)
    _check_shape("counts", images, geometry)
    flat, flat_top = _mean_image("flats", flats, geometry, saturation)
    dark = np.zeros(geometry.shape) if darks is None else _mean_image("darks", darks, geometry, None)[0]
    dead = flat <= dark
    if dead.mean() > MAX_BAD_FLAT_SHARE:
        raise InputError(
            "flats",
            f"{100 * dead.mean():.0f} % of the mean flat is at or below the mean dark",
            "flats below darks: check that flats and darks are not swapped and belong to this scan",
        )
    top = _saturation_level(images.dtype, saturation)
    saturated = (images >= top) | flat_top if top is not None else np.broadcast_to(flat_top, images.shape)
    signal = images.astype(np.float32) - dark.astype(np.float32)
    dark_pixels = signal <= 0
    open_beam = np.where(dead, 1.0, flat - dark).astype(np.float32)
    good = ~(dead | saturated | dark_pixels)
    report = PixelReport(
        total=images.size,
        dead=int(dead.sum()) * len(images),
        dark=int((dark_pixels & ~dead & ~saturated).sum()),
        saturated=int((saturated & ~dead).sum()),
    )
    np.divide(signal, open_beam, out=signal)
    beam = np.maximum(open_beam / open_beam[~dead].mean(), 0.01)
    return replace(_from_ratio("counts", signal, good, geometry), open_beam=beam), report


def line_integrals_from_transmission(transmission: ArrayLike, geometry: Geometry) -> tuple[Scan, PixelReport]:
    """Turn transmissions I/I₀, already flat-field corrected, into line integrals −ln(I/I₀).

    Values at or below zero are masked and counted as dark; NaN is an error.
    """
    images = np.asarray(transmission, dtype=np.float32)
    _check_shape("transmission", images, geometry)
    _check_finite("transmission", images)
    typical = _typical(images)
    if typical > MAX_MEDIAN:
        raise InputError(
            "transmission",
            f"the median is {typical:.4g}, where I/I0 is about 0 to 1",
            'if these are camera counts, set kind = "counts" and give flats and darks',
        )
    good = images > 0
    report = PixelReport(total=images.size, dark=int((~good).sum()))
    return _from_ratio("transmission", images, good, geometry), report


def checked_line_integrals(images: ArrayLike, geometry: Geometry) -> tuple[Scan, PixelReport]:
    """Take line integrals as they are; NaN, and values that can only be counts, are errors."""
    values = np.asarray(images, dtype=np.float32)
    _check_shape("line-integrals", values, geometry)
    _check_finite("line-integrals", values)
    typical = _typical(values)
    if typical > MAX_MEDIAN:
        raise InputError(
            "line-integrals",
            f"the median is {typical:.4g}, and exp(-{typical:.4g}) of the beam reaches no camera",
            'if these are camera counts, set kind = "counts" and give flats and darks',
        )
    return Scan(values, geometry), PixelReport(total=values.size)


def _saturation_level(dtype: np.dtype, saturation: float | None) -> float | None:
    if saturation is not None:
        return saturation
    return float(np.iinfo(dtype).max) if np.issubdtype(dtype, np.integer) else None


def _mean_image(
    name: str, images: ArrayLike, geometry: Geometry, saturation: float | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Mean of a stack of flats or darks, and where any of them is saturated."""
    stack = np.asarray(images)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1:] != geometry.shape or len(stack) == 0:
        fact = f"images of {stack.shape[1:]} pixels, where the radiographs have {geometry.shape}"
        raise InputError(name, fact, f"give {name} of the same camera settings")
    _check_counts(name, stack)
    top = _saturation_level(stack.dtype, saturation)
    saturated = np.zeros(geometry.shape, dtype=bool)
    if top is not None:
        saturated |= np.asarray(stack >= top).any(axis=0)
    return stack.mean(axis=0, dtype=float), saturated


def _check_shape(name: str, images: NDArray, geometry: Geometry) -> None:
    if images.ndim != 3 or images.shape[0] != len(geometry):
        count = len(images) if images.ndim == 3 else 1
        fact = f"{count} radiographs, but the geometry has {len(geometry)} views"
        raise InputError(name, fact, "give one geometry row a radiograph")
    if images.shape[1:] != geometry.shape:
        fact = f"radiographs of {images.shape[1:]} pixels, but the geometry has {geometry.shape}"
        raise InputError(name, fact, "give rows and columns of the panel")


def _typical(images: NDArray) -> float:
    """Median of pixels drawn at random."""
    flat = images.reshape(-1)
    if flat.size > MEDIAN_SAMPLE:
        flat = flat[np.random.default_rng(0).integers(0, flat.size, MEDIAN_SAMPLE)]
    return float(np.median(flat)) if flat.size else 0.0


def _check_finite(name: str, images: NDArray) -> None:
    bad = ~np.isfinite(images)
    if bad.any():
        view, row, column = np.argwhere(bad)[0]
        fact = f"{int(bad.sum())} values are NaN or infinite, first in view {view}, row {row}, column {column}"
        raise InputError(name, fact, "repair those pixels before, or give raw counts with flats and darks")


def _check_counts(name: str, images: NDArray) -> None:
    if not (np.issubdtype(images.dtype, np.integer) or np.issubdtype(images.dtype, np.floating)):
        raise InputError(name, f"values of type {images.dtype}", "give grey images of integers or floats")
    if not np.issubdtype(images.dtype, np.integer):
        _check_finite(name, images)
    lowest = images.min() if images.size else 0
    if lowest < 0:
        number = int((images < 0).sum())
        raise InputError(
            name,
            f"{number} counts are negative, the lowest is {lowest:.6g}",
            'give raw counts, or set kind = "transmission" or "line-integrals" for corrected images',
        )


def _from_ratio(name: str, ratio: NDArray[np.float32], good: NDArray[np.bool_], geometry: Geometry) -> Scan:
    empty = ~good.any(axis=(1, 2))
    if empty.any():
        fact = f"view {int(np.argmax(empty))} has no pixel that is neither dead, dark nor saturated"
        raise InputError(name, fact, "check the flats, the darks and the saturation level")
    values = -np.log(ratio, where=good, out=np.ones_like(ratio))
    if good.all():
        return Scan(values, geometry)
    return Scan(_repaired(values, good), geometry, good)


def _repaired(values: NDArray[np.float32], good: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Replace each bad pixel by the mean of its good neighbours among eight, or else by the nearest good pixel."""
    out = np.where(good, values, np.float32(0))
    weights = np.pad(good, ((0, 0), (1, 1), (1, 1)))
    padded = np.pad(out, ((0, 0), (1, 1), (1, 1)))
    view, row, column = np.nonzero(~good)
    total = np.zeros(len(view))
    number = np.zeros(len(view))
    for i in range(3):
        for j in range(3):
            total += padded[view, row + i, column + j]
            number += weights[view, row + i, column + j]
    near = number > 0
    out[view[near], row[near], column[near]] = total[near] / number[near]
    for k in np.unique(view[~near]):
        index = ndimage.distance_transform_edt(~good[k], return_distances=False, return_indices=True)
        here = ~near & (view == k)
        r, c = index[:, row[here], column[here]]
        out[k, row[here], column[here]] = values[k, r, c]
    return out
