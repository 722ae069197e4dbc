"""The grid of a volume made by other software: by the experiment file, else by what the volume's file tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from grainmotion.diagnosis.file_series import series_findings
from grainmotion.diagnosis.given_volume import VOLUME_CHECK
from grainmotion.diagnosis.labels import LABELS_CHECK
from grainmotion.diagnosis.voxel_sizes import size_conflict
from grainmotion.errors import InputError
from grainmotion.experiment.config import VolumeTable
from grainmotion.io.formats import family
from grainmotion.io.volumes.find import find_volume
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.model.finding import Finding, Level
from grainmotion.model.volume import Volume


def named_volume(key: str, files: list[str] | None, folder: Path) -> VolumeFile | None:
    """The volume or labels behind a key; errors name the file and the key."""
    if files is None:
        return None
    try:
        return find_volume(files, folder)
    except InputError as error:
        raise InputError(f"{error.where} ({key})", error.fact, error.remedy) from error


def given_grid(table: VolumeTable, volume: VolumeFile) -> Volume:
    """Zeros on the grid of a given volume; the experiment file's voxel size and centre come before the file's own."""
    if table.shape is not None and tuple(table.shape) != volume.shape:
        fact = f"{list(table.shape)}, but {volume.spec} (reference.volume) has {list(volume.shape)}"
        raise InputError("volume.shape", fact, "leave it out, or correct one of them")
    told_center = volume.center is not None and "center" not in table.model_fields_set
    center = volume.center if told_center and volume.center is not None else table.center
    return Volume.zeros(volume.shape, _voxel_size(table, volume), center)


def _voxel_size(table: VolumeTable, volume: VolumeFile) -> float:
    if table.voxel_size is not None:
        return table.voxel_size
    if volume.voxel is None:
        why = f", and {volume.spec} tells none" + "".join(f" ({note})" for note in volume.notes if "voxel" in note)
        raise InputError("volume.voxel_size", f"it is missing{why}", "give the voxel size of the volume, mm")
    if volume.voxel.size is None:
        fact = f"its {volume.voxel.key} tells voxels of {volume.voxel.text}: grains that rotate need cubes"
        remedy = "resample it to cubes (Fiji: Image > Scale), or give volume.voxel_size if the file is wrong"
        raise InputError(f"{volume.spec} (reference.volume)", fact, remedy)
    return volume.voxel.size


def other_size(volume: VolumeFile, grid: Volume) -> str:
    """What to add to an error about lengths if the volume's file tells another voxel size; else empty."""
    conflict = "" if volume.voxel is None else size_conflict(volume.voxel.edges, grid.voxel_size)
    return f"; {volume.spec} tells voxels of {volume.voxel.text}{conflict}" if volume.voxel and conflict else ""


def voxel_findings(volume: VolumeFile, grid: Volume, where: str) -> tuple[Finding, ...]:
    """What was noticed in the volume's file, and a voxel size in it that contradicts the experiment file."""
    found = [Finding(Level.NOTE, VOLUME_CHECK, where, note) for note in volume.notes] + _slices(volume, where)
    told, conflict = _voxels_told(volume, grid)
    if conflict:
        fact = f"{told}, but volume.voxel_size is {grid.voxel_size:.6g} mm{conflict}"
        remedy = "the experiment file counts; correct the wrong one, or leave volume.voxel_size out"
        found.append(Finding(Level.WARNING, VOLUME_CHECK, where, fact, remedy=remedy))
    elif volume.voxel is not None and volume.voxel.size is not None:
        found.append(Finding(Level.NOTE, VOLUME_CHECK, where, told))
    return tuple(found)


def label_size_findings(labels: VolumeFile, grid: Volume, where: str) -> tuple[Finding, ...]:
    """What was noticed in the labels' file, and a voxel size in it that is not the volume's."""
    found = [Finding(Level.NOTE, LABELS_CHECK, where, note) for note in labels.notes if "voxel" not in note]
    found += _slices(labels, where)
    told, conflict = _voxels_told(labels, grid)
    if conflict:
        fact = f"{told}, but the volume's are {grid.voxel_size:.6g} mm{conflict}"
        remedy = "check that the labels are of this volume, at this resolution"
        found.append(Finding(Level.WARNING, LABELS_CHECK, where, fact, remedy=remedy))
    return tuple(found)


def _voxels_told(file: VolumeFile, grid: Volume) -> tuple[str, str]:
    """The voxels that a file tells, and how they differ from the grid's; both are empty if it tells none."""
    if file.voxel is None:
        return "", ""
    return f"voxels of {file.voxel.text} by its {file.voxel.key}", size_conflict(file.voxel.edges, grid.voxel_size)


def _slices(file: VolumeFile, where: str) -> list[Finding]:
    """Gaps and strangers in a series of files, one slice each."""
    if len(file.files) < 2 or len(file.files) != file.shape[0] or family(file.files[0]) is None:
        return []
    remedy = "copy what is missing, or name the slices alone: those above a gap lie too low otherwise"
    found = series_findings(where, [path.name for path in file.files], None)
    return [replace(finding, remedy=remedy) if "gap" in finding.fact else finding for finding in found]
