"""TIFF: single images and stacks; a truncated file is refused, a failed write leaves the old file."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import tifffile

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.colour import grey
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.progress import counted

_COPY = "copy or export the file again"
_OTHER_FILES = ("ome", "mmstack", "ndtiff")
"""Kinds of files that name others as parts of themselves: each is read as the images that it holds itself."""
_JPEG = (tifffile.COMPRESSION.JPEG, tifffile.COMPRESSION.OJPEG)
_COLOUR_MAP = tifffile.PHOTOMETRIC.PALETTE
_IMAGEJ_TAGS, _FIRST_PRIVATE_TAG = (50838, 50839), 32768
"""Tags of ImageJ's texts, and from which tag on programs write what others cannot check."""
_TYPE_BYTES: Mapping[int, int] = MappingProxyType(
    {3: 2, 4: 4, 5: 8, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 16: 8, 17: 8, 18: 8}
)
"""Bytes of a number of each type of a tag, if more than one."""
_SAMPLES = (2, 3, 4)  # values a pixel: grey and opacity, colours, colours and opacity


def tiff_info(path: str | Path, *, numbers: bool = False) -> tuple[tuple[int, int, int], np.dtype]:
    """Shape (pages, rows, columns) and type of a TIFF file, without reading its pixels; errors as in `read_tiff`."""
    with opened_tiff(path) as file:
        series = only_series(path, file, numbers=numbers)
        return _as_stack_shape(path, series), series.dtype


def read_tiff(path: str | Path, *, numbers: bool = False) -> Pixels:
    """Pixels ``(pages, rows, columns)`` of a grey TIFF image or stack, in the type of the file.

    A colour image is read if its colours are alike, one with a colour map if its ``numbers`` are wanted, as those of
    labels are.  Raises an `InputError` if the file is missing, empty, truncated, in colour, or compressed with loss or
    by an unknown codec.
    """
    with opened_tiff(path) as file:
        series = only_series(path, file, numbers=numbers)
        shape = _as_stack_shape(path, series)
        try:
            pixels = series.asarray()
        except Exception as error:
            if "imagecodecs" in str(error) or isinstance(error, KeyError):  # a codec that it does not have
                raise InputError(str(path), f"compressed: {error.args[0]}", "save it uncompressed") from error
            raise InputError(str(path), f"truncated or damaged TIFF ({error})", _COPY) from error
        return (grey(pixels, str(path)) if series.axes.endswith("S") else pixels).reshape(shape)


def write_tiff(path: str | Path, array: Pixels, about: Mapping[str, str] | None = None) -> None:
    """Write ``([pages,] rows, columns)`` pixels as a grey TIFF; integers, such as labels, are compressed.

    What the file says ``about`` itself goes into its description, which is JSON.
    """
    axes = {2: "YX", 3: "ZYX"}[array.ndim]
    compression = "zlib" if np.issubdtype(array.dtype, np.integer) else None
    with atomic_write(path) as temporary:
        tifffile.imwrite(
            temporary,
            pages(array),
            shape=array.shape,
            dtype=array.dtype,
            photometric="minisblack",
            metadata={"axes": axes, **(about or {})},
            compression=compression,
        )


def pages(array: Pixels) -> Iterator[Pixels]:
    """The pages of an image or stack as they are written, one by one."""
    return counted(array if array.ndim > 2 else array[None])


# ---------------------------------------------------------------------- checks
def opened_tiff(path: str | Path) -> tifffile.TiffFile:
    """An open TIFF file whose pages all lie in it; it is read as the images that it holds itself."""
    path = checked_file(path)
    _check_page_chain(path)
    try:
        file = tifffile.TiffFile(path)
    except Exception as error:
        raise InputError(str(path), f"not a readable TIFF file ({error})", _COPY) from error
    for kind in _OTHER_FILES:
        setattr(file, f"is_{kind}", False)
    return file


