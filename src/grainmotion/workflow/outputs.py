"""Outputs of a run beside the motions: residual radiographs, the deformed volume, exports, the report."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

import numpy as np

from grainmotion import report
from grainmotion.analysis.residual_images import fitted_geometry, residual_images
from grainmotion.calibration.scanner import ScannerCalibration
from grainmotion.experiment.config import Experiment, Export
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.last_reference import described
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.io.appeared_csv import write_new_grains
from grainmotion.io.bodies_csv import write_body_motions
from grainmotion.io.contents import about
from grainmotion.io.pieces_csv import write_piece_motions
from grainmotion.io.results import StoredReference
from grainmotion.io.series_files import write_series
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.finding import Finding
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.report import ReportData, StateReport
from grainmotion.report.data import Rows
from grainmotion.sequences.series import Series
from grainmotion.workflow.calibration_stage import calibration_facts
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.dem_export import DEM, export_dem
from grainmotion.workflow.exports import (
    COLLECTIONS,
    DEFORMED,
    REFERENCE_EXPORTS,
    STATE_EXPORTS,
    Exporter,
    rebuilt_formats,
    time_of,
)
from grainmotion.workflow.mechanics_stage import MECHANICS, write_mechanics_files
from grainmotion.workflow.provenance import Stage
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.run_record import run_record
from grainmotion.workflow.tracking_stage import TrackedState

RESIDUALS: str = "residuals.tif"
REPORT: str = "report.html"
RESIDUALS_ABOUT = {
    "content": "measured - simulated radiographs [view, row, column], NaN where a pixel is masked",
    "unit": "line integral, dimensionless",
}
SERIES = "series"
PRINTS = {"vtk": "vtk, surfaces", "spam": "spam, with voxel size"}
"""What fingerprints say of files that older versions wrote otherwise."""
BODIES, APPEARED, PIECES = "bodies.csv", "appeared.csv", "pieces.csv"


@dataclass(frozen=True, eq=False)
class Results:
    """Data of the report; scans and motions by the name of their state."""

    experiment: Experiment
    inputs: Inputs
    folder: Path
    reference: StoredReference
    scans: Mapping[str, Scan]
    motions: Mapping[str, Motions]
    scanner: ScannerCalibration = field(default_factory=ScannerCalibration)
    findings: tuple[Finding, ...] = ()


def write_outputs(
    context: RunContext, reference: Callable[[], SegmentedReference], tracked: Mapping[str, TrackedState]
) -> None:
    """Write the reference's exports, then the outputs of each state, then what is made of all states."""
    exporter = Exporter(context, reference)
    write_reference_exports(context, exporter)
    for table, source in context.states:
        write_state_outputs(context, exporter, table, source, tracked[table.name])
    write_outputs_of_all_states(context, exporter, tracked)


def write_reference_exports(context: RunContext, exporter: Exporter) -> None:
    """Write volume, labels and grains of the reference for other software."""
    exports = _exports(context)
    for export in exports:
        if export == "tiff" and "spam" in exports:
            continue  # the same files
        files = [context.folder / file for file in REFERENCE_EXPORTS[export]]
        write: Callable[[], None] = partial(exporter.reference_files, export, files)
        fingerprint = context.fingerprints.after_segmentation(PRINTS.get(export, export))
        _complete(context, f"reference/{export}", fingerprint, files, write)


