"""Volumes and labels in files, from Python: the format is that of the file's name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.io.volumes.find import find_volume
from grainmotion.io.volumes.hdf5_writer import write_volume_hdf5
from grainmotion.io.volumes.label_types import label_array
from grainmotion.io.volumes.tiff_writer import write_volume_tiff
from grainmotion.io.volumes.zarr_writer import write_ome_zarr
from grainmotion.model.volume import Volume

WRITTEN_FORMATS = "give a name that ends with .tif, .h5 or .zarr"
_TIFF_NAMES, _HDF5_NAMES = (".tif", ".tiff"), (".h5", ".hdf5")
_OME_TIFF_NAMES = (".ome.tif", ".ome.tiff")


@checked_arguments
def read_volume(
    path: str | Path | Sequence[str | Path],
    *,
    voxel_size: float | None = None,
    center: tuple[float, float, float] | None = None,
) -> Volume:
    """Read a volume from a file of this or another program.

    Parameters
    ----------
    path : path, glob, ``"file.h5::/path"``, ``"scan.zarr::1"``, ``"rec.raw::uint16,x=200,y=180,z=160"``, or a list
        TIFF stack or series, HDF5, OME-Zarr, NIfTI, NRRD, MetaImage, AmiraMesh, VGStudio's .vgi, .npy, or raw bytes.
    voxel_size : float, optional
        Edge of a voxel, mm; by default what the file tells.
    center : (float, float, float), optional
        Centre of the array in the sample frame, mm, x y z; by default what a file of this package tells, else the
        origin, on the rotation axis.

    Returns
    -------
    Volume
        Single precision, indexed ``[z, y, x]``; attenuation, 1/mm, if the file holds it: values are taken as they are.

    Raises
    ------
    InputError
        If the file is missing, damaged or holds no single volume, no voxel size is told, or its voxels are no cubes.

    Examples
    --------
    >>> gm.write_volume("volume.h5", volume)
    >>> gm.read_volume("volume.h5").voxel_size
    0.125
    """
    file = find_volume(path)
    if voxel_size is None:
        if file.voxel is None:
            why = "".join(f" ({note})" for note in file.notes if "voxel" in note)
            raise InputError(file.spec, f"it tells no voxel size{why}", "give voxel_size, mm")
        voxel_size = file.voxel.size
        if voxel_size is None:
            fact = f"voxels of {file.voxel.text} by its {file.voxel.key} are no cubes"
            raise InputError(file.spec, fact, "resample it to cubes, or give voxel_size, mm, if the file is wrong")
    place = center if center is not None else file.center or (0.0, 0.0, 0.0)
    try:
        return Volume(file.read_values(), voxel_size, place)
    except InputError as error:
        raise InputError(file.spec, error.fact, error.remedy) from error


@checked_arguments
def read_labels(path: str | Path | Sequence[str | Path]) -> NDArray[np.int32]:
    """Read labels of grains from a file of this or another program.

    Parameters
    ----------
    path : like that of `read_volume`
        Whole numbers of any type, with gaps; one negative number is taken for no grain.

    Returns
    -------
    (nz, ny, nx) int32 array
        0 for no grain; the numbers of the grains are those of the file.

    Raises
    ------
    InputError
        If the numbers are not whole, too large, below 0 in several ways, or all 0.

    Examples
    --------
    >>> gm.write_labels("labels.tif", labels, volume)
    >>> np.array_equal(gm.read_labels("labels.tif"), labels)
    True
    """
    file = find_volume(path)
    return label_array(file, file.spec)[0]


@checked_arguments
def write_volume(path: str | Path, volume: Volume, *, labels: NDArray[np.integer] | None = None) -> None:
    """Write a volume with its voxel size and place, and labels beside it.

    Parameters
    ----------
    path : path
        ``.tif`` as ImageJ reads it (OME-TIFF above 4 GB, and for ``.ome.tif``), with labels in a second file,
        ``NAME_labels.tif``; ``.h5`` with the datasets ``volume`` and ``labels``; ``.zarr`` for an OME-Zarr folder with
        coarser levels, labels in ``labels/grains``, which needs the extra ``[zarr]``.
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) integer array, optional
        Grains, 0 for none.

    Raises
    ------
    InputError
        If the name has another suffix, the labels another shape, or the file cannot be written.

    Examples
    --------
    >>> gm.write_volume("volume.tif", volume)
    """
    path = Path(path)
    labels = None if labels is None else _on_grid(labels, volume)
    name = path.name.lower()
    if name.endswith(_TIFF_NAMES):
        ome = name.endswith(_OME_TIFF_NAMES)
        write_volume_tiff(path, volume.array, volume.voxel_size, center=volume.center, ome=ome)
        if labels is not None:
            ending = "".join(path.suffixes[-2:]) if ome else path.suffix
            beside = path.with_name(f"{path.name.removesuffix(ending)}_labels{ending}")
            write_volume_tiff(beside, labels, volume.voxel_size, center=volume.center, ome=ome)
    elif name.endswith(_HDF5_NAMES):
        write_volume_hdf5(path, volume, labels)
    elif name.endswith(".zarr"):
        write_ome_zarr(path, volume, labels)
    else:
        raise InputError(str(path), f"the format '{path.suffix}' cannot be written", WRITTEN_FORMATS)


@checked_arguments
def write_labels(path: str | Path, labels: NDArray[np.integer], grid: Volume) -> None:
    """Write labels of grains with the voxel size and place of their volume.

    Parameters
    ----------
    path : path
        ``.tif``, ``.h5`` or ``.zarr``, as for `write_volume`.
    labels : (nz, ny, nx) integer array
        Grains, 0 for none; written with 16 bits if these hold them.
    grid : Volume
        The volume of the labels; its values do not matter.

    Raises
    ------
    InputError
        If the name has another suffix, the labels another shape, or the file cannot be written.

    Examples
    --------
    >>> gm.write_labels("labels.tif", labels, volume)
    """
    path = Path(path)
    labels = _on_grid(labels, grid)
    name = path.name.lower()
    if name.endswith(_TIFF_NAMES):
        ome = name.endswith(_OME_TIFF_NAMES)
        write_volume_tiff(path, labels, grid.voxel_size, center=grid.center, ome=ome)
    elif name.endswith(_HDF5_NAMES):
        write_volume_hdf5(path, None, labels, grid=grid)
    elif name.endswith(".zarr"):
        write_ome_zarr(path, None, labels, grid=grid)
    else:
        raise InputError(str(path), f"the format '{path.suffix}' cannot be written", WRITTEN_FORMATS)


def _on_grid(labels: NDArray[np.integer], grid: Volume) -> NDArray[np.integer]:
    """The labels, whose shape must be that of the grid."""
    labels = np.asarray(labels)
    if labels.shape != grid.shape:
        raise InputError("labels", f"shape {labels.shape} is not the volume's {grid.shape}", "give them on one grid")
    if labels.dtype.kind not in "iu":
        raise InputError("labels", f"they are {labels.dtype}", "give integers, 0 where there is no grain")
    return labels