def only_series(path: str | Path, file: tifffile.TiffFile, *, numbers: bool = False) -> tifffile.TiffPageSeries:
    """The images of a TIFF file, which must be of one size and grey, or ``numbers`` of a colour map."""
    try:
        series = file.series
    except Exception as error:
        raise InputError(str(path), f"truncated or damaged TIFF ({error})", _COPY) from error
    series = [s for s in series if not s.keyframe.is_reduced] or series  # without smaller copies
    if len(series) != 1:
        shapes = sorted({str(s.shape) for s in series})
        raise InputError(str(path), f"it holds images of different kinds: {', '.join(shapes)}", "split it")
    page = series[0].keyframe
    if page.photometric == _COLOUR_MAP and not numbers:
        raise InputError(str(path), "its pixels are numbers of a colour map, no counts", "save it as a grey image")
    if page.compression in _JPEG and page.bitspersample <= 8:
        fact = "compressed by JPEG, with loss: counts are altered in blocks of 8 x 8 pixels"
        raise InputError(str(path), fact, "save it uncompressed, from the original")
    return series[0]


def _as_stack_shape(path: str | Path, series: tifffile.TiffPageSeries) -> tuple[int, int, int]:
    shape, axes = tuple(int(n) for n in series.shape), series.axes
    if axes.endswith("S"):  # leading samples are a stack: tifffile writes three images so by default
        if shape[-1] not in _SAMPLES:
            raise InputError(str(path), f"{shape[-1]} channels, axes {axes}", "save it as a grey image")
        shape = shape[:-1]
    elif any(n > 1 for axis, n in zip(axes, shape) if axis not in "SYX") and "S" in axes:
        raise InputError(
            str(path), f"a colour image: its colours lie in planes, axes {axes}", "save it as a grey image"
        )
    while len(shape) > 2 and shape[-1] == 1 and axes[-1] not in "XS":  # one value a pixel, behind the columns
        shape, axes = shape[:-1], axes[:-1]
    if len(shape) < 2 or 0 in shape:
        raise InputError(str(path), f"its shape {shape} is no image", _COPY)
    return int(np.prod(shape[:-2], dtype=int)), shape[-2], shape[-1]


def _check_page_chain(path: Path) -> None:
    """Follow the chain of page directories: of a truncated file tifffile returns the first pages without an error."""
    size = path.stat().st_size
    with path.open("rb") as file:
        order = {b"II": "<", b"MM": ">"}.get(file.read(2))
        if order is None or size < 8:
            raise InputError(str(path), "not a TIFF file: it does not begin with II or MM", _COPY)
        version = struct.unpack(order + "H", file.read(2))[0]
        if version not in (42, 43):
            raise InputError(str(path), f"not a TIFF file: version {version}", _COPY)
        big = version == 43
        count_format, tag_format, next_format = ("Q", "HHQQ", "Q") if big else ("H", "HHII", "I")
        tag_size = struct.calcsize("=" + tag_format)
        count_size, next_size = struct.calcsize(count_format), struct.calcsize(next_format)
        file.seek(8 if big else 4)
        visited: set[int] = set()
        offset = _unpacked(order + next_format, file.read(next_size), path)
        while offset and offset not in visited:
            visited.add(offset)
            file.seek(offset)
            tags = _unpacked(order + count_format, file.read(count_size), path)
            if len(visited) == 1:
                _check_tags(path, file.read(tags * tag_size), order + tag_format, size)
            file.seek(offset + count_size + tags * tag_size)
            offset = _unpacked(order + next_format, file.read(next_size), path)


def _check_tags(path: Path, tags: bytes, layout: str, size: int) -> None:
    """Refuse a file of ``size`` bytes, a tag of whose first page lies beyond its end, such as the description."""
    whole = len(tags) // struct.calcsize(layout) * struct.calcsize(layout)
    for code, kind, count, place in struct.iter_unpack(layout, tags[:whole]):
        length = count * _TYPE_BYTES.get(kind, 1)
        private = code >= _FIRST_PRIVATE_TAG and code not in _IMAGEJ_TAGS
        if not private and length > struct.calcsize(layout[0] + layout[-1]) and place + length > size:
            raise InputError(str(path), "truncated TIFF: what it tells of itself lies beyond its end", _COPY)


def _unpacked(layout: str, data: bytes, path: Path) -> int:
    if len(data) < struct.calcsize(layout):
        raise InputError(str(path), "truncated TIFF: a page lies beyond its end", _COPY)
    return int(struct.unpack(layout, data)[0])
