"""What the recipes of hard cases start from: arguments of `hard_case`, and the plain experiment of each scale."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Progress
from grainmotion.model.motions import Motions, Status
from grainmotion.simulate.hard_case_record import HardCase
from grainmotion.simulate.sample import Particle, Sample
from grainmotion.simulate.scenarios import PAPER_SCALE, SMALL_SCALE, Case, Scale, Spectrum, case_of, stones

SCALES: Mapping[str, Scale] = {"small": SMALL_SCALE, "paper": PAPER_SCALE}
GRAINS_BY_SCALE = {"small": 6, "paper": 15}
DEFAULT_SNR = 50.0
QUARTZ_SPECTRUM: Spectrum = ((0.2, 2.16), (0.35, 0.892), (0.3, 0.629), (0.15, 0.451))
"""Quartz at 30, 45, 60 and 90 keV (2.3, 0.95, 0.67 and 0.48 per cm) in the filtered beam of a laboratory tube."""


@dataclass(frozen=True)
class Setup:
    """Arguments of `hard_case`, and the plain experiment that the recipes start from."""

    seed: int
    scale_name: str
    motion: str
    inclusion: float | None
    progress: Progress | None

    @property
    def scale(self) -> Scale:
        return SCALES[self.scale_name]

    @property
    def voxel(self) -> float:
        return self.scale.scanner.voxel_size

    def sample(self) -> Sample:
        return stones(self.scale, self.seed, GRAINS_BY_SCALE[self.scale_name], self.inclusion, self.progress)

    def case(self, snr: float = DEFAULT_SNR) -> Case:
        return case_of(self.sample(), self.scale, self.seed, snr)

    def draws(self) -> np.random.Generator:
        """Random numbers of the recipe, independent of those of packing and motions."""
        return np.random.default_rng([self.seed, 2])


def rigid_case(setup: Setup, case: Case) -> HardCase:
    """A case without difficulties: every grain moves as a rigid body."""
    motions = case.motions[setup.motion]
    return HardCase(case, motions, case.sample.moved(motions))


def denser(particle: Particle, factor: float) -> Particle:
    """The particle with all its attenuations times ``factor``."""
    inclusions = tuple((shape, factor * value) for shape, value in particle.inclusions)
    return Particle(particle.shape, factor * particle.attenuation, inclusions)


def marked(motions: Motions, rows: Sequence[int], status: Status, reason: str) -> Motions:
    """A copy of the true motions with another status of some grains."""
    statuses, reasons = motions.statuses.copy(), list(motions.reasons)
    for row in rows:
        statuses[row], reasons[row] = status.value, reason
    return dataclasses.replace(
        motions,
        translations=motions.translations.copy(),
        rotations=motions.rotations.copy(),
        covariances=motions.covariances.copy(),
        statuses=statuses,
        reasons=tuple(reasons),
    )


def absent(motions: Motions, rows: Sequence[int]) -> Motions:
    """True motions of which some grains have none, as they are missing."""
    truth = marked(motions, rows, Status.ABSENT, "it is missing in this state")
    for numbers in (truth.translations, truth.rotations, truth.covariances):
        numbers[list(rows)] = np.nan
    return truth
