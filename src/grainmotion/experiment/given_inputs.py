"""What other software made: a reference volume and its labels, and their comparison with the radiographs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.coarse_projection import MAX_VIEWS_COMPARED
from grainmotion.diagnosis.given_volume import check_volume
from grainmotion.diagnosis.labels import check_labels
from grainmotion.errors import InputError
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.stacks import Stack
from grainmotion.model.finding import Finding
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.settings import ReconstructSettings


def read_given_volume(stack: Stack, grid: Volume) -> Volume:
    """The reference volume made by other software."""
    try:
        return Volume(stack.read().astype(np.float32), grid.voxel_size, grid.center)
    except InputError as error:
        raise InputError(f"{stack.spec} (reference.volume)", error.fact, error.remedy) from error


def seen_given_volume(inputs: Inputs) -> Volume:
    """The same, with what of it its radiographs saw if they are given as well."""
    assert inputs.volume is not None
    volume, source = read_given_volume(inputs.volume, inputs.grid), inputs.volume_scan
    if source is None:
        return volume
    some = source.select(growth_views(len(source.geometry))).read()[0]
    kept = ReconstructSettings(outline="grid")
    return replace(volume, field=fitted_grid(some, source.geometry, inputs.grid, kept).field)


def read_given_labels(stack: Stack) -> NDArray[np.int32]:
    """The labels made by other software."""
    where = f"{stack.spec} (reference.labels)"
    labels = stack.read()
    if not np.isfinite(labels).all() or (labels < 0).any() or (labels != np.round(labels)).any():
        raise InputError(where, "labels are not whole numbers >= 0", "give 0 for no grain, 1, 2, ... for grains")
    if labels.max(initial=0) > np.iinfo(np.int32).max:
        raise InputError(where, f"a label of {labels.max()}", "number the grains from 1")
    if not labels.any():
        raise InputError(where, "no grains found: all labels are 0", "give 1, 2, ... where grains are")
    return labels.astype(np.int32)


def given_volume_findings(inputs: Inputs, volume: Volume, later: Scan | None) -> tuple[Finding, ...]:
    """The given volume held against its own radiographs, or against those of a ``later`` state."""
    assert inputs.volume is not None
    where = f"{inputs.volume.spec} (reference.volume)"
    if inputs.volume_scan is not None:
        return check_volume(volume, None, _some_views(inputs.volume_scan), same_state=True, where=where)
    return () if later is None else check_volume(volume, None, later, same_state=False, where=where)


def given_label_findings(inputs: Inputs, volume: Volume, labels: NDArray[np.int32]) -> tuple[Finding, ...]:
    """The given labels held against their volume."""
    assert inputs.labels is not None
    return tuple(check_labels(volume, labels, f"{inputs.labels.spec} (reference.labels)"))


def _some_views(source: ScanInput) -> Scan:
    """A full scan at a few of its views."""
    views = np.arange(MAX_VIEWS_COMPARED) * len(source.geometry) // MAX_VIEWS_COMPARED
    return source.select(np.unique(views)).read()[0]
