"""Pixels of radiographs that carry no weight: marked, counted and filled view by view.

One view at a time, so that a scan needs little memory beyond its own line integrals.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.scan import Scan
from grainmotion.model.thread_map import by_threads
from grainmotion.preprocessing.outliers import constant_lines, spikes

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


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


class View(NamedTuple):
    """One radiograph: its transmission, masks of bad pixels by their kind, and its line integrals if they are known."""

    transmission: Image
    masks: dict[str, Mask]
    line_integrals: Image | None = None


def masked_scan(
    name: str, raw: NDArray, geometry: Geometry, prepared: Callable[[NDArray], View], top: float | None = None
) -> tuple[Scan, PixelReport]:
    """Line integrals of raw images, with their bad pixels marked and filled from good ones beside them.

    Parameters
    ----------
    name : str
        What the images are, for errors.
    raw : (views, rows, columns) array
        Images as in the files.
    geometry : Geometry
        One view an image.
    prepared : callable
        Gives the `View` of an image; a bad pixel counts as of the first mask that holds it.
    top : float, optional
        Count from which a pixel is saturated, for errors.

    Returns
    -------
    scan : Scan
        With ``valid = None`` if all pixels are good.
    report : PixelReport
        Numbers of pixels by their kind; those that contradict their neighbours are spikes.

    Raises
    ------
    InputError
        If a view has no good pixel.
    """
    values, good = large_empty(raw.shape, np.float32), large_empty(raw.shape, bool)

    def mask(k: int) -> Counter[str]:
        image, here = raw[k], Counter[str]()
        view = prepared(image)
        good[k] = True
        for kind, bad in (*view.masks.items(), ("stuck", constant_lines(image))):
            here[kind] += int(np.count_nonzero(bad & good[k]))
            good[k] &= ~bad
        if not good[k].any():
            raise _nothing_left(name, k, here, top)
        odd = spikes(view.transmission, good[k])
        here["spikes"] += int(np.count_nonzero(odd & good[k]))
        good[k] &= ~odd
        values[k] = _filled(_line_integrals(view, good[k]), good[k])
        return here

    numbers = sum(by_threads(mask, range(len(raw))), Counter[str]())
    report = PixelReport(
        total=raw.size,
        dead=numbers["dead"],
        dark=numbers["dark"],
        saturated=numbers["saturated"],
        missing=numbers["missing"],
        stuck=numbers["stuck"],
        spikes=numbers["spikes"],
    )
    return Scan(values, geometry, good if report.bad else None), report


def _line_integrals(view: View, good: Mask) -> Image:
    if view.line_integrals is not None:
        return view.line_integrals
    return -np.log(view.transmission, where=good, out=np.ones_like(view.transmission))


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


def _filled(image: Image, good: Mask) -> Image:
    """An image whose bad pixels have the mean of the good ones among eight neighbours, or else the nearest good one."""
    if good.all():
        return image
    out = np.where(good, image, np.float32(0))
    weights, padded = np.pad(good, 1), np.pad(out, 1)
    row, column = np.nonzero(~good)
    total, number = np.zeros(len(row)), np.zeros(len(row))
    for i in range(3):
        for j in range(3):
            total += padded[row + i, column + j]
            number += weights[row + i, column + j]
    near = number > 0
    out[row[near], column[near]] = total[near] / number[near]
    if not near.all():
        index = ndimage.distance_transform_edt(~good, return_distances=False, return_indices=True)
        r, c = index[:, row[~near], column[~near]]
        out[row[~near], column[~near]] = image[r, c]
    return out
