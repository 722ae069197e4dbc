"""Pixels of a radiograph that are far brighter or darker than all of their surroundings."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, nogil=True)
def mark_spikes(
    image: np.ndarray, limits: tuple[float, float, float, float], found: np.ndarray, lines: np.ndarray
) -> None:
    """Mark spikes of one image, and count the pixels of each line that differ from the lines at both sides.

    ``limits`` holds the least distance where the transmission is 1 (elsewhere it goes with its square root), the
    transmission that is brighter than air, and the ratios of bright and of dark spikes to their surroundings.
    ``found[rows, columns]`` becomes True at spikes; ``lines[0, row]`` and ``lines[1, column]`` grow by one for each
    (bright, dark) pixel of the line.
    """
    rows, columns = image.shape
    for r in range(rows):
        for c in range(columns):
            value = image[r, c]
            for axis in range(2):
                kind = _beside_lines(image, r, c, axis, limits)
                if kind >= 0:
                    lines[axis, r if axis == 0 else c, kind] += 1
            if _is_bright(value, image[r, _next(c, -2, columns)], limits):
                high = _ring_maximum(image, r, c)
                if _is_bright(value, high, limits):
                    _mark_bright(image, r, c, high, limits, found)
            elif _is_dark(value, image[r, _next(c, -2, columns)], limits):
                low = _ring_minimum(image, r, c)
                if _is_dark(value, low, limits):
                    found[r, c] = True


@nb.njit(cache=CACHE, nogil=True)
def _next(index: int, step: int, count: int) -> int:
    """The index some steps further, or as many steps back where that lies beyond the image."""
    return index + step if 0 <= index + step < count else index - step


@nb.njit(cache=CACHE, nogil=True)
def _is_bright(value: float, surroundings: float, limits: tuple[float, float, float, float]) -> bool:
    distance, beyond_air, ratio, _ = limits
    if value <= surroundings or (value <= ratio * surroundings and value <= beyond_air):
        return False
    return value > surroundings + distance * math.sqrt(max(surroundings, 0.0))


@nb.njit(cache=CACHE, nogil=True)
def _is_dark(value: float, surroundings: float, limits: tuple[float, float, float, float]) -> bool:
    distance, _, _, ratio = limits
    limit = ratio * surroundings
    return value < limit and value < limit - distance * math.sqrt(max(surroundings, 0.0))


@nb.njit(cache=CACHE, nogil=True)
def _ring_maximum(image: np.ndarray, r: int, c: int) -> float:
    """Largest of the 16 pixels on the border of the 5 x 5 around a pixel."""
    high = -math.inf
    for i in range(-2, 3):
        for j in range(-2, 3):
            if max(abs(i), abs(j)) == 2:
                high = max(high, image[_next(r, i, image.shape[0]), _next(c, j, image.shape[1])])
    return high


@nb.njit(cache=CACHE, nogil=True)
def _ring_minimum(image: np.ndarray, r: int, c: int) -> float:
    """Smallest of them."""
    low = math.inf
    for i in range(-2, 3):
        for j in range(-2, 3):
            if max(abs(i), abs(j)) == 2:
                low = min(low, image[_next(r, i, image.shape[0]), _next(c, j, image.shape[1])])
    return low


@nb.njit(cache=CACHE, nogil=True)
def _mark_bright(
    image: np.ndarray, r: int, c: int, high: float, limits: tuple[float, float, float, float], found: np.ndarray
) -> None:
    """Mark a bright spike with those of its eight neighbours that are as bright."""
    for i in range(max(r - 1, 0), min(r + 2, image.shape[0])):
        for j in range(max(c - 1, 0), min(c + 2, image.shape[1])):
            if _is_bright(image[i, j], high, limits):
                found[i, j] = True


@nb.njit(cache=CACHE, nogil=True)
def _beside_lines(image: np.ndarray, r: int, c: int, axis: int, limits: tuple[float, float, float, float]) -> int:
    """0 if a pixel is brighter than air and than the lines at both sides, 1 if far darker than them, -1 else."""
    value, beyond_air = image[r, c], limits[1]
    first = _across(image, r, c, axis, -3)
    if value > beyond_air:
        if (
            _is_bright(value, first, limits)
            and _is_bright(value, _across(image, r, c, axis, -4), limits)
            and _is_bright(value, _across(image, r, c, axis, 3), limits)
            and _is_bright(value, _across(image, r, c, axis, 4), limits)
        ):
            return 0
    elif _is_dark(value, first, limits) and (
        _is_dark(value, _across(image, r, c, axis, -4), limits)
        and _is_dark(value, _across(image, r, c, axis, 3), limits)
        and _is_dark(value, _across(image, r, c, axis, 4), limits)
    ):
        return 1
    return -1


@nb.njit(cache=CACHE, nogil=True)
def _across(image: np.ndarray, r: int, c: int, axis: int, step: int) -> float:
    """The pixel some lines further."""
    if axis == 0:
        return image[_next(r, step, image.shape[0]), c]
    return image[r, _next(c, step, image.shape[1])]
