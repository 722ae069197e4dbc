"""Specimens: simulated samples, described by a few numbers, and their reconstructions, cached on disk.

The specimen at the paper's scale is that of `paper.gravel` and shares its reconstruction.
"""

from __future__ import annotations

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
from validation.accuracy.page import PAGE
from validation.common.cache import RECONSTRUCTION, SIMULATION
from validation.paper import gravel

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

    @property
    def is_gravel(self) -> bool:
        """Whether it is the simulated sample of `paper.gravel`."""
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
    """Radiographs of one of `STATES`, 2 to 6 views."""
    simulated = case(specimen)
    return simulated.state(simulated.motions[name], LATER_ANGLES_DEG[views], gravel.noise_number(name, views))


def bounds(specimen: Specimen, name: str, views: int) -> NDArray[np.float64]:
    """Cramér–Rao bounds on the standard deviations of the motions of a state, ``(n, 6)``: voxels and degrees.

    They scale with one over the square root of the photons, so that one exposure gives those of all.
    """
    standard = replace(specimen, snr=SNR)
    simulated = case(standard)
    variances = np.diagonal(bound_covariances(standard, name, views), axis1=1, axis2=2)
    photon_ratio = simulated.physics.photons / case(specimen).physics.photons
    return in_voxels_and_degrees(np.sqrt(variances * photon_ratio), simulated.scanner.voxel_size)


@PAGE.cached(*SIMULATION)
def bound_covariances(specimen: Specimen, name: str, views: int) -> NDArray[np.float64]:
    """Cramér–Rao bounds of the motions of a state, ``(n, 6, 6)``: mm and radians."""
    simulated = case(specimen)
    moved = simulated.sample.moved(simulated.motions[name])
    return motion_bounds(moved, simulated.scanner.geometry(LATER_ANGLES_DEG[views]), simulated.physics)


def in_voxels_and_degrees(columns: NDArray[np.float64], voxel_size: float) -> NDArray[np.float64]:
    """Translations and rotations ``(n, 6)``, from mm and radians."""
    return np.hstack([columns[:, :3] / voxel_size, np.rad2deg(columns[:, 3:])])


# ---------------------------------------------------------------------- what is reconstructed
@lru_cache(maxsize=2)
def volume(specimen: Specimen, settings: ReconstructSettings = gravel.SMOOTH) -> Volume:
    """The reference, reconstructed."""
    if specimen.is_gravel:
        return gravel.reference(settings).volume
    return reconstructed(specimen, settings)


@PAGE.cached(*RECONSTRUCTION)
def reconstructed(specimen: Specimen, settings: ReconstructSettings) -> Volume:
    """The reconstruction of a specimen's full scan."""
    simulated = case(specimen)
    return reconstruct(simulated.reference(), simulated.scanner.grid, settings).volume


@lru_cache(maxsize=2)
def grains(specimen: Specimen) -> GrainSet:
    """The grains of the reference, by default."""
    reconstruction = volume(specimen)
    return grains_from_labels(reconstruction, segment(reconstruction).labels)


def true_volume(specimen: Specimen) -> Volume:
    """Attenuation of the exact sample, averaged over voxels."""
    return _true_volume(replace(specimen, snr=SNR))


def true_labels(specimen: Specimen) -> NDArray[np.integer]:
    """Label of the stone that holds the centre of each voxel."""
    return _true_labels(replace(specimen, snr=SNR))


@lru_cache(maxsize=2)
@PAGE.cached(*SIMULATION)
def _true_volume(specimen: Specimen) -> Volume:
    simulated = case(specimen)
    return attenuation_volume(simulated.sample, simulated.scanner.grid)


@lru_cache(maxsize=2)
@PAGE.cached(*SIMULATION)
def _true_labels(specimen: Specimen) -> NDArray[np.integer]:
    simulated = case(specimen)
    return label_volume(simulated.sample, simulated.scanner.grid)


def moved(specimen: Specimen, motions: Motions, views: int, number: int) -> Scan:
    """Radiographs of the specimen after other motions than its own."""
    return case(specimen).state(motions, LATER_ANGLES_DEG[views], number)
