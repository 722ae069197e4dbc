"""The machine of a run: what its reference scan tells of panel, axis and beam, and inputs corrected by it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Progress
from grainmotion.calibration.calibrate import FEWEST_VIEWS, CalibrateSettings, calibrate
from grainmotion.calibration.corrections import DEFAULT, Calibration
from grainmotion.errors import InputError
from grainmotion.experiment.config import ExperimentFile
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.beam_hardening import Hardening, HardeningSettings, calibrate_hardening
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.segment import segment

ROUNDS = ("hardening", "hardening, once more")  # the first template is itself of a hardened volume


@dataclass(frozen=True, eq=False)
class ScannerCalibration:
    """What was found of the machine; None for what was not asked for."""

    calibration: Calibration | None = None
    hardening: Hardening | None = None

    def apply(self, scan: Scan) -> Scan:
        """A scan of this machine, corrected."""
        if self.calibration is not None:
            scan = dataclasses.replace(scan, geometry=self.calibration.apply(scan.geometry))
        return scan if self.hardening is None else self.hardening.apply(scan)

    def correct(self, inputs: Inputs) -> Inputs:
        """The inputs, to be read corrected."""
        reference = None if inputs.reference is None else self._correct(inputs.reference)
        return dataclasses.replace(inputs, reference=reference, states=tuple(map(self._correct, inputs.states)))

    def _correct(self, source: ScanInput) -> ScanInput:
        geometry = source.geometry if self.calibration is None else self.calibration.apply(source.geometry)
        return dataclasses.replace(source, geometry=geometry, hardening=self.hardening)

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """What to say of it, name and value."""
        rows = []
        if self.calibration is not None:
            before, after = self.calibration.residuals
            rows += [(f"Calibrated: {c.name}", str(c).removeprefix(f"{c.name} ")) for c in self.calibration.corrections]
            rows.append(("Half of the views against the other half", f"{before:.4f} as told, {after:.4f} calibrated"))
        if self.hardening is not None:
            rows.append(("Calibrated: beam", str(self.hardening)))
        return tuple(rows)


def calibrate_machine(
    scan: Scan,
    grid: Volume,
    tables: ExperimentFile,
    labels: NDArray[np.int32] | None,
    listener: Callable[[str], Progress],
) -> ScannerCalibration:
    """Find what ``[calibrate]`` asks for; ``labels`` are the grains if they were given."""
    wanted = tables.calibrate
    calibration = hardening = None
    auto = wanted.geometry == "auto"
    if wanted.geometry and not (auto and len(scan) < FEWEST_VIEWS):
        names = tuple(wanted.geometry) if isinstance(wanted.geometry, list) else DEFAULT
        calibration = calibrate(scan, grid, CalibrateSettings(parameters=names), progress=listener("calibrate"))
        calibration = calibration.significant(scan.geometry) if auto else calibration
        scan = dataclasses.replace(scan, geometry=calibration.geometry)
    if wanted.hardening:
        hardening = _hardening(scan, grid, tables, labels, listener)
    return ScannerCalibration(calibration, hardening)


def _hardening(
    scan: Scan,
    grid: Volume,
    tables: ExperimentFile,
    labels: NDArray[np.int32] | None,
    listener: Callable[[str], Progress],
) -> Hardening:
    """The curve, from a reconstruction of what was measured, then of what the first curve made of it."""
    settings = HardeningSettings(
        degree=tables.calibrate.hardening, threshold=tables.segment.threshold, projector=tables.reconstruct.projector
    )
    curve = Hardening()
    for name in ROUNDS:
        volume = reconstruct(curve.apply(scan), grid, tables.reconstruct, progress=listener(name)).volume
        found = labels if labels is not None else _grains(volume, tables)
        curve = calibrate_hardening(scan, volume, found, settings)
        if curve.is_linear:
            break
    return curve


def _grains(volume: Volume, tables: ExperimentFile) -> NDArray[np.int32] | None:
    try:
        return segment(volume, tables.segment).labels
    except InputError:  # said later, of the corrected volume
        return None
