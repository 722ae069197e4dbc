"""Calibration of a scanner on its reference scan: geometry of panel and axis, then beam hardening."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.calibration.calibrate import CalibrateSettings, calibrate
from grainmotion.calibration.corrections import DEFAULT_PARAMETERS, Calibration
from grainmotion.calibration.settings import ReferenceSettings
from grainmotion.errors import InputError
from grainmotion.model.progress import begin, prefixed
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised, Summary
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.beam_hardening import Hardening, HardeningSettings, calibrate_hardening
from grainmotion.reconstruction.fit import fitted_volume
from grainmotion.segmentation.segment import segment

HARDENING_ROUNDS = ("hardening", "hardening, once more")  # the first template is of a volume not yet corrected


@dataclass(frozen=True, eq=False, repr=False)
class ScannerCalibration(Summarised):
    """Corrections of a scanner, estimated from its reference scan.

    Attributes
    ----------
    calibration : Calibration, optional
        Corrections of the geometry; None if it is taken as given.
    hardening : Hardening, optional
        Curve that undoes beam hardening; None if it was not asked for.

    Examples
    --------
    >>> corrected = gm.ScannerCalibration().apply(state)  # neither geometry nor beam hardening: as it was
    >>> corrected is state
    True
    """

    calibration: Calibration | None = None
    hardening: Hardening | None = None

    @checked_arguments
    def apply(self, scan: Scan) -> Scan:
        """Correct a scan of this scanner.

        Parameters
        ----------
        scan : Scan
            The reference scan, or the radiographs of a later state, with the geometry as given.

        Returns
        -------
        Scan
            With the corrected geometry and linearised line integrals.
        """
        if self.calibration is not None:
            scan = replace(scan, geometry=self.calibration.apply(scan.geometry))
        return scan if self.hardening is None else self.hardening.apply(scan)

    def _summary(self) -> Summary:
        corrections = () if self.calibration is None else self.calibration.corrections
        found = ", ".join(map(str, corrections)) or "as given"
        rows = (("geometry", found), ("beam hardening", "as it is" if self.hardening is None else "undone by a curve"))
        return Summary("ScannerCalibration", ", ".join(f"{name} {value}" for name, value in rows), rows)


def calibrate_scanner(
    scan: Scan,
    grid: Volume,
    settings: ReferenceSettings,
    *,
    labels: NDArray[np.int32] | None = None,
    progress: Progress | None = None,
) -> ScannerCalibration:
    """Estimate what ``settings.calibrate`` asks for; ``labels`` are the grains if they were given."""
    asked = settings.calibrate
    if not asked.calibrates(len(scan)):
        return ScannerCalibration()
    calibration = hardening = None
    if asked.calibrates_geometry(len(scan)):
        names = tuple(asked.geometry) if isinstance(asked.geometry, list) else DEFAULT_PARAMETERS
        corrections = CalibrateSettings(parameters=names)
        calibration = calibrate(scan, grid, corrections, progress=prefixed(progress, "calibrate"))
        calibration = calibration.significant(scan.geometry) if asked.geometry == "auto" else calibration
        scan = replace(scan, geometry=calibration.geometry)
    if asked.hardening:
        hardening = _hardening(scan, grid, settings, labels, progress)
    return ScannerCalibration(calibration, hardening)


def _hardening(
    scan: Scan, grid: Volume, settings: ReferenceSettings, labels: NDArray[np.int32] | None, progress: Progress | None
) -> Hardening:
    """The curve, from a reconstruction of the scan, then from one of the scan that the first curve linearised."""
    curve_settings = HardeningSettings(
        degree=settings.calibrate.hardening,
        threshold=settings.segment.threshold,
        projector=settings.reconstruct.projector,
    )
    curve, reconstruction = Hardening(), settings.reconstruct
    if labels is not None:  # they are on this grid
        reconstruction = replace(reconstruction, outline="grid")
    for name in HARDENING_ROUNDS:
        volume = fitted_volume(curve.apply(scan), grid, reconstruction, prefixed(progress, name)).volume
        grains = _grains(volume, settings, prefixed(progress, name)) if labels is None else labels
        begin(f"{name}: curve", 1)
        curve = calibrate_hardening(scan, volume, curve_settings, labels=grains)
        if curve.is_linear:
            break
    return curve


def _grains(volume: Volume, settings: ReferenceSettings, progress: Progress | None) -> NDArray[np.int32] | None:
    try:
        return segment(volume, settings.segment, progress=progress).labels
    except InputError:  # the segmentation of the corrected volume will report it
        return None
