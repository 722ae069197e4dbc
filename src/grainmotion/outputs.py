"""Outputs of a state beside its motions: residual radiographs, the rebuilt sample, exports, the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.grains import GrainSet
from grainmotion.io.results import Reference
from grainmotion.io.spam import write_ddic_tsv
from grainmotion.io.tiff import write_tiff
from grainmotion.io.vtk import write_grains_vtp, write_image_vti
from grainmotion.motions import Motions
from grainmotion.project import Projector, simulate_radiographs
from grainmotion.rebuild import rebuild
from grainmotion.scan import Scan
from grainmotion.volume import Volume


def write_residuals(
    folder: Path, grains: GrainSet, motions: Motions, scan: Scan, projector: Projector
) -> list[Path]:
    """Write ``residuals.tif``: measured − (a · simulated + b) of each view, NaN where a pixel is masked."""
    simulated = simulate_radiographs(grains, motions, scan.geometry, projector)
    residuals = scan.line_integrals - (motions.fit.gain * simulated + motions.fit.offset)
    if scan.valid is not None:
        residuals[~scan.valid] = np.nan
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
