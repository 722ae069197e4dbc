"""Deformation gradient at a grain from the displacements of those around it, by local least squares.

An affine field u = a + G (X − Xᵢ) is fitted to grain i and its neighbours within a radius, with weights (1 − r²/R²)²,
so that a grain on the rim counts for nothing; F = I + G.  It is exact for a linear field and smoother than the average
over tetrahedra: a wider radius averages more noise away, and more of the field.  What the fit leaves of the
displacements is their non-affine part (as D²min of Falk and Langer, Physical Review E 57, 7192, 1998, which fits
differences to grain i; here the displacement of grain i is one of the data).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion._typing import Float
from grainmotion.mechanics.gradient_weights import GradientWeights, weights_from_entries

MIN_SPREAD = 0.02
"""Smallest second moment of the neighbours' places, relative to the largest: below it they lie nearly in a plane."""


@dataclass(frozen=True, eq=False)
class LocalFits:
    """Weights of F at each of n grains, and what is needed of the fits.

    Attributes
    ----------
    weights : GradientWeights
        Of F; without entries for grains whose neighbours do not determine it.
    determined : (n,) bool array
        Whether the neighbours determine F.
    counts : (n,) int array
        Grains within the radius, the grain itself included.
    """

    weights: GradientWeights
    determined: NDArray[np.bool_]
    counts: NDArray[np.int64]
    _pairs: tuple[NDArray[np.int64], NDArray[np.int64], Float]  # grain, neighbour, weight of the neighbour
    _offsets: Float  # place of the neighbour from the weighted mean of places, mm

    def non_affine(self, displacements: Float, gradients: Float) -> Float:
        """Root mean square of displacements ``(n, 3)`` about the fitted fields, mm, ``(n,)``."""
        rows, columns, weights = self._pairs
        n = len(self.counts)
        sums = np.bincount(rows, weights, n)
        mean = _sums(rows, weights[:, None] * displacements[columns], n) / sums[:, None]
        fitted = mean[rows] + np.einsum("kij,kj->ki", gradients[rows] - np.eye(3), self._offsets)
        squares = ((displacements[columns] - fitted) ** 2).sum(axis=1)
        return np.where(self.determined, np.sqrt(np.bincount(rows, weights * squares, n) / sums), np.nan)


def fit_around(points: Float, radius: float, *, planar: bool = False) -> LocalFits:
    """Fits around each of the points ``(n, 3)``, mm, to those within a radius, mm; at one z if ``planar``."""
    n, dimension = len(points), 2 if planar else 3
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray") if n else np.zeros((0, 2), dtype=np.int64)
    rows = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(n)]).astype(np.int64)
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(n)]).astype(np.int64)
    places = points[columns] - points[rows]
    weights = (1 - (places**2).sum(axis=1) / radius**2) ** 2
    mean = _sums(rows, weights[:, None] * places, n) / np.bincount(rows, weights, n)[:, None]
    offsets = places - mean[rows]
    moments = _sums(rows, weights[:, None, None] * offsets[:, :, None] * offsets[:, None, :], n)
    moments = moments[:, :dimension, :dimension]
    spread = np.linalg.eigvalsh(moments)
    counts = np.bincount(rows, minlength=n)
    determined = (counts > dimension) & (spread[:, 0] > MIN_SPREAD * spread[:, -1])
    inverse = np.zeros((n, 3, 3))
    inverse[determined, :dimension, :dimension] = np.linalg.inv(moments[determined])
    used = determined[rows]
    entries = weights[used, None] * np.einsum("kij,kj->ki", inverse[rows[used]], offsets[used])
    found = weights_from_entries(rows[used], columns[used], entries, (n, n))
    return LocalFits(found, determined, counts, (rows, columns, weights), offsets)


def _sums(rows: NDArray[np.int64], values: Float, count: int) -> Float:
    """Sums of values ``(k, ...)`` that share a row, ``(count, ...)``."""
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, rows, values)
    return total
