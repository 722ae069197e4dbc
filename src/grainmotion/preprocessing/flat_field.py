"""Flat-field correction: line integrals from counts, flats and darks, or from transmissions.

The line integral of a pixel is −ln((I − dark)/(flat − dark)).  Pixels for which it is undefined (dead, NaN, without any
transmission, saturated) or that contradict their neighbours (`preprocessing.outliers`) are marked in `Scan.valid`,
carry no weight in any fit, and hold the mean of their good neighbours, as filters need finite values; `PixelReport`
counts them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

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
from grainmotion.preprocessing.outliers import PanelFacts, constant_lines, panel_facts, spikes

MAX_BAD_FLAT_SHARE = 0.05
"""Largest share of the flat at or below the dark; more means that the files are mixed up."""
FLAT_RATIOS = (0.05, 3.0)
"""Flat of a pixel over that of the 7 x 7 pixels around it; others are dead or stuck.  Gains differ by some 20 %."""
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
        Pixels whose flat is not above the dark or far below that of its neighbours, counted once in each view.
    dark : int
        Other pixels without signal: counts at or below the dark, transmission at or below zero.
    saturated : int
        Other pixels at the top of the camera's range, in the radiograph or in the flat.
    missing : int
        Other pixels that are NaN or infinite.
    stuck : int
        Other pixels that have one value in all views, or a flat far above that of its neighbours.
    spikes : int
        Other pixels that are far brighter or darker than all of their neighbours, such as zingers and hot columns.
    flats_left_out, darks_left_out : tuple of int
        Frames that do not belong to the others, from 0.
    values_left_out : int
        Single values of flats and darks that are NaN or zingers.
    """

    total: int
    dead: int = 0
    dark: int = 0
    saturated: int = 0
    missing: int = 0
    stuck: int = 0
    spikes: int = 0
    flats_left_out: tuple[int, ...] = ()
    darks_left_out: tuple[int, ...] = ()
    values_left_out: int = 0

    @property
    def bad(self) -> int:
        """Pixels that carry no weight."""
        return self.dead + self.dark + self.saturated + self.missing + self.stuck + self.spikes

    def __str__(self) -> str:
        kinds = f"{self.dead} dead, {self.dark} dark, {self.saturated} saturated"
        more = {"NaN": self.missing, "stuck": self.stuck, "unlike their neighbours": self.spikes}
        kinds += "".join(f", {number} {kind}" for kind, number in more.items() if number)
        return f"{self.bad} of {self.total} pixels masked: {kinds}"


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
    missing = ~np.isfinite(images) if is_floating(images) else np.zeros((1, 1, 1), bool)
    missing = missing | flat.missing | (False if dark is None else dark.missing)
    top = _saturation_level(images.dtype, top)
    saturated = (images >= top) | flat.saturated if top is not None else flat.saturated
    signal = images.astype(np.float32) - dark_level.astype(np.float32)
    dark_pixels = signal <= 0
    stuck = panel.stuck | odd_flat
    np.divide(signal, open_beam, out=signal)
    masks = {"dead": dead, "missing": missing, "saturated": saturated, "dark": dark_pixels, "stuck": stuck}
    good, report = _masked("counts", masks, images, lambda view: signal[view], top)
    report = replace(
        report,
        flats_left_out=flat.left_out,
        darks_left_out=() if dark is None else dark.left_out,
        values_left_out=flat.values + (0 if dark is None else dark.values),
    )
    beam = np.maximum(open_beam / open_beam[~(dead | flat.missing)].mean(), 0.01)
    return replace(_from_ratio(signal, good, geometry), open_beam=beam), report


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


def _masked(
    name: str,
    masks: dict[str, NDArray[np.bool_]],
    raw: NDArray,
    transmission: Callable[[int], NDArray[np.float32]],
    top: float | None = None,
) -> tuple[NDArray[np.bool_], PixelReport]:
    """Good pixels, and how many are bad by each mask, the first that holds; then by their neighbours."""
    good = np.ones(raw.shape, bool)
    numbers: Counter[str] = Counter()

    for k, image in enumerate(raw):
        here: Counter[str] = Counter()

        def mask(kind: str, bad: NDArray[np.bool_], view: int = k, here: Counter[str] = here) -> None:
            here[kind] += int(np.count_nonzero(bad & good[view]))
            good[view] &= ~bad

        for kind, bad in masks.items():
            mask(kind, np.broadcast_to(bad, raw.shape)[k])
        mask("stuck", constant_lines(image))
        if not good[k].any():
            raise _nothing_left(name, k, here, top)
        mask("spikes", spikes(transmission(k), good[k]))
        numbers += here
    report = PixelReport(
        total=raw.size,
        dead=numbers["dead"],
        dark=numbers["dark"],
        saturated=numbers["saturated"],
        missing=numbers["missing"],
        stuck=numbers["stuck"],
        spikes=numbers["spikes"],
    )
    return good, report


def _nothing_left(name: str, view: int, numbers: Counter[str], top: float | None) -> InputError:
    """The error of a view without any good pixel, with what most of its pixels are."""
    kind, number = numbers.most_common(1)[0]
    remedies = {
        "dark": "the radiograph is black (shutter closed, no beam, an empty file), or these are no counts: leave it "
        "out by the key views, or set kind to what the images are",
        "saturated": "the camera was overexposed, in the radiographs or in the flats, and what it lost cannot be "
        "found again: expose for a shorter time",
    }
    share = 100 * number / numbers.total()
    fact = f"view {view} has no pixel that is neither dead, dark nor saturated: {share:.0f} % are {kind}"
    fact += f" at {top:.0f}" if kind == "saturated" and top is not None else ""
    return InputError(name, fact, remedies.get(kind, "check the flats, the darks and the saturation level"))


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
    masks = {"missing": ~np.isfinite(images), "dark": images <= 0, "stuck": panel.stuck}
    good, report = _masked("transmission", masks, images, lambda view: images[view])
    return _from_ratio(images, good, geometry), report


def checked_line_integrals(
    images: ArrayLike, geometry: Geometry, *, panel: PanelFacts | None = None
) -> tuple[Scan, PixelReport]:
    """Take line integrals as they are; NaN is masked and counted, values that can only be counts are an error."""
    values = np.asarray(images, dtype=np.float32)
    check_shape("line-integrals", values, geometry)
    check_missing("line-integrals", values)
    refuse_counts(values)
    panel = panel_facts(values) if panel is None else panel
    masks = {"missing": ~np.isfinite(values), "stuck": panel.stuck}
    good, report = _masked(
        "line-integrals", masks, values, lambda view: np.exp(-np.clip(values[view], -MAX_MEDIAN, None))
    )
    if good.all():
        return Scan(values, geometry), report
    return Scan(_repaired(values, good), geometry, good), report


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


def _from_ratio(ratio: NDArray[np.float32], good: NDArray[np.bool_], geometry: Geometry) -> Scan:
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
