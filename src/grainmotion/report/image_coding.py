"""Radiographs as bytes for the page: averaged over blocks of pixels, one byte a pixel.

The page gets the simulated and the residual radiograph of a view and adds them for the measured one.  Simulated ones
are smooth and compress well; steps of a residual are a third of its noise, and grow with it where it is large, so that
no byte is spent on digits of the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from grainmotion._typing import Float, Image

MASKED = 255
"""Byte of pixels without a value."""
ZERO = 127
"""Byte of a residual of zero; residuals have bytes up to twice this."""
STEPS_OF_NOISE = 3
"""Steps of a residual's bytes in one standard deviation of its noise."""


@dataclass(frozen=True)
class Coding:
    """What the bytes i of one view mean.

    Simulated: ``low + step i``.  Residual: ``knee sinh(fine (i − ZERO) / knee)``, or ``fine (i − ZERO)`` if ``knee``
    is None.  All are line integrals.
    """

    low: float
    step: float
    fine: float
    knee: float | None

    @classmethod
    def of(cls, simulated: Image, residual: Image) -> Coding:
        """The coding that holds all finite values of these images."""
        low, high = _ends(simulated)
        step = (high - low) / (MASKED - 1) if high > low else 1.0
        sizes = np.abs(residual[np.isfinite(residual)]).astype(float)
        largest = float(sizes.max()) if sizes.size else 0.0
        if largest == 0:
            return cls(_short(low), _short(step), 1.0, None)
        noise = 1.4826 * float(np.median(sizes))  # the standard deviation, if few pixels misfit
        fine = max(noise / STEPS_OF_NOISE, 1e-6 * largest)
        if largest <= fine * ZERO:
            return cls(_short(low), _short(step), _short(fine), None)
        # the knee, in steps, above which steps grow so that the largest residual has the last byte
        knee = brentq(lambda k: k * math.asinh(largest / (fine * k)) - ZERO, 1.0, 1e9)
        return cls(_short(low), _short(step), _short(fine), _short(knee * fine))

    def simulated_bytes(self, image: Image) -> NDArray[np.uint8]:
        """Bytes of a simulated radiograph."""
        return _bytes(image, (image - self.low) / self.step, MASKED - 1)

    def residual_bytes(self, image: Image) -> NDArray[np.uint8]:
        """Bytes of a residual radiograph."""
        steps = image / self.fine if self.knee is None else np.arcsinh(image / self.knee) * (self.knee / self.fine)
        return _bytes(image, steps + ZERO, 2 * ZERO)

    def simulated_values(self, coded: NDArray[np.uint8]) -> Float:
        """Line integrals of a simulated radiograph's bytes, NaN where masked."""
        return np.where(coded == MASKED, np.nan, self.low + self.step * coded)

    def residual_values(self, coded: NDArray[np.uint8]) -> Float:
        """Line integrals of a residual's bytes, NaN where masked."""
        steps = self.fine * (coded.astype(float) - ZERO)
        values = steps if self.knee is None else self.knee * np.sinh(steps / self.knee)
        return np.where(coded == MASKED, np.nan, values)


def block_means(image: Image, edge: int) -> Image:
    """Means of the finite pixels of ``edge`` × ``edge`` blocks from the first pixel on; NaN where fewer than half are.

    Blocks at the far edges are averaged over the pixels that they have.
    """
    if edge == 1:
        return image
    finite = np.isfinite(image)
    whole = bool(finite.all())
    sizes = np.outer(*(np.minimum(edge, n - np.arange(0, n, edge)) for n in image.shape)).astype(np.float32)
    sums = _block_sums(image if whole else np.where(finite, image, 0), edge)
    counts = sizes if whole else _block_sums(finite, edge)
    return np.where(2 * counts >= sizes, sums / np.maximum(counts, 1), np.float32(np.nan))


def _block_sums(image: Image | NDArray[np.bool_], edge: int) -> NDArray[np.float32]:
    padded = np.pad(image.astype(np.float32, copy=False), [(0, -n % edge) for n in image.shape])
    rows = padded.reshape(-1, edge, padded.shape[1]).sum(axis=1)  # whole rows first, which is several times as fast
    return np.asarray(rows.reshape(len(rows), -1, edge).sum(axis=2), dtype=np.float32)


def row_differences(coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Each row less the one above it, modulo 256: small numbers, which compress better."""
    return np.diff(coded, axis=0, prepend=np.zeros((1, coded.shape[1]), np.uint8))


def _bytes(image: Image, steps: Image, last: int) -> NDArray[np.uint8]:
    finite = np.isfinite(image)
    return np.where(finite, np.clip(np.rint(np.where(finite, steps, 0)), 0, last), MASKED).astype(np.uint8)


def _ends(image: Image) -> tuple[float, float]:
    values = image[np.isfinite(image)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)


def _short(value: float) -> float:
    """A number with few digits, for JSON."""
    return float(f"{value:.6g}")
