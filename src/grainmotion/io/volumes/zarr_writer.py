"""OME-Zarr: a volume and labels in chunks, with a pyramid of coarser levels, written block by block.

Version 0.4 on Zarr 2, which Fiji, napari, neuroglancer and webKnossos of some years read as well as those of today.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_folder
from grainmotion.io.volumes.tiff_writer import short_labels
from grainmotion.io.volumes.zarr_metadata import OWN_KEY
from grainmotion.io.volumes.zarr_reader import ZARR_FILES, import_zarr
from grainmotion.model.progress import counted
from grainmotion.model.volume import Volume

if TYPE_CHECKING:
    import zarr

CHUNK = 64
"""Voxels along each edge of a chunk: 1 MB of single precision."""
MAX_COARSEST_VOXELS = 128
"""Voxels along the longest axis of the coarsest level: a view of it is loaded at once."""
LABELS_GROUP = "labels/grains"
_VERSION = "0.4"
Reduce = Callable[[Pixels], Pixels]
Json = str | int | float | Mapping[str, "Json"] | Sequence["Json"] | None


def write_ome_zarr(
    path: str | Path, volume: Volume | None, labels: Pixels | None = None, *, grid: Volume | None = None
) -> None:
    """Write a volume, its labels below ``labels/grains``, or labels of a ``grid`` alone, as one OME-Zarr folder."""
    path = Path(path)
    import_zarr(str(path))
    import zarr

    if path.exists() and not any((path / name).is_file() for name in ZARR_FILES):
        raise InputError(str(path), "something else has this name", "choose another name for the OME-Zarr folder")
    place = volume if volume is not None else grid
    assert place is not None
    with atomic_folder(path) as folder:
        root = zarr.create_group(store=str(folder), zarr_format=2)
        if volume is not None:
            _write_levels(root, volume.array, place, _mean, "attenuation, 1/mm")
        if labels is not None:
            held = root if volume is None else root.create_group("labels").create_group("grains")
            if volume is not None:
                root["labels"].attrs["labels"] = ["grains"]
                held.attrs["image-label"] = {"version": _VERSION, "source": {"image": "../../"}}
            _write_levels(held, short_labels(labels), place, _first, "grain, 0 for none")


def _write_levels(group: zarr.Group, array: Pixels, place: Volume, reduce: Reduce, quantity: str) -> None:
    """All levels of an image, each from the one before, and what they are."""
    level = 0
    source: Pixels | zarr.Array = array
    while True:
        source = _write_level(group, str(level), source, None if level == 0 else reduce)
        if max(source.shape) <= MAX_COARSEST_VOXELS or min(source.shape) < 2:
            break
        level += 1
    origin = [float(x) for x in place.origin[::-1]]
    datasets: list[Json] = []
    for k in range(level + 1):
        edge = place.voxel_size * 2**k
        shift = (edge - place.voxel_size) / 2  # from the centre of a fine voxel to that of a coarse one
        transforms: list[Json] = [
            {"type": "scale", "scale": [edge] * 3},
            {"type": "translation", "translation": [x + shift for x in origin]},
        ]
        datasets.append({"path": str(k), "coordinateTransformations": transforms})
    axes: list[Json] = [{"name": axis, "type": "space", "unit": "millimeter"} for axis in "zyx"]
    group.attrs["multiscales"] = [{"version": _VERSION, "name": quantity, "axes": axes, "datasets": datasets}]
    group.attrs[OWN_KEY] = {
        "version": version("grainmotion"),
        "quantity": quantity,
        "axes": "z y x, z up along the rotation axis",
        "voxel_size": place.voxel_size,
        "center": list(place.center),
        "units": "mm, center x y z of the whole array",
    }


def _write_level(group: zarr.Group, name: str, source: Pixels | zarr.Array, reduce: Reduce | None) -> zarr.Array:
    """One level, block by block of whole chunks; ``reduce`` halves a block of the level before."""
    from numcodecs import Blosc

    factor = 1 if reduce is None else 2
    shape = tuple(n // factor for n in source.shape)
    level = group.create_array(
        name, shape=shape, chunks=tuple(min(CHUNK, n) for n in shape), dtype=source.dtype,
        compressors=Blosc(cname="lz4", clevel=5, shuffle=Blosc.SHUFFLE),
        chunk_key_encoding={"name": "v2", "separator": "/"},
    )  # fmt: skip
    for z, y in counted(list(_blocks(shape))):
        fine = tuple(slice(s.start * factor, s.stop * factor) for s in (z, y, slice(0, shape[2])))
        block = np.asarray(source[fine])
        level[z, y, :] = block if reduce is None else reduce(block)
    return level


def _blocks(shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """Blocks of a chunk along z and y, and all of x."""
    for z in range(0, shape[0], CHUNK):
        for y in range(0, shape[1], CHUNK):
            yield slice(z, min(z + CHUNK, shape[0])), slice(y, min(y + CHUNK, shape[1]))


def _mean(block: Pixels) -> Pixels:
    """Means of 2 x 2 x 2 voxels; summed one by one, which needs no copy of the block."""
    nz, ny, nx = (n // 2 * 2 for n in block.shape)
    total = np.zeros((nz // 2, ny // 2, nx // 2))
    for z, y, x in np.ndindex(2, 2, 2):
        total += block[z:nz:2, y:ny:2, x:nx:2]
    return (total / 8).astype(block.dtype)


def _first(block: Pixels) -> Pixels:
    """One of 2 x 2 x 2 voxels: labels have no means."""
    return block[::2, ::2, ::2]
