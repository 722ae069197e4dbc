"""An experiment with its flaws: what stood in the scanner, what was told, and what is true."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.simulate.detector import Recording, record, record_line_integrals
from grainmotion.simulate.misalignment import Slip, misaligned
from grainmotion.simulate.sample import Sample
from grainmotion.simulate.scenarios import LATER_ANGLES_DEG, Case

VIEWS = LATER_ANGLES_DEG[4]


@dataclass(frozen=True, eq=False)
class HardCase:
    """One experiment: the reference state of `Case`, one later state, and what is wrong with them.

    Attributes
    ----------
    case : Case
        The reference state: sample, scanner and physics (which serves the later state, too).
    motions : Motions
        The truth of the later state, a row for each grain of the reference.  A grain that is gone is NaN and
        ``not-fitted``; one that broke has the motion of the whole before it parted, and is ``not-converged``.
    later : Sample
        What stands in the scanner in the later state; its labels are not the truth's where grains are
        missing or broken.
    name, summary : str
        In the registry; a sentence.
    slip : Slip
        Of all views of all states, which the geometry told does not know.
    wobble : Slip
        Standard deviations of what comes to it in each view of the later state.
    gain, gain_spread : float
        Intensity of the later state's beam over that of the flats, and its standard deviation from view to view.
    missing, broken : tuple of int
        Labels of grains that are gone, and that broke.
    facts : dict of str to float
        Sizes of the effect, as far as they are chosen by the seed.
    """

    case: Case
    motions: Motions
    later: Sample
    name: str = ""
    summary: str = ""
    slip: Slip = field(default_factory=Slip)
    wobble: Slip = field(default_factory=Slip)
    gain: float = 1.0
    gain_spread: float = 0.0
    missing: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()
    facts: Mapping[str, float] = field(default_factory=dict)

    def nominal_geometry(self, angles_deg: tuple[float, ...] | None = None) -> Geometry:
        """The views that the tracker is told: at some angles, or the full scan's."""
        return self.case.scanner.geometry(angles_deg)

    def true_reference_geometry(self) -> Geometry:
        """The views that took the full scan."""
        return misaligned(self.nominal_geometry(), **dataclasses.asdict(self.slip))

    def true_geometry(self, angles_deg: tuple[float, ...] = VIEWS, number: int = 1) -> Geometry:
        """The views that took the later state."""
        told = self.nominal_geometry(angles_deg)
        z = self._draws(len(told), number)
        return misaligned(
            told,
            shift_pixels=np.array(self.slip.shift_pixels) + self.wobble.shift_pixels * z[:, :2],
            turn_deg=self.slip.turn_deg + self.wobble.turn_deg * z[:, 2],
            stage_deg=self.slip.stage_deg + self.wobble.stage_deg * z[:, 3],
        )

    def beam(self, views: int = len(VIEWS), number: int = 1) -> Float:
        """Intensity of the beam in each view of the later state over that of the flats ``(views,)``."""
        return np.maximum(self.gain + self.gain_spread * self._draws(views, number)[:, 4], 0.1)

    def reference(self) -> Scan:
        """The full scan with the geometry told, as line integrals with noise."""
        case = self.case
        scan = record_line_integrals(case.sample, self.true_reference_geometry(), case.physics, case.seed)
        return Scan(scan.line_integrals, self.nominal_geometry())

    def reference_counts(self) -> Recording:
        """The full scan with the geometry told, as counts with flats and darks."""
        case = self.case
        recording = record(case.sample, self.true_reference_geometry(), case.physics, case.seed)
        return dataclasses.replace(recording, geometry=self.nominal_geometry())

    def state(self, angles_deg: tuple[float, ...] = VIEWS, number: int = 1) -> Scan:
        """The later state with the geometry told, as line integrals; noise and wobble differ with ``number``."""
        views, beam = self.true_geometry(angles_deg, number), self.beam(len(angles_deg), number)
        scan = record_line_integrals(self.later, views, self.case.physics, self._seed(number), beam)
        return Scan(scan.line_integrals, self.nominal_geometry(angles_deg))

    def state_counts(self, angles_deg: tuple[float, ...] = VIEWS, number: int = 1) -> Recording:
        """The later state with the geometry told, as counts with flats and darks."""
        views, beam = self.true_geometry(angles_deg, number), self.beam(len(angles_deg), number)
        recording = record(self.later, views, self.case.physics, self._seed(number), beam)
        return dataclasses.replace(recording, geometry=self.nominal_geometry(angles_deg))

    def _seed(self, number: int) -> int:
        return self.case.seed + 1000 * number

    def _draws(self, views: int, number: int) -> Float:
        """What is random of each view, standard normal ``(views, 5)``: shifts, turn, stage, gain."""
        return np.random.default_rng([self.case.seed, number]).standard_normal((views, 5))
