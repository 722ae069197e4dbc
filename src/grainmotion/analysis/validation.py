"""Errors of measured motions against true ones, grain by grain.

Grains are paired by their centres in the reference state.  The two centres of a pair differ a little (a segmented grain
is not quite the true one), so the true motion is evaluated at the *measured* centre before translations are subtracted:
u_true(c) = Ω (c − c_true) + u_true + c_true − c.  The rotation error is the vector log(Ω_measured Ω_trueᵀ).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.summary import Summarised, Summary
from grainmotion.rotations import recenter, rotation_vector


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Summarised):
    """Errors of n true grains; rows follow the truth.

    Attributes
    ----------
    labels : (n,) int array
        Labels in the truth.
    matches : (n,) int array
        Row of the measurement that is the same grain, or −1 if it is missing.
    translation_errors : (n, 3) array
        Measured − true, at the measured centre, mm, x y z; NaN if missing.
    rotation_errors_deg : (n, 3) array
        Components of log(Ω_measured Ω_trueᵀ), degrees; NaN if missing.
    failed_translation, failed_rotation : (n,) bool array
        Missing, no result to use (`Motions.ok_translation`, `ok_rotation`), or beyond the limits of `compare`.
    spurious : (m,) int array
        Rows of the measurement that are no true grain.
    voxel_size : float, optional
        mm.

    Examples
    --------
    >>> comparison = gm.compare(motions, truth, case.scanner.voxel_size)
    >>> comparison.failures, comparison.missing
    (0, 0)
    >>> bool(comparison.translation_rms_voxels < 0.02)
    True
    """

    labels: NDArray[np.int64]
    matches: NDArray[np.int64]
    translation_errors: NDArray[np.float64]
    rotation_errors_deg: NDArray[np.float64]
    failed_translation: NDArray[np.bool_]
    failed_rotation: NDArray[np.bool_]
    spurious: NDArray[np.int64]
    voxel_size: float | None = None

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def missing(self) -> int:
        """True grains without a measured one."""
        return int((self.matches < 0).sum())

    @property
    def failed(self) -> NDArray[np.bool_]:
        """True grains whose translation or rotation failed, ``(n,)``."""
        return self.failed_translation | self.failed_rotation

    @property
    def failures(self) -> int:
        """True grains that failed, the missing ones among them."""
        return int(self.failed.sum())

    @property
    def translation_rms(self) -> float:
        """Root mean square over the translations that did not fail and over components, mm; NaN if all failed."""
        return _rms(self.translation_errors[~self.failed_translation])

    @property
    def rotation_rms_deg(self) -> float:
        """Root mean square over the rotations that did not fail and over components, degrees."""
        return _rms(self.rotation_errors_deg[~self.failed_rotation])

    @property
    def translation_rms_voxels(self) -> float:
        """`translation_rms` in voxels; NaN without a voxel size."""
        return self.translation_rms / self.voxel_size if self.voxel_size else float("nan")

    def _summary(self) -> Summary:
        n = len(self)
        voxels = f" ({self.translation_rms_voxels:.3g} voxel)" if self.voxel_size else ""
        good = [n - int(failed.sum()) for failed in (self.failed_translation, self.failed_rotation)]
        rows = (
            ("translation rms", f"{self.translation_rms:.4g} mm{voxels}, {good[0]} of {n} grains"),
            ("rotation rms", f"{self.rotation_rms_deg:.4g}°, {good[1]} of {n} grains"),
            ("failed", f"{self.failures}, {self.missing} of them without a measured grain"),
            ("spurious", str(len(self.spurious))),
        )
        return Summary(
            f"Comparison of {n} grains",
            f"rms {self.translation_rms:.3g} mm, {self.rotation_rms_deg:.3g}°; {self.failures} failed",
            rows,
        )


@checked_arguments
def compare(
    measured: Motions,
    truth: Motions,
    voxel_size: float | None = None,
    *,
    limit_voxels: float = 1.0,
    limit_deg: float = 5.0,
) -> Comparison:
    """Errors of measured motions.

    Parameters
    ----------
    measured, truth : Motions
        Grains may be in any order and differ in number; labels are not used.  Pairs are one to one and
        lie within half the grain spacing (the median distance to the nearest true neighbour).
    voxel_size : float, optional
        mm, for errors in voxels.
    limit_voxels : float
        A translation whose error is longer than this has failed; without effect if there is no ``voxel_size``.
    limit_deg : float
        A rotation whose error is longer than this, in degrees, has failed.

    Returns
    -------
    Comparison
        Errors of the true grains, in their order.

    Raises
    ------
    InputError
        If the truth holds no grain, or the voxel size is not positive.

    Examples
    --------
    >>> comparison = gm.compare(motions, truth, case.scanner.voxel_size)
    >>> comparison.failures
    0
    >>> bool(comparison.translation_rms_voxels < 0.02)
    True
    """
    n = len(truth)
    if n == 0:
        raise InputError("truth", "it holds no grain", "give the motions of at least one grain")
    if voxel_size is not None and not voxel_size > 0:
        raise InputError("voxel_size", f"must be > 0, got {voxel_size}", "give it in mm, or leave it out")
    matches = _paired(measured.centers, truth.centers)
    matched = np.flatnonzero(matches >= 0)
    pair = matches[matched]
    translations, rotations = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    if len(matched):
        true = truth.matrices[matched]
        at_measured = recenter(true, truth.translations[matched], truth.centers[matched], measured.centers[pair])
        translations[matched] = measured.translations[pair] - at_measured
        difference = measured.matrices[pair] @ np.swapaxes(true, -1, -2)
        rotations[matched] = np.rad2deg(rotation_vector(difference))
    failed_translation, failed_rotation = np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    failed_translation[matched], failed_rotation[matched] = ~measured.ok_translation[pair], ~measured.ok_rotation[pair]
    failed_rotation |= ~(np.linalg.norm(rotations, axis=1) <= limit_deg)
    if voxel_size is not None:
        failed_translation |= ~(np.linalg.norm(translations, axis=1) <= limit_voxels * voxel_size)
    return Comparison(
        labels=np.asarray(truth.labels),
        matches=matches,
        translation_errors=translations,
        rotation_errors_deg=rotations,
        failed_translation=failed_translation,
        failed_rotation=failed_rotation,
        spurious=np.setdiff1d(np.arange(len(measured)), pair),
        voxel_size=voxel_size,
    )


def _paired(measured: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.int64]:
    """Row of ``measured`` for each of ``truth``, −1 for none, ``(n,)``."""
    matches = np.full(len(truth), -1)
    if len(measured) == 0:
        return matches
    largest = np.inf
    if len(truth) > 1:
        apart = cdist(truth, truth)
        np.fill_diagonal(apart, np.inf)
        largest = float(np.median(apart.min(axis=1))) / 2
    distances = cdist(truth, measured)
    # all pairs too far apart cost the same, so that one missing grain does not shift the pairs of its neighbours
    rows, columns = linear_sum_assignment(np.where(distances <= largest, distances, 1e3 * min(largest, 1e9)))
    near = distances[rows, columns] <= largest
    matches[rows[near]] = columns[near]
    return matches


def _rms(errors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
