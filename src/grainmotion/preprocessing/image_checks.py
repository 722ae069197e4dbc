"""Checks of images before they become line integrals: shapes, types, and values that cannot be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import counted
from grainmotion.preprocessing.beam_images import MAX_MISSING_SHARE

MEDIAN_SAMPLE = 1 << 16
"""Pixels drawn at random for the median of a scan; the median of all takes as long as reading them."""


def beam_stack(name: str, images: ArrayLike, geometry: Geometry) -> NDArray:
    """Flats or darks as a checked stack."""
    stack = np.asarray(images)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1:] != geometry.shape or len(stack) == 0:
        fact = f"images of {stack.shape[1:]} pixels, where the radiographs have {geometry.shape}"
        raise InputError(name, fact, f"give {name} of the same camera settings")
    check_counts(name, stack)
    return stack


def check_shape(name: str, images: NDArray, geometry: Geometry) -> None:
    """Refuse radiographs whose number or size differs from the geometry's."""
    if images.ndim != 3 or images.shape[0] != len(geometry):
        count = len(images) if images.ndim == 3 else 1
        fact = f"{count} radiographs, but the geometry has {len(geometry)} views"
        raise InputError(name, fact, "give one geometry row a radiograph")
    if images.shape[1:] != geometry.shape:
        fact = f"radiographs of {images.shape[1:]} pixels, but the geometry has {geometry.shape}"
        raise InputError(name, fact, "give rows and columns of the panel")


def typical_value(images: NDArray) -> float:
    """Median of pixels drawn at random, but for those that are NaN or infinite."""
    flat = images.reshape(-1)
    if flat.size > MEDIAN_SAMPLE:
        flat = flat[np.random.default_rng(0).integers(0, flat.size, MEDIAN_SAMPLE)]
    flat = flat[np.isfinite(flat)]
    return float(np.median(flat)) if flat.size else 0.0


def is_floating(images: NDArray) -> bool:
    """Whether the values are floating-point numbers."""
    return bool(np.issubdtype(images.dtype, np.floating))


def check_missing(name: str, images: NDArray) -> None:
    """Refuse images of which too many values are NaN or infinite."""
    share = np.array([(~np.isfinite(image)).mean() for image in counted(images)])
    worst = int(np.argmax(share)) if len(share) else 0
    if len(share) and share[worst] > MAX_MISSING_SHARE:
        row, column = np.argwhere(~np.isfinite(images[worst]))[0]
        fact = f"{100 * share[worst]:.0f} % of view {worst} is NaN or infinite, from row {row}, column {column} on"
        raise InputError(name, fact, "leave that view out, or give the images before they were corrected")


def check_counts(name: str, images: NDArray) -> None:
    """Refuse values that are no counts."""
    if not (np.issubdtype(images.dtype, np.integer) or is_floating(images)):
        raise InputError(name, f"values of type {images.dtype}", "give grey images of integers or floats")
    if is_floating(images):
        check_missing(name, images)
    if np.issubdtype(images.dtype, np.unsignedinteger):
        return
    numbers = [int(np.count_nonzero(_negative(image))) for image in counted(images)]
    if any(numbers):
        signed = "unsigned 16-bit numbers that were read as signed ones; save the images as unsigned, or set kind = "
        raw = "give raw counts, or set kind = "
        remedy = f'{signed if images.dtype == np.int16 else raw}"transmission" or "line-integrals" for corrected images'
        remedy = f"probably {remedy}" if images.dtype == np.int16 else remedy
        lowest = min(image[_negative(image)].min() for image, number in zip(images, numbers, strict=True) if number)
        fact = f"{sum(numbers)} counts are negative, the lowest is {lowest:.6g}"
        raise InputError(name, fact, remedy)


def _negative(image: NDArray) -> NDArray[np.bool_]:
    """Pixels that are negative and finite."""
    return np.asarray((image < 0) & np.isfinite(image))
