"""What makes each hard case hard: one function a case; the registry is in `hard`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq

from grainmotion._typing import Float, Progress
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import fracture, motion_fields
from grainmotion.simulate.hard_case import HardCase
from grainmotion.simulate.misalignment import Slip
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.radiograph import line_integrals
from grainmotion.simulate.sample import Particle, Sample, Tube, ellipsoid_particle
from grainmotion.simulate.scenarios import (
    ATTENUATION,
    LATER_ANGLES_DEG,
    PAPER_SCALE,
    SMALL_SCALE,
    Case,
    Scale,
    Spectrum,
    case_of,
    stones,
)

SCALES: Mapping[str, Scale] = MappingProxyType({"small": SMALL_SCALE, "paper": PAPER_SCALE})
GRAINS: Mapping[str, int] = MappingProxyType({"small": 6, "paper": 15})
WIDER: Mapping[str, tuple[tuple[int, int], float]] = MappingProxyType(  # panel and cylinder for 20 grains
    {"small": ((112, 96), 34.0), "paper": ((280, 220), 72.0)}
)
SNR = 50.0
# Quartz at 30, 45, 60 and 90 keV (2.3, 0.95, 0.67 and 0.48 per cm) in the filtered beam of a laboratory tube
QUARTZ: Spectrum = ((0.2, 2.16), (0.35, 0.892), (0.3, 0.629), (0.15, 0.451))
DROP = 0.2  # of the effective attenuation along the longest path


@dataclass(frozen=True)
class Setup:
    """What was asked for, and the plain experiment that the recipes start from."""

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
        return stones(self.scale, self.seed, GRAINS[self.scale_name], self.inclusion, self.progress)

    def case(self, snr: float = SNR) -> Case:
        return case_of(self.sample(), self.scale, self.seed, snr)

    def draws(self) -> np.random.Generator:
        """What a recipe leaves to chance."""
        return np.random.default_rng([self.seed, 2])


def _rigid(setup: Setup, case: Case) -> HardCase:
    """Every grain moves as a rigid body; nothing is hard yet."""
    motions = case.motions[setup.motion]
    return HardCase(case, motions, case.sample.moved(motions))


def noisy(setup: Setup) -> HardCase:
    return _rigid(setup, setup.case(snr=10.0))


def beam_hardening(setup: Setup) -> HardCase:
    sample = setup.sample()
    longest = float(_later_radiographs(sample, setup.scale).max())
    shares, ratios = np.array(QUARTZ).T
    ratios = ratios / (shares @ ratios)  # thin paths are attenuated as the sample says

    def drop(path: float) -> float:
        return 1 + float(np.log(shares @ np.exp(-ratios * path))) / path

    wanted = brentq(lambda path: drop(path) - DROP, 1e-3, 50.0)
    dense = Sample(tuple(_denser(p, wanted / longest) for p in sample.particles))
    spectrum = tuple((float(s), float(r)) for s, r in zip(shares, ratios, strict=True))
    case = case_of(dense, setup.scale, setup.seed, SNR, spectrum)
    return dataclasses.replace(_rigid(setup, case), facts={"longest_path": wanted, "drop": DROP})


def blur(setup: Setup) -> HardCase:
    case = setup.case()
    return _rigid(setup, dataclasses.replace(case, physics=dataclasses.replace(case.physics, blur=1.0)))


def misaligned(setup: Setup) -> HardCase:
    return dataclasses.replace(_rigid(setup, setup.case()), slip=Slip((0.5, 0.5), turn_deg=0.5))


def misaligned_state(setup: Setup) -> HardCase:
    return dataclasses.replace(_rigid(setup, setup.case()), wobble=Slip((0.3, 0.3), stage_deg=0.1))


def gain_drift(setup: Setup) -> HardCase:
    gain = float(setup.draws().choice([0.9, 1.1]))
    return dataclasses.replace(_rigid(setup, setup.case()), gain=gain, facts={"gain": gain})


def gain_drift_views(setup: Setup) -> HardCase:
    return dataclasses.replace(_rigid(setup, setup.case()), gain_spread=0.1)


def container(setup: Setup) -> HardCase:
    sample = setup.sample()
    inner = setup.scale.radius * setup.voxel
    wall = Tube(inner, 1.1 * inner, 1.0)
    norms = [np.linalg.norm(_later_radiographs(s, setup.scale)) for s in (sample, Sample((), wall))]
    wall = dataclasses.replace(wall, attenuation=float(0.1 * norms[0] / norms[1]))
    case = case_of(Sample(sample.particles, wall), setup.scale, setup.seed, SNR)
    angle = setup.draws().uniform(0, 2 * np.pi)
    shift = 3 * setup.voxel * np.array([np.cos(angle), np.sin(angle), 0.0])
    own = case.motions[setup.motion]
    motions = dataclasses.replace(own, translations=own.translations + shift)
    later = Sample(case.sample.moved(motions).particles, wall.moved(np.eye(3), shift))
    facts = {"tube_shift_x": float(shift[0]), "tube_shift_y": float(shift[1]), "norm_share": 0.1}
    return HardCase(case, motions, later, facts=facts)


def missing(setup: Setup) -> HardCase:
    case = setup.case()
    row = int(setup.draws().integers(len(case.sample)))
    motions = case.motions[setup.motion]
    moved = case.sample.moved(motions)
    rest = Sample(moved.particles[:row] + moved.particles[row + 1 :], moved.tube)
    gone = _marked(motions, row, Status.NOT_FITTED, "it is gone in this state")
    for numbers in (gone.translations, gone.rotations, gone.covariances):
        numbers[row] = np.nan
    return HardCase(case, gone, rest, missing=(row + 1,))


def broken(setup: Setup) -> HardCase:
    case, rng = setup.case(), setup.draws()
    row = int(rng.integers(len(case.sample)))
    motions = case.motions[setup.motion]
    moved = case.sample.moved(motions)
    whole = moved.particles[row]
    normal = rng.normal(size=3) * [1.0, 1.0, 0.5]  # the halves part sideways rather than up
    normal /= np.linalg.norm(normal)
    halves = []
    for half, side in zip(fracture.broken(whole, normal), (1, -1), strict=True):
        turn = rotation_matrix(np.deg2rad(15.0) * _direction(rng))
        halves.append(half.moved(turn, half.center - turn @ half.center + side * 3 * setup.voxel * normal))
    later = Sample((*moved.particles[:row], *halves, *moved.particles[row + 1 :]), moved.tube)
    parted = _marked(motions, row, Status.NOT_CONVERGED, "it broke in two; the motion is the whole's before")
    return HardCase(case, parted, later, broken=(row + 1,), facts={"apart": 6 * setup.voxel, "turn_deg": 15.0})


def near_spherical(setup: Setup) -> HardCase:
    rng, diameter = np.random.default_rng(setup.seed), setup.scale.diameter * setup.voxel
    n = GRAINS[setup.scale_name]
    sizes = diameter * (1 + 0.08 * rng.uniform(-1, 1, n))
    balls = [ellipsoid_particle(rng, size, ATTENUATION, elongation=1.02) for size in sizes]
    sample = pack(balls, PackingSettings(setup.scale.radius * setup.voxel), setup.seed, setup.progress)
    return _rigid(setup, case_of(sample, setup.scale, setup.seed, SNR))


def shear_band(setup: Setup) -> HardCase:
    panel, radius = WIDER[setup.scale_name]
    scanner = dataclasses.replace(setup.scale.scanner, panel=panel)
    scale = dataclasses.replace(setup.scale, scanner=scanner, radius=radius)
    sample = stones(scale, setup.seed, 20, setup.inclusion, setup.progress)
    case = case_of(sample, scale, setup.seed, SNR)
    angle = setup.draws().uniform(0, 2 * np.pi)
    normal, slip = _turned_about_z([0.0, 0.5, 1.0], angle), _turned_about_z([0.0, 1.0, -0.5], angle)
    size = 6 * setup.voxel
    motions = motion_fields.shear_band(sample, size, scale.diameter * setup.voxel, normal=normal, direction=slip)
    return HardCase(case, motions, sample.moved(motions), facts={"slip": size})


# ---------------------------------------------------------------------- small parts
def _later_radiographs(sample: Sample, scale: Scale) -> Float:
    views = scale.scanner.geometry(LATER_ANGLES_DEG[4] + LATER_ANGLES_DEG[2])
    return line_integrals(sample, views, subsamples=1).astype(float)


def _denser(particle: Particle, factor: float) -> Particle:
    inclusions = tuple((shape, factor * value) for shape, value in particle.inclusions)
    return Particle(particle.shape, factor * particle.attenuation, inclusions)


def _marked(motions: Motions, row: int, status: Status, reason: str) -> Motions:
    """A copy of the truth with another status of one grain."""
    statuses, reasons = motions.statuses.copy(), list(motions.reasons)
    statuses[row], reasons[row] = status.value, reason
    return dataclasses.replace(
        motions,
        translations=motions.translations.copy(),
        rotations=motions.rotations.copy(),
        covariances=motions.covariances.copy(),
        statuses=statuses,
        reasons=tuple(reasons),
    )


def _direction(rng: np.random.Generator) -> Float:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def _turned_about_z(vector: list[float], angle: float) -> Float:
    return rotation_matrix([0.0, 0.0, angle]) @ np.array(vector)