def write_state_outputs(
    context: RunContext, exporter: Exporter, table: StateTable, source: ScanInput, state: TrackedState
) -> None:
    """Write what belongs to one state beside its motions."""
    output, prints, folder = context.tables.output, context.fingerprints, context.folder / table.name
    files = [folder / RESIDUALS]
    outputs = [("residuals", files, partial(_write_residuals, context, exporter.reference, source, state, files[0]))]
    fit = state.motions.fit
    if fit.bodies:
        files = [folder / BODIES]
        outputs.append(("bodies", files, partial(write_body_motions, files[0], fit.bodies)))
    if fit.appeared:
        files = [folder / APPEARED]
        outputs.append(("appeared", files, partial(write_new_grains, files[0], fit.appeared)))
    if fit.pieces:
        files = [folder / PIECES]
        outputs.append(("pieces", files, partial(write_piece_motions, files[0], fit.pieces)))
    for k, kind in enumerate(rebuilt_formats(output)):
        files = [folder / file for file in DEFORMED[kind]]
        name = f"rebuilt {kind}" if k else "rebuilt"
        outputs.append((name, files, partial(exporter.deformed, state.motions, files)))
    for export in (export for export in _exports(context) if export in STATE_EXPORTS):
        files = [folder / file for file in STATE_EXPORTS[export]]
        outputs.append((export, files, partial(exporter.state_files, export, table, state.motions, files)))
    for name, files, write in outputs:
        made = f"{name} {output.spam_about}" if name == "spam" else PRINTS.get(name, name)
        if name == "vtk":
            made += f" {time_of(table, context.tables.states)}"
        elif name.startswith("rebuilt"):
            made += f" {files[0].name}"
        _complete(context, f"{table.name}/{name}", prints.after_tracking(made, table.name), files, write)


def write_outputs_of_all_states(context: RunContext, exporter: Exporter, tracked: Mapping[str, TrackedState]) -> None:
    """Write what is made of all states together."""
    if "vtk" in _exports(context):
        files = [context.folder / file for file in COLLECTIONS]
        steps = [[table.name, str(time_of(table, context.tables.states))] for table, _ in context.states]
        fingerprint = context.cache.fingerprint(["collections", steps])
        _complete(context, "collections", fingerprint, files, partial(exporter.collections, files))
    if DEM in context.tables.output.exports:
        export_dem(context, exporter.reference, tracked)
    if MECHANICS in context.tables.output.exports:
        write_mechanics_files(context, exporter.reference, tracked)
    write_series_files(context, {name: state.motions for name, state in tracked.items()})


def _exports(context: RunContext) -> list[Export]:
    """Files for other software that are wanted, each once, but for those that are made of all states."""
    return [export for export in dict.fromkeys(context.tables.output.exports) if export not in (MECHANICS, DEM)]


def write_series_files(context: RunContext, motions: Mapping[str, Motions]) -> None:
    """Write the table of all states, in each format that is asked for; nothing if there is no state."""
    tables = context.tables
    if not motions:
        return
    settings = {"track": dataclasses.asdict(tables.track), "experiment": context.experiment.path.name}

    @cache
    def series() -> Series:
        return Series.of(motions, {table.name: table.time for table in tables.states if table.time is not None})

    for suffix in tables.output.series:
        path = context.folder / f"{SERIES}.{suffix}"

        def write(path: Path = path) -> None:
            write_series(path, series(), settings=settings)

        _complete(context, f"{SERIES}/{suffix}", context.fingerprints.series, [path], write)


def _complete(context: RunContext, name: str, fingerprint: str, files: list[Path], write: Callable[[], None]) -> None:
    """Complete a stage that has no result but its files."""
    run = partial(context.notify, name.replace("/", ": "))
    context.complete(Stage(name, fingerprint, files, run=run, write=lambda _: write(), load=lambda: None))


def _write_residuals(
    context: RunContext,
    reference: Callable[[], SegmentedReference],
    source: ScanInput,
    state: TrackedState,
    path: Path,
) -> None:
    """Measured − m(simulated) of each view, NaN where a pixel is masked; simulated only if tracking did not keep it."""
    residual = state.residual
    if residual is None:
        grains, scan, projector = reference().grains, context.radiographs(source), context.tables.track.projector
        residual = residual_images(grains, state.motions, scan, projector=projector)
    write_tiff(path, residual.astype(np.float32), {**about(), **RESIDUALS_ABOUT})


