"""Which reader a scanner's file needs, by its suffix and, where several formats share one, by its content."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from grainmotion.io.formats import HDF5, TXRM, family
from grainmotion.io.scanners.bruker import read_bruker_scan
from grainmotion.io.scanners.data_exchange import is_data_exchange, read_data_exchange
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.nikon import read_nikon_scan
from grainmotion.io.scanners.nsi import read_nsi_scan
from grainmotion.io.scanners.nxtomo import read_nxtomo_scan
from grainmotion.io.scanners.phoenix import read_phoenix_scan
from grainmotion.io.scanners.rx_solutions import read_rx_scan
from grainmotion.io.scanners.view_panel import Panel
from grainmotion.io.scanners.view_tables import VIEW_READERS
from grainmotion.io.scanners.zeiss import read_zeiss_scan
from grainmotion.model.geometry import Geometry


def _read_hdf5(path: Path) -> ScannerFile:
    """What a file of Data Exchange or NXtomo tells, by its groups."""
    return read_data_exchange(path) if is_data_exchange(path) else read_nxtomo_scan(path)


Reader = Callable[[Path], ScannerFile]
READERS: Mapping[str, Reader] = MappingProxyType({
    **dict.fromkeys(HDF5, _read_hdf5),
    **dict.fromkeys(TXRM, read_zeiss_scan),
    ".xtekct": read_nikon_scan,
    ".log": read_bruker_scan,
    ".pca": read_phoenix_scan,
    ".nsipro": read_nsi_scan,
})  # fmt: skip
"""Reader of the files with a suffix, in lower case."""
NAMED_READERS: Mapping[str, Reader] = MappingProxyType(
    {"unireconstruction.xml": read_rx_scan, "geom.csv": read_rx_scan}
)
"""Reader of files whose suffix other formats share, by their name in lower case."""


def is_scanner_file(name: str) -> bool:
    """Whether a path names a scanner's file, by its suffix or name; ``"file.h5::/path"`` names a dataset instead."""
    return "::" not in name and _reader(Path(name)) is not None


def scanner_files_beside(name: str, folder: Path) -> list[str]:
    """Paths from ``folder`` of scanners' files in the folder that images are, or lie in; not those that hold images."""
    place = folder / name
    place = place if place.is_dir() else place.parent
    if not place.is_dir():
        return []
    found = [p for p in sorted(place.iterdir()) if p.is_file() and is_scanner_file(p.name) and family(p) is None]
    return [p.relative_to(folder).as_posix() if p.is_relative_to(folder) else str(p) for p in found]


def is_described_elsewhere(path: Path) -> bool:
    """Whether a scanner's file is a part of what another one beside it describes."""
    return path.name.lower() == "geom.csv" and path.with_name("unireconstruction.xml").is_file()


def read_scanner_file(path: Path) -> ScannerFile:
    """What a scanner's file tells about its scan; `is_scanner_file` holds for it.

    A relative path starts at the working folder.  The images are named by absolute paths all the same, for they are
    looked up from the folder of the file later.
    """
    reader = _reader(path)
    assert reader is not None
    scan, here = reader(path), Path.cwd()
    radiographs, flats, darks = (
        tuple(str(here / spec) for spec in specs) for specs in (scan.radiographs, scan.flats, scan.darks)
    )
    return replace(scan, radiographs=radiographs, flats=flats, darks=darks)


def is_view_file(path: Path) -> bool:
    """Whether a file holds whole positions of source and panel in each view, by its suffix and content."""
    return _reader(path) is None or _rx_table_of(path) is not None


def _rx_table_of(path: Path) -> Path | None:
    """The table of views that a file of RX Solutions is, or that lies beside it."""
    table = path.with_name("geom.csv") if path.name.lower() == "unireconstruction.xml" else path
    return table if table.name.lower() == "geom.csv" and table.is_file() else None


def _reader(path: Path) -> Reader | None:
    """The reader of a file, by its name or suffix."""
    return NAMED_READERS.get(path.name.lower()) or READERS.get(path.suffix.lower())


def read_views(path: Path, panel: Panel) -> Geometry:
    """The views in a file for which `is_view_file` holds; an unknown suffix is taken for a CSV."""
    path = _rx_table_of(path) or path
    return VIEW_READERS.get(path.suffix.lower(), VIEW_READERS[".csv"])(path, panel)
