"""What other software made: a reference volume and its labels, and their comparison with the radiographs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.coarse_projection import MAX_VIEWS_COMPARED
from grainmotion.diagnosis.given_volume import check_volume
from grainmotion.diagnosis.labels import LABELS_CHECK, check_labels
from grainmotion.errors import InputError
from grainmotion.experiment.given_grid import label_size_findings, voxel_findings
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.volumes.label_types import label_array
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.model.finding import Finding, Level
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.settings import ReconstructSettings


def read_given_volume(file: VolumeFile, grid: Volume) -> Volume:
    """The reference volume made by other software."""
    with _named("reference.volume"):
        array = file.read_values()
    try:
        return Volume(array, grid.voxel_size, grid.center)
    except InputError as error:
        raise InputError(f"{file.spec} (reference.volume)", error.fact, error.remedy) from error


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Errors in reading a file name the key, too."""
    try:
        yield
    except InputError as error:
        where = error.where if f"({key})" in error.where else f"{error.where} ({key})"
        raise InputError(where, error.fact, error.remedy) from error


def seen_given_volume(inputs: Inputs) -> Volume:
    """The same, with what of it its radiographs saw if they are given as well."""
    assert inputs.volume is not None
    volume, source = read_given_volume(inputs.volume, inputs.grid), inputs.volume_scan
    if source is None:
        return volume
    some = source.select(growth_views(len(source.geometry))).read()[0]
    kept = ReconstructSettings(outline="grid")
    return replace(volume, field=fitted_grid(some, source.geometry, inputs.grid, kept).field)


@dataclass(frozen=True, eq=False)
class GivenLabels:
    """Labels made by other software, and the negative number that stood for no grain, if there was one."""

    array: NDArray[np.int32]
    background: int = 0


def read_given_labels(file: VolumeFile) -> GivenLabels:
    """The labels made by other software, of any type of whole numbers."""
    where = f"{file.spec} (reference.labels)"
    with _named("reference.labels"):
        return GivenLabels(*label_array(file, where))


def given_volume_findings(inputs: Inputs, volume: Volume, later: Scan | None) -> tuple[Finding, ...]:
    """The given volume held against its own radiographs, or against those of a ``later`` state."""
    assert inputs.volume is not None
    where = f"{inputs.volume.spec} (reference.volume)"
    if inputs.volume_scan is not None:
        seen = check_volume(volume, None, _some_views(inputs.volume_scan), same_state=True, where=where)
    else:
        seen = () if later is None else check_volume(volume, None, later, same_state=False, where=where)
    return *voxel_findings(inputs.volume, inputs.grid, where), *seen


def given_label_findings(inputs: Inputs, volume: Volume, given: GivenLabels) -> tuple[Finding, ...]:
    """The given labels held against their volume."""
    assert inputs.labels is not None
    where = f"{inputs.labels.spec} (reference.labels)"
    found = label_size_findings(inputs.labels, inputs.grid, where)
    if given.background < 0:
        fact = f"voxels of {given.background} are taken for no grain"
        found = (*found, Finding(Level.NOTE, LABELS_CHECK, where, fact))
    return *found, *check_labels(volume, given.array, where)


def _some_views(source: ScanInput) -> Scan:
    """A full scan at a few of its views."""
    views = np.arange(MAX_VIEWS_COMPARED) * len(source.geometry) // MAX_VIEWS_COMPARED
    return source.select(np.unique(views)).read()[0]
