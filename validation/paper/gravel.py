"""The twin of the paper's experiment: 15 gravel grains without voxels, 352 views, SNR 50.

What is slow, full scans and SART sweeps, is kept as .npz in `page.CACHE` under a name that says what made
it, so that studies share it.  Every noise has a number of its own, so that every rerun sees the same data.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from grainmotion.analysis.validation import Comparison, compare
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, Case, paper_scale
from grainmotion.tracking.track import TrackSettings, track
from validation.common.cache import Arrays, digest
from validation.common.cache import kept as kept_file
from validation.common.page import number
from validation.common.warm import compile_kernels
from validation.paper import page

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
    """Motions that were measured, their errors, and CPU seconds."""

    motions: Motions
    errors: Comparison
    cpu: float

    @property
    def failures(self) -> int:
        """Grains that failed, and measured ones that are no grain."""
        return self.errors.failures + len(self.errors.spurious)

    def cells(self) -> list[str]:
        """Voxels, degrees, failures and CPU seconds, for a table."""
        voxels, degrees = number(self.errors.translation_rms_voxels, 4), number(self.errors.rotation_rms_deg, 3)
        return [voxels, degrees, str(self.failures), f"{self.cpu:.1f}"]


HEAD = ("translation, voxel", "rotation, °", "failures", "CPU s")
"""Of the columns that `Run.cells` fills."""


# ---------------------------------------------------------------------- the experiment
@cache
def case() -> Case:
    """Sample, scanner and true motions."""
    return paper_scale(SEED)


def angles_deg() -> tuple[float, ...]:
    """Of the full scan."""
    views = case().scanner.reference_views
    return tuple(np.arange(views) * 360.0 / views)


@cache
def full_scan(noise: int = 0) -> Scan:
    """The full scan of the reference state; each ``noise`` is a scan of its own."""

    def make() -> Arrays:
        twin = case()
        scan = twin.reference() if noise == 0 else twin.state(twin.motions["unmoved"], angles_deg(), 1000 + noise)
        return {"images": scan.line_integrals, "vectors": scan.geometry.vectors}

    found = kept(f"gravel{SEED}-scan{noise}", make)
    return Scan(found["images"], Geometry(found["vectors"], found["images"].shape[1:]))


@cache
def state(name: str, views: int) -> Scan:
    """A few radiographs of one of `STATES`, at the paper's angles for 4 or 2 views."""
    return case().state(case().motions[name], LATER_ANGLES_DEG[views], noise_number(name, views))


def noise_number(name: str, views: int) -> int:
    """Which noise the radiographs of a state carry."""
    return 10 * STATES.index(name) + views


# ---------------------------------------------------------------------- the reference
def sweep(count: int, settings: ReconstructSettings = SMOOTH, noise: int = 0) -> Reference:
    """SART after ``count`` sweeps over a full scan; 0 is the empty start.

    The relaxation of a sweep does not depend on the sweeps that follow, so that any number of sweeps
    is a beginning of all longer runs, and each is kept.
    """
    if count == 0:
        return Reference(case().scanner.grid, (), 0.0)
    one = replace(settings, sweeps=1, relaxation=settings.relaxation * settings.decay ** (count - 1))

    def make() -> Arrays:
        before, scan = sweep(count - 1, settings, noise), full_scan(noise)
        start = time.process_time()
        found = reconstruct(scan, before.volume, one)
        cpu = before.cpu + time.process_time() - start
        residuals = (*before.residuals, *found.residuals)
        return {"array": found.volume.array, "residuals": np.array(residuals), "cpu": np.array(cpu)}

    whole = repr(replace(settings, sweeps=1, tolerance=0.0, noise=None))
    name = f"gravel{SEED}-scan{noise}-{settings.projector}-{digest(whole)}-sweep{count}"
    found = kept(name, make)
    volume = Volume(found["array"], case().scanner.voxel_size)
    return Reference(volume, tuple(found["residuals"].tolist()), float(found["cpu"]))


@cache
def reference(settings: ReconstructSettings = SMOOTH, noise: int = 0) -> Reference:
    """The reconstruction of a full scan, with the sweeps that the settings' own stopping rule takes."""
    for count in range(1, settings.sweeps + 1):
        found = sweep(count, settings, noise)
        last = found.residuals
        if count > 1 and last[-1] > last[-2] * (1 - settings.tolerance):
            break
    return found


@cache
def labels(settings: ReconstructSettings = SMOOTH) -> NDArray[np.integer]:
    """Which grain each voxel of a reference belongs to, by default segmentation."""
    return kept(
        f"gravel{SEED}-{settings.projector}-{digest(repr(settings))}-labels",
        lambda: {"labels": segment(reference(settings).volume).labels},
    )["labels"]


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
    """A start away from the truth by up to so much, each grain its own way: random axes, uniform amounts."""
    true, still = case().motions[name], Motions.identity(sample.labels, sample.centers)
    rows = compare(still, true).matches
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(2, len(sample), 3))
    away *= rng.uniform(size=(2, len(sample), 1)) / np.linalg.norm(away, axis=2, keepdims=True)
    found = rows >= 0
    translations, rotations = still.translations.copy(), still.rotations.copy()
    translations[rows[found]], rotations[rows[found]] = true.translations[found], true.rotations[found]
    return replace(
        still,
        translations=translations + away[0] * voxels * case().scanner.voxel_size,
        rotations=rotations + away[1] * np.deg2rad(degrees),
    )


# ---------------------------------------------------------------------- small things
def kept(name: str, make: Callable[[], Arrays]) -> Arrays:
    """Arrays from the paper's cache, made and put there if they are not in it."""
    return kept_file(page.CACHE / f"{version('grainmotion')}-{name}.npz", make)
