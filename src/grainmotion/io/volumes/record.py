"""A volume in a file: located, its header read; its voxels are read on demand, all or slab by slab."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.volumes.units import ToldVoxel

Bounds = tuple[int, int]
"""First plane of a slab, and the one past its last."""
Slabs = Callable[[Iterable[Bounds]], Iterator[Pixels]]
"""Reads slabs ``[z, y, x]`` in turn; the file is opened once."""
SLAB_BYTES = 64_000_000
"""Bytes of a slab as stored: small beside a volume, large beside a chunk."""


class Sliceable(Protocol):
    """A dataset in a file: indexed as an array."""

    def __getitem__(self, index: tuple[int | slice, ...], /) -> object: ...


@dataclass(frozen=True, eq=False)
class VolumeFile:
    """A volume or labels that are located, but not read yet.

    Attributes
    ----------
    spec : str
        As the user wrote it, for messages.
    files : tuple of Path
        The files that hold it.
    shape : (int, int, int)
        Voxels along z, y, x.
    dtype : dtype
        As stored.
    slabs : callable
        Reads slabs.
    voxel : ToldVoxel, optional
        The edges of a voxel, if the file tells them with their unit.
    center : (float, float, float), optional
        Centre of the array in the sample frame, x y z, mm; told only by files of this package.
    notes : tuple of str
        What is worth telling about the file.
    inner : tuple of (str or None)
        Path inside each file.
    depth : int
        Planes of a chunk, of which slabs hold whole numbers, so that none is decompressed twice.
    colour_map : bool
        Whether its voxels are numbers of a colour map, as labels may be.
    """

    spec: str
    files: tuple[Path, ...]
    shape: tuple[int, int, int]
    dtype: np.dtype
    slabs: Slabs
    voxel: ToldVoxel | None = None
    center: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    inner: tuple[str | None, ...] = (None,)
    depth: int = 1
    colour_map: bool = False

    def __post_init__(self) -> None:
        if min(self.shape) < 1:
            raise InputError(self.spec, f"its shape {self.shape} holds no voxel", "export it again")
        if self.dtype.kind not in "buif":
            raise InputError(
                self.spec, f"its voxels are {self.dtype}, no real numbers", "export one channel, as numbers"
            )

    @property
    def bounds(self) -> list[Bounds]:
        """Slabs of about `SLAB_BYTES` that make up the volume."""
        return slab_bounds(self.shape, self.dtype.itemsize, self.depth)

    def read(self, dtype: type[np.generic] | np.dtype | None = None) -> Pixels:
        """All voxels ``[z, y, x]``, as stored or as ``dtype``; of what is stored, only one slab is held beside them."""
        array = np.empty(self.shape, self.dtype.newbyteorder("=") if dtype is None else dtype)
        bounds = self.bounds
        for (first, last), slab in zip(bounds, self.slabs(bounds), strict=True):
            array[first:last] = slab
        return array

    def read_values(self) -> NDArray[np.float32]:
        """The same of a quantity, in single precision: numbers of a colour map are none."""
        if self.colour_map:
            raise InputError(self.spec, "its voxels are numbers of a colour map", "save it as a grey image")
        return self.read(np.float32).astype(np.float32, copy=False)

    def read_slab(self, first: int, last: int) -> Pixels:
        """Planes from ``first`` up to, not including, ``last``."""
        return next(self.slabs([(first, last)]))


def slab_bounds(shape: Sequence[int], itemsize: int, depth: int = 1) -> list[Bounds]:
    """Slabs of about `SLAB_BYTES` along z, of one or more times ``depth`` planes."""
    step = max(1, SLAB_BYTES // max(1, shape[1] * shape[2] * itemsize * depth)) * depth
    return [(z, min(z + step, shape[0])) for z in range(0, shape[0], step)]


def sliced(opened: Callable[[], AbstractContextManager[Sliceable]], order: tuple[int, int, int], ndim: int) -> Slabs:
    """Slabs of a dataset whose axes ``order`` are z, y, x; the others, of length 1, are dropped."""

    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        kept = sorted(order)
        with opened() as data:
            for first, last in bounds:
                index: list[int | slice] = [0] * ndim
                for axis in order:
                    index[axis] = slice(first, last) if axis == order[0] else slice(None)
                yield np.asarray(data[tuple(index)]).transpose([kept.index(axis) for axis in order])

    return slabs


def volume_axes(shape: Sequence[int], names: Sequence[str], where: str) -> tuple[int, int, int]:
    """Which axes are z, y, x: by their ``names`` if there are any, else the three that are longer than 1.

    Raises an `InputError` for several channels or times.
    """
    if names:
        lower = [name.lower() for name in names]
        missing = [name for name in "zyx" if lower.count(name) != 1]
        others = {n: size for n, size in zip(lower, shape) if n not in ("z", "y", "x") and size > 1}
        if missing:
            raise InputError(where, f"its axes are {', '.join(names)}, not z, y, x", "export one volume")
        if others:
            many = ", ".join(f"{size} along '{name}'" for name, size in others.items())
            raise InputError(where, f"it holds several volumes: {many}", "export one channel and one time")
        return lower.index("z"), lower.index("y"), lower.index("x")
    axes = list(range(len(shape)))
    while len(axes) > 3 and 1 in (shape[axis] for axis in axes):
        axes.remove(next(axis for axis in axes if shape[axis] == 1))
    if len(axes) != 3:
        raise InputError(where, f"an array of shape {tuple(shape)} is no volume", "give one of (z, y, x)")
    return axes[0], axes[1], axes[2]
