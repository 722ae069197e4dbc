"""Ready-made experiments with their truth: the paper's scale, and a small one for tests and demos."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.simulate import motion_fields
from grainmotion.simulate.detector import Physics, Recording, photons_for_snr, record, record_line_integrals
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.radiograph import line_integrals
from grainmotion.simulate.sample import Particle, Sample, inscribed
from grainmotion.simulate.shapes import stone

STONES = 95
Spectrum = tuple[tuple[float, float], ...]
ATTENUATION = 0.1  # of every stone, 1/mm
OPEN_BEAM = 40_000  # counts without the sample, well inside 16 bits
LATER_ANGLES_DEG = {2: (22.5, 112.5), 4: (0.0, 45.0, 90.0, 135.0)}


@dataclass(frozen=True)
class Scanner:
    """A circular cone-beam scanner and the grid that suits it.

    Attributes
    ----------
    panel : (int, int)
        Rows and columns.
    pixel_size, source_to_axis, source_to_detector : float
        mm.
    reference_views : int
        Views of the full scan, evenly over 360°.
    """

    panel: tuple[int, int]
    pixel_size: float
    source_to_axis: float
    source_to_detector: float
    reference_views: int

    @property
    def voxel_size(self) -> float:
        """A pixel carried back to the rotation axis, mm."""
        return self.pixel_size * self.source_to_axis / self.source_to_detector

    def geometry(self, angles_deg: tuple[float, ...] | None = None) -> Geometry:
        """The views at some angles, or the full scan's."""
        if angles_deg is None:
            angles_deg = tuple(np.arange(self.reference_views) * 360.0 / self.reference_views)
        return Geometry.cone(
            angles_deg,
            self.panel,
            self.pixel_size,
            source_to_axis=self.source_to_axis,
            source_to_detector=self.source_to_detector,
        )

    @property
    def grid(self) -> Volume:
        """An empty volume of rows × columns × columns voxels on the axis."""
        rows, columns = self.panel
        return Volume.zeros((rows, columns, columns), self.voxel_size)


@dataclass(frozen=True, eq=False)
class Case:
    """A sample, its scanner and its physics, from which any state can be recorded.

    Attributes
    ----------
    sample : Sample
        In the reference state.
    scanner : Scanner
    physics : Physics
    seed : int
    motions : dict of str to Motions
        Ready-made truths by name: ``unmoved``, ``shift``, ``random``.
    """

    sample: Sample
    scanner: Scanner
    physics: Physics
    seed: int
    motions: dict[str, Motions] = field(default_factory=dict)

    def reference(self) -> Scan:
        """The full scan, as line integrals with noise."""
        return record_line_integrals(self.sample, self.scanner.geometry(), self.physics, self.seed)

    def reference_counts(self) -> Recording:
        """The full scan, as counts with flats and darks."""
        return record(self.sample, self.scanner.geometry(), self.physics, self.seed)

    def state(self, motions: Motions, angles_deg: tuple[float, ...], number: int = 1) -> Scan:
        """Radiographs of a later state, as line integrals with noise of their own for each ``number``."""
        moved = self.sample.moved(motions)
        return record_line_integrals(moved, self.scanner.geometry(angles_deg), self.physics, self.seed + 1000 * number)

    def state_counts(self, motions: Motions, angles_deg: tuple[float, ...], number: int = 1) -> Recording:
        """Radiographs of a later state, as counts with flats and darks."""
        views = self.scanner.geometry(angles_deg)
        return record(self.sample.moved(motions), views, self.physics, self.seed + 1000 * number)


@dataclass(frozen=True)
class Scale:
    """How large the stones of a case are, and the scanner that suits them.

    Attributes
    ----------
    scanner : Scanner
    diameter, radius : float
        Of the stones and of the cylinder that they lie in, voxels.
    shift : (float, float, float)
        The motion ``shift`` of the whole sample, mm.
    level : int
        Subdivisions of each stone's mesh, see `stone`.
    """

    scanner: Scanner
    diameter: float
    radius: float
    shift: tuple[float, float, float]
    level: int


PAPER_SCALE = Scale(Scanner((280, 180), 0.508, 150.0, 0.508 * 150.0 / 0.112, 352), 45, 55, (-2.78, -2.12, 0.0), 5)
SMALL_SCALE = Scale(Scanner((96, 72), 0.5, 120.0, 480.0, 90), 20, 26, (0.4, -0.5, 0.7), 4)


def paper_scale(
    seed: int = 0,
    n_grains: int = 15,
    snr: float = 50.0,
    progress: Progress | None = None,
    *,
    inclusion: float | None = None,
) -> Case:
    """The scale of Khalili et al. (2017): 15 touching gravel stones about 45 voxels across.

    A panel of 280 × 180 pixels, 352 views, voxels of 0.112 mm; every motion keeps the stones in the
    field of view.  ``motions`` holds ``unmoved``; ``shift``, the paper's 31 voxels sideways; and
    ``random``, up to 5 voxels and 10°.  ``inclusion`` as in `stones`.
    """
    return case_of(stones(PAPER_SCALE, seed, n_grains, inclusion, progress), PAPER_SCALE, seed, snr)


def small(
    seed: int = 0,
    n_grains: int = 6,
    snr: float = 50.0,
    progress: Progress | None = None,
    *,
    inclusion: float | None = None,
) -> Case:
    """A small sibling of `paper_scale`, in seconds: 6 stones about 20 voxels across, 90 views of 96 × 72."""
    return case_of(stones(SMALL_SCALE, seed, n_grains, inclusion, progress), SMALL_SCALE, seed, snr)


def stones(
    scale: Scale, seed: int, n_grains: int, inclusion: float | None = None, progress: Progress | None = None
) -> Sample:
    """Different gravel stones of about one size, packed in a cylinder.

    Parameters
    ----------
    scale : Scale
    seed : int
    n_grains : int
    inclusion : float, optional
        Attenuation over its stone's of an ellipsoid inside each stone; no inclusions if None.  The stones
        and their places are the same either way.
    progress : callable, optional
    """
    if not 1 <= n_grains <= STONES:
        raise InputError("n_grains", f"must be 1 to {STONES}, got {n_grains}", "ask for fewer stones")
    if inclusion is not None and not inclusion >= 0:
        raise InputError("inclusion", f"must be >= 0, got {inclusion}", "give its attenuation over the stone's")
    rng = np.random.default_rng(seed)
    voxel = scale.scanner.voxel_size
    shapes = [
        stone(int(index), scale.diameter * voxel * (1 + 0.08 * rng.uniform(-1, 1)), scale.level)
        for index in rng.permutation(STONES)[:n_grains]
    ]
    inner = np.random.default_rng([seed, 1])
    particles = [
        Particle(s, ATTENUATION, () if inclusion is None else ((inscribed(s, inner), ATTENUATION * inclusion),))
        for s in shapes
    ]
    return pack(particles, PackingSettings(scale.radius * voxel), seed, progress)


def case_of(sample: Sample, scale: Scale, seed: int, snr: float, spectrum: Spectrum = ((1.0, 1.0),)) -> Case:
    """The experiment of a sample: photons for an SNR (Eq. 24) of its later radiographs, and ready-made motions."""
    scanner = scale.scanner
    views = scanner.geometry(LATER_ANGLES_DEG[4] + LATER_ANGLES_DEG[2])
    photons = photons_for_snr(line_integrals(sample, views, subsamples=1, spectrum=spectrum), snr)
    physics = Physics(
        photons=photons,
        counts_per_photon=OPEN_BEAM / photons,
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