# ---------------------------------------------------------------------- the report
def report_stage(
    context: RunContext, reference: Callable[[], SegmentedReference], motions: Mapping[str, Motions]
) -> Path:
    """Write the report on all states."""

    def write() -> None:
        scans = {table.name: context.radiographs(source) for table, source in context.states}
        stored, scanner, found = reference().stored, context.scanner(), tuple(context.findings)
        inputs, folder = context.inputs, context.folder
        write_report(Results(context.experiment, inputs, folder, stored, scans, motions, scanner, found))

    told = sorted(str(finding) for finding in context.findings)
    fingerprint = context.cache.fingerprint(["findings", told], (), [context.fingerprints.report])
    _complete(context, "report", fingerprint, [context.folder / REPORT], write)
    return context.folder / REPORT


def write_report(results: Results, comparisons: Mapping[str, Rows] | None = None) -> None:
    """Write ``report.html``, with facts of a comparison for the states that ``comparisons`` names."""
    experiment, reference, comparisons = results.experiment, results.reference, comparisons or {}
    data = ReportData(
        title=experiment.path.stem if experiment.path.stem != "experiment" else experiment.folder.resolve().name,
        facts=(*_reference_facts(results.inputs, reference), *calibration_facts(results.scanner)),
        reconstruction_errors=reference.residuals,
        volume=reference.volume,
        labels=reference.labels,
        bodies=() if reference.scene is None else reference.scene.bodies,
        states=tuple(_state_report(results, name, comparisons.get(name, ())) for name in results.motions),
        findings=results.findings,
        run=run_record(experiment, results.inputs, results.folder),
    )
    report.write_report(results.folder / REPORT, data)


def _state_report(results: Results, name: str, comparison: Rows) -> StateReport:
    scan = results.scans[name]
    measured = scan.line_integrals.copy()
    residual = read_tiff(results.folder / name / RESIDUALS).astype(measured.dtype, copy=False)
    if scan.valid is not None:
        measured[~scan.valid] = np.nan
    upright = float(scan.geometry.v[:, 2].mean()) >= 0
    return StateReport(
        name=name,
        measured=measured,
        simulated=measured - residual,
        residual=residual,
        motions=results.motions[name],
        voxel_size=results.reference.volume.voxel_size,
        views=tuple(f"view {k}, {angle:.1f}°" for k, angle in enumerate(scan.geometry.azimuths_deg)),
        comparison=comparison,
        first_row="bottom" if upright else "top",
        geometry=fitted_geometry(scan.geometry, results.motions[name].fit),
        time=next((table.time for table in results.experiment.tables.states if table.name == name), None),
    )


def _reference_facts(inputs: Inputs, reference: StoredReference) -> Rows:
    volume, labels = reference.volume, reference.labels
    size = " x ".join(str(n) for n in volume.shape)
    rows = [
        ("Volume", f"{size} voxels (z, y, x) of {volume.voxel_size:.4g} mm"),
        ("Grains", str(0 if labels is None else np.count_nonzero(label_sizes(labels)[1:]))),
    ]
    if np.isfinite(reference.threshold):
        rows.append(("Threshold", f"{reference.threshold:.4g} 1/mm"))
    if reference.phases:
        rows.append(("Phases, with their shares of the volume", ", ".join(map(str, reference.phases))))
    if sentences := described(reference):
        rows.append(("What attenuates, with its share", "; ".join(sentences)))
    if reference.border:
        rows.append(("Cut by the border of the field of view", f"{len(reference.border)} grains"))
    if inputs.reference is None:
        return ("Reference volume", "given"), *rows
    geometry = inputs.reference.geometry
    rows.append(("Relative residual of the reconstruction", f"{reference.residuals[-1]:.4f}"))
    scan = f"{len(geometry)} views of {geometry.shape[0]} x {geometry.shape[1]} pixels"
    return ("Reference scan", scan), *rows
