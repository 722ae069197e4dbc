"""Large datasets of HDF5 files, read and written some planes at a time: with progress, and Ctrl-C gets in between."""

from __future__ import annotations

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted

PLANES_BYTES = 1 << 26
"""Bytes of the planes that are read or written at once: a fraction of a second where they are compressed."""
CHUNK_SHAPE = (16, 128, 128)
"""Voxels of a compressed chunk, at most: thin along z, so that a slab holds whole ones."""


def read_whole(data: h5py.Dataset) -> NDArray:
    """All values of a dataset, in its own number type."""
    if data.ndim == 0 or data.size == 0:
        return np.asarray(data[()])
    out = large_empty(data.shape, data.dtype)
    for planes in _slabs(data):
        out[planes] = data[planes]
    return out


def write_whole(group: h5py.Group, name: str, array: NDArray, *, compressed: bool = False) -> h5py.Dataset:
    """Write a volume or labels as a dataset, which is returned; ``compressed`` by gzip, as suits labels."""
    if not compressed:
        data = group.create_dataset(name, array.shape, array.dtype)
    else:
        chunks = tuple(min(most, max(n, 1)) for most, n in zip(CHUNK_SHAPE, array.shape, strict=True))
        data = group.create_dataset(
            name, array.shape, array.dtype, chunks=chunks, compression="gzip", compression_opts=1, shuffle=True
        )
    for planes in _slabs(data):
        data[planes] = array[planes]
    return data


def _slabs(data: h5py.Dataset) -> Iterator[slice]:
    """Planes along the first axis, in whole chunks."""
    depth = data.chunks[0] if data.chunks else 1
    plane = max(1, data.dtype.itemsize * int(np.prod(data.shape[1:], dtype=np.int64)))
    step = depth * max(1, PLANES_BYTES // (plane * depth))
    return counted([slice(first, first + step) for first in range(0, data.shape[0], step)])
