"""TIFF with voxel size: as ImageJ writes it where its format allows, else as OME-TIFF."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import numpy as np
import tifffile

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write
from grainmotion.io.tiff import pages

MAX_IMAGEJ_BYTES = 4_000_000_000
"""Bytes of pixels up to which ImageJ's format serves: offsets in it have 32 bits."""
MAX_SHORT_LABEL = 65_535
"""Largest label that 16 bits hold; ImageJ has no whole numbers of 32 bits."""
_IMAGEJ_TYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))


def write_volume_tiff(
    path: str | Path,
    array: Pixels,
    voxel_size: float,
    *,
    center: tuple[float, float, float] | None = None,
    ome: bool = False,
) -> None:
    """Write a volume or labels ``[z, y, x]`` with the edge of a voxel, mm, and the centre x y z of the array, mm.

    Fiji, Dragonfly and Avizo read the voxel size from it.  Labels are written with 16 bits where these hold them, and
    compressed.  What ImageJ's own format cannot hold (whole numbers of 32 bits, double precision, more than 4 GB), or
    ``ome``, is written as OME-TIFF, which Fiji opens by Bio-Formats.
    """
    array = short_labels(array) if array.dtype.kind in "iub" else array
    array = array.astype(np.float32) if array.dtype == np.float16 else array
    if array.ndim != 3:
        raise InputError(str(path), f"an array of shape {array.shape} is no volume", "give (z, y, x)")
    small = array.nbytes < MAX_IMAGEJ_BYTES and array.dtype in _IMAGEJ_TYPES
    compression = "zlib" if array.dtype.kind in "iu" else None
    text = description(array.shape, voxel_size, center)
    with atomic_write(path) as temporary:
        if small and not ome:
            metadata = {"axes": "ZYX", "spacing": voxel_size, "unit": "mm", "Info": text}
            per_mm = (1 / voxel_size, 1 / voxel_size)
            tifffile.imwrite(
                temporary,
                pages(array),
                shape=array.shape,
                dtype=array.dtype,
                imagej=True,
                resolution=per_mm,
                metadata=metadata,
                compression=compression,
            )
        else:
            sizes = {f"PhysicalSize{axis}": voxel_size for axis in "XYZ"}
            units = {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
            metadata = {"axes": "ZYX", **sizes, **units, "Description": text}
            tifffile.imwrite(
                temporary,
                pages(array),
                shape=array.shape,
                dtype=array.dtype,
                ome=True,
                photometric="minisblack",
                metadata=metadata,
                compression=compression,
            )


def short_labels(labels: Pixels) -> Pixels:
    """The same labels with 16 bits if these hold them, else with 32; an `InputError` if these do not."""
    low, high = int(labels.min(initial=0)), int(labels.max(initial=0))
    bounds = np.iinfo(np.int32)
    if low < bounds.min or high > bounds.max:
        raise InputError(
            "labels", f"they run from {low} to {high}", "number the grains from 1 on: 32 bits hold them then"
        )
    return labels.astype(np.uint16 if low >= 0 and high <= MAX_SHORT_LABEL else np.int32, copy=False)


def description(shape: tuple[int, ...], voxel_size: float, center: tuple[float, float, float] | None) -> str:
    """What a volume's file says of itself: a line each, ``key = value``."""
    lines = [
        f"grainmotion = {version('grainmotion')}",
        "axes = z y x, z up along the rotation axis",
        f"shape = {' '.join(map(str, shape))}",
        f"voxel_size = {voxel_size!r} mm",
    ]
    if center is not None:
        lines.append(f"center = {' '.join(repr(float(c)) for c in center)} mm, x y z of the centre of the array")
    return "\n".join(lines)
