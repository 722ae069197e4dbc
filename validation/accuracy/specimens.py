"""Specimens: simulated samples by a few numbers, and their reconstructions, which are kept.

The name of what is kept holds the source that made it, so that nothing is stale after a change.  The paper's
specimen is that of `paper.gravel` and shares its reconstruction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import (
    LATER_ANGLES_DEG,
    Case,
    attenuation_volume,
    label_volume,
    motion_bounds,
    paper_scale,
    small,
)
from validation.accuracy import page
from validation.common.cache import digest, kept, source
from validation.paper import gravel

SIMULATED = ("simulate", "kernels", "model", "rotations")
RECONSTRUCTED = (*SIMULATED, "backends", "projection", "reconstruction")
STATES = gravel.STATES
SNR = 50.0


@dataclass(frozen=True)
class Specimen:
    """A sample of `simulate.small` or `simulate.paper_scale`, with its noise."""

    scale: Literal["small", "paper"] = "small"
    seed: int = 0
    snr: float = SNR
    inclusion: float | None = None
    grains: int | None = None

    def __str__(self) -> str:
        more = [f"inclusion{self.inclusion:g}"] if self.inclusion is not None else []
        more += [f"of{self.grains}"] if self.grains is not None else []
        return "-".join([f"{self.scale}{self.seed}", f"snr{self.snr:g}", *more])

    @property
    def is_gravel(self) -> bool:
        """Whether it is the specimen of `paper.gravel`."""
        return self == Specimen("paper", gravel.SEED)


# ---------------------------------------------------------------------- what is simulated
@lru_cache(maxsize=4)
def case(specimen: Specimen) -> Case:
    """Sample, scanner, physics and true motions."""
    if specimen.is_gravel:
        return gravel.case()
    count = {} if specimen.grains is None else {"n_grains": specimen.grains}
    make = small if specimen.scale == "small" else paper_scale
    return make(specimen.seed, snr=specimen.snr, inclusion=specimen.inclusion, **count)


def state(specimen: Specimen, name: str, views: int) -> Scan:
    """A few radiographs of one of `STATES`."""
    twin = case(specimen)
    return twin.state(twin.motions[name], LATER_ANGLES_DEG[views], gravel.noise_number(name, views))


def bounds(specimen: Specimen, name: str, views: int) -> NDArray[np.float64]:
    """Least standard deviations of the motions of a state, ``(n, 6)``: voxels and degrees.

    They go as one over the root of the photons, so that those of one exposure tell those of all.
    """
    plain = replace(specimen, snr=SNR)
    twin = case(plain)

    def make() -> dict[str, NDArray[np.generic]]:
        moved = twin.sample.moved(twin.motions[name])
        return {"covariances": motion_bounds(moved, twin.scanner.geometry(LATER_ANGLES_DEG[views]), twin.physics)}

    path = page.CACHE / "bounds" / f"{plain}-{name}-{views}-{source(*SIMULATED)}.npz"
    variances = np.diagonal(kept(path, make)["covariances"], axis1=1, axis2=2).astype(float)
    fewer = twin.physics.photons / case(specimen).physics.photons
    return in_voxels_and_degrees(np.sqrt(variances * fewer), twin.scanner.voxel_size)


def in_voxels_and_degrees(columns: NDArray[np.float64], voxel_size: float) -> NDArray[np.float64]:
    """Translations and rotations ``(n, 6)`` of mm and radians."""
    return np.hstack([columns[:, :3] / voxel_size, np.rad2deg(columns[:, 3:])])


# ---------------------------------------------------------------------- what is reconstructed
def reconstructed(
    name: str, scan: Callable[[], Scan], grid: Volume, settings: ReconstructSettings | None = None
) -> Volume:
    """The reconstruction of a scan, kept under a name of its own."""
    settings = settings or ReconstructSettings()
    file = f"{name}-{digest(repr(settings))}-{source(*RECONSTRUCTED)}.npz"
    made = kept(page.CACHE / "references" / file, lambda: {"array": reconstruct(scan(), grid, settings).volume.array})
    return Volume(made["array"], grid.voxel_size, grid.center)


@lru_cache(maxsize=2)
def volume(specimen: Specimen, settings: ReconstructSettings = gravel.SMOOTH) -> Volume:
    """The reference, reconstructed."""
    if specimen.is_gravel:
        return gravel.reference(settings).volume
    twin = case(specimen)
    return reconstructed(str(specimen), twin.reference, twin.scanner.grid, settings)


@lru_cache(maxsize=2)
def grains(specimen: Specimen) -> GrainSet:
    """The grains of the reference, by default."""
    found = volume(specimen)
    return grains_from_labels(found, segment(found).labels)


@lru_cache(maxsize=2)
def true_volume(specimen: Specimen) -> Volume:
    """The attenuation of the exact sample, averaged over voxels."""
    twin = case(specimen)
    grid = twin.scanner.grid
    path = page.CACHE / "exact" / f"{replace(specimen, snr=SNR)}-{source(*SIMULATED)}.npz"
    made = kept(path, lambda: {"array": attenuation_volume(twin.sample, grid).array})
    return Volume(made["array"], grid.voxel_size, grid.center)


@lru_cache(maxsize=2)
def true_labels(specimen: Specimen) -> NDArray[np.integer]:
    """The label of the stone that holds the centre of each voxel."""
    twin = case(specimen)
    path = page.CACHE / "exact" / f"{replace(specimen, snr=SNR)}-labels-{source(*SIMULATED)}.npz"
    return kept(path, lambda: {"labels": label_volume(twin.sample, twin.scanner.grid)})["labels"]


def moved(specimen: Specimen, motions: Motions, views: int, number: int) -> Scan:
    """A few radiographs of the specimen after other motions than its own."""
    return case(specimen).state(motions, LATER_ANGLES_DEG[views], number)
