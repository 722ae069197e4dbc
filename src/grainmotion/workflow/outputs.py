"""Outputs of a state beside its motions: residual radiographs, the rebuilt sample, exports, the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from grainmotion import report
from grainmotion._typing import Projector
from grainmotion.analysis.deformed_volume import rebuild
from grainmotion.analysis.residual_images import leftover
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.results import Reference
from grainmotion.io.spam import write_ddic_tsv
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.io.vtk import write_grains_vtp, write_image_vti
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, StateReport
from grainmotion.report.data import Rows


def write_residuals(folder: Path, grains: GrainSet, motions: Motions, scan: Scan, projector: Projector) -> list[Path]:
    """Write ``residuals.tif``: measured − m(simulated) of each view, NaN where a pixel is masked."""
    residuals = leftover(grains, motions, scan, projector=projector)
    path = folder / "residuals.tif"
    write_tiff(path, residuals.astype(np.float32))
    return [path]


def write_rebuilt(folder: Path, grains: GrainSet, motions: Motions, grid: Volume) -> list[Path]:
    """Write ``rebuilt.tif`` and ``rebuilt_labels.tif``: the current configuration on the reference's grid."""
    volume, labels = rebuild(grains, motions, grid)
    paths = [folder / "rebuilt.tif", folder / "rebuilt_labels.tif"]
    write_tiff(paths[0], volume.array)
    write_tiff(paths[1], labels)
    return paths


def write_export(what: str, folder: Path, motions: Motions, reference: Reference) -> list[Path]:
    """Write a state for ParaView ("vtk": ``grains.vtp``) or for spam ("spam": ``grains-ddic.tsv``)."""
    if what == "vtk":
        path = folder / "grains.vtp"
        write_grains_vtp(path, motions)
        return [path]
    path = folder / "grains-ddic.tsv"
    write_ddic_tsv(path, motions, reference.volume, reference.labels)
    return [path]


def write_reference_export(what: str, folder: Path, reference: Reference) -> list[Path]:
    """Write the reference beside the states: ``reference.vti``, or volume and labels as TIFF for spam."""
    if what == "vtk":
        paths = [folder / "reference.vti"]
        write_image_vti(paths[0], reference.volume, reference.labels)
        return paths
    assert reference.labels is not None
    paths = [folder / "reference.tif", folder / "reference_labels.tif"]
    write_tiff(paths[0], reference.volume.array)
    write_tiff(paths[1], reference.labels)
    return paths


def write_report(
    experiment: Experiment,
    inputs: Inputs,
    reference: Reference,
    motions: Mapping[str, Motions],
    folder: Path,
    comparisons: Mapping[str, Rows] | None = None,
    machine: Rows = (),
) -> Path:
    """Write ``report.html`` from the results in ``folder``.

    ``comparisons`` are facts beside a state, ``machine`` those that calibration found.
    """
    beside = comparisons or {}
    states = tuple(
        _state_report(scan, name, motions[name], folder, reference.volume.voxel_size, beside.get(name, ()))
        for scan, name in zip(inputs.states, motions)
    )
    data = ReportData(
        title=experiment.path.stem if experiment.path.stem != "experiment" else experiment.folder.resolve().name,
        facts=(*_facts(inputs, reference), *machine),
        reconstruction_errors=reference.residuals,
        volume=reference.volume,
        labels=reference.labels,
        states=states,
    )
    path = folder / "report.html"
    report.write_report(path, data)
    return path


def _state_report(
    source: ScanInput, name: str, motions: Motions, folder: Path, voxel_size: float, comparison: Rows
) -> StateReport:
    scan, _ = source.read()
    residual = read_tiff(folder / name / "residuals.tif")
    measured = scan.line_integrals.copy()
    if scan.valid is not None:
        measured[~scan.valid] = np.nan
    upright = float(source.geometry.v[:, 2].mean()) >= 0
    return StateReport(
        name=name,
        measured=measured,
        simulated=measured - residual,
        residual=residual,
        motions=motions,
        voxel_size=voxel_size,
        views=tuple(f"view {k}, {angle:.1f}°" for k, angle in enumerate(source.geometry.azimuths_deg)),
        comparison=comparison,
        first_row="bottom" if upright else "top",
    )


def _facts(inputs: Inputs, reference: Reference) -> Rows:
    volume, labels = reference.volume, reference.labels
    rows = [
        (
            "Volume",
            f"{' x '.join(str(n) for n in volume.shape)} voxels (z, y, x) of {volume.voxel_size:.4g} mm",
        ),
        ("Grains", str(0 if labels is None else len(np.unique(labels[labels > 0])))),
    ]
    if np.isfinite(reference.threshold):
        rows.append(("Threshold", f"{reference.threshold:.4g} /mm"))
    if reference.border:
        rows.append(("Cut by the border of the field of view", f"{len(reference.border)} grains"))
    if inputs.reference is not None:
        geometry = inputs.reference.geometry
        rows.insert(
            0,
            ("Reference scan", f"{len(geometry)} views of {geometry.shape[0]} x {geometry.shape[1]} pixels"),
        )
        rows.append(("Relative residual of the reconstruction", f"{reference.residuals[-1]:.4f}"))
    else:
        rows.insert(0, ("Reference volume", "given"))
    return tuple(rows)
