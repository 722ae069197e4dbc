"""Calibration of the scanner as a stage of a run, and its facts for the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from grainmotion.calibration.corrections import LENGTHS
from grainmotion.calibration.scanner import ScannerCalibration, calibrate_scanner
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.calibration_json import read_calibration, write_calibration
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.workflow.context import RunContext, load_result
from grainmotion.workflow.provenance import Stage

CALIBRATION = "calibration.json"
CORRECTED: dict[str, str] = {
    "shift_u": "the position of panel or axis along the rows",
    "shift_v": "the height of the panel",
    "turn": "the rotation of the panel in its plane",
    "pitch": "the tilt of the panel about its rows",
    "yaw": "the tilt of the panel about its columns",
    "axis_offset": "the position of the axis along the rows",
    "axis_tilt": "the tilt of the axis",
}
"""What each correction is, for the user."""


def calibrate_stage(context: RunContext) -> Callable[[], ScannerCalibration]:
    """Calibrate the scanner, if the experiment asks for it."""
    source, settings = context.inputs.reference, context.experiment.reference_settings
    if source is None or not context.fingerprints.calibrates:
        return ScannerCalibration
    geometry, path = source.geometry, context.folder / CALIBRATION

    def run() -> ScannerCalibration:
        scan, grid, labels = context.measured(source), context.inputs.grid, context.given_labels
        return calibrate_scanner(scan, grid, settings, labels=labels, progress=context.progress)

    def load() -> ScannerCalibration:
        return ScannerCalibration(*load_result(lambda file: read_calibration(file, geometry), path))

    def write(scanner: ScannerCalibration) -> None:
        write_calibration(path, scanner.calibration, scanner.hardening)

    return context.complete(Stage("calibrate", context.fingerprints.calibrate, [path], run, write, load))


def calibration_findings(scanner: ScannerCalibration, geometry: Geometry) -> list[Finding]:
    """A note on each correction that is applied to all scans; ``geometry`` is the reference's as given."""
    found = []
    if scanner.calibration is not None:
        before, after = scanner.calibration.residuals
        evidence = f"half of the views against the other half: {before:.3g} as given, {after:.3g} corrected"
        for c in scanner.calibration.corrections:
            if c.determined and c.amount:
                pixel = geometry.pixel_at((0, 0, 0)) if c.name == "axis_offset" else float(geometry.pixel_sizes.mean())
                pixels = f", {c.amount / pixel:.2g} pixels" if c.name in LENGTHS else ""
                fact = f"{CORRECTED[c.name]} was corrected in all scans: {c}{pixels}"
                remedy = "if this is wrong, set [calibrate] geometry = false"
                found.append(Finding(Level.NOTE, "calibration", "reference", fact, evidence, remedy))
    if scanner.hardening is not None and not scanner.hardening.is_linear:
        fact = f"beam hardening was corrected in all scans: {scanner.hardening}"
        found.append(Finding(Level.NOTE, "calibration", "reference", fact))
    return found


def corrected_source(source: ScanInput, scanner: ScannerCalibration) -> ScanInput:
    """A scan whose files workers read with the calibration applied."""
    geometry = source.geometry if scanner.calibration is None else scanner.calibration.apply(source.geometry)
    return replace(source, geometry=geometry, hardening=scanner.hardening)


def calibration_facts(scanner: ScannerCalibration) -> tuple[tuple[str, str], ...]:
    """Facts of a calibration for the report, name and value."""
    rows = []
    if scanner.calibration is not None:
        before, after = scanner.calibration.residuals
        rows += [(f"Calibrated: {c.name}", str(c).removeprefix(f"{c.name} ")) for c in scanner.calibration.corrections]
        rows.append(("Half of the views against the other half", f"{before:.4f} as given, {after:.4f} calibrated"))
    if scanner.hardening is not None:
        rows.append(("Calibrated: beam", str(scanner.hardening)))
    return tuple(rows)
