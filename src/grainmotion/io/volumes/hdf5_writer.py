"""HDF5 with ``volume`` and ``labels``, as in a reference.h5, and the voxel size as Fiji and ilastik read it."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import h5py

from grainmotion._typing import Pixels
from grainmotion.io.files import atomic_write
from grainmotion.io.hdf5_slabs import write_whole
from grainmotion.io.volumes.tiff_writer import short_labels
from grainmotion.model.volume import Volume


def write_volume_hdf5(
    path: str | Path, volume: Volume | None, labels: Pixels | None = None, *, grid: Volume | None = None
) -> None:
    """Write a volume, its labels, or labels of a ``grid`` alone."""
    place = volume if volume is not None else grid
    assert place is not None
    told = {
        "voxel_size": place.voxel_size,
        "voxel_size_unit": "mm",
        "center": place.center,
        "center_unit": "mm, x y z of the whole array",
        "element_size_um": [1000 * place.voxel_size] * 3,
        "axes": "z y x, z up along the rotation axis",
    }
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["grainmotion"] = version("grainmotion")
        if volume is not None:
            write_whole(file, "volume", volume.array).attrs.update({**told, "unit": "1/mm"})
        if labels is not None:
            data = write_whole(file, "labels", short_labels(labels), compressed=True)
            data.attrs.update({**told, "unit": "1", "meaning": "grain, 0 for none"})
