"""Simulated copy of the paper's experiment: 15 gravel grains without voxels, 352 views, SNR 50.

Full scans and SART sweeps are slow, so they are cached on disk and shared by the studies.  Every noise has a number
of its own, so that every rerun sees the same data.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from grainmotion.analysis.validation import Comparison, compare
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, Case, paper_scale
from grainmotion.tracking.track import TrackSettings, track
from validation.common.cache import RECONSTRUCTION, SEGMENTATION, SIMULATION
from validation.common.page import number
from validation.common.warm import compile_kernels
from validation.paper.page import PAGE

SEED = 0
STATES = ("unmoved", "shift", "random")
SMOOTH = ReconstructSettings(method="sart", sweeps=6, relaxation=1.0, decay=0.5, tolerance=0.02)
"""Plain SART, as in the paper, with the trilinear projector."""
SIDDON = replace(SMOOTH, projector="exact")
"""The paper's operator: the exact radiological path."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A reconstruction: its volume, ε of each sweep (each view just before its update), and CPU seconds."""

    volume: Volume
    residuals: tuple[float, ...]
    cpu: float


@dataclass(frozen=True, eq=False)
class Run:
    """Measured motions, their errors, and CPU seconds."""

    motions: Motions
    errors: Comparison
    cpu: float

    @property
    def failures(self) -> int:
        """Grains that failed, and measured ones that match no true grain."""
        return self.errors.failures + len(self.errors.spurious)

    def cells(self) -> list[str]:
        """Voxels, degrees, failures and CPU seconds, for a table."""
        voxels, degrees = number(self.errors.translation_rms_voxels, 4), number(self.errors.rotation_rms_deg, 3)
        return [voxels, degrees, str(self.failures), f"{self.cpu:.1f}"]


HEAD = ("translation, voxel", "rotation, °", "failures", "CPU s")
"""Titles of the columns that `Run.cells` fills."""


# ---------------------------------------------------------------------- the experiment
@cache
def case() -> Case:
    """Sample, scanner and true motions."""
    return paper_scale(SEED)


def angles_deg() -> tuple[float, ...]:
    """Angles of the full scan."""
    views = case().scanner.reference_views
    return tuple(np.arange(views) * 360.0 / views)


@cache
@PAGE.cached(*SIMULATION)
def full_scan(noise: int = 0) -> Scan:
    """The full scan of the reference state; each ``noise`` is a scan of its own."""
    if noise == 0:
        return case().reference()
    return case().state(case().motions["unmoved"], angles_deg(), 1000 + noise)


@cache
def state(name: str, views: int) -> Scan:
    """Radiographs of one of `STATES`, at the paper's angles for 4 or 2 views."""
    return case().state(case().motions[name], LATER_ANGLES_DEG[views], noise_number(name, views))


def noise_number(name: str, views: int) -> int:
    """Which noise the radiographs of a state carry."""
    return 10 * STATES.index(name) + views


# ---------------------------------------------------------------------- the reference
def sweep(count: int, settings: ReconstructSettings = SMOOTH, noise: int = 0) -> Reference:
    """SART after ``count`` sweeps over a full scan; 0 is the empty start.

    The relaxation of a sweep does not depend on the sweeps that follow, so that any number of sweeps
    is the beginning of all longer runs; each is cached, whatever the stopping rule.
    """
    if count == 0:
        return Reference(case().scanner.grid, (), 0.0)
    return _sweep(count, replace(settings, sweeps=1, tolerance=0.0, noise=None), noise)


@PAGE.cached(*RECONSTRUCTION)
def _sweep(count: int, settings: ReconstructSettings, noise: int) -> Reference:
    one = replace(settings, relaxation=settings.relaxation * settings.decay ** (count - 1))
    before, scan = sweep(count - 1, settings, noise), full_scan(noise)
    start = time.process_time()
    after = reconstruct(scan, before.volume, one)
    cpu = before.cpu + time.process_time() - start
    return Reference(after.volume, (*before.residuals, *after.residuals), cpu)


@cache
def reference(settings: ReconstructSettings = SMOOTH, noise: int = 0) -> Reference:
    """The reconstruction of a full scan, with the sweeps that the settings' own stopping rule takes."""
    for count in range(1, settings.sweeps + 1):
        current = sweep(count, settings, noise)
        residuals = current.residuals
        if count > 1 and residuals[-1] > residuals[-2] * (1 - settings.tolerance):
            break
    return current


@cache
@PAGE.cached(*SEGMENTATION)
def labels(settings: ReconstructSettings = SMOOTH) -> NDArray[np.integer]:
    """Label of each voxel of a reference, by default segmentation."""
    return segment(reference(settings).volume).labels


@cache
def grains(settings: ReconstructSettings = SMOOTH) -> GrainSet:
    """The grains of a reference."""
    return grains_from_labels(reference(settings).volume, labels(settings))


# ---------------------------------------------------------------------- measuring
def track_state(
    sample: GrainSet,
    name: str,
    views: int = 4,
    settings: TrackSettings | None = None,
    start: Motions | None = None,
    scan: Scan | None = None,
) -> Run:
    """Track one of `STATES` (or ``scan`` of it) and compare with the truth; zero start unless given."""
    compile_kernels()
    scan = state(name, views) if scan is None else scan
    begin = time.process_time()
    motions = track(sample, scan, start, settings)
    cpu = time.process_time() - begin
    return Run(motions, compare(motions, case().motions[name], case().scanner.voxel_size), cpu)


def near_truth(sample: GrainSet, name: str, voxels: float, degrees: float, seed: int) -> Motions:
    """A start away from the truth by up to these amounts, for each grain along a random axis, uniformly."""
    true, still = case().motions[name], Motions.identity(sample.labels, sample.centers)
    rows = compare(still, true).matches
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(2, len(sample), 3))
    away *= rng.uniform(size=(2, len(sample), 1)) / np.linalg.norm(away, axis=2, keepdims=True)
    matched = rows >= 0
    translations, rotations = still.translations.copy(), still.rotations.copy()
    translations[rows[matched]], rotations[rows[matched]] = true.translations[matched], true.rotations[matched]
    return replace(
        still,
        translations=translations + away[0] * voxels * case().scanner.voxel_size,
        rotations=rotations + away[1] * np.deg2rad(degrees),
    )
