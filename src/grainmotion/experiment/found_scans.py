"""The scans in a folder: scanners' files with radiographs beside them or elsewhere, and bare series of images."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion.diagnosis.file_names import natural_order, stem
from grainmotion.errors import InputError
from grainmotion.experiment.folder_contents import FolderContents, ImageSet
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import ReferenceTable
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.stacks import find_stack
from grainmotion.model.geometry import Geometry

_ABSENT_KEY = re.compile(r"geometry\.(\w+): it is missing")


@dataclass(frozen=True, eq=False)
class FoundScan:
    """Radiographs of one state, as a folder holds them."""

    name: str  # for the state
    spec: str
    count: int  # radiographs; 0 if unknown
    file: ScannerFile | None = None  # of the scanner, if it is one
    described_by: str = ""  # path of the scanner's file, if the radiographs lie elsewhere

    @property
    def folder(self) -> Path:
        """Folder of the scan, from the folder that was looked into."""
        return Path(self.spec).parent


def missing_keys(contents: FolderContents, scan: FoundScan) -> list[str]:
    """Keys of the geometry without which the scan of a scanner's file cannot be used."""
    table = _table_of(scan)
    try:
        find_scan("reference", table, table, contents.path)
    except InputError as error:
        return list(dict.fromkeys(_ABSENT_KEY.findall(str(error))))
    return []


def lacks_open_beam(contents: FolderContents, scan: FoundScan) -> bool:
    """Whether the scanner's file tells neither flats nor the count of the open beam."""
    table = _table_of(scan)
    try:
        (count, rows, columns), _ = find_stack(list(_images_of(scan)), contents.path).info()
        find_scan("reference", table, table, contents.path, Geometry.parallel(np.zeros(count), (rows, columns), 1.0))
    except InputError as error:
        return error.where == "reference.flats"
    return False


def _images_of(scan: FoundScan) -> tuple[str, ...]:
    return (scan.spec,) if scan.file is None or scan.described_by else scan.file.radiographs


def _table_of(scan: FoundScan) -> ReferenceTable:
    return ReferenceTable(radiographs=[scan.spec], geometry=scan.described_by or None)


def found_scans(contents: FolderContents) -> list[FoundScan]:
    """All scans of the folder in the order of the numbers in their paths."""
    sets = [s for s in contents.of_role("radiographs") if not _is_beside_scan(contents, s)]
    scans = []
    for spec, file in contents.scans:
        if file.radiographs:
            scans.append(FoundScan(_name(spec), spec, _count(file), file))
            continue
        elsewhere = next((s for s in sets if s.shape[0] == _count(file)), None)
        if elsewhere is not None:
            sets.remove(elsewhere)
            scans.append(FoundScan(_name(spec), elsewhere.spec, elsewhere.shape[0], file, spec))
    scans += [FoundScan(_name(s.spec), s.spec, s.shape[0]) for s in sets]
    return [scans[k] for k in natural_order([scan.spec for scan in scans])]


def _is_beside_scan(contents: FolderContents, images: ImageSet) -> bool:
    """Whether images are previews or slices of a scanner's scan: beside its radiographs, named alike or single."""
    first = [Path(file.radiographs[0]) for _, file in contents.scans if file.radiographs]
    begins = [(path.parent, re.sub(r"[\d_ -]+$", "", path.stem)) for path in first]
    place = (contents.path / images.spec).absolute()
    single = images.shape[0] == 1
    return any(place.parent == folder and (single or (name and place.name.startswith(name))) for folder, name in begins)


def _count(file: ScannerFile) -> int:
    """Number of radiographs of a scanner's file."""
    if file.circle.angles_deg is not None:
        return len(file.circle.angles_deg)
    if file.views is not None:
        return len(file.views)
    try:
        return find_stack(list(file.radiographs), file.path.parent).info()[0][0] if file.radiographs else 0
    except InputError:
        return 0


def _name(spec: str) -> str:
    """A name for a state: that of its folder, or of its file."""
    folder = Path(spec).parent.name
    name = folder or re.sub(r"[_\-. ]*\*$", "", stem(Path(spec).name)) or "state"
    return re.sub(r'[/\\:*?"<>|\x00-\x1f]', "-", name).lstrip("_-. ") or "state"
