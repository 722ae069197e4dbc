"""Outcomes: result of one tracked state, grain by grain, and statistics of many of them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.analysis.validation import compare
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.scan import Scan
from grainmotion.tracking.track import TrackSettings, track
from validation.accuracy.specimens import in_voxels_and_degrees
from validation.common.measures import rms
from validation.common.warm import compile_kernels

Float = NDArray[np.float64]
MISSING = "missing"
"""Status of a true grain that is not among the grains of the reference."""
WRONG_VOXELS, WRONG_DEG = 0.3, 2.0
"""A component whose error is less is never called wrong."""
WRONG_SDS = 5.0
"""Likewise, in its own standard deviations."""


@dataclass(frozen=True)
class Outcome:
    """One tracked state, a row for each true grain.

    Attributes
    ----------
    labels, statuses, reasons : lists of n
        Label of the true grain; status and reason of the measured one.
    errors, sds : n lists of 6
        Measured minus true, and the standard deviation that the tracker states: voxels and degrees.
    failed : list of n bool
        As `compare` defines it.
    spurious : int
        Measured grains that match no true one.
    notes : list of str
        Sentences on the state as a whole.
    cpu : float
        CPU seconds of tracking.
    """

    labels: list[int]
    statuses: list[str]
    reasons: list[str]
    errors: list[list[float]]
    sds: list[list[float]]
    failed: list[bool]
    spurious: int
    notes: list[str]
    cpu: float


def measure(
    grains: GrainSet, scan: Scan, truth: Motions, voxel_size: float, settings: TrackSettings | None = None
) -> Outcome:
    """Track a state from a zero start, and compare it with the truth."""
    compile_kernels()
    begin = time.process_time()
    motions = track(grains, scan, settings=settings)
    return outcome(motions, truth, voxel_size, time.process_time() - begin)


def outcome(motions: Motions, truth: Motions, voxel_size: float, cpu: float) -> Outcome:
    """Compare measured motions with the truth."""
    errors = compare(motions, truth, voxel_size)
    rows, matched = errors.matches, errors.matches >= 0
    deviations = np.full((len(truth), 6), np.nan)
    deviations[matched] = np.sqrt(np.diagonal(motions.covariances, axis1=1, axis2=2))[rows[matched]]
    own = np.hstack([errors.translation_errors / voxel_size, errors.rotation_errors_deg])
    return Outcome(
        labels=[int(k) for k in truth.labels],
        statuses=[str(motions.statuses[k]) if k >= 0 else MISSING for k in rows],
        reasons=[motions.reasons[k] if k >= 0 else "" for k in rows],
        errors=own.tolist(),
        sds=in_voxels_and_degrees(deviations, voxel_size).tolist(),
        failed=errors.failed.tolist(),
        spurious=len(errors.spurious),
        notes=list(motions.fit.notes),
        cpu=cpu,
    )


# ---------------------------------------------------------------------- together
@dataclass(frozen=True, eq=False)
class Pool:
    """The grains of some outcomes together, one row each."""

    outcomes: Sequence[Outcome]
    errors: Float
    sds: Float
    statuses: NDArray[np.str_]
    failed: NDArray[np.bool_]

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Grains whose status is *converged*."""
        return self.statuses == Status.CONVERGED.value

    @property
    def wrong(self) -> int:
        """Grains that converged and whose error is far beyond their standard deviation."""
        limits = np.maximum(WRONG_SDS * self.sds, np.repeat([WRONG_VOXELS, WRONG_DEG], 3))
        return int((self.ok & (np.abs(self.errors) > limits).any(axis=1)).sum())

    @property
    def failures(self) -> int:
        """Grains that failed, and measured ones that match no true grain."""
        return int(self.failed.sum()) + sum(o.spurious for o in self.outcomes)

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square error of a component over the grains that converged: voxels, degrees."""
        return by_kind(self.errors[self.ok])

    @property
    def over_sd(self) -> tuple[float, float]:
        """Root mean square of errors over their predicted standard deviations: translations, rotations."""
        return by_kind(self.ratios)

    @property
    def ratios(self) -> Float:
        """Errors over their predicted standard deviations, of the grains that converged, ``(m, 6)``."""
        return self.errors[self.ok] / self.sds[self.ok]

    @property
    def cpu(self) -> float:
        """Seconds a state, on average."""
        return float(np.mean([o.cpu for o in self.outcomes]))

    def counts(self) -> str:
        """How many grains have each status, for a table."""
        return counted(self.statuses.tolist())


def pool(outcomes: Sequence[Outcome], left_out: Sequence[Collection[int]] | None = None) -> Pool:
    """All grains of some outcomes, except those with the labels ``left_out`` of each."""
    excluded = left_out or [()] * len(outcomes)
    keep = np.array([label not in out for o, out in zip(outcomes, excluded, strict=True) for label in o.labels])

    def rows(name: str) -> NDArray[np.generic]:
        return np.array([row for o in outcomes for row in getattr(o, name)])[keep]

    errors, sds = rows("errors").reshape(-1, 6).astype(float), rows("sds").reshape(-1, 6).astype(float)
    return Pool(outcomes, errors, sds, rows("statuses").astype(str), rows("failed").astype(bool))


def by_kind(rows: Float) -> tuple[float, float]:
    """Root mean square of translations and of rotations ``(n, 6)``; NaN if there are none."""
    return rms(rows[:, :3]), rms(rows[:, 3:])


def counted(words: Sequence[str]) -> str:
    """Words with how often they come, the most frequent first."""
    return ", ".join(f"{n} {word}" for word, n in Counter(words).most_common())
