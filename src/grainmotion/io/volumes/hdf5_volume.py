"""A dataset of an HDF5 file as a volume, with the voxel size in the attributes that programs write.

``element_size_um`` (z, y, x; Fiji's HDF5 plugin, ilastik), ``voxel_size``, ``spacing`` or ``pixel_size`` with a unit in
``..._unit`` or ``..._units``, datasets of these names beside it with an attribute ``units``, or the axes of
NeXus' NXdata; this package's own files tell mm.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.hdf5 import dataset_in, dataset_shapes, opened
from grainmotion.io.hdf5_sources import check_written
from grainmotion.io.volumes.record import Sliceable, VolumeFile, sliced, volume_axes
from grainmotion.io.volumes.units import ToldVoxel, told_voxel

MAX_NAMES_LISTED = 6
_SIZE_NAMES = ("voxel_size", "voxelsize", "VoxelSize", "spacing", "pixel_size", "pixelsize")
_OWN_UNIT = "1/mm"
Told = tuple[ToldVoxel | None, tuple[str, ...]]


def hdf5_volume(path: Path, spec: str, inner: str) -> VolumeFile:
    """The dataset ``inner`` of an HDF5 file, or its only volume."""
    with opened(path) as file:
        inner = inner or _only_volume(file, path)
        data = dataset_in(file, path, inner)
        where = f"{path}::{inner}"
        order = volume_axes(data.shape, _axis_names(data), where)
        check_written(data)
        voxel, notes = _told(data)
        shape = (data.shape[order[0]], data.shape[order[1]], data.shape[order[2]])
        center = _own_center(data)
        dtype, ndim = data.dtype, data.ndim
        depth = data.chunks[order[0]] if data.chunks else 1

    @contextmanager
    def dataset() -> Iterator[Sliceable]:
        with opened(path) as file:
            yield dataset_in(file, path, inner)

    return VolumeFile(spec, (path,), shape, dtype, sliced(dataset, order, ndim), voxel, center, notes, (inner,), depth)


def _only_volume(file: h5py.File, path: Path) -> str:
    """The path of the only dataset that is a volume; ``volume`` in a reference.h5."""
    own = [name for name in ("volume", "labels") if isinstance(file.get(name), h5py.Dataset)]
    if own and _is_own(file[own[0]].attrs):  # also one slice
        return f"/{own[0]}"
    shapes = {name: shape for name, shape in dataset_shapes(file).items() if sum(n > 1 for n in shape) >= 3}
    if len(shapes) == 1:
        return next(iter(shapes))
    names = ", ".join(f"{name} {shape}" for name, shape in list(shapes.items())[:MAX_NAMES_LISTED])
    fact = f"it holds {len(shapes)} volumes: {names}" if shapes else "it holds no volume"
    example = next(iter(shapes), "/path/to/data")
    raise InputError(str(path), fact, f'name one dataset in it, as "{path.name}::{example}"')


def _axis_names(data: h5py.Dataset) -> list[str]:
    """Names of the axes by ilastik's ``axistags`` or h5py's dimension labels; none if they are not told."""
    tags = data.attrs.get("axistags")
    if tags is not None:
        try:
            names = [str(axis["key"]) for axis in json.loads(_text(tags))["axes"]]
        except (ValueError, KeyError, TypeError):
            names = []
        if len(names) == data.ndim:
            return names
    labels = [dimension.label for dimension in data.dims]
    return labels if {"z", "y", "x"} <= {label.lower() for label in labels} else []


def _told(data: h5py.Dataset) -> Told:
    """The voxel by attributes of the dataset, then of the groups around it, then by what lies beside it."""
    notes: tuple[str, ...] = ()
    holders: list[h5py.Dataset | h5py.Group] = [data]
    while holders[-1].name != "/":
        holders.append(holders[-1].parent)
    own = [beside for beside in (data.parent.get("volume"),) if isinstance(beside, h5py.Dataset)]
    for holder in (*holders, *own):
        voxel, why = _by_attributes(holder.attrs)
        if voxel is not None:
            return voxel, ()
        notes += why
    for name in _SIZE_NAMES:
        beside = data.parent.get(name)
        if isinstance(beside, h5py.Dataset) and beside.dtype.kind in "iuf":
            voxel, why = told_voxel(_three(beside[()]), _text(beside.attrs.get("units", "")), beside.name)
            if voxel is not None:
                return voxel, ()
            notes += why
    return _by_axes(data) or (None, notes)


def _by_attributes(attributes: Mapping[str, object]) -> Told:
    if _text(attributes.get("unit", "")) == _OWN_UNIT and "center" in attributes and "voxel_size" in attributes:
        return told_voxel(_three(attributes["voxel_size"]), "mm", "voxel_size")
    if "element_size_um" in attributes:
        return told_voxel(_three(attributes["element_size_um"]), "um", "element_size_um", one_is_default=True)
    for name in _SIZE_NAMES:
        if name in attributes:
            units = [attributes[key] for key in (f"{name}_unit", f"{name}_units") if key in attributes]
            unit = _text(units[0]) if units else None
            return told_voxel(_three(attributes[name]), unit, name, one_is_default=True)
    return None, ()


def _by_axes(data: h5py.Dataset) -> Told | None:
    """The steps of the axes that NXdata names."""
    names = [_text(name) for name in np.ravel(data.parent.attrs.get("axes", []))]
    axes = [data.parent.get(name) for name in names]
    if len(axes) != 3 or not all(isinstance(axis, h5py.Dataset) and axis.ndim == 1 and len(axis) > 1 for axis in axes):
        return None
    units = {_text(axis.attrs.get("units", "")) for axis in axes}
    if len(units) != 1:
        return None
    steps = [float(abs(axis[-1] - axis[0]) / (len(axis) - 1)) for axis in reversed(axes)]
    return told_voxel(steps, units.pop(), "NXdata axes")


def _own_center(data: h5py.Dataset) -> tuple[float, float, float] | None:
    """The centre of the array, in files of this package."""
    for holder in (data, data.parent.get("volume")):
        if isinstance(holder, h5py.Dataset) and "center" in holder.attrs and _is_own(holder.attrs):
            x, y, z = (float(c) for c in holder.attrs["center"])
            return x, y, z
    return None


def _is_own(attributes: Mapping[str, object]) -> bool:
    """Whether attributes are those of this package: of a volume, or of labels alone."""
    return _text(attributes.get("unit", "")) == _OWN_UNIT or "center_unit" in attributes


def _three(value: object) -> list[float]:
    """Sizes x, y, z of one number or of three along z, y, x."""
    numbers = np.ravel(np.asarray(value))
    if numbers.dtype.kind not in "iuf" or len(numbers) not in (1, 3):
        return []
    return [float(n) for n in (numbers[::-1] if len(numbers) == 3 else np.repeat(numbers, 3))]


def _text(value: object) -> str:
    """An attribute as text: a string, bytes, or an array of one of them."""
    first = np.ravel(np.asarray(value, dtype=object))[:1]
    item = first[0] if len(first) else ""
    return item.decode(errors="replace") if isinstance(item, bytes) else str(item)
