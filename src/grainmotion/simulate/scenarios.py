"""Ready-made experiments with true motions: at the paper's scale, and a small one for tests and demos."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Progress
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised, Summary, names_text
from grainmotion.simulate import motion_fields
from grainmotion.simulate.detector import Physics, Recording, photons_for_snr, record, record_line_integrals
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.radiograph import line_integrals
from grainmotion.simulate.sample import Particle, Sample, inscribed
from grainmotion.simulate.scanner import Scanner
from grainmotion.simulate.stone_shapes import stone

STONE_COUNT = 95  # shapes of FDOT-57
Spectrum = tuple[tuple[float, float], ...]
STONE_ATTENUATION = 0.1  # of every stone, 1/mm
OPEN_BEAM_COUNTS = 40_000  # counts without the sample, well inside 16 bits
LATER_ANGLES_DEG = {2: (22.5, 112.5), 4: (0.0, 45.0, 90.0, 135.0)}
"""Angles of the radiographs of later states, degrees, by their number."""


@dataclass(frozen=True, eq=False, repr=False)
class Case(Summarised):
    """A sample, its scanner and its physics, from which any state can be simulated.

    Attributes
    ----------
    sample : Sample
        In the reference state.
    scanner : Scanner
        Views and grid.
    physics : Physics
        Beam and detector.
    seed : int
        Seed of the noise.
    motions : dict of str to Motions
        Ready-made motions by name: ``unmoved``, ``shift``, ``random``.

    Examples
    --------
    >>> case = gm.simulate.small(n_grains=2)
    >>> sorted(case.motions)
    ['random', 'shift', 'unmoved']
    >>> case.state(case.motions["shift"], (0, 90)).line_integrals.shape
    (2, 96, 72)
    """

    sample: Sample
    scanner: Scanner
    physics: Physics
    seed: int
    motions: dict[str, Motions] = field(default_factory=dict)

    def reference(self) -> Scan:
        """Simulate the full scan as line integrals with noise."""
        return record_line_integrals(self.sample, self.scanner.geometry(), self.physics, self.seed)

    def reference_counts(self) -> Recording:
        """Simulate the full scan as counts with flats and darks."""
        return record(self.sample, self.scanner.geometry(), self.physics, self.seed)

    def state(self, motions: Motions, angles_deg: tuple[float, ...], number: int = 1) -> Scan:
        """Simulate radiographs of a later state as line integrals with noise.

        Parameters
        ----------
        motions : Motions
            True motions of all particles.
        angles_deg : tuple of float
            Angles of the views, degrees.
        number : int
            Seed of the noise, beside the seed of the case.

        Returns
        -------
        Scan
            Noisy line integrals, dimensionless.
        """
        moved = self.sample.moved(motions)
        return record_line_integrals(moved, self.scanner.geometry(angles_deg), self.physics, self.seed + 1000 * number)

    def state_counts(self, motions: Motions, angles_deg: tuple[float, ...], number: int = 1) -> Recording:
        """Simulate radiographs of a later state as counts with flats and darks.

        Parameters
        ----------
        motions, angles_deg, number : Motions, tuple of float, int
            As in `state`.

        Returns
        -------
        Recording
            Counts, flats and darks.
        """
        views = self.scanner.geometry(angles_deg)
        return record(self.sample.moved(motions), views, self.physics, self.seed + 1000 * number)

    def _summary(self) -> Summary:
        rows = (
            ("sample", f"{len(self.sample.particles)} particles"),
            ("states", names_text(list(self.motions)) or "none"),
        )
        return Summary("Case", f"{rows[0][1]}; states {rows[1][1]}", rows)


@dataclass(frozen=True)
class Scale:
    """Sizes of a case, and the matching scanner.

    ``diameter`` of the stones and ``radius`` of the cylinder around them are in voxels; ``shift`` is the motion of that
    name, mm; ``level`` counts the subdivisions of each stone's mesh (see `stone`); ``spread`` is half the range of the
    stones' diameters over their mean.
    """

    scanner: Scanner
    diameter: float
    radius: float
    shift: tuple[float, float, float]
    level: int
    spread: float = 0.08


PAPER_SCALE = Scale(Scanner((280, 180), 0.508, 150.0, 0.508 * 150.0 / 0.112, 352), 45, 55, (-2.78, -2.12, 0.0), 5)
SMALL_SCALE = Scale(Scanner((96, 72), 0.5, 120.0, 480.0, 90), 20, 26, (0.4, -0.5, 0.7), 4)


@checked_arguments
def paper_scale(
    seed: int = 0,
    n_grains: int = 15,
    snr: float = 50.0,
    progress: Progress | None = None,
    *,
    inclusion: float | None = None,
) -> Case:
    """The scale of Khalili et al. (2017): 15 touching gravel stones about 45 voxels across.

    A panel of 280 × 180 pixels, 352 views, voxels of 0.112 mm.  ``motions`` holds ``unmoved``; ``shift``, the paper's
    31 voxels sideways; and ``random``, up to 5 voxels and 10°.  All keep the stones in the field of view.

    Parameters
    ----------
    seed : int
        Seed of the stones, the packing, the motions and the noise.
    n_grains : int
        Number of stones, 1 to 95.
    snr : float
        Signal-to-noise ratio of the later radiographs, Eq. 24 of Khalili et al. (2017).
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    inclusion : float, optional
        Attenuation over its stone's of an ellipsoid inside each stone; no inclusions if None.  The stones
        and their places are the same either way.

    Returns
    -------
    Case
        Sample, scanner, physics and motions.

    Examples
    --------
    >>> case = gm.simulate.paper_scale(n_grains=1)
    >>> case.scanner.panel
    (280, 180)
    """
    return case_of(stones(PAPER_SCALE, seed, n_grains, inclusion, progress), PAPER_SCALE, seed, snr)


@checked_arguments
def small(
    seed: int = 0,
    n_grains: int = 6,
    snr: float = 50.0,
    progress: Progress | None = None,
    *,
    inclusion: float | None = None,
) -> Case:
    """A small version of `paper_scale`, made in seconds: 6 stones about 20 voxels across, 90 views of 96 × 72 pixels.

    Parameters
    ----------
    seed, n_grains, snr, progress, inclusion : int, int, float, callable, float
        As in `paper_scale`.

    Returns
    -------
    Case
        Sample, scanner, physics and motions.

    Examples
    --------
    >>> case = gm.simulate.small(n_grains=2)
    >>> len(case.sample.particles)
    2
    """
    return case_of(stones(SMALL_SCALE, seed, n_grains, inclusion, progress), SMALL_SCALE, seed, snr)


def stones(
    scale: Scale, seed: int, n_grains: int, inclusion: float | None = None, progress: Progress | None = None
) -> Sample:
    """Different gravel stones of about the same size, packed in a cylinder; parameters as in `paper_scale`."""
    if not 1 <= n_grains <= STONE_COUNT:
        raise InputError("n_grains", f"must be 1 to {STONE_COUNT}, got {n_grains}", "ask for fewer stones")
    if inclusion is not None and not inclusion >= 0:
        raise InputError("inclusion", f"must be >= 0, got {inclusion}", "give its attenuation over the stone's")
    rng = np.random.default_rng(seed)
    voxel = scale.scanner.voxel_size
    shapes = [
        stone(int(index), scale.diameter * voxel * (1 + scale.spread * rng.uniform(-1, 1)), scale.level)
        for index in rng.permutation(STONE_COUNT)[:n_grains]
    ]
    inclusion_rng = np.random.default_rng([seed, 1])
    particles = [Particle(shape, STONE_ATTENUATION) for shape in shapes]
    if inclusion is not None:
        value = STONE_ATTENUATION * inclusion
        particles = [replace(p, inclusions=((inscribed(s, inclusion_rng), value),)) for p, s in zip(particles, shapes)]
    return pack(particles, PackingSettings(scale.radius * voxel), seed, progress)


def later_radiographs(sample: Sample, scale: Scale, spectrum: Spectrum = ((1.0, 1.0),)) -> Float:
    """Noise-free line integrals of a sample in all the views that later states have."""
    views = scale.scanner.geometry(LATER_ANGLES_DEG[4] + LATER_ANGLES_DEG[2])
    return line_integrals(sample, views, subsamples=1, spectrum=spectrum).astype(float)


def case_of(sample: Sample, scale: Scale, seed: int, snr: float, spectrum: Spectrum = ((1.0, 1.0),)) -> Case:
    """The experiment of a sample: as many photons as its later radiographs need for ``snr``, and ready-made motions."""
    scanner = scale.scanner
    photons = photons_for_snr(later_radiographs(sample, scale, spectrum), snr)
    physics = Physics(
        photons=photons,
        counts_per_photon=OPEN_BEAM_COUNTS / photons,
        dark=100,
        dark_noise=2,
        flat_variation=0.03,
        spectrum=spectrum,
    )
    motions = {
        "unmoved": motion_fields.unmoved(sample),
        "shift": motion_fields.rigid(sample, scale.shift),
        "random": motion_fields.random(sample, 5 * scanner.voxel_size, 10.0, seed + 1),
    }
    return Case(sample, scanner, physics, seed, motions)
