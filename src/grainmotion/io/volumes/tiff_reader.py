"""TIFF stacks and series as volumes, read slab by slab; `tiff_sizes` tells their voxel size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import tifffile

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.tiff import only_series, opened_tiff, read_tiff, tiff_info
from grainmotion.io.volumes.record import Bounds, Slabs, VolumeFile
from grainmotion.io.volumes.tiff_sizes import ome_pixels, told_center, told_size

_STACK_AXES = ("Z", "I", "Q")  # z, and axes without a name


def tiff_volume(paths: Sequence[Path], spec: str) -> VolumeFile:
    """A volume in one or more TIFF files, in the order given."""
    counts, shapes, dtypes = [], list[tuple[int, int]](), []
    for path in paths:
        (pages, rows, columns), dtype = tiff_info(path, numbers=True)
        counts.append(pages)
        shapes.append((rows, columns))
        dtypes.append(dtype)
    for path, pixels in zip(paths, shapes):
        if pixels != shapes[0]:
            fact = f"{pixels} pixels, but {paths[0].name} has {shapes[0]}"
            raise InputError(str(path), fact, "give slices of one volume; leave previews out")
    with opened_tiff(paths[0]) as file:
        series, page = only_series(paths[0], file, numbers=True), file.pages.first
        text = page.description or ""
        notes = _check_axes(paths[0], series, text, sum(counts))
        shape = (sum(counts), *shapes[0])
        (voxel, told), center = told_size(file, text), told_center(text, file.imagej_metadata or {}, shape)
        colour_map = page.photometric == tifffile.PHOTOMETRIC.PALETTE
    dtype = np.result_type(*set(dtypes))
    slabs = _slabs(list(paths), counts)
    return VolumeFile(
        spec, tuple(paths), shape, dtype, slabs, voxel, center, (*notes, *told), (None,) * len(paths),
        colour_map=colour_map,
    )  # fmt: skip


def _check_axes(path: Path, series: tifffile.TiffPageSeries, text: str, planes: int) -> tuple[str, ...]:
    """Refuse channels and times beside slices; tell a stack that calls its slices by another name."""
    long = [(axis, n) for axis, n in zip(series.axes, series.shape) if n > 1 and axis not in "YXS"]
    ome = ome_pixels(text)
    if ome is not None:
        size = {axis: int(ome.get(f"Size{axis}", "1")) for axis in "ZCT"}
        long = [(axis, size[axis]) for axis in "TCZ" if size[axis] > 1]
        if size["Z"] * size["C"] * size["T"] > planes:
            fact = f"its OME metadata tells {size['Z']} slices, but {planes} are here"
            raise InputError(str(path), fact, "name all files of the volume")
    if len(long) > 1:
        many = " x ".join(f"{n} {axis}" for axis, n in long)
        raise InputError(str(path), f"it holds several volumes: {many}", "export one channel and one time")
    if long and long[0][0] == "C" and long[0][1] <= 4:
        raise InputError(str(path), f"{long[0][1]} channels of one slice", "export one channel, as a stack of slices")
    if long and long[0][0] not in _STACK_AXES:
        name = {"T": "times", "C": "channels"}.get(long[0][0], f"'{long[0][0]}'")
        return (f"its {long[0][1]} images are called {name}; they are taken for slices along z",)
    return ()


def _slabs(paths: list[Path], counts: list[int]) -> Slabs:
    ends = np.cumsum(counts)

    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        with ExitStack() as stack:
            current, planes = -1, _Planes.none()
            for first, last in bounds:
                parts = []
                for k in range(int(np.searchsorted(ends, first, side="right")), len(paths)):
                    start = int(ends[k]) - counts[k]
                    if start >= last:
                        break
                    if k != current:
                        stack.close()
                        current, planes = k, _Planes.of(paths[k], stack)
                    parts.append(planes.read(max(first - start, 0), min(last - start, counts[k])))
                yield parts[0] if len(parts) == 1 else np.concatenate(parts)

    return slabs


class _Planes:
    """The planes of one file: mapped where they lie in one piece, else read page by page."""

    def __init__(self, path: Path, file: tifffile.TiffFile | None, whole: Pixels | None) -> None:
        self._path, self._file, self._whole = path, file, whole

    @classmethod
    def none(cls) -> _Planes:
        """No file."""
        return cls(Path(), None, np.empty((0, 0, 0)))

    @classmethod
    def of(cls, path: Path, stack: ExitStack) -> _Planes:
        """Open a file until the stack is closed."""
        file = stack.enter_context(opened_tiff(path))
        series, shape = only_series(path, file, numbers=True), tiff_info(path, numbers=True)[0]
        colours = series.axes.endswith("S")
        if series.dataoffset is not None and not colours:
            dtype = series.dtype.newbyteorder(file.byteorder)
            try:
                return cls(path, None, np.memmap(path, dtype, "r", series.dataoffset, shape))
            except ValueError as error:
                raise InputError(str(path), f"truncated TIFF ({error})", "copy or export the file again") from error
        if colours or len(series.pages) != shape[0]:
            return cls(path, None, read_tiff(path, numbers=True))
        return cls(path, file, None)

    def read(self, first: int, last: int) -> Pixels:
        """Planes from ``first`` up to, not including, ``last``."""
        if self._file is None:
            assert self._whole is not None
            return np.asarray(self._whole[first:last])
        try:
            planes = self._file.asarray(key=range(first, last), series=0)
        except Exception as error:
            fact = f"truncated or damaged TIFF ({error})"
            raise InputError(str(self._path), fact, "copy or export the file again") from error
        return np.asarray(planes).reshape(last - first, *planes.shape[-2:])
