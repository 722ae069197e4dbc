"""Record of a hard case: a sample with one later state, its true motions, and nominal and true geometry."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised, Summary
from grainmotion.simulate.detector import Physics, Recording, record, record_line_integrals
from grainmotion.simulate.misalignment import Misalignment, crept, misaligned
from grainmotion.simulate.sample import Sample
from grainmotion.simulate.scenarios import LATER_ANGLES_DEG, Case

FOUR_ANGLES_DEG = LATER_ANGLES_DEG[4]
_FORMER_FIELDS = {"told_geometry": "nominal_geometry", "slip": "misalignment", "wobble": "view_misalignment"}


@dataclass(frozen=True, eq=False, repr=False)
class HardCase(Summarised):
    """A reference state, one later state, and an effect that makes tracking hard.

    Attributes
    ----------
    case : Case
        The reference state: sample, scanner and physics (which serves the later state, too).
    motions : Motions
        True motions to the later state, a row for each grain of the reference.  A missing grain is NaN and
        ``absent``.  A broken one has the motion that it had as a whole, and is ``broken``.  Strained ones have their
        strains, too.
    later : Sample
        The sample in the later state; its labels are not those of the motions where grains are missing or broken.
    name, summary : str
        Name in the registry, and a sentence.
    misalignment : Misalignment
        Difference of all views of both states from the nominal geometry.
    view_misalignment : Misalignment
        Standard deviations of a further misalignment of each view of the later state.
    gain, gain_spread : float
        Intensity of the later state's beam over that of the flats, and its standard deviation from view to view.
    missing, broken : tuple of int
        Labels of the grains that are missing, and of those that broke.
    body_motions : Motions, optional
        True motions of `Sample.bodies`, in their order.
    creep : (float, float, float)
        Displacement of the sample in the course of the reference scan, mm; it is in place midway.
    read_noise : float
        Standard deviation of the panel's read noise over the counts of the open beam.
    facts : dict of str to float
        Sizes of the effect that depend on the seed.

    Examples
    --------
    >>> case = gm.simulate.hard_case("missing")
    >>> case.name, len(case.missing) > 0
    ('missing', True)
    """

    case: Case
    motions: Motions
    later: Sample
    name: str = ""
    summary: str = ""
    misalignment: Misalignment = field(default_factory=Misalignment)
    view_misalignment: Misalignment = field(default_factory=Misalignment)
    gain: float = 1.0
    gain_spread: float = 0.0
    missing: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()
    body_motions: Motions | None = None
    creep: tuple[float, float, float] = (0.0, 0.0, 0.0)
    read_noise: float = 0.0
    facts: Mapping[str, float] = field(default_factory=dict)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name not in _FORMER_FIELDS:
                raise AttributeError(f"HardCase has no attribute {name!r}")
            warnings.warn(f"HardCase.{name} is now HardCase.{_FORMER_FIELDS[name]}", DeprecationWarning, stacklevel=2)
            return getattr(self, _FORMER_FIELDS[name])

    def nominal_geometry(self, angles_deg: tuple[float, ...] | None = None) -> Geometry:
        """The views that the tracker is given.

        Parameters
        ----------
        angles_deg : tuple of float, optional
            Angles of the views, degrees; those of the full scan if None.

        Returns
        -------
        Geometry
            Views of an aligned scanner.
        """
        return self.case.scanner.geometry(angles_deg)

    def true_reference_geometry(self) -> Geometry:
        """The true views of the full scan."""
        return crept(misaligned(self.nominal_geometry(), **dataclasses.asdict(self.misalignment)), self.creep)

    def true_geometry(self, angles_deg: tuple[float, ...] = FOUR_ANGLES_DEG, number: int = 1) -> Geometry:
        """The true views of the later state.

        Parameters
        ----------
        angles_deg : tuple of float
            Nominal angles of the views, degrees.
        number : int
            Seed of what is random in the views.

        Returns
        -------
        Geometry
            Misaligned views.
        """
        mean, sd, draws = self.misalignment, self.view_misalignment, self._draws(len(angles_deg), number)
        return misaligned(
            self.nominal_geometry(angles_deg),
            shift_pixels=np.array(mean.shift_pixels) + sd.shift_pixels * draws[:, :2],
            turn_deg=mean.turn_deg + sd.turn_deg * draws[:, 2],
            stage_deg=mean.stage_deg + sd.stage_deg * draws[:, 3],
        )

    def beam(self, views: int = len(FOUR_ANGLES_DEG), number: int = 1) -> Float:
        """Intensity of the beam in each view of the later state over that of the flats.

        Parameters
        ----------
        views, number : int
            Number of views, and seed of what is random in them.

        Returns
        -------
        (views,) array
            Intensities, at least 0.1.
        """
        return np.maximum(self.gain + self.gain_spread * self._draws(views, number)[:, 4], 0.1)

    def whole(self, angles_deg: tuple[float, ...] = FOUR_ANGLES_DEG) -> NDArray[np.bool_]:
        """Find the grains that are wholly on the panel in both states.

        Parameters
        ----------
        angles_deg : tuple of float
            Nominal angles of the later state's views, degrees.

        Returns
        -------
        (n,) bool array
            Rows as in ``motions``; a missing grain is whole if the reference shows it whole.
        """
        rows = [k for k, label in enumerate(self.case.sample.labels) if label not in self.missing + self.broken]
        before = _on_panel(self.case.sample, self.true_reference_geometry())
        if len(rows) == len(self.later):
            before[rows] &= _on_panel(self.later, self.true_geometry(angles_deg))
        return before

    def reference(self) -> Scan:
        """Simulate the full scan as line integrals with noise; its geometry is the nominal one."""
        case = self.case
        scan = record_line_integrals(case.sample, self.true_reference_geometry(), case.physics, case.seed)
        return Scan(self._with_read_noise(scan, case.seed), self.nominal_geometry())

    def reference_counts(self) -> Recording:
        """Simulate the full scan as counts with flats and darks; its geometry is the nominal one."""
        case = self.case
        recording = record(case.sample, self.true_reference_geometry(), self._physics, case.seed)
        return dataclasses.replace(recording, geometry=self.nominal_geometry())

    def state(self, angles_deg: tuple[float, ...] = FOUR_ANGLES_DEG, number: int = 1) -> Scan:
        """Simulate the later state as line integrals with noise.

        Parameters
        ----------
        angles_deg : tuple of float
            Nominal angles of the views, degrees.
        number : int
            Seed of the noise and of what is random in the views.

        Returns
        -------
        Scan
            With the nominal geometry.
        """
        sample, views, physics, seed, beam = self._later_state(angles_deg, number)
        scan = record_line_integrals(sample, views, physics, seed, beam)
        return Scan(self._with_read_noise(scan, seed), self.nominal_geometry(angles_deg))

    def state_counts(self, angles_deg: tuple[float, ...] = FOUR_ANGLES_DEG, number: int = 1) -> Recording:
        """Simulate the later state as counts with flats and darks.

        Parameters
        ----------
        angles_deg, number : tuple of float, int
            As in `state`.

        Returns
        -------
        Recording
            With the nominal geometry.
        """
        recording = record(*self._later_state(angles_deg, number))
        return dataclasses.replace(recording, geometry=self.nominal_geometry(angles_deg))

    def _later_state(self, angles_deg: tuple[float, ...], number: int) -> tuple[Sample, Geometry, Physics, int, Float]:
        """Arguments of `record` for the later state."""
        views, beam = self.true_geometry(angles_deg, number), self.beam(len(angles_deg), number)
        return self.later, views, self._physics, self.case.seed + 1000 * number, beam

    @property
    def _physics(self) -> Physics:
        """The physics of the case, with the read noise among that of dark counts."""
        physics = self.case.physics
        if self.read_noise == 0:
            return physics
        counts = self.read_noise * physics.photons * physics.counts_per_photon
        return dataclasses.replace(physics, dark_noise=float(np.hypot(physics.dark_noise, counts)))

    def _with_read_noise(self, scan: Scan, seed: int) -> NDArray[np.float32]:
        """Line integrals with the read noise, to first order; `record_line_integrals` leaves dark counts out."""
        if self.read_noise == 0:
            return scan.line_integrals
        noise = self.read_noise * np.random.default_rng([seed, 4]).standard_normal(scan.line_integrals.shape)
        return (scan.line_integrals + noise * np.exp(scan.line_integrals)).astype(np.float32)

    def _draws(self, views: int, number: int) -> Float:
        """Standard normal numbers of each view ``(views, 5)``: two shifts, in-plane rotation, stage angle, gain."""
        return np.random.default_rng([self.case.seed, number]).standard_normal((views, 5))

    def _summary(self) -> Summary:
        rows = (("summary", self.summary), ("particles", str(len(self.case.sample.particles))))
        return Summary(f"HardCase {self.name}", self.summary, rows)


def _on_panel(sample: Sample, geometry: Geometry) -> NDArray[np.bool_]:
    """Which particles cast their whole shadows on the panel in every view ``(n,)``."""
    last = np.array(geometry.shape) - 1
    pixels = [geometry.project_points(p.shape.outline) for p in sample.particles]
    return np.array([bool(((at >= 0) & (at <= last)).all()) for at in pixels], dtype=bool)
