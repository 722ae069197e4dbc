"""What a volume or labels in a file are, for `grainmotion inspect`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.formats import TIFF, family
from grainmotion.io.volumes.find import find_volume
from grainmotion.io.volumes.record import VolumeFile

FEW_VALUES = 1000
"""Different whole numbers in a slice up to which they are counted as labels may be."""


def describe_volume(path: Path) -> tuple[tuple[str, str], ...]:
    """Label and text of each line about a volume.

    Raises
    ------
    InputError
        If the file is damaged, or holds no single volume.
    """
    volume = find_volume(path.name, path.parent)
    nz, ny, nx = volume.shape
    as_volume = "" if volume.colour_map else f'volume = "{path.name}" or '
    megabytes = nz * ny * nx * volume.dtype.itemsize / 1e6
    return (
        ("Volume", f"{nz} x {ny} x {nx} voxels (z, y, x) {volume.dtype}, {megabytes:.4g} MB"),
        ("Voxel size", _size(volume)),
        *(("Note", note) for note in volume.notes),
        ("Values", _values(volume)),
        ("Use", f'{as_volume}labels = "{path.name}" in [reference]'),
    )


def voxel_lines(path: Path) -> tuple[tuple[str, str], ...]:
    """The voxel size that a TIFF file tells; nothing if it is none or tells none."""
    try:
        volume = find_volume(path.name, path.parent) if family(path) == TIFF else None
    except InputError:  # images of several times or channels
        return ()
    return () if volume is None or volume.voxel is None else (("Voxel size", _size(volume)),)


def _size(volume: VolumeFile) -> str:
    if volume.voxel is None:
        return "not told: give volume.voxel_size, mm"
    cubes = "" if volume.voxel.size is not None else ", no cubes: it must be resampled"
    return f"{volume.voxel.text} by its {volume.voxel.key}{cubes}"


def _values(volume: VolumeFile) -> str:
    """The range of the middle slice, and how many whole numbers it holds."""
    middle = volume.read_slab(volume.shape[0] // 2, volume.shape[0] // 2 + 1)
    numbers = np.unique(middle)
    text = f"{numbers[0]:g} to {numbers[-1]:g} in the middle slice"
    whole = middle.dtype.kind in "iub" or bool((numbers == np.round(numbers)).all())
    return f"{text}, {len(numbers)} different" if whole and len(numbers) <= FEW_VALUES else text
