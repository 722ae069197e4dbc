"""Files that hold whole positions of source and panel in each view, with a reader a suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.scanners.astra_vectors import read_astra_vectors
from grainmotion.io.scanners.rtk import read_rtk
from grainmotion.io.scanners.rx_table import is_rx_table, read_rx_table
from grainmotion.io.scanners.view_panel import Panel
from grainmotion.model.geometry import VIEW_COLUMNS, Geometry


def _read_csv(path: Path, panel: Panel) -> Geometry:
    if is_rx_table(path):
        return read_rx_table(path).geometry(panel.shape)
    return read_geometry(path, panel.shape, panel.beam)


ViewReader = Callable[[Path, Panel], Geometry]
VIEW_READERS: Mapping[str, ViewReader] = MappingProxyType({
    ".csv": _read_csv, ".txt": _read_csv, ".npy": read_astra_vectors, ".geom": read_astra_vectors, ".xml": read_rtk,
})  # fmt: skip
"""Reader of the files with a suffix, in lower case."""
VIEW_KEYS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    ".npy": ("pixel_size",), ".geom": ("pixel_size",), ".xml": ("pixel_size", "first_row", "detector_offset"),
})  # fmt: skip
"""Keys of the experiment file, beside the file and its beam, that a reader uses; others tolerate pixels and rows."""
TOLERATED_KEYS = ("pixel_size", "first_row")


def view_file(path: Path) -> Geometry | None:
    """The views of a file of ASTRA's vectors or RTK's geometry, of pixels of 1 mm if it has none; None of others.

    A .npy file is one if it holds rows of 12 numbers, for which the beam is what they can be.
    """
    suffix = path.suffix.lower()
    if suffix not in (".npy", ".geom", ".xml") or (suffix == ".npy" and not _holds_vectors(path)):
        return None
    if suffix == ".xml":
        return read_rtk(path, Panel((1, 1), 1.0))
    try:
        return read_astra_vectors(path, Panel((1, 1)))
    except InputError:
        return read_astra_vectors(path, Panel((1, 1), beam="parallel"))


def _holds_vectors(path: Path) -> bool:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError):
        return False
    return array.dtype.kind == "f" and array.ndim == 2 and array.shape[1] == len(VIEW_COLUMNS)


def keys_beside_views(path: Path) -> tuple[str, ...]:
    """Keys of the experiment file that may stand beside a file of views."""
    return ("file", "beam", *VIEW_KEYS.get(path.suffix.lower(), TOLERATED_KEYS))
