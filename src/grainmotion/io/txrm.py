"""Zeiss ``.txrm`` and ``.xrm``: images and numbers of an OLE compound file, read with ``olefile``.

Streams as public readers know them (dxchange, xrmreader, txrm2tiff): images are ``ImageData1/Image1`` to ``Image100``,
then ``ImageData2/Image101`` and so on, little-endian, without a header; the open beam is ``ReferenceData/Image`` or
``MultiReferenceData/Image1, ...``.  Row 0 is the lowest row of the image as Zeiss's own viewer shows it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float, Index, Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file

if TYPE_CHECKING:
    from olefile import OleFileIO

OPEN_BEAM = "ReferenceData"
"""Name of the images of the open beam: ``"scan.txrm::ReferenceData"``."""
_COPY_TXRM = "copy or export the file again"
_XRM_TYPES: Mapping[int, str] = MappingProxyType({3: "u1", 5: "<u2", 10: "<f4"})
_IMAGE_STREAM = re.compile(r"imagedata\d+/image(\d+)$")


@dataclass(frozen=True, eq=False)
class ImageStreams:
    """The images of one kind in a file.

    Attributes
    ----------
    names : tuple of str
        Their streams, in order.
    numbers : (n,) array of int
        Their numbers in the file, from 1; some are missing if the scan was stopped.
    shape : (int, int)
        Rows and columns.
    dtype : dtype
        Of the pixels.
    """

    names: tuple[str, ...]
    numbers: Index
    shape: tuple[int, int]
    dtype: np.dtype


@contextmanager
def opened_txrm(path: str | Path) -> Iterator[OleFileIO]:
    """A file open for reading; any failure of OLE becomes an `InputError` that names the file."""
    path = checked_file(path)
    try:
        import olefile
    except ImportError as error:
        fact = "files of Zeiss need the package olefile, which is not installed"
        raise InputError(str(path), fact, 'pip install "grainmotion[scanners]"') from error
    if not olefile.isOleFile(path):
        fact = "not a file of Zeiss: it is no OLE compound file"
        raise InputError(str(path), fact, "give the .txrm or .xrm file that the scanner wrote")
    try:
        with olefile.OleFileIO(path) as ole:
            yield ole
    except InputError:
        raise
    except (OSError, IndexError, ValueError, RecursionError) as error:
        raise InputError(str(path), f"truncated or damaged OLE file ({error})", _COPY_TXRM) from error


def numbers_of(ole: OleFileIO, name: str, kind: str = "<f4") -> Float | None:
    """All numbers in a stream; None if it is missing or empty."""
    if not ole.exists(name):
        return None
    data = ole.openstream(name).read()
    size = np.dtype(kind).itemsize
    values = np.frombuffer(data[: len(data) // size * size], kind).astype(float)
    return values if len(values) else None


def number_of(ole: OleFileIO, name: str, kind: str = "<f4") -> float | None:
    """The first number in a stream; None if it is missing, empty or no finite number."""
    values = numbers_of(ole, name, kind)
    return float(values[0]) if values is not None and np.isfinite(values[0]) else None


def texts_of(ole: OleFileIO, name: str) -> list[str]:
    """The texts in a stream, which are separated by bytes that are no letters."""
    if not ole.exists(name):
        return []
    return [text.decode("ascii").strip() for text in re.split(rb"[^\x20-\x7e]+", ole.openstream(name).read()) if text]


def image_streams(ole: OleFileIO, path: Path, inner: str | None = None) -> ImageStreams:
    """The radiographs of a file, or its images of the open beam if ``inner`` is ``"ReferenceData"``."""
    names = {"/".join(entry).lower(): "/".join(entry) for entry in ole.listdir()}
    if inner is None:
        found = {int(match[1]): names[name] for name in names if (match := _IMAGE_STREAM.match(name))}
        taken = number_of(ole, "ImageInfo/ImagesTaken", "<i4")
        found = {k: name for k, name in found.items() if not taken or k <= taken}
        info = "ImageInfo"
    elif inner.lower() != OPEN_BEAM.lower():
        raise InputError(f"{path}::{inner}", "there are no such images", f"'::{OPEN_BEAM}' are those of the open beam")
    elif "referencedata/image" in names:
        found, info = {1: names["referencedata/image"]}, "ReferenceData"
    else:
        pattern = re.compile(r"multireferencedata/image(\d+)$")
        found = {int(match[1]): names[name] for name in names if (match := pattern.match(name))}
        info = "MultiReferenceData"
    if not found:
        what = "radiograph" if inner is None else "image of the open beam"
        remedy = "give the .txrm or .xrm file of a scan" if inner is None else "give flats"
        raise InputError(str(path), f"it holds no {what}", remedy)
    kind, size = _told_type(ole, info), _told_size(ole, info)
    if size is None:
        raise InputError(str(path), "ImageInfo/ImageWidth and ImageHeight are missing or not positive", _COPY_TXRM)
    if kind not in _XRM_TYPES:
        fact = f"its pixels have the type {kind} (DataType), which is not known"
        raise InputError(str(path), fact, "export the scan as 16-bit TIFF with Zeiss's software")
    order, dtype = sorted(found), np.dtype(_XRM_TYPES[kind])
    _check_bytes(path, found[order[0]], ole.get_size(found[order[0]]), size, dtype)
    return ImageStreams(tuple(found[k] for k in order), np.array(order), size, dtype)


def txrm_info(path: Path, inner: str | None = None) -> tuple[tuple[int, int, int], np.dtype]:
    """Shape (images, rows, columns) and type of the pixels."""
    with opened_txrm(path) as ole:
        streams = image_streams(ole, path, inner)
    return (len(streams.names), *streams.shape), streams.dtype


def read_txrm(path: Path, inner: str | None = None, chosen: Index | None = None) -> Pixels:
    """Pixels ``(images, rows, columns)`` of all or of the chosen images; no others are read."""
    with opened_txrm(path) as ole:
        streams = image_streams(ole, path, inner)
        names = streams.names if chosen is None else [streams.names[int(k)] for k in chosen]
        images = np.empty((len(names), *streams.shape), streams.dtype)
        for image, name in zip(images, names, strict=True):
            data = ole.openstream(name).read()
            _check_bytes(path, name, len(data), streams.shape, streams.dtype)
            image[:] = np.frombuffer(data, streams.dtype).reshape(streams.shape)
    return images


def _check_bytes(path: Path, name: str, size: int, shape: tuple[int, int], dtype: np.dtype) -> None:
    """Refuse an image of another size than its pixels need."""
    needed = shape[0] * shape[1] * dtype.itemsize
    if size != needed:
        fact = f"{name} has {size} bytes, but {shape} pixels of {dtype} need {needed}"
        raise InputError(str(path), fact, _COPY_TXRM)


def _told_type(ole: OleFileIO, info: str) -> int:
    """DataType of images; those of the open beam have their own, else that of the radiographs."""
    for name in (f"{info}/DataType", f"{info}/ImageInfo/DataType", "ImageInfo/DataType"):
        if (kind := number_of(ole, name, "<i4")) is not None:
            return int(kind)
    return 0


def _told_size(ole: OleFileIO, info: str) -> tuple[int, int] | None:
    """Rows and columns of images; those of the open beam may have their own."""
    for place in (f"{info}/ImageInfo", "ImageInfo"):
        size = [number_of(ole, f"{place}/{name}", "<i4") for name in ("ImageHeight", "ImageWidth")]
        if size[0] and size[1] and min(size[0], size[1]) > 0:
            return int(size[0]), int(size[1])
    return None
