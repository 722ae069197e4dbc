"""Which reader a scanner's file needs, by its suffix and, where several formats share one, by its content."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from grainmotion.io.formats import HDF5
from grainmotion.io.scanners.bruker import read_bruker_scan
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.nikon import read_nikon_scan
from grainmotion.io.scanners.nxtomo import read_nxtomo_scan
from grainmotion.io.scanners.phoenix import read_phoenix_scan
from grainmotion.io.scanners.view_tables import VIEW_READERS, Panel
from grainmotion.model.geometry import Geometry

Reader = Callable[[Path], ScannerFile]
READERS: Mapping[str, Reader] = MappingProxyType({
    **{suffix: read_nxtomo_scan for suffix in HDF5},
    ".xtekct": read_nikon_scan,
    ".log": read_bruker_scan,
    ".pca": read_phoenix_scan,
})  # fmt: skip
"""Reader of the files with a suffix, in lower case."""


def is_scanner_file(name: str) -> bool:
    """Whether a path names a scanner's file, by its suffix; ``"file.h5::/path"`` names a dataset instead."""
    return "::" not in name and Path(name).suffix.lower() in READERS


def read_scanner_file(path: Path) -> ScannerFile:
    """What a scanner's file tells about its scan; `is_scanner_file` holds for it."""
    return READERS[path.suffix.lower()](path)


def is_view_file(path: Path) -> bool:
    """Whether a file holds whole positions of source and panel in each view, by its suffix and content."""
    return path.suffix.lower() not in READERS


def read_views(path: Path, panel: Panel) -> Geometry:
    """The views in a file for which `is_view_file` holds; an unknown suffix is taken for a CSV."""
    return VIEW_READERS.get(path.suffix.lower(), VIEW_READERS[".csv"])(path, panel)
